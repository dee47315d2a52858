//! Numbers as tables and plots print them.

use crate::findings::Factor;

/// Three significant digits of seconds, with the unit that fits.
pub fn seconds(value: f64) -> String {
    if value.is_infinite() {
        return NOT_REACHED.to_owned();
    }
    let (scaled, unit) = if value >= 0.999_5 {
        (value, "s")
    } else if value >= 0.999_5e-3 {
        (1e3 * value, "ms")
    } else {
        (1e6 * value, "µs")
    };
    format!("{} {unit}", significant(scaled, 3))
}

/// What stands for an infinite number.
pub const NOT_REACHED: &str = "not reached";

/// A number in plain notation, rounded to `digits` significant ones, whole from there on.
pub fn significant(value: f64, digits: i32) -> String {
    if value == 0.0 || !value.is_finite() {
        return format!("{value}");
    }
    // Rounded first: 9.96 has another decade than 10.0.
    let after_point = digits.max(1) as usize - 1;
    let rounded = format!("{value:.after_point$e}").parse().unwrap_or(value);
    let decade = libm::log10(rounded.abs()).floor() as i32;
    let places = (digits - 1 - decade).max(0) as usize;
    group(&format!("{value:.places$}"))
}

/// Commas between groups of three digits of the whole part.
pub fn group(text: &str) -> String {
    let (whole, rest) = text
        .split_once('.')
        .map_or((text, None), |(whole, rest)| (whole, Some(rest)));
    let mut grouped = String::new();
    for (place, digit) in whole.chars().enumerate() {
        let left = whole.len() - place;
        if place > 0 && left % 3 == 0 && digit.is_ascii_digit() && !grouped.ends_with('-') {
            grouped.push(',');
        }
        grouped.push(digit);
    }
    if let Some(rest) = rest {
        grouped.push('.');
        grouped.push_str(rest);
    }
    grouped
}

/// Two digits and a power of ten.
pub fn scientific(value: f64) -> String {
    if value == 0.0 {
        return "0".to_owned();
    }
    format!("{value:.1e}").replace('-', "−")
}

/// A share in percent, never rounded up to all.
pub fn percent(share: f64) -> String {
    let floored = (1e4 * share).floor() / 100.0;
    format!("{floored:.2} %")
}

/// A number of which two places after the point tell enough.
pub fn ratio(value: f64) -> String {
    match value {
        0.0 => "0".to_owned(),
        ..0.005 => "<0.01".to_owned(),
        ..9.995 => format!("{value:.2}"),
        ..99.95 => format!("{value:.1}"),
        _ => group(&format!("{value:.0}")),
    }
}

/// How many times, or at least how many.
pub fn times(factor: Factor) -> String {
    let sign = if factor.at_least { "≥ " } else { "" };
    format!("{sign}{} ×", significant(factor.times, 2))
}

/// A round number with a power of ten.
pub fn exact(value: f64) -> String {
    format!("{value:e}").replace('-', "−")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_read_well() {
        let all = [1.234_56e-5, 0.001_234, 0.999_9, 12.345, 1234.5].map(seconds);
        assert_eq!(all, ["12.3 µs", "1.23 ms", "1.00 s", "12.3 s", "1,234 s"]);
        assert_eq!(seconds(f64::INFINITY), NOT_REACHED);
        assert_eq!(significant(0.0, 2), "0");
        let ratios = [0.0, 1e-9, 0.005, 1.0, 9.996, 99.96, 1234.0].map(ratio);
        let expected = ["0", "<0.01", "0.01", "1.00", "10.0", "100", "1,234"];
        assert_eq!(ratios, expected);
        assert_eq!(group("-1234567.5"), "-1,234,567.5");
        assert_eq!(group("-123456"), "-123,456");
        assert_eq!(group("123"), "123");
        assert_eq!(scientific(1.26e-4), "1.3e−4");
        assert_eq!(percent(0.999_999), "99.99 %");
        assert_eq!(percent(1.0), "100.00 %");
        let factor = |times, at_least| Factor { times, at_least };
        assert_eq!(times(factor(1234.0, true)), "≥ 1,234 ×");
        assert_eq!(times(factor(3.21, false)), "3.2 ×");
        assert_eq!(exact(1e-3), "1e−3");
    }
}

//! Numbers as people read them.

/// Four significant digits, without zeros at the end; an exponent where the number is far from one.
pub fn significant(value: f64) -> String {
    let size = value.abs();
    if !value.is_finite() {
        return "–".to_owned();
    }
    if size != 0.0 && !(1e-3..1e6).contains(&size) {
        return format!("{value:.1e}").replace('-', "−");
    }
    let places = match size {
        size if size >= 1000.0 => 0,
        size if size >= 100.0 => 1,
        size if size >= 10.0 => 2,
        size if size >= 1.0 => 3,
        size if size >= 0.1 => 4,
        size if size >= 0.01 => 5,
        _ => 6,
    };
    let text = format!("{value:.places$}");
    let text = match text.contains('.') {
        true => text.trim_end_matches('0').trim_end_matches('.'),
        false => &text,
    };
    text.replace('-', "−")
}

/// A count with a space between thousands.
pub fn grouped(count: u64) -> String {
    let digits = count.to_string();
    let mut text = String::new();
    for (index, digit) in digits.chars().enumerate() {
        if index > 0 && (digits.len() - index).is_multiple_of(3) {
            text.push('\u{202f}');
        }
        text.push(digit);
    }
    text
}

/// Bytes in the largest unit that they fill.
pub fn bytes(count: u64) -> String {
    let units = [(1e12, "TB"), (1e9, "GB"), (1e6, "MB"), (1e3, "kB")];
    let count = count as f64;
    let unit = units.into_iter().find(|(size, _)| count >= *size);
    match unit {
        Some((size, unit)) => format!("{} {unit}", significant(count / size)),
        None => format!("{count} bytes"),
    }
}

/// A span of time as people say it.
pub fn span(seconds: f64) -> String {
    match seconds {
        seconds if seconds < 90.0 => format!("{seconds:.0} s"),
        seconds if seconds < 5_400.0 => format!("{:.0} min", seconds / 60.0),
        seconds if seconds < 172_800.0 => format!("{:.1} h", seconds / 3_600.0),
        seconds => format!("{:.1} days", seconds / 86_400.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_short_and_say_their_size() {
        for (value, text) in [
            (0.0, "0"),
            (1.0, "1"),
            (-12.345_67, "−12.35"),
            (0.123_456, "0.1235"),
            (0.001_235_6, "0.001236"),
            (1.234e-5, "1.2e−5"),
            (123_456.0, "123456"),
            (1.5e7, "1.5e7"),
            (f64::NAN, "–"),
        ] {
            assert_eq!(significant(value), text);
        }
        assert_eq!(grouped(0), "0");
        assert_eq!(grouped(1_234_567).replace('\u{202f}', " "), "1 234 567");
        assert_eq!(bytes(999), "999 bytes");
        assert_eq!(bytes(1_530_000_000), "1.53 GB");
    }

    #[test]
    fn spans_read_well() {
        for (seconds, text) in [
            (3.2, "3 s"),
            (600.0, "10 min"),
            (7_200.0, "2.0 h"),
            (1e6, "11.6 days"),
        ] {
            assert_eq!(span(seconds), text);
        }
    }
}

//! Statistics and their tail probabilities.

/// Pearson's statistic of counts that are expected to be equal.
pub fn chi_square(counts: &[u32]) -> f64 {
    let total: u32 = counts.iter().sum();
    let expected = f64::from(total) / counts.len() as f64;
    counts
        .iter()
        .map(|count| {
            let excess = f64::from(*count) - expected;
            excess * excess / expected
        })
        .sum()
}

/// The probability that chi-square with this many degrees of freedom is at least `statistic`: the
/// upper regularised gamma function, by its series below the mode and by Lentz's continued fraction
/// above (DLMF 8.7.1 and 8.9.2).
pub fn chi_square_tail(statistic: f64, degrees: u32) -> f64 {
    let (a, x) = (f64::from(degrees) / 2.0, statistic / 2.0);
    if x <= 0.0 {
        return 1.0;
    }
    let front = libm::exp(a * libm::log(x) - x - libm::lgamma(a));
    if x < a + 1.0 {
        let (mut term, mut sum, mut n) = (1.0 / a, 1.0 / a, a);
        while term > sum * f64::EPSILON {
            n += 1.0;
            term *= x / n;
            sum += term;
        }
        return 1.0 - front * sum;
    }
    let mut b = x + 1.0 - a;
    let (mut c, mut d) = (f64::INFINITY, 1.0 / b);
    let mut fraction = d;
    for i in 1..10_000 {
        let i = f64::from(i);
        let an = -i * (i - a);
        b += 2.0;
        d = 1.0 / (an * d + b);
        c = b + an / c;
        fraction *= c * d;
        if (c * d - 1.0).abs() < f64::EPSILON {
            break;
        }
    }
    front * fraction
}

/// The largest difference between the fractions of values below each x and x itself: the two-sided
/// statistic of Kolmogorov and Smirnov against the uniform distribution on 0 to 1.
pub fn kolmogorov_smirnov(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    let count = values.len() as f64;
    values
        .iter()
        .enumerate()
        .map(|(rank, value)| (value - rank as f64 / count).max((rank + 1) as f64 / count - value))
        .fold(0.0, f64::max)
}

/// The probability that the statistic of this many independent values is at least `statistic`:
/// Kolmogorov's limit with the correction for finite counts of Stephens (1970).
pub fn kolmogorov_smirnov_tail(statistic: f64, count: usize) -> f64 {
    let root = (count as f64).sqrt();
    let lambda = (root + 0.12 + 0.11 / root) * statistic;
    if lambda < 0.3 {
        // The series below converges slowly there, and the probability is 1 to nine digits.
        return 1.0;
    }
    let terms = (1..=100).map(|k| {
        let k = f64::from(k);
        let sign = if k % 2.0 == 1.0 { 2.0 } else { -2.0 };
        sign * libm::exp(-2.0 * k * k * lambda * lambda)
    });
    terms.sum::<f64>().clamp(0.0, 1.0)
}

/// The level of each of `tests` tests at which all together raise a false alarm at the given rate
/// (Sidak).
pub fn level_of_each(false_alarm_rate: f64, tests: usize) -> f64 {
    -libm::expm1(libm::log1p(-false_alarm_rate) / tests as f64)
}

#[test]
fn tails_are_those_of_tables() {
    // NIST's table of upper critical values.
    for (statistic, degrees, tail) in [
        (3.841, 1, 0.05),
        (18.307, 10, 0.05),
        (124.342, 100, 0.05),
        (61.918, 99, 0.999),
        (148.230, 99, 0.001),
    ] {
        let found = chi_square_tail(statistic, degrees);
        assert!((found / tail - 1.0).abs() < 2e-3, "{found} is not {tail}");
    }
    // Kolmogorov's limit: 1.3581 at 5 percent, 1.6276 at 1 percent.
    for (lambda, tail) in [(1.3581, 0.05), (1.6276, 0.01)] {
        let found = kolmogorov_smirnov_tail(lambda / 1000.0, 1_000_000);
        assert!((found / tail - 1.0).abs() < 2e-3, "{found} is not {tail}");
    }
    assert!((level_of_each(0.05, 2) - 0.025_320_565).abs() < 1e-8);
}

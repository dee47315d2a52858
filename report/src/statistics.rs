//! Order statistics, fitted slopes and histograms of what was measured.

/// The values in ascending order; infinities are allowed, NaN is not.
pub fn sorted(values: impl IntoIterator<Item = f64>) -> Vec<f64> {
    let mut values: Vec<f64> = values.into_iter().collect();
    values.sort_unstable_by(f64::total_cmp);
    values
}

/// The quantile `share`, 0 to 1, of values in ascending order, interpolated between neighbours;
/// `None` without values.
pub fn quantile(ascending: &[f64], share: f64) -> Option<f64> {
    let last = ascending.len().checked_sub(1)?;
    let place = share.clamp(0.0, 1.0) * last as f64;
    let below = place.floor() as usize;
    let (low, high) = (ascending[below], ascending[(below + 1).min(last)]);
    let part = place - below as f64;
    // An infinite neighbour of no weight must not turn the sum into NaN.
    Some(if part == 0.0 || low == high {
        low
    } else {
        low + part * (high - low)
    })
}

/// Three quantiles of values in any order.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spread {
    /// The lower one.
    pub low: f64,
    /// The median.
    pub median: f64,
    /// The upper one.
    pub high: f64,
}

impl Spread {
    /// The median, and the quantiles `share` and `1 - share`; `None` without values.
    pub fn new(values: impl IntoIterator<Item = f64>, share: f64) -> Option<Self> {
        let ascending = sorted(values);
        Some(Self {
            low: quantile(&ascending, share)?,
            median: quantile(&ascending, 0.5)?,
            high: quantile(&ascending, 1.0 - share)?,
        })
    }
}

/// The slope of the least-squares line through points; `None` for fewer than two abscissas.
pub fn slope(points: &[[f64; 2]]) -> Option<f64> {
    let count = points.len() as f64;
    let mean = |axis: usize| points.iter().map(|point| point[axis]).sum::<f64>() / count;
    let [x0, y0] = [mean(0), mean(1)];
    let squares: f64 = points.iter().map(|[x, _]| (x - x0) * (x - x0)).sum();
    let products: f64 = points.iter().map(|[x, y]| (x - x0) * (y - y0)).sum();
    (squares > 0.0).then(|| products / squares)
}

/// Counts of positive numbers over a wide range, by their logarithm.
#[derive(Clone, Debug, PartialEq)]
pub struct LogHistogram {
    counts: Vec<u64>,
    /// Numbers below the first bin, zeros among them.
    below: u64,
    /// Numbers beyond the last bin.
    above: u64,
}

impl LogHistogram {
    /// The decades covered: 10^-6 to 10^4.
    pub const DECADES: [i32; 2] = [-6, 4];
    /// Bins a decade.
    pub const BINS_A_DECADE: usize = 20;

    /// Nothing counted yet.
    pub fn new() -> Self {
        let [low, high] = Self::DECADES;
        Self {
            counts: vec![0; (high - low) as usize * Self::BINS_A_DECADE],
            below: 0,
            above: 0,
        }
    }

    /// Counts a number that is not negative; a bin holds its upper end.
    pub fn add(&mut self, value: f64) {
        let decades = libm::log10(value) - f64::from(Self::DECADES[0]);
        let place = (decades * Self::BINS_A_DECADE as f64).ceil() - 1.0;
        if value == 0.0 || place < 0.0 {
            self.below += 1;
        } else if place < self.counts.len() as f64 {
            self.counts[place as usize] += 1;
        } else {
            self.above += 1;
        }
    }

    /// Adds the counts of another.
    pub fn merge(&mut self, other: &Self) {
        self.below += other.below;
        self.above += other.above;
        for (count, other) in self.counts.iter_mut().zip(&other.counts) {
            *count += other;
        }
    }

    /// How many numbers were counted.
    pub fn total(&self) -> u64 {
        self.below + self.above + self.counts.iter().sum::<u64>()
    }

    /// The share of numbers up to each bin's upper end, with that end's decimal logarithm; empty
    /// where nothing was counted.
    pub fn cumulative(&self) -> Vec<(f64, f64)> {
        let total = self.total();
        if total == 0 {
            return Vec::new();
        }
        let mut sum = self.below;
        (1..)
            .zip(&self.counts)
            .map(|(bin, count)| {
                sum += count;
                let decade =
                    f64::from(Self::DECADES[0]) + f64::from(bin) / Self::BINS_A_DECADE as f64;
                (decade, sum as f64 / total as f64)
            })
            .collect()
    }
}

impl Default for LogHistogram {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_interpolate_and_bear_infinity() {
        let values = sorted([3.0, 1.0, 2.0, f64::INFINITY]);
        assert_eq!(quantile(&values, 0.0), Some(1.0));
        assert_eq!(quantile(&values, 0.5), Some(2.5));
        assert_eq!(quantile(&values, 2.0 / 3.0), Some(3.0));
        assert_eq!(quantile(&values, 0.9), Some(f64::INFINITY));
        assert_eq!(quantile(&[], 0.5), None);
        assert_eq!(quantile(&[f64::INFINITY; 2], 0.3), Some(f64::INFINITY));
        let spread = Spread::new((0..=10).map(f64::from), 0.1).unwrap();
        assert_eq!([spread.low, spread.median, spread.high], [1.0, 5.0, 9.0]);
        assert_eq!(Spread::new([], 0.1), None);
    }

    #[test]
    fn slopes_are_those_of_the_line() {
        let line: Vec<_> = (0..5).map(f64::from).map(|x| [x, 3.0 - 0.5 * x]).collect();
        assert_eq!(slope(&line), Some(-0.5));
        // Symmetric noise about the line leaves its slope.
        assert_eq!(
            slope(&[[0.0, 1.0], [0.0, -1.0], [2.0, 5.0], [2.0, 3.0]]),
            Some(2.0)
        );
        assert_eq!(slope(&[[1.0, 1.0], [1.0, 2.0]]), None);
        assert_eq!(slope(&[]), None);
    }

    #[test]
    fn histograms_count_everything_once() {
        let mut histogram = LogHistogram::new();
        for value in [0.0, 1e-9, 0.5, 1.0, 2.0, 1e9, f64::INFINITY] {
            histogram.add(value);
        }
        assert_eq!(histogram.total(), 7);
        let share = |decade: f64| {
            let cumulative = histogram.cumulative();
            let at = cumulative
                .iter()
                .find(|(end, _)| (end - decade).abs() < 1e-9);
            at.unwrap().1 * 7.0
        };
        assert_eq!(share(-5.0), 2.0);
        // One is counted up to one: a true error that equals its bound keeps it.
        assert_eq!(share(0.0).round(), 4.0);
        assert_eq!(share(1.0).round(), 5.0);
        assert_eq!(share(4.0).round(), 5.0);
        let mut twice = histogram.clone();
        twice.merge(&histogram);
        assert_eq!(twice.total(), 14);
        assert_eq!(twice.cumulative(), histogram.cumulative());
        assert_eq!(LogHistogram::new().cumulative(), []);
    }
}

//! Quantiles, and intervals by the bootstrap.

use crate::keystream::{Purpose, keystream};
use rand_distr::{Distribution, Uniform};

/// Samples that an interval is taken from.
pub const BOOTSTRAP_SAMPLES: usize = 2000;

/// Quartiles of a sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quartiles {
    /// A quarter is below.
    pub lower: f64,
    /// Half is below.
    pub median: f64,
    /// Three quarters are below.
    pub upper: f64,
}

/// The quantile at `fraction`, 0 to 1, between the two nearest of sorted values; NaN of none.
pub fn quantile(sorted: &[f64], fraction: f64) -> f64 {
    let Some(last) = sorted.len().checked_sub(1) else {
        return f64::NAN;
    };
    let place = fraction * last as f64;
    let below = place.floor() as usize;
    let above = (below + 1).min(last);
    sorted[below] + (sorted[above] - sorted[below]) * (place - below as f64)
}

/// The quartiles of values in any order.
pub fn quartiles(values: &[f64]) -> Quartiles {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    Quartiles {
        lower: quantile(&sorted, 0.25),
        median: quantile(&sorted, 0.5),
        upper: quantile(&sorted, 0.75),
    }
}

/// A figure with its 95 percent interval.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Interval {
    /// The figure.
    pub value: f64,
    /// 2.5 percent of bootstrap samples are below.
    pub low: f64,
    /// 2.5 percent of bootstrap samples are above.
    pub high: f64,
}

/// The median of paired ratios one/other, with the percentile interval over `BOOTSTRAP_SAMPLES`
/// samples of materials. Pairs of which one is 0 or not finite do not count.
pub fn median_ratio(one: &[f64], other: &[f64], seed: u64) -> Interval {
    let ratios: Vec<f64> = one
        .iter()
        .zip(other)
        .filter(|(one, other)| **one > 0.0 && **other > 0.0)
        .map(|(one, other)| one / other)
        .filter(|ratio| ratio.is_finite())
        .collect();
    let value = quartiles(&ratios).median;
    let Ok(places) = Uniform::new(0, ratios.len().max(1)) else {
        unreachable!("the range is not empty");
    };
    let mut rng = keystream(seed, Purpose::Bootstrap, 0);
    let mut medians: Vec<f64> = (0..BOOTSTRAP_SAMPLES)
        .filter(|_| !ratios.is_empty())
        .map(|_| {
            let mut sample: Vec<f64> = (0..ratios.len())
                .map(|_| ratios[places.sample(&mut rng)])
                .collect();
            let middle = sample.len() / 2;
            *sample.select_nth_unstable_by(middle, f64::total_cmp).1
        })
        .collect();
    medians.sort_by(f64::total_cmp);
    Interval {
        value,
        low: quantile(&medians, 0.025),
        high: quantile(&medians, 0.975),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_distr::StandardNormal;

    #[test]
    fn quantiles_lie_between_their_neighbours() {
        let values = [4.0, 1.0, 3.0, 2.0];
        let quartiles = quartiles(&values);
        assert_eq!(
            (quartiles.lower, quartiles.median, quartiles.upper),
            (1.75, 2.5, 3.25)
        );
        assert_eq!(quantile(&[7.0], 0.3), 7.0);
        assert!(quantile(&[], 0.5).is_nan());
    }

    #[test]
    fn intervals_of_the_median_ratio_hold_the_truth_as_often_as_they_say() {
        let mut rng = keystream(3, Purpose::Bootstrap, 1);
        let truth = 0.7;
        let trials = 200;
        let hits = (0..trials).filter(|&trial| {
            let one: Vec<f64> = (0..60)
                .map(|_| {
                    let noise: f64 = StandardNormal.sample(&mut rng);
                    truth * libm::exp(0.5 * noise)
                })
                .collect();
            let interval = median_ratio(&one, &[1.0; 60], trial);
            (interval.low..=interval.high).contains(&truth)
        });
        // 95 percent of 200 is 190; fewer than 180 come by chance once in a thousand.
        let hits = hits.count();
        assert!(hits >= 180, "{hits} of {trials}");
    }

    #[test]
    fn pairs_without_a_ratio_do_not_count() {
        let interval = median_ratio(&[1.0, 0.0, 2.0], &[2.0, 1.0, 0.0], 0);
        assert_eq!(
            (interval.value, interval.low, interval.high),
            (0.5, 0.5, 0.5)
        );
        assert!(median_ratio(&[], &[], 0).value.is_nan());
    }
}

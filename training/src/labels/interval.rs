//! A distribution over bins as an interval.

use super::BINS;
use super::reading::{argmax, circular_mean};

/// The interval, in bins, between whose ends the share `share` of a distribution lies, half of the
/// rest on either side. A bin's probability is spread evenly over it: bin b reaches from b - 0.5 to
/// b + 0.5.
///
/// On a circle the interval lies about the circular mean. An end may then be below -0.5 or above
/// 99.5, by less than a turn.
pub fn interval(distribution: &[f64; BINS], circular: bool, share: f64) -> [f64; 2] {
    let tail = 0.5 * (1.0 - share);
    if !circular {
        return [tail, 1.0 - tail].map(|level| quantile(distribution, level) - 0.5);
    }
    let mean = circular_mean(distribution).unwrap_or(argmax(distribution) as f64);
    // Turned so that the mean's bin is in the middle.
    let turn = mean.round() as usize % BINS;
    let half = BINS / 2;
    let turned = std::array::from_fn(|bin| distribution[(bin + turn + half) % BINS]);
    [tail, 1.0 - tail].map(|level| quantile(&turned, level) - 0.5 + turn as f64 - half as f64)
}

/// Where the sum of the probabilities reaches a level, in bins from the lower end of bin 0.
fn quantile(distribution: &[f64; BINS], level: f64) -> f64 {
    let mut below = 0.0;
    for (bin, &probability) in distribution.iter().enumerate() {
        if probability > 0.0 && below + probability >= level {
            return bin as f64 + ((level - below) / probability).clamp(0.0, 1.0);
        }
        below += probability;
    }
    BINS as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::labels::target::Smoothing;

    #[test]
    fn intervals_hold_their_share() {
        let even = [0.01; BINS];
        let [low, high] = interval(&even, false, 0.9);
        assert!((low - 4.5).abs() < 1e-9 && (high - 94.5).abs() < 1e-9);
        for centre in [0.0, 20.0, 50.3, 99.0] {
            let target = Smoothing::default().target(centre, false);
            let [low, high] = interval(&target, false, 0.95);
            assert!(low <= centre && centre <= high, "{low} to {high}");
            assert!(high - low < 13.0);
        }
        let mut one = [0.0; BINS];
        one[7] = 1.0;
        assert_eq!(interval(&one, false, 1.0), [6.5, 7.5]);
    }

    #[test]
    fn intervals_on_a_circle_cross_its_ends() {
        let target = Smoothing::default().target(99.0, true);
        let [low, high] = interval(&target, true, 0.95);
        // 1.96 standard deviations of three bins.
        assert!(
            (low - 93.1).abs() < 0.2 && (high - 104.9).abs() < 0.2,
            "{low} to {high}"
        );
        let target = Smoothing::default().target(0.0, true);
        let [low, high] = interval(&target, true, 0.95);
        assert!(
            (low + 5.9).abs() < 0.2 && (high - 5.9).abs() < 0.2,
            "{low} to {high}"
        );
    }
}

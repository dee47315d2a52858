//! A rendered film against a reference: errors in units that HDR images are compared in.

use crate::statistics::{LogHistogram, quantile, sorted};
use dataset::specification::Accuracy;
use renderer::film::{Film, FilmPixel, target};

/// The absolute part of a target over its relative part, in units of white: below this value a
/// pixel's error counts as a fraction of this and not of the pixel. So a relative error of at most
/// `accuracy.relative` is what the specification's two bounds together ask for.
pub const RELATIVE_FLOOR: f64 = 0.1;

/// Added to the reference's square below a squared difference, in units of white squared.
pub const RELATIVE_MSE_FLOOR: f64 = RELATIVE_FLOOR * RELATIVE_FLOOR;

/// Added to the sum below a difference in SMAPE, in units of white.
pub const SMAPE_FLOOR: f64 = 0.01;

/// How far a film is from its reference. Pixels on which both are exactly black, which neither
/// sample nor chart covers, are left out.
#[derive(Clone, Debug, PartialEq)]
pub struct Comparison {
    /// Pixels compared.
    pub pixels: usize,
    /// The reference's brightest channel, in units of white.
    pub reference_brightest: f64,
    /// Mean over pixels and channels of (v - r)^2 / (r^2 + [`RELATIVE_MSE_FLOOR`]).
    pub relative_mse: f64,
    /// Mean over pixels and channels of |v - r| / (|v| + |r| + [`SMAPE_FLOOR`]).
    pub smape: f64,
    /// Mean over pixels and channels of v - r, in units of white.
    pub mean_difference: f64,
    /// Mean over pixels of the relative error.
    pub mean_relative_error: f64,
    /// Its 95th percentile over pixels.
    pub p95_relative_error: f64,
    /// Mean over pixels of the stated error, as a fraction of the same.
    pub stated_mean_relative_error: f64,
    /// Its 95th percentile.
    pub stated_p95_relative_error: f64,
    /// The 95th percentile of the reference's stated error, as a fraction of the same: what is
    /// smaller cannot be measured.
    pub reference_p95_relative_error: f64,
    /// Share of pixels that lie within the stated error, widened by the reference's.
    pub within_bound: f64,
    /// Share of pixels that meet the target.
    pub within_target: f64,
    /// True error over the stated one, widened by the reference's, of every pixel with either.
    pub ratios: LogHistogram,
}

/// The largest difference of a channel.
fn difference(pixel: &FilmPixel, reference: &FilmPixel) -> f64 {
    pixel
        .value
        .iter()
        .zip(reference.value)
        .fold(0.0, |largest, (value, expected)| {
            largest.max((value - expected).abs())
        })
}

/// What a relative error is a fraction of.
fn scale(reference: &FilmPixel) -> f64 {
    reference
        .value
        .iter()
        .fold(RELATIVE_FLOOR, |a, &b| a.max(b))
}

/// Compares `film` with `reference`, which has its size; `accuracy` is the target.
pub fn compare(film: &Film, reference: &Film, accuracy: &Accuracy) -> Comparison {
    let nothing = FilmPixel::default();
    let pairs: Vec<_> = film
        .pixels
        .iter()
        .zip(&reference.pixels)
        .filter(|&(&pixel, &expected)| pixel != nothing || expected != nothing)
        .collect();
    let count = pairs.len() as f64;
    let share = |number: usize| match pairs.len() {
        0 => 1.0,
        _ => number as f64 / count,
    };
    let over_pixels = |of: &dyn Fn(&FilmPixel, &FilmPixel) -> f64| {
        let values = sorted(
            pairs
                .iter()
                .map(|(pixel, expected)| of(pixel, expected) / scale(expected)),
        );
        let mean = match values.len() {
            0 => 0.0,
            _ => values.iter().sum::<f64>() / count,
        };
        (mean, quantile(&values, 0.95).unwrap_or(0.0))
    };
    let (mean_relative_error, p95_relative_error) = over_pixels(&difference);
    let (stated_mean_relative_error, stated_p95_relative_error) =
        over_pixels(&|pixel, _| pixel.error);
    let (_, reference_p95_relative_error) = over_pixels(&|_, expected| expected.error);

    let mut comparison = Comparison {
        pixels: pairs.len(),
        reference_brightest: reference
            .pixels
            .iter()
            .flat_map(|pixel| pixel.value)
            .fold(0.0, f64::max),
        relative_mse: 0.0,
        smape: 0.0,
        mean_difference: 0.0,
        mean_relative_error,
        p95_relative_error,
        stated_mean_relative_error,
        stated_p95_relative_error,
        reference_p95_relative_error,
        within_bound: 1.0,
        within_target: 1.0,
        ratios: LogHistogram::new(),
    };
    let (mut inside, mut good) = (0, 0);
    for (pixel, expected) in &pairs {
        for (v, r) in pixel.value.into_iter().zip(expected.value) {
            let off = v - r;
            comparison.relative_mse += off * off / (r * r + RELATIVE_MSE_FLOOR) / (3.0 * count);
            comparison.smape += off.abs() / (v.abs() + r.abs() + SMAPE_FLOOR) / (3.0 * count);
            comparison.mean_difference += off / (3.0 * count);
        }
        let off = difference(pixel, expected);
        let bound = pixel.error + expected.error;
        inside += usize::from(off <= bound);
        good += usize::from(off <= target(accuracy, expected.value));
        if off > 0.0 || bound > 0.0 {
            // Over a bound of zero an error is infinitely many times what was stated.
            comparison.ratios.add(off / bound);
        }
    }
    comparison.within_bound = share(inside);
    comparison.within_target = share(good);
    comparison
}

#[cfg(test)]
mod tests {
    use super::*;

    const ACCURACY: Accuracy = Accuracy {
        absolute: 1e-4,
        relative: 1e-3,
    };

    fn film(pixels: &[(f64, f64)]) -> Film {
        Film {
            width: pixels.len() as u32,
            height: 1,
            pixels: pixels
                .iter()
                .map(|&(value, error)| FilmPixel {
                    value: [value, 0.5 * value, 0.0],
                    error,
                })
                .collect(),
        }
    }

    #[test]
    fn errors_are_those_worked_out_by_hand() {
        // Off by 0.002 of 2, within its bound; off by 0.001 of 0.01, beyond it; black.
        let rendered = film(&[(2.002, 0.003), (0.011, 0.0004), (0.0, 0.0)]);
        let reference = film(&[(2.0, 0.0), (0.01, 0.0001), (0.0, 0.0)]);
        let found = compare(&rendered, &reference, &ACCURACY);
        assert_eq!(found.pixels, 2);
        assert_eq!(found.reference_brightest, 2.0);
        let close = |a: f64, b: f64| assert!((a - b).abs() < 1e-12, "{a} against {b}");
        close(found.mean_relative_error, 0.5 * (0.001 + 0.01));
        close(found.p95_relative_error, 0.001 + 0.95 * 0.009);
        close(found.stated_mean_relative_error, 0.5 * (0.0015 + 0.004));
        close(found.reference_p95_relative_error, 0.95 * 0.001);
        close(found.mean_difference, (0.003 + 0.0015) / 6.0);
        let mse = 4e-6 / 4.01 + 1e-6 / 1.01 + 1e-6 / 0.0101 + 2.5e-7 / 0.010_025;
        close(found.relative_mse, mse / 6.0);
        let smape = 0.002 / 4.012 + 0.001 / 2.011 + 0.001 / 0.031 + 0.0005 / 0.0205;
        close(found.smape, smape / 6.0);
        close(found.within_bound, 0.5);
        close(found.within_target, 0.5);
        assert_eq!(found.ratios.total(), 2);
    }

    #[test]
    fn a_black_view_is_without_error() {
        let black = film(&[(0.0, 0.0); 4]);
        let found = compare(&black, &black, &ACCURACY);
        assert_eq!(found.pixels, 0);
        assert_eq!(found.within_bound, 1.0);
        assert_eq!(found.mean_relative_error, 0.0);
        assert_eq!(found.ratios.total(), 0);
    }

    #[test]
    fn an_error_over_a_bound_of_zero_is_beyond_it() {
        let found = compare(&film(&[(1.0, 0.0)]), &film(&[(1.5, 0.0)]), &ACCURACY);
        assert_eq!(found.within_bound, 0.0);
        assert_eq!(found.ratios.cumulative().last().unwrap().1, 0.0);
    }
}

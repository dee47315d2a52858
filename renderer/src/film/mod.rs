//! The film: pixel values with their estimated errors, and the rules that fill it.

pub(crate) mod canvas;
pub(crate) mod demand;
mod edge;
mod interval;
pub(crate) mod log_tile;
pub(crate) mod log_tiling;
pub(crate) mod outline;
mod pixel;
mod refine;
pub(crate) mod region;
pub(crate) mod tile_nodes;
pub(crate) mod tiling;

use dataset::{ErrorStatistics, specification::Accuracy};

/// A rendered image: radiance in units of white, linear Rec.709, row 0 at the top.
#[derive(Clone, Debug, PartialEq)]
pub struct Film {
    /// Pixels a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// `height * width` pixels, row by row.
    pub pixels: Vec<FilmPixel>,
}

/// A pixel's value and how far it may be off.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FilmPixel {
    /// Red, green and blue.
    pub value: [f64; 3],
    /// Half the width of the 95 percent interval of the channel with the widest.
    pub error: f64,
}

impl Film {
    /// The statistics of the estimated errors, for this many light paths and evaluations spent.
    pub fn statistics(
        &self,
        accuracy: &Accuracy,
        samples: u64,
        evaluations: u64,
    ) -> ErrorStatistics {
        let mut errors: Vec<f64> = self.pixels.iter().map(|pixel| pixel.error).collect();
        let count = errors.len();
        let mean = errors.iter().sum::<f64>() / count as f64;
        let at_95 = (count - 1) * 95 / 100;
        let (_, p95, above) = errors.select_nth_unstable_by(at_95, f64::total_cmp);
        let (p95, max) = (*p95, above.iter().fold(*p95, |max, error| max.max(*error)));
        let met = self
            .pixels
            .iter()
            .filter(|pixel| pixel.error <= target(accuracy, pixel.value))
            .count();
        ErrorStatistics {
            mean: stated(mean),
            p95: stated(p95),
            max: stated(max),
            within_target: met as f64 / count as f64,
            samples,
            evaluations,
        }
    }
}

/// An error as it is stated: one that is smaller than normal numbers, which not all readers of labels take, is
/// raised to the least of these.
fn stated(error: f64) -> f64 {
    if error > 0.0 {
        error.max(f64::MIN_POSITIVE)
    } else {
        error
    }
}

/// The error that `accuracy` allows a pixel of this value.
pub fn target(accuracy: &Accuracy, value: [f64; 3]) -> f64 {
    let largest = value[0].max(value[1]).max(value[2]);
    accuracy.absolute.max(accuracy.relative * largest)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Readers of JSON refuse numbers that are smaller than normal ones, and with them all labels.
    #[test]
    fn no_stated_error_is_smaller_than_normal_numbers() {
        let film = |error: f64| Film {
            width: 2,
            height: 1,
            pixels: [0.0, error]
                .map(|error| FilmPixel {
                    error,
                    ..FilmPixel::default()
                })
                .to_vec(),
        };
        let accuracy = Accuracy {
            absolute: 1e-3,
            relative: 1e-3,
        };
        let tiny = film(1.5e-315).statistics(&accuracy, 0, 0);
        assert!([tiny.mean, tiny.max].iter().all(|error| error.is_normal()));
        assert_eq!(tiny.p95, 0.0);
        let zero = film(0.0).statistics(&accuracy, 0, 0);
        assert_eq!([zero.mean, zero.p95, zero.max], [0.0; 3]);
    }
}

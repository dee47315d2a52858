//! The film: pixel values with their estimated errors, and the rules that fill it.

pub(crate) mod canvas;
pub(crate) mod demand;
pub(crate) mod log_tile;
pub(crate) mod log_tiling;
mod pixel;
mod refine;
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
        errors.sort_unstable_by(f64::total_cmp);
        let count = errors.len();
        let met = self
            .pixels
            .iter()
            .filter(|pixel| pixel.error <= target(accuracy, pixel.value))
            .count();
        ErrorStatistics {
            mean: errors.iter().sum::<f64>() / count as f64,
            p95: errors[(count - 1) * 95 / 100],
            max: errors[count - 1],
            within_target: met as f64 / count as f64,
            samples,
            evaluations,
        }
    }
}

/// The error that `accuracy` allows a pixel of this value.
pub fn target(accuracy: &Accuracy, value: [f64; 3]) -> f64 {
    let largest = value[0].max(value[1]).max(value[2]);
    accuracy.absolute.max(accuracy.relative * largest)
}

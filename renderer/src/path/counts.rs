//! How many paths each pixel of a curved sample gets, by the accuracy that is asked.
//!
//! Paths are cheap where light falls evenly, and many are needed where the bulb shows in the sample.
//! Pilots of four times as many paths each tell where the error is still too large. They are thrown
//! away: had a pixel stopped on the paths that told it to stop, those that happened to agree would
//! stop too early, and its interval would be too narrow.

use super::interval::REPLICATES;
use super::trace::{Picture, Spent, Traced, trace};
use super::{TracedFilm, Tracer};
use crate::film::{Film, target};
use dataset::specification::Accuracy;

/// From one pilot to the next: halves the error at least, that of independent samples.
const STEP: u32 = 4;

/// The share of the tolerance that a pilot's error has to meet. Errors are estimated from eight
/// replicates, and those of other paths are larger as often as not.
const MARGIN: f64 = 0.7;

/// Pixels begin with the specification's paths divided by this, and with no fewer than the fewest that know
/// their error.
const BEGIN_DIVISOR: u32 = 4;
const BEGIN_MIN: u32 = 2 * REPLICATES;

/// The most paths of one pixel, as a multiple of those that it begins with.
const PIXEL_TIMES_MAX: u32 = 4096;

/// The most that an image costs, all pilots included, as a multiple of the specification's paths: 1,536
/// a pixel where that says 64. At 128 x 128 pixels they take 10 to 20 s of a core.
const IMAGE_TIMES_MAX: f64 = 24.0;

/// Evaluations of the reflectance by cubature that take as long as a path, measured.
const EVALUATIONS_A_PATH: f64 = 20.0;

/// What tracing cost, in paths.
fn cost(spent: Spent) -> f64 {
    spent.paths as f64 + spent.evaluations as f64 / EVALUATIONS_A_PATH
}

/// What pilots found.
pub struct Counts {
    /// Paths of each pixel.
    pub of_pixels: Vec<u32>,
    /// What the pilots took.
    pub spent: Spent,
}

impl Counts {
    /// The same number for each pixel.
    pub fn even(pixels: usize, paths: u32) -> Self {
        Self {
            of_pixels: vec![paths; pixels],
            spent: Spent::default(),
        }
    }

    /// Traces all of a film by so many paths.
    pub fn trace(&self, tracer: &Tracer<'_>, picture: &Picture) -> TracedFilm {
        let mut known = Traced::nothing(picture.pixels(), tracer);
        let spent = trace(tracer, picture, 0, &mut known, |index| {
            self.of_pixels[index]
        });
        TracedFilm {
            film: Film {
                width: picture.width as u32,
                height: picture.height,
                pixels: known.finished(picture.width),
            },
            paths: self.spent.paths + spent.paths,
            evaluations: self.spent.evaluations + spent.evaluations,
        }
    }

    /// Takes from the pixels that have most until no more than `budget` is spent in all, by paths that
    /// cost `each`.
    fn within(mut self, budget: f64, each: f64) -> Self {
        let mut most = self.of_pixels.iter().copied().max().unwrap_or(0);
        let wanted = |most: u32| -> u64 {
            let paths = self.of_pixels.iter();
            paths.map(|paths| u64::from(*paths.min(&most))).sum()
        };
        let left = budget - cost(self.spent);
        while most > REPLICATES && wanted(most) as f64 * each > left {
            most /= 2;
        }
        for paths in &mut self.of_pixels {
            *paths = (*paths).min(most);
        }
        self
    }
}

/// Chooses how many paths each pixel gets, `samples` being the specification's.
pub fn choose(tracer: &Tracer<'_>, picture: &Picture, accuracy: &Accuracy, samples: u32) -> Counts {
    let count = picture.pixels();
    let budget = IMAGE_TIMES_MAX * f64::from(samples) * count as f64;
    let least = (samples / BEGIN_DIVISOR).max(BEGIN_MIN);
    let mut of_pixels = vec![least; count];
    let mut is_open = vec![true; count];
    let mut known = Traced::nothing(count, tracer);
    let mut spent = Spent::default();
    // What a path of the last pilot cost, for each of the pixels that it traced.
    let mut each = 0.0;
    for (pilot, times) in (1..).zip(powers()) {
        let paths = least * times;
        let first = pilot * REPLICATES;
        let of_pilot = trace(tracer, picture, first, &mut known, |index| {
            if is_open[index] { paths } else { 0 }
        });
        let traced = is_open.iter().filter(|open| **open).count();
        each = cost(of_pilot) / (traced as f64 * f64::from(paths));
        spent = spent + of_pilot;
        let so_far = known.so_far(picture.width);
        for index in 0..count {
            if !is_open[index] {
                continue;
            }
            let pixel = &so_far[index];
            let allowed = MARGIN * target(accuracy, pixel.value);
            is_open[index] = pixel.error > f64::from(STEP).sqrt() * allowed;
            of_pixels[index] = if pixel.error > allowed {
                paths * STEP
            } else {
                paths
            };
        }
        let open = is_open.iter().filter(|open| **open).count();
        let next = each * open as f64 * f64::from(paths * STEP);
        // What a pilot takes, the image takes again.
        if open == 0 || cost(spent) + 2.0 * next > budget || times * STEP >= PIXEL_TIMES_MAX {
            break;
        }
    }
    Counts { of_pixels, spent }.within(budget, each)
}

/// 1, 4, 16 and so on.
fn powers() -> impl Iterator<Item = u32> {
    std::iter::successors(Some(1), |times: &u32| times.checked_mul(STEP))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// The specification's paths are a power of two, and so are those of all pixels.
        #[test]
        fn the_dearest_pixels_give_way_first_and_keep_a_path_a_replicate(
            powers in prop::collection::vec(4..16u32, 1..40),
            [each, budget, spent] in [0.0..3.0f64, 0.0..7.0, 0.0..7.0].prop_map(|logs| logs.map(libm::exp10)),
        ) {
            let wanted: Vec<u32> = powers.into_iter().map(|power| 1 << power).collect();
            let spent = Spent { paths: spent as u64, evaluations: 0 };
            let counts = Counts { of_pixels: wanted.clone(), spent };
            let given = counts.within(budget, each).of_pixels;
            let left = budget - cost(spent);
            let takes = |paths: &[u32]| each * paths.iter().map(|&paths| f64::from(paths)).sum::<f64>();
            let most = given.iter().copied().max().expect("a pixel");
            for (given, wanted) in given.iter().zip(&wanted) {
                prop_assert_eq!(*given, *wanted.min(&most));
                prop_assert_eq!(given % REPLICATES, 0);
            }
            prop_assert!(most >= REPLICATES);
            prop_assert!(takes(&given) <= left || most == REPLICATES);
            let before: Vec<u32> = wanted.iter().map(|&paths| paths.min(2 * most)).collect();
            prop_assert!(before == given || takes(&before) > left);
        }
    }
}

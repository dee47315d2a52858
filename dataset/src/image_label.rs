//! What an image says of itself, and what is known of how it was made.

use crate::{Material, specification::Tint};
use serde::{Deserialize, Serialize};

/// The renderer's version: part of every image's bytes, raised whenever a change of the renderer
/// changes any of them. It stands here because a coordinator, which has no renderer, has to know
/// which workers it can accept.
pub const RENDERER_VERSION: &str = "31";

/// The name of the EXR attribute that holds an [`ImageHeader`] as canonical JSON.
pub const IMAGE_HEADER_ATTRIBUTE: &str = "brdfarm";

/// The identity of an image, embedded in its EXR file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ImageHeader {
    /// The specification's hash, 64 hexadecimal digits.
    pub specification: String,
    /// The specification's seed.
    pub seed: u64,
    /// The material's index in the set; absent for a material that was given by its numbers.
    pub material: Option<u32>,
    /// The view's index in the specification.
    pub view: u32,
    /// The ten parameters.
    pub parameters: Material,
    /// How the tint was formed.
    pub tint: Tint,
    /// [`RENDERER_VERSION`] of the renderer that made the image.
    pub renderer_version: String,
}

impl ImageHeader {
    /// The text in the file: JSON without white space, the fields in their order here.
    pub fn to_json(&self) -> String {
        serde_json::to_string(self)
            .unwrap_or_else(|_| unreachable!("numbers and texts under names are JSON"))
    }
}

/// The measured error and cost of one image. Everything here is as deterministic as the image;
/// seconds are kept apart from it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ErrorStatistics {
    /// Mean over pixels of the estimated error, the half width of the 95 percent interval of the
    /// worst channel, in units of white.
    pub mean: f64,
    /// 95th percentile over pixels of the same.
    pub p95: f64,
    /// Largest over pixels of the same.
    pub max: f64,
    /// The fraction of pixels whose estimated error meets the specification's accuracy.
    pub within_target: f64,
    /// Light paths traced from the camera, by the path tracer.
    pub samples: u64,
    /// Evaluations of the reflectance model, by the hybrid integrator.
    pub evaluations: u64,
}

/// The most light paths, or evaluations, of one image. At ten million a second that is a month of
/// one core.
pub const WORK_PER_IMAGE_MAX: u64 = 1 << 45;

impl ErrorStatistics {
    /// That the numbers can be those of an image: not negative, finite, a mean and a percentile below
    /// the largest, a share between 0 and 1, and work that somebody can have done. Says which is not.
    pub fn check(&self) -> Result<(), String> {
        let Self {
            mean,
            p95,
            max,
            within_target,
            samples,
            evaluations,
        } = *self;
        for (what, value) in [("mean", mean), ("95th percentile", p95), ("largest", max)] {
            // A mean of equal numbers may be rounded above them.
            if !value.is_finite() || !(0.0..=max * (1.0 + 1e-9)).contains(&value) {
                return Err(format!(
                    "an error whose {what} is {value} and whose largest is {max} cannot be"
                ));
            }
        }
        if !(0.0..=1.0).contains(&within_target) {
            return Err(format!("{within_target} is no share of the pixels"));
        }
        for (what, count) in [("paths", samples), ("evaluations", evaluations)] {
            if count > WORK_PER_IMAGE_MAX {
                return Err(format!(
                    "{count} {what} of one image are more than {WORK_PER_IMAGE_MAX}"
                ));
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn statistics_that_no_image_has_are_refused() {
        let honest = ErrorStatistics {
            mean: 1e-4,
            p95: 2e-4,
            max: 3e-4,
            within_target: 0.99,
            samples: 0,
            evaluations: 1_000_000,
        };
        let exact = ErrorStatistics {
            mean: 0.0,
            p95: 0.0,
            max: 0.0,
            within_target: 1.0,
            ..honest
        };
        assert_eq!(honest.check(), Ok(()));
        assert_eq!(exact.check(), Ok(()));
        let lies: [fn(&mut ErrorStatistics); 11] = [
            |lie| lie.mean = -1e-9,
            |lie| lie.mean = 4e-4,
            |lie| lie.mean = f64::NAN,
            |lie| lie.p95 = 3.1e-4,
            |lie| lie.p95 = f64::NAN,
            |lie| lie.max = f64::INFINITY,
            |lie| lie.max = f64::NAN,
            |lie| lie.within_target = 7.0,
            |lie| lie.within_target = f64::NAN,
            |lie| lie.samples = u64::MAX,
            |lie| lie.evaluations = u64::MAX,
        ];
        for lie in lies {
            let mut told = honest;
            lie(&mut told);
            assert!(told.check().is_err(), "{told:?}");
        }
    }
}

//! What an image says of itself, and what is known of how it was made.

use crate::{Material, specification::Tint};
use serde::{Deserialize, Serialize};

/// The renderer's version: part of every image's bytes, raised whenever a change of the renderer
/// changes any of them. It stands here because a coordinator, which has no renderer, has to know
/// which workers it can accept.
pub const RENDERER_VERSION: &str = "7";

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

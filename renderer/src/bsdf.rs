//! How a surface scatters: the sample's material or a patch of the chart.

use crate::reflectance::{DirectionSample, Reflectance};
use crate::vector::Vec3;
use crate::warp;
use std::f64::consts::FRAC_1_PI;

/// Scattering at a surface, in the frame of that surface (z its normal).
#[derive(Clone, Copy, Debug)]
pub enum Bsdf<'a> {
    /// The sample.
    Material(&'a Reflectance),
    /// A Lambertian patch of this reflectance, linear Rec.709.
    Diffuse([f64; 3]),
}

impl Bsdf<'_> {
    /// f(wi, wo), a steradian.
    pub fn evaluate(&self, wi: Vec3, wo: Vec3) -> [f64; 3] {
        match self {
            Self::Material(reflectance) => reflectance.evaluate(wi, wo),
            Self::Diffuse(_) if wi.z <= 0.0 || wo.z <= 0.0 => [0.0; 3],
            Self::Diffuse(colour) => colour.map(|channel| channel * FRAC_1_PI),
        }
    }

    /// A direction to the light, its weight f cos_i / density and its density.
    pub fn sample(&self, wo: Vec3, point: [f64; 2]) -> Option<DirectionSample> {
        match self {
            Self::Material(reflectance) => reflectance.sample(wo, point),
            Self::Diffuse(_) if wo.z <= 0.0 => None,
            Self::Diffuse(colour) => {
                let wi = warp::cosine_hemisphere(point);
                Some(DirectionSample {
                    wi,
                    weight: *colour,
                    density: warp::cosine_hemisphere_density(wi.z),
                })
            }
        }
    }

    /// The density of [`Bsdf::sample`], a steradian.
    pub fn density(&self, wi: Vec3, wo: Vec3) -> f64 {
        match self {
            Self::Material(reflectance) => reflectance.density(wi, wo),
            Self::Diffuse(_) => warp::cosine_hemisphere_density(wi.z),
        }
    }
}

//! A material: ten numbers.

use crate::specification::{Tint, limits};
use serde::{Deserialize, Serialize};
use std::ops::RangeInclusive;

/// A parameter outside the model's domain.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{parameter} is {value}, outside {low} to {high}")]
pub struct MaterialError {
    parameter: &'static str,
    value: f64,
    low: f64,
    high: f64,
}

/// A text that is no material.
#[derive(Debug, thiserror::Error)]
pub enum ReadMaterialError {
    /// It is no JSON, or has other fields.
    #[error(transparent)]
    Json(#[from] serde_json::Error),
    /// A parameter is outside the model's domain.
    #[error(transparent)]
    Parameter(#[from] MaterialError),
}

/// The ten parameters of the reflectance model (Vidaurre et al. 2019, section 3).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Material {
    /// R, percent, 0 to 100.
    pub roughness: f64,
    /// A, 0 to 1.
    pub anisotropy: f64,
    /// psi, degrees, 0 to 180, counter-clockwise from +x about the normal.
    pub angle_deg: f64,
    /// N_d, 1 to 10; the extinction coefficient is 0.
    pub ior: f64,
    /// Reflectance at 0 degrees, linear Rec.709, each channel 0 to 1.
    pub rgb0: [f64; 3],
    /// Reflectance at 90 degrees, linear Rec.709, each channel 0 to 1.
    pub rgb90: [f64; 3],
}

/// Up to this roughness R, percent, and under the tint `hue`, a common factor of both colours changes no
/// image, to the bit.
pub const HUE_ALONE_TO_PERCENT: f64 = 90.0;

impl Material {
    /// The same with both colours over the largest of their six channels where their common factor
    /// changes no image: what images can tell of the colours. Unchanged elsewhere, and where both
    /// colours are black.
    #[must_use]
    pub fn scaled(&self, tint: Tint) -> Self {
        let channels = self.rgb0.iter().chain(&self.rgb90);
        let largest = channels.copied().fold(0.0, f64::max);
        if tint != Tint::Hue || self.roughness > HUE_ALONE_TO_PERCENT || largest <= 0.0 {
            return *self;
        }
        Self {
            rgb0: self.rgb0.map(|channel| channel / largest),
            rgb90: self.rgb90.map(|channel| channel / largest),
            ..*self
        }
    }

    /// Reads a material as JSON: the fields of this type, all of them.
    ///
    /// # Errors
    /// When it is malformed or outside the model's domain.
    pub fn from_json(text: &[u8]) -> Result<Self, ReadMaterialError> {
        let material: Self = serde_json::from_slice(text)?;
        material.check()?;
        Ok(material)
    }

    /// Checks that every parameter lies in the model's domain.
    ///
    /// # Errors
    /// Names the first that does not.
    pub fn check(&self) -> Result<(), MaterialError> {
        const CHANNEL: RangeInclusive<f64> = 0.0..=1.0;
        let scalars = [
            ("roughness", self.roughness, limits::ROUGHNESS_PERCENT),
            ("anisotropy", self.anisotropy, limits::ANISOTROPY),
            ("angle_deg", self.angle_deg, limits::ANGLE_DEG),
            ("ior", self.ior, limits::IOR),
        ];
        let rgb0 = self.rgb0.map(|channel| ("rgb0", channel, CHANNEL));
        let rgb90 = self.rgb90.map(|channel| ("rgb90", channel, CHANNEL));
        for (parameter, value, range) in scalars.into_iter().chain(rgb0).chain(rgb90) {
            if !range.contains(&value) {
                return Err(MaterialError {
                    parameter,
                    value,
                    low: *range.start(),
                    high: *range.end(),
                });
            }
        }
        Ok(())
    }
}

//! A question about the reflectance model as one JSON object:
//!
//! ```json
//! {"material": {"roughness": 30, "anisotropy": 0.5, "angle_deg": 40, "ior": 2,
//!   "rgb0": [0.8, 0.5, 0.3], "rgb90": [1, 1, 1]},
//!  "wi": [0, 0.5, 0.5], "wo": [0, -0.5, 0.5], "tint": "hue"}
//! ```

use crate::{reflectance::Reflectance, vector::Vec3};
use dataset::{Material, MaterialError, specification::Tint};
use serde::Deserialize;
use thiserror::Error;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Query {
    material: Material,
    wi: [f64; 3],
    wo: [f64; 3],
    #[serde(default = "hue")]
    tint: Tint,
}

fn hue() -> Tint {
    Tint::Hue
}

/// A question without an answer.
#[derive(Debug, Error)]
pub enum QueryError {
    /// It is no JSON, or has other fields.
    #[error(transparent)]
    Json(#[from] serde_json::Error),
    /// A parameter is outside the model's domain.
    #[error(transparent)]
    Material(#[from] MaterialError),
    /// A direction leads nowhere.
    #[error("{0} has length zero")]
    Direction(&'static str),
    /// A component of a direction is no number.
    #[error("{0} is not finite")]
    NotFinite(&'static str),
}

/// The BRDF's value in linear Rec.709, 1/sr. The normal is +z; the directions' lengths do not
/// matter; `tint` is hue where it is left out.
///
/// # Errors
/// When the text is no question, or the material or a direction is none.
pub fn answer(text: &[u8]) -> Result<[f64; 3], QueryError> {
    let query: Query = serde_json::from_slice(text)?;
    query.material.check()?;
    let wi = direction("wi", query.wi)?;
    let wo = direction("wo", query.wo)?;
    Ok(Reflectance::new(&query.material, 0.0, query.tint).evaluate(wi, wo))
}

/// The unit vector along `components`, which are called `name`. They are divided by the largest first,
/// so that no square overflows.
///
/// # Errors
/// When all are zero, or one is not finite.
pub fn direction(name: &'static str, components: [f64; 3]) -> Result<Vec3, QueryError> {
    let [x, y, z] = components.map(f64::abs);
    let largest = x.max(y).max(z);
    if !(x + y + z).is_finite() && !components.iter().all(|component| component.is_finite()) {
        return Err(QueryError::NotFinite(name));
    }
    if largest == 0.0 {
        return Err(QueryError::Direction(name));
    }
    Ok(Vec3::from(components.map(|component| component / largest)).normalized())
}

//! The spherical emitter.

use crate::vector::Vec3;
use dataset::specification::Light;

/// The spherical emitter.
#[derive(Clone, Copy, Debug)]
pub struct Bulb {
    /// Its centre.
    pub centre: Vec3,
    /// Its radius.
    pub radius: f64,
    /// Its radiance. The irradiance at the origin is pi L (r/d)^2, so L = (d/r)^2 makes white 1.
    pub radiance: f64,
}

impl Bulb {
    /// The bulb with its centre at `centre`.
    pub(super) fn new(light: &Light, centre: Vec3) -> Self {
        let ratio = light.distance_m / light.radius_m;
        Self {
            centre,
            radius: light.radius_m,
            radiance: ratio * ratio,
        }
    }
}

//! The bulb's light off a point of the sample.

use super::bulb::{self, ScaledRadiance, SlopeBatch};
use super::bulb_view::BulbView;
use crate::film::log_tile::TintedLog;
use crate::numerics::instructions::Instructions;
use crate::numerics::tolerance::Tolerance;
use crate::reflectance::Reflectance;
use crate::reflectance::lobe::Lobe;
use crate::vector::Vec3;

/// A bulb that lights a material.
#[derive(Clone, Copy, Debug)]
pub struct BulbLight<'a> {
    /// The material.
    pub reflectance: &'a Reflectance,
    /// The bulb's radius, metres.
    pub radius: f64,
    /// The bulb's radiance, in units of white.
    pub radiance: f64,
    /// How exact the cubature is.
    pub tolerance: Tolerance,
    /// What works it out.
    pub instructions: Instructions,
}

impl BulbLight<'_> {
    /// The light toward `wo` from a bulb whose centre is `to_bulb` away, and evaluations spent. Both
    /// are in the frame of the surface, and all of the bulb is above it and nothing before it.
    pub fn toward(&self, wo: Vec3, to_bulb: Vec3, batch: &mut SlopeBatch) -> (TintedLog, u32) {
        let reflectance = self.reflectance;
        let view = bulb_view(&reflectance.lobe, wo, to_bulb, self.radius);
        let share = reflectance.specular_share;
        // The bulb stands above the horizon as a whole: its Lambertian light is a closed form.
        let diffuse = (1.0 - share) * view.sin2 * view.centre.z;
        let (specular, spent) = if share > 0.0 {
            let response = reflectance.tint_response(wo.z);
            bulb::specular(
                &view,
                reflectance,
                &response,
                self.tolerance,
                self.instructions,
                batch,
            )
        } else {
            (ScaledRadiance::NONE, 0)
        };
        // Where there is diffuse light the lobe is wide, and its logarithm small. Elsewhere the
        // factor may overflow.
        let diffuse = if share < 1.0 {
            diffuse * libm::exp(-specular.log)
        } else {
            0.0
        };
        let untinted = share * specular.untinted + diffuse;
        let tint = std::array::from_fn(|channel| {
            let part = share * specular.radiance[channel] + diffuse * reflectance.rgb0[channel];
            if untinted > 0.0 { part / untinted } else { 0.0 }
        });
        let log = libm::log(untinted.max(f64::MIN_POSITIVE) * self.radiance) + specular.log;
        (TintedLog { log, tint }, spent)
    }
}

/// The bulb and the viewer from a point of the sample.
pub(super) fn bulb_view(lobe: &Lobe, wo: Vec3, to_bulb: Vec3, radius: f64) -> BulbView {
    let distance = to_bulb.length();
    let sine = radius / distance;
    BulbView {
        wo: lobe.to_lobe(wo),
        centre: lobe.to_lobe(to_bulb * (1.0 / distance)),
        sin2: sine * sine,
    }
}

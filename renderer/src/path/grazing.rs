//! The bulb on the horizon of a curved glossy surface.
//!
//! Half of the directions are drawn over the bulb and half by the lobe, weighed by the balance heuristic (Veach and
//! Guibas 1995). Those below the horizon bring nothing. By the lobe, half vectors that see the bulb are drawn, as
//! elsewhere ([`super::glint`]). Where some of these are below the surface they fill no ellipse; there the surface's own
//! density draws directions.

use super::glint::Glint;
use crate::bsdf::Bsdf;
use crate::reflectance::Reflectance;
use crate::scene::Surface;
use crate::vector::Vec3;
use crate::warp::Cone;

/// The share of directions that are drawn over the bulb.
const OVER_BULB: f64 = 0.5;

/// A direction in the frame of the surface and its density, from a point of the open unit square;
/// `None` where it misses the bulb.
pub fn sample(
    surface: &Surface,
    reflectance: &Reflectance,
    cone: &Cone,
    wo: Vec3,
    [x, y]: [f64; 2],
) -> Option<(Vec3, f64)> {
    let bsdf = Bsdf::Material(reflectance);
    let axis = surface.frame.to_local(cone.axis());
    let glint = if wo.z + lowest(axis, cone.one_minus_cos_max()) > 0.0 {
        Glint::new(&reflectance.lobe, wo, axis, cone.one_minus_cos_max())
    } else {
        None
    };
    let wi = if x < OVER_BULB {
        surface.frame.to_local(cone.sample([x / OVER_BULB, y]))
    } else {
        let point = [(x - OVER_BULB) / (1.0 - OVER_BULB), y];
        match &glint {
            Some(glint) => glint.sample(point)?.wi,
            None => bsdf.sample(wo, point)?.wi,
        }
    };
    if !cone.holds(surface.frame.to_world(wi)) {
        return None;
    }
    let by_lobe = match &glint {
        Some(glint) => glint.density(wi),
        None => bsdf.density(wi, wo),
    };
    let density = OVER_BULB * cone.density() + (1.0 - OVER_BULB) * by_lobe;
    Some((wi, density))
}

/// The least height of unit directions within a cone about `axis`, one minus the cosine of whose half angle is
/// `narrow`.
fn lowest(axis: Vec3, narrow: f64) -> f64 {
    let sine = (narrow * (2.0 - narrow)).sqrt();
    axis.z * (1.0 - narrow) - (1.0 - axis.z * axis.z).max(0.0).sqrt() * sine
}

//! The bulb on the horizon of a curved glossy surface.
//!
//! Where part of the bulb is below the horizon, the half vectors that see the rest are no ellipse. Half
//! of the directions are drawn over the bulb and half by the surface, weighed by the balance heuristic
//! (Veach and Guibas 1995).

use crate::bsdf::Bsdf;
use crate::scene::Surface;
use crate::vector::Vec3;
use crate::warp::Cone;

/// The share of directions that are drawn over the bulb.
const OVER_BULB: f64 = 0.5;

/// A direction in the frame of the surface and its density, from a point of the open unit square;
/// `None` where it misses the bulb.
pub fn sample(
    surface: &Surface,
    bsdf: &Bsdf<'_>,
    cone: &Cone,
    wo: Vec3,
    [x, y]: [f64; 2],
) -> Option<(Vec3, f64)> {
    let wi = if x < OVER_BULB {
        surface.frame.to_local(cone.sample([x / OVER_BULB, y]))
    } else {
        let wi = bsdf
            .sample(wo, [(x - OVER_BULB) / (1.0 - OVER_BULB), y])?
            .wi;
        if !cone.holds(surface.frame.to_world(wi)) {
            return None;
        }
        wi
    };
    let density = OVER_BULB * cone.density() + (1.0 - OVER_BULB) * bsdf.density(wi, wo);
    Some((wi, density))
}

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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::path::glint::tests::{LOBES, grid};
    use dataset::{Material, specification::Tint};

    /// A bulb that the horizon cuts, and one just above it, by these directions and by ones over the bulb alone.
    #[test]
    fn directions_to_a_bulb_on_the_horizon_know_their_density() {
        let normal = Vec3::new(0.3, -0.4, 0.8).normalized();
        let surface = Surface::of_curved_sample(Vec3::new(0.1, 0.2, -0.1), normal);
        for (roughness, anisotropy) in LOBES {
            let material = Material {
                roughness,
                anisotropy,
                angle_deg: 35.0,
                ior: 1.5,
                rgb0: [0.5; 3],
                rgb90: [0.5; 3],
            };
            let reflectance = Reflectance::new(&material, 0.0, Tint::Product);
            for [elevation, viewer] in [[0.0, 0.2], [-0.05, 0.02], [0.08, 0.5], [0.15, 0.02]] {
                let centre = Vec3::new(0.2, 1.0, elevation);
                let to_bulb = surface.frame.to_world(centre);
                let cone = Cone::new(surface.position, surface.position + to_bulb, 0.1);
                let cone = cone.expect("outside");
                let wo = Vec3::new(0.1, -1.0, viewer).normalized();
                let light = |wi: Vec3| match wi.z > 0.0 {
                    true => reflectance.evaluate(wi, wo)[0] * wi.z,
                    false => 0.0,
                };
                let (mut found, mut expected) = (0.0, 0.0);
                for point in grid(600) {
                    if let Some((wi, density)) = sample(&surface, &reflectance, &cone, wo, point) {
                        found += light(wi) / density;
                    }
                    let wi = surface.frame.to_local(cone.sample(point));
                    expected += light(wi) / cone.density();
                }
                assert!(
                    (found / expected - 1.0).abs() < 0.01,
                    "{roughness} {elevation} {viewer}: {found} {expected}"
                );
            }
        }
    }

    #[test]
    fn no_direction_in_a_cone_is_lower_than_its_lowest() {
        for elevation in [-0.9, -0.3, 0.0, 0.2, 0.7, 0.95] {
            let across = (1.0f64 - elevation * elevation).sqrt();
            let axis = Vec3::new(0.6 * across, -0.8 * across, elevation);
            for radius in [0.001, 0.1, 0.2] {
                let cone = Cone::new(Vec3::default(), axis, radius).expect("outside");
                let lowest = lowest(axis, cone.one_minus_cos_max());
                let heights = grid(200).map(|point| cone.sample(point).z);
                let least = heights.fold(1.0, f64::min);
                assert!(lowest <= least + 1e-12, "{lowest} {least}");
                assert!(least - lowest < 0.02 * radius, "{lowest} {least}");
            }
        }
    }
}

//! Slopes of half vectors toward the bulb's edge.

use crate::reflectance::lobe::Lobe;
use crate::vector::Vec3;
use crate::warp::perpendiculars;
use std::f64::consts::PI;

/// Standard deviations of the lobe from its middle to the outline. Of a Gaussian in two dimensions
/// exp(-REACH^2/2), 4e-5, lies beyond.
pub const REACH: f64 = 4.5;

/// Directions to the bulb's edge that are looked at.
pub const SIDES: u32 = 256;

/// The slopes along the lobe's axes of half vectors between `wo` and the bulb's edge.
pub fn edge_slopes(
    wo: Vec3,
    to_bulb: Vec3,
    radius: f64,
    lobe: &Lobe,
) -> impl Iterator<Item = [f64; 2]> {
    let axis = to_bulb.normalized();
    let (x, y) = perpendiculars(axis);
    let tangent = radius / (to_bulb.length_squared() - radius * radius).sqrt();
    around().map(move |[cos, sin]| {
        let edge = (axis + x * (tangent * cos) + y * (tangent * sin)).normalized();
        let half = lobe.to_lobe(wo + edge);
        [half.x / half.z, half.y / half.z]
    })
}

/// The largest of them along each axis.
pub fn bulb_slopes(wo: Vec3, to_bulb: Vec3, radius: f64, lobe: &Lobe) -> [f64; 2] {
    let edge = edge_slopes(wo, to_bulb, radius, lobe);
    edge.fold([0.0; 2], |[u, v], [p, q]| [u.max(p.abs()), v.max(q.abs())])
}

/// Cosines and sines of angles all around.
pub fn around() -> impl Iterator<Item = [f64; 2]> {
    (0..SIDES).map(|side| {
        let (sin, cos) = libm::sincos(2.0 * PI * f64::from(side) / f64::from(SIDES));
        [cos, sin]
    })
}

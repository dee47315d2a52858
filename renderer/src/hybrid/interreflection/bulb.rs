//! The bulb in the frame of chart and sample.

use crate::vector::Vec3;

/// The bulb. Its disc of directions is mapped to from the unit disc by Lambert's azimuthal map, which keeps areas.
#[derive(Clone, Copy, Debug)]
pub struct Bulb {
    /// The centre in the frame.
    pub centre: Vec3,
    /// In metres.
    pub radius: f64,
    /// In units of white.
    pub radiance: f64,
    /// The world's x axis in the frame. No direction to the centre is parallel to it, because the
    /// specification keeps the bulb above the sample's plane.
    pub x_axis: [f64; 2],
}

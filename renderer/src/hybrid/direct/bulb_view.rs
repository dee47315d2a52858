//! The bulb as a point of the sample sees it.

use crate::vector::Vec3;

/// Directions at a point of the sample, in the lobe's frame.
#[derive(Clone, Copy, Debug)]
pub struct BulbView {
    /// To the viewer, unit.
    pub wo: Vec3,
    /// To the bulb's centre, unit.
    pub centre: Vec3,
    /// The squared sine of the bulb's half angle, (r/d)^2.
    pub sin2: f64,
}

impl BulbView {
    /// The least and the largest cosine of the light's direction on the bulb.
    pub fn cosines(&self) -> [f64; 2] {
        let Vec3 { x, y, z } = self.centre;
        let (sin, cos) = (self.sin2.sqrt(), (1.0 - self.sin2).sqrt());
        let (along, across) = (z * cos, (x * x + y * y).sqrt() * sin);
        // Where the bulb stands overhead the largest lies within it.
        let largest = if z >= cos { 1.0 } else { along + across };
        [along - across, largest]
    }
}

//! Orthonormal frames.

use crate::vector::Vec3;

/// A right-handed orthonormal frame, z the normal of a surface.
#[derive(Clone, Copy, Debug)]
pub struct Frame {
    /// Along the surface.
    pub x: Vec3,
    /// Along the surface, to the left of x as seen from the front.
    pub y: Vec3,
    /// The normal.
    pub z: Vec3,
}

/// Below this a normal's z is so near to -1 that their difference loses digits.
const NEARLY_DOWN: f64 = -1.0 + 1e-6;

impl Frame {
    /// The frame of the sample: the world's.
    pub(super) const WORLD: Self = Self {
        x: Vec3::new(1.0, 0.0, 0.0),
        y: Vec3::new(0.0, 1.0, 0.0),
        z: Vec3::new(0.0, 0.0, 1.0),
    };

    /// The world's frame, turned by the smallest rotation that takes +z to the unit vector `normal`.
    /// (Hughes and Moeller, "Building an Orthonormal Basis from a Unit Vector", 1999, have the rotation
    /// that is inverse to it.) Straight down, where there are many, it is turned about x.
    pub(super) fn carried(normal: Vec3) -> Self {
        let Vec3 { x, y, z } = normal;
        let mut scale = 1.0 / (1.0 + z);
        if z < NEARLY_DOWN {
            let beside = x * x + y * y;
            if beside < f64::MIN_POSITIVE {
                return Self {
                    x: Self::WORLD.x,
                    y: -Self::WORLD.y,
                    z: -Self::WORLD.z,
                };
            }
            // The sum above has lost its digits.
            scale = (1.0 - z) / beside;
        }
        let mixed = -x * y * scale;
        Self {
            x: Vec3::new(1.0 - x * x * scale, mixed, -x),
            y: Vec3::new(mixed, 1.0 - y * y * scale, -y),
            z: normal,
        }
    }

    /// A world direction in the frame.
    pub fn to_local(&self, v: Vec3) -> Vec3 {
        Vec3::new(self.x.dot(v), self.y.dot(v), self.z.dot(v))
    }

    /// A direction of the frame in the world.
    pub fn to_world(&self, v: Vec3) -> Vec3 {
        self.x * v.x + self.y * v.y + self.z * v.z
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Also where a normal points straight down, or nearly so.
    #[test]
    fn a_carried_frame_is_orthonormal_whatever_the_normal() {
        for tilt in [0.0, 1e-200, 1e-17, 1e-9, 1e-4, 0.3, 1.5, 3.0] {
            for turn in [0.0, 0.7, 2.0, 4.4] {
                let ((sin, cos), (sin_turn, cos_turn)) = (libm::sincos(tilt), libm::sincos(turn));
                for z in [cos, -cos] {
                    let normal = Vec3::new(sin * cos_turn, sin * sin_turn, z);
                    let Frame { x, y, z } = Frame::carried(normal);
                    assert!((z - normal).length() < 1e-12, "{normal:?}");
                    assert!((x.length() - 1.0).abs() < 1e-9, "{normal:?}: {x:?}");
                    assert!((x.cross(y) - z).length() < 1e-9, "{normal:?}: {x:?} {y:?}");
                }
            }
        }
    }
}

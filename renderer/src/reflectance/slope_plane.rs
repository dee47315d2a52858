//! The slope plane: half vectors h = (p, q, 1)/|.| in the frame of the lobe.

use super::lobe::Lobe;
use crate::vector::Vec3;

/// The slope plane of a viewer and a lobe.
#[derive(Clone, Copy, Debug)]
pub struct Slopes<'a> {
    /// To the viewer, unit, in the lobe's frame.
    pub wo: Vec3,
    /// The lobe.
    pub lobe: &'a Lobe,
}

impl<'a> Slopes<'a> {
    /// The plane for this viewer, a unit vector in the lobe's frame.
    pub fn new(wo: Vec3, lobe: &'a Lobe) -> Self {
        Self { wo, lobe }
    }

    /// The direction to the light for the half vector of slopes (p, q), in the lobe's frame.
    pub fn light(&self, p: f64, q: f64) -> Vec3 {
        let along = self.wo.x * p + self.wo.y * q + self.wo.z;
        let scale = 2.0 * along / (1.0 + p * p + q * q);
        Vec3::new(p * scale, q * scale, scale) - self.wo
    }

    /// The p on the line q at which the light's cosine is `cos_i`; both infinite where the line
    /// misses the circle.
    pub fn crossings_along(&self, q: f64, cos_i: f64) -> [f64; 2] {
        let swapped = Vec3::new(self.wo.y, self.wo.x, self.wo.z);
        crossings(&swapped, q, cos_i)
    }
}

/// The q on the line p at which the light's cosine is `cos_i` for a viewer `wo`, a circle of the plane; both
/// infinite where the line misses it. Without branches, for kernels.
#[inline(always)]
pub fn crossings(wo: &Vec3, p: f64, cos_i: f64) -> [f64; 2] {
    // 2 (wo_u p + wo_v q + wo_z) = (cos_i + wo_z)(1 + p^2 + q^2)
    let sum = cos_i + wo.z;
    let discriminant = wo.y * wo.y + sum * (wo.z - cos_i + p * (2.0 * wo.x - sum * p));
    let missed = discriminant <= 0.0;
    let root = if missed { 0.0 } else { discriminant }.sqrt();
    [-root, root].map(|root| {
        if missed {
            f64::INFINITY
        } else {
            (wo.y + root) / sum
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_light_has_its_cosine_at_the_crossings() {
        let lobe = Lobe::new(60.0, 0.4, 0.0);
        let slopes = Slopes::new(Vec3::new(0.3, -0.8, 0.52).normalized(), &lobe);
        for cos_i in [0.1, 0.5, 0.9, slopes.wo.z] {
            for q in crossings(&slopes.wo, 0.1, cos_i) {
                assert!(q.is_finite());
                assert!((slopes.light(0.1, q).z - cos_i).abs() < 1e-14);
                let [before, after] = [-1e-6, 1e-6].map(|step| slopes.light(0.1, q + step).z);
                assert_ne!(before > cos_i, after > cos_i);
            }
        }
        assert_eq!(crossings(&slopes.wo, 5.0, 0.99), [f64::INFINITY; 2]);
    }
}

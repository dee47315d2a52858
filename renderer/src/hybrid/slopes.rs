//! The slope plane: half vectors h = (p, q, 1)/|.| in the frame of the lobe.

use crate::reflectance::lobe::Lobe;
use crate::vector::Vec3;

/// Twice the logarithm of what the lobe falls to where it is left out: exp(-22) is 3e-10.
const CUT: f64 = 44.0;

/// The slope beyond which a lobe of exponent `n` is left out; infinite for one that never vanishes.
pub fn lobe_reach(n: f64) -> f64 {
    let exponent = CUT / n;
    if exponent > 600.0 {
        f64::INFINITY
    } else {
        libm::expm1(exponent).sqrt()
    }
}

/// Gauss points for an interval of so many lobe widths, `least` for a short one.
pub fn points(widths: f64, least: f64, density: f64) -> usize {
    ((least + 1.5 * widths.min(14.0)) * density).ceil() as usize
}

/// The slope plane of a viewer and a lobe.
#[derive(Clone, Copy, Debug)]
pub struct Slopes<'a> {
    /// To the viewer, unit, in the lobe's frame.
    pub wo: Vec3,
    /// The lobe.
    pub lobe: &'a Lobe,
}

/// What a half vector stands for.
#[derive(Clone, Copy, Debug)]
pub struct SlopePoint {
    /// Cosine of the light's direction.
    pub cos_i: f64,
    /// h_z^3: the slope plane's measure is that of half vectors over h_z^3.
    pub h_z3: f64,
    /// The logarithm of the lobe's power (n.h)^e.
    pub exponent: f64,
}

impl<'a> Slopes<'a> {
    /// The plane for this viewer, a unit vector in the lobe's frame.
    pub fn new(wo: Vec3, lobe: &'a Lobe) -> Self {
        Self { wo, lobe }
    }

    /// What (p, q) stands for.
    pub fn at(&self, p: f64, q: f64) -> SlopePoint {
        let (p2, q2) = (p * p, q * q);
        let t = p2 + q2;
        let inverse = 1.0 / (1.0 + t);
        let root = inverse.sqrt();
        let along = self.wo.x * p + self.wo.y * q + self.wo.z;
        // ln(1+t)/t, by its series where the quotient has no digits.
        let ratio = if t > 1e-12 {
            libm::log1p(t) / t
        } else {
            1.0 - 0.5 * t
        };
        SlopePoint {
            cos_i: 2.0 * along * inverse - self.wo.z,
            h_z3: inverse * root,
            exponent: -0.5 * (self.lobe.n_u * p2 + self.lobe.n_v * q2) * ratio,
        }
    }

    /// The direction to the light at (p, q), in the lobe's frame.
    pub fn light(&self, p: f64, q: f64, point: &SlopePoint) -> Vec3 {
        let scale = point.cos_i + self.wo.z;
        Vec3::new(p * scale, q * scale, scale) - self.wo
    }

    /// Where on the line p the light stands as high as the viewer, cut to [low, high], in order.
    /// cos_i = cos_o is the circle p wo_u + q wo_v = wo_z (p^2 + q^2).
    pub fn level_with_viewer(&self, p: f64, low: f64, high: f64) -> [f64; 2] {
        let wo = self.wo;
        let discriminant = wo.y * wo.y + 4.0 * wo.z * p * (wo.x - wo.z * p);
        if discriminant <= 0.0 {
            return [low; 2];
        }
        let root = discriminant.sqrt();
        [wo.y - root, wo.y + root].map(|sum| (sum / (2.0 * wo.z)).clamp(low, high))
    }

    /// Whether the light at (p, q) stands higher than the viewer.
    pub fn light_above_viewer(&self, p: f64, q: f64) -> bool {
        p * self.wo.x + q * self.wo.y > self.wo.z * (p * p + q * q)
    }
}

//! The anisotropic lobe: a density of half vectors about the normal.
//!
//! Ashikhmin and Shirley, "An Anisotropic Phong BRDF Model", 2000, with the exponents of Vidaurre
//! et al. 2019, equation 5. Exponents run from 1 to 1e9, where a power of the cosine is
//! meaningless (the cosine rounds to 1): everything here works on the tangential part of the half
//! vector.

use crate::vector::Vec3;
use std::f64::consts::PI;

/// The lobe of a material, in the frame of its surface (z the normal).
#[derive(Clone, Copy, Debug)]
pub struct Lobe {
    /// The exponent along the lobe's u axis.
    pub n_u: f64,
    /// The exponent along its v axis.
    pub n_v: f64,
    /// sqrt((n_u + 1)(n_v + 1)).
    pub normalization: f64,
    sin_psi: f64,
    cos_psi: f64,
}

impl Lobe {
    /// The lobe of `roughness` (0 to 100) and `anisotropy` (0 to 1), its u axis rotated
    /// counter-clockwise from +x by `angle_deg`. The printed exponents carry an erratum: n_v is
    /// (n_u^(-1/3) + A^3)^-3, which alone is isotropic at A = 0.
    pub fn new(roughness: f64, anisotropy: f64, angle_deg: f64) -> Self {
        let cubed_inverse = |base: f64| 1.0 / (base * base * base);
        let base = 0.001 + 0.00999 * roughness;
        let n_u = cubed_inverse(base);
        let n_v = cubed_inverse(base + anisotropy * anisotropy * anisotropy);
        let (sin_psi, cos_psi) = dataset::sin_cos_deg(angle_deg);
        Self {
            n_u,
            n_v,
            normalization: ((n_u + 1.0) * (n_v + 1.0)).sqrt(),
            sin_psi,
            cos_psi,
        }
    }

    /// A direction of the surface's frame in the lobe's, whose x is the lobe's u axis.
    pub fn to_lobe(&self, v: Vec3) -> Vec3 {
        Vec3::new(
            self.cos_psi * v.x + self.sin_psi * v.y,
            self.cos_psi * v.y - self.sin_psi * v.x,
            v.z,
        )
    }

    /// The inverse of [`Lobe::to_lobe`].
    pub fn to_surface(&self, v: Vec3) -> Vec3 {
        Vec3::new(
            self.cos_psi * v.x - self.sin_psi * v.y,
            self.sin_psi * v.x + self.cos_psi * v.y,
            v.z,
        )
    }

    /// (n.h)^e with e = (n_u h_u^2 + n_v h_v^2) / (h_u^2 + h_v^2), for a half vector of any
    /// positive length and h.z > 0. With t the squared tangent of h's polar angle it is
    /// exp(-e/2 log1p(t)): no cancellation near the normal, none at the horizon.
    pub fn power(&self, half: Vec3) -> f64 {
        let half = self.to_lobe(half);
        let (u2, v2) = (half.x * half.x, half.y * half.y);
        let tangential = u2 + v2;
        if tangential == 0.0 {
            return 1.0;
        }
        let exponent = (self.n_u * u2 + self.n_v * v2) / tangential;
        libm::exp(-0.5 * exponent * libm::log1p(tangential / (half.z * half.z)))
    }

    /// The density of [`Lobe::sample`] at a half vector, for each steradian of half vectors:
    /// sqrt((n_u+1)(n_v+1))/(2 pi) (n.h)^e. `half` as for [`Lobe::power`].
    pub fn density(&self, half: Vec3) -> f64 {
        self.normalization / (2.0 * PI) * self.power(half)
    }

    /// A unit half vector by the lobe's density, from a point of the open unit square:
    /// Ashikhmin and Shirley's equations 9 and 10, where the tangent of the azimuth is written as
    /// a quotient so that one formula serves all four quadrants and stays continuous over them.
    pub fn sample(&self, point: [f64; 2]) -> Vec3 {
        let (sin_turn, cos_turn) = libm::sincos(2.0 * PI * point[0]);
        let u = (self.n_v + 1.0).sqrt() * cos_turn;
        let v = (self.n_u + 1.0).sqrt() * sin_turn;
        let scale = 1.0 / (u * u + v * v).sqrt();
        let (cos_phi, sin_phi) = (u * scale, v * scale);
        let exponent = self.n_u * cos_phi * cos_phi + self.n_v * sin_phi * sin_phi;
        let log_cos = libm::log(point[1]) / (exponent + 1.0);
        let sin_theta = (-libm::expm1(2.0 * log_cos)).sqrt();
        let (h_u, h_v) = (sin_theta * cos_phi, sin_theta * sin_phi);
        self.to_surface(Vec3::new(h_u, h_v, libm::exp(log_cos)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exponents_span_one_to_a_billion() {
        let mirror = Lobe::new(0.0, 0.0, 0.0);
        assert!((mirror.n_u / 1e9 - 1.0).abs() < 1e-12 && mirror.n_u == mirror.n_v);
        let brushed = Lobe::new(0.0, 1.0, 0.0);
        assert!((brushed.n_v - 0.997_005_99).abs() < 1e-6);
        let rough = Lobe::new(100.0, 0.0, 0.0);
        assert!((rough.n_u - 1.0).abs() < 1e-12);
    }

    #[test]
    fn the_power_is_one_at_the_normal_and_does_not_know_the_length() {
        let lobe = Lobe::new(0.0, 1.0, 25.0);
        assert_eq!(lobe.power(Vec3::new(0.0, 0.0, 2.0)), 1.0);
        let half = Vec3::new(3e-5, -1e-5, 1.0);
        let ratio = lobe.power(half * 1e-3) / lobe.power(half);
        assert!((ratio - 1.0).abs() < 1e-12, "{ratio}");
    }

    #[test]
    fn half_a_turn_is_no_turn() {
        let half = Vec3::new(0.1, -0.3, 0.9);
        let at = |angle| Lobe::new(30.0, 0.7, angle).power(half);
        assert_eq!(at(0.0), at(180.0));
    }
}

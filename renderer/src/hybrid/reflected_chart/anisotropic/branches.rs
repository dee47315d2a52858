//! Where the integrand bends.

use super::conic::Conic;
use crate::reflectance::fresnel;
use crate::vector::Vec3;

/// Where the integrand bends: min(1, cos_i/cos_o) where light stands as high as the viewer, and the
/// tint at its knee.
pub struct Branches {
    /// Light as high as the viewer.
    even: Conic,
    /// Fresnel's reflectance at the knee; none where there is no such direction.
    knees: [Option<Conic>; 2],
    knee: f64,
    ior: f64,
}

impl Branches {
    pub fn new(wo: Vec3, knee: f64, ior: f64) -> Self {
        Self {
            even: Conic::level(wo.z, wo),
            knees: fresnel::cosines(knee, ior)
                .map(|cosine| (cosine <= 1.0).then(|| Conic::level(cosine, wo))),
            knee,
            ior,
        }
    }

    /// The curves at which the integrand bends.
    pub fn levels(&self) -> impl Iterator<Item = &Conic> {
        std::iter::once(&self.even).chain(self.knees.iter().flatten())
    }

    /// Whether light stands lower than the viewer at (p, q), and whether the tint is beyond its
    /// knee.
    #[inline(always)]
    pub fn at(&self, wo: Vec3, p: f64, q: f64) -> [bool; 2] {
        let low = self.even.value(p, q) < 0.0;
        if self.knee > 1.0 {
            return [low, false];
        }
        let cos_i = 2.0 * (wo.x * p + wo.y * q + wo.z) / (1.0 + p * p + q * q) - wo.z;
        let beyond = fresnel::reflectance(cos_i.max(0.0), self.ior) > self.knee;
        [low, beyond]
    }
}

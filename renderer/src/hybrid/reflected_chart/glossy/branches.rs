//! Where the integrand bends.

use super::conic::Conic;
use crate::reflectance::fresnel;
use crate::vector::Vec3;

/// Where the integrand bends: min(1, cos_i/cos_o) where light stands as high as the viewer, and the
/// tint at its knee.
pub struct Branches {
    /// Light as high as the viewer.
    pub(super) even: Conic,
    /// Fresnel's reflectance at the knee; none where there is no such direction.
    knees: [Option<Conic>; 2],
    pub(super) knee: f64,
    pub(super) ior: f64,
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

    /// Whether the tint has a knee.
    pub fn has_knee(&self) -> bool {
        self.knee <= 1.0
    }
}

//! The colour chart in a sample whose lobe is narrow along at least one axis.
//!
//! In the slope plane of half vectors (p, q) (see [`Slopes`](crate::reflectance::slope_plane::Slopes)) the edges of the chart's
//! patches are conics ([`conic`]). Along the lobe's narrow axis p the lobe is a normal density times
//! a factor that a few points tell, so a line of constant q is integrated in closed form piece by
//! piece between the edges it crosses ([`moments`]). The wide axis q is integrated by Gauss rules
//! between the places where that integral is not smooth: where an edge crosses the axis p = 0, where
//! a corner of a patch lies in the lobe, and where an edge that runs along p enters and leaves it.

mod branches;
mod conic;
mod line;
mod moments;
mod point;
mod wide_axis;

use crate::numerics::tolerance::Fineness;
use crate::reflectance::Reflectance;
use crate::vector::Vec3;
use line::add_lines;
pub use point::GlossyChart;
use point::Point;
pub use wide_axis::Scratch;

/// From this exponent along the narrow axis on, and from this ratio of the two exponents on, rules
/// along the lobe's axes take fewer evaluations than those along the chart's.
const NARROW_EXPONENT: f64 = 300.0;
const ANISOTROPY: f64 = 20.0;

/// Whether the chart in a sample of this material is worked out here.
pub fn wanted(reflectance: &Reflectance) -> bool {
    let lobe = &reflectance.lobe;
    reflectance.specular_share == 1.0
        && lobe.n_u > NARROW_EXPONENT
        && lobe.n_u > ANISOTROPY * lobe.n_v
}

impl GlossyChart<'_> {
    /// The chart's light off the sample at `position` toward `wo` (unit, the world's frame), in units
    /// of white, and how many evaluations it took.
    pub fn reflected(
        &self,
        position: Vec3,
        wo: Vec3,
        fineness: Fineness,
        scratch: &mut Scratch,
    ) -> ([f64; 3], u32) {
        let lobe = &self.reflectance.lobe;
        let response = self.reflectance.tint_response(wo.z);
        let point = Point::new(self, position, wo, response.knee, fineness);
        point.gather(scratch);
        let sums = add_lines(self.instructions, &point, &scratch.lines, &mut scratch.cuts);
        let scale = lobe.normalization / (2.0 * std::f64::consts::PI);
        let radiance = std::array::from_fn(|channel| {
            scale * response.at_moments(sums.fresnel[channel], sums.excess[channel])[channel]
        });
        (radiance, sums.evaluations)
    }
}

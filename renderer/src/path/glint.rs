//! The bulb in a glossy surface: half vectors that see the bulb, drawn by the lobe.
//!
//! A half vector is written by its slopes (h_u, h_v)/h_z in the frame of the lobe, in widths of the lobe:
//! so counted, the lobe is as good as round. Half vectors that turn a given viewer to the bulb fill an
//! ellipse. Its extent along its longer axis is sampled by the lobe, and then its chord there. So no sample
//! misses the bulb, and none finds the lobe by chance: neither a mirror, nor a highly anisotropic lobe, nor
//! a bulb that grazing light draws out makes rare events.

use super::slice::{Slice, nearest_to_zero};
use crate::reflectance::lobe::Lobe;
use crate::vector::Vec3;

/// A direction to the bulb, in the frame of the surface.
#[derive(Clone, Copy, Debug)]
pub struct GlintSample {
    /// Toward the bulb.
    pub wi: Vec3,
    /// The density of `wi`, a steradian.
    pub density: f64,
}

/// The half vectors that see the bulb, by slopes in widths of the lobe along and across its own axes:
/// with x and y their offsets from those of the bulb's centre,
/// a11 x^2 + 2 a12 x y + a22 y^2 - 2 (b1 x + b2 y) <= c.
/// Written about the slopes of the bulb's centre nothing cancels, however small the bulb.
#[derive(Clone, Copy, Debug)]
struct Ellipse {
    /// The slopes of a unit along the longer axis and across it.
    axes: [[f64; 2]; 2],
    centre: [f64; 2],
    a11: f64,
    a12: f64,
    a22: f64,
    b: [f64; 2],
    c: f64,
}

impl Ellipse {
    /// Of directions in the frame of the lobe, and its extent along its longer axis; `None` where rounding leaves none.
    fn of(lobe: &Lobe, wo: Vec3, centre: Vec3, narrow: f64) -> Option<(Self, [f64; 2])> {
        let widths = [lobe.n_u, lobe.n_v].map(|n| 1.0 / n.sqrt());
        let ellipse = Self::new(wo, centre, narrow, widths);
        let extent = ellipse.extent();
        let [low, high] = extent;
        (low < high && high - low < f64::INFINITY).then_some((ellipse, extent))
    }

    /// About the point of it that is nearest to the lobe's middle.
    fn nearest(&self, extent: [f64; 2]) -> [f64; 2] {
        let along = nearest_to_zero(extent);
        [along, nearest_to_zero(self.chord(along))]
    }

    /// From 2 (wo.h)(centre.h) >= (cos + wo.centre) h.h, at h = (p, q, 1); `narrow` is one minus the cosine of the
    /// bulb's half angle, and `widths` are those of the lobe.
    fn new(wo: Vec3, centre: Vec3, narrow: f64, widths: [f64; 2]) -> Self {
        let half = wo + centre;
        let base = 1.0 + wo.dot(centre) - narrow;
        let slopes = [half.x / half.z, half.y / half.z];
        let [p0, q0] = slopes;
        let by_slopes = [
            base - 2.0 * wo.x * centre.x,
            -(wo.x * centre.y + wo.y * centre.x),
            base - 2.0 * wo.y * centre.y,
        ];
        let product = |[p, q]: [f64; 2], [r, s]: [f64; 2]| {
            by_slopes[0] * p * r + by_slopes[1] * (p * s + q * r) + by_slopes[2] * q * s
        };
        let [across_u, across_v] = [[widths[0], 0.0], [0.0, widths[1]]];
        let [cos, sin] = longer_axis([
            product(across_u, across_u),
            product(across_u, across_v),
            product(across_v, across_v),
        ]);
        let axes = [[cos, sin], [-sin, cos]];
        let of_widths = |[u, v]: [f64; 2]| [u * widths[0], v * widths[1]];
        let unit = axes.map(of_widths);
        let along = |axis: [f64; 2]| axis[0] * p0 / widths[0] + axis[1] * q0 / widths[1];
        Self {
            axes: unit,
            centre: axes.map(along),
            a11: product(unit[0], unit[0]),
            a12: product(unit[0], unit[1]),
            a22: product(unit[1], unit[1]),
            b: unit.map(|[p, q]| narrow * (p0 * p + q0 * q)),
            c: narrow * (1.0 + p0 * p0 + q0 * q0),
        }
    }

    /// The slopes of a point.
    fn slopes(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let [along, across] = self.axes;
        [0, 1].map(|i| along[i] * x + across[i] * y)
    }

    /// The inverse of [`Ellipse::slopes`].
    fn coordinates(&self, [p, q]: [f64; 2], lobe: &Lobe) -> [f64; 2] {
        self.axes.map(|[u, v]| u * lobe.n_u * p + v * lobe.n_v * q)
    }

    /// The least and the largest coordinate along the longer axis.
    fn extent(&self) -> [f64; 2] {
        let determinant = self.a11 * self.a22 - self.a12 * self.a12;
        let [b1, b2] = self.b;
        let middle = self.a22 * b1 - self.a12 * b2;
        let root = (middle * middle + determinant * (b2 * b2 + self.a22 * self.c)).sqrt();
        [
            self.centre[0] + (middle - root) / determinant,
            self.centre[0] + (middle + root) / determinant,
        ]
    }

    /// The least and the largest coordinate across it, at one along it.
    fn chord(&self, along: f64) -> [f64; 2] {
        let x = along - self.centre[0];
        let b = self.b[1] - self.a12 * x;
        let c = self.c - x * (self.a11 * x - 2.0 * self.b[0]);
        let root = (b * b + self.a22 * c).max(0.0).sqrt();
        [
            self.centre[1] + (b - root) / self.a22,
            self.centre[1] + (b + root) / self.a22,
        ]
    }
}

/// The unit vector along the longer axis of an ellipse a11 x^2 + 2 a12 x y + a22 y^2 = 1.
fn longer_axis([a11, a12, a22]: [f64; 3]) -> [f64; 2] {
    let difference = 0.5 * (a11 - a22);
    let root = libm::hypot(difference, a12);
    // That of the lesser eigenvalue: of two forms of it the one in which nothing cancels.
    let [x, y] = if difference > 0.0 {
        [-a12, difference + root]
    } else {
        [root - difference, -a12]
    };
    let length = libm::hypot(x, y);
    if length > 0.0 {
        [x / length, y / length]
    } else {
        [1.0, 0.0]
    }
}

/// The directions to a bulb, drawn by the lobe.
#[derive(Clone, Copy, Debug)]
pub struct Glint<'a> {
    lobe: &'a Lobe,
    /// In the frame of the lobe.
    wo: Vec3,
    ellipse: Ellipse,
    /// Along the ellipse's longer axis.
    along: Slice,
    /// The squared slope of the point that is nearest to the lobe's centre.
    t: f64,
}

impl<'a> Glint<'a> {
    /// To a bulb toward `centre` (unit), one minus the cosine of whose half angle is `narrow`. All directions are in
    /// the frame of the surface; the bulb is above it, or at least all half vectors are. `None` where rounding leaves
    /// no ellipse.
    pub fn new(lobe: &'a Lobe, wo: Vec3, centre: Vec3, narrow: f64) -> Option<Self> {
        let (wo, centre) = (lobe.to_lobe(wo), lobe.to_lobe(centre));
        let (ellipse, extent) = Ellipse::of(lobe, wo, centre, narrow)?;
        let [p, q] = ellipse.slopes(ellipse.nearest(extent));
        let t = p * p + q * q;
        Some(Self {
            lobe,
            wo,
            ellipse,
            along: Slice::new(extent, 1.0, t),
            t,
        })
    }

    /// A direction, from a point of the open unit square; `None` where rounding leaves no chord.
    pub fn sample(&self, point: [f64; 2]) -> Option<GlintSample> {
        let (along, along_density) = self.along.sample(point[0]);
        let (across, across_density) = self.across(along)?.sample(point[1]);
        let density = along_density * across_density * (self.lobe.n_u * self.lobe.n_v).sqrt();
        let slopes = self.ellipse.slopes([along, across]);
        Some(reflected(self.lobe, self.wo, slopes, density))
    }

    /// The density of [`Glint::sample`] at a direction to the bulb, a steradian.
    pub fn density(&self, wi: Vec3) -> f64 {
        let half = (self.lobe.to_lobe(wi) + self.wo).normalized();
        let slopes = [half.x / half.z, half.y / half.z];
        let [along, across] = self.ellipse.coordinates(slopes, self.lobe);
        let of_chord = self
            .across(along)
            .map_or(0.0, |slice| slice.density(across));
        let density = self.along.density(along) * of_chord;
        density * (self.lobe.n_u * self.lobe.n_v).sqrt() * per_steradian(half, self.wo)
    }

    fn across(&self, along: f64) -> Option<Slice> {
        let chord = self.ellipse.chord(along);
        (chord[0] < chord[1]).then(|| Slice::new(chord, 1.0, self.t))
    }
}

/// About the direction to such a bulb from which the lobe turns most light to the viewer; `None` where rounding leaves
/// no ellipse.
pub fn brightest(lobe: &Lobe, wo: Vec3, centre: Vec3, narrow: f64) -> Option<Vec3> {
    let (wo, centre) = (lobe.to_lobe(wo), lobe.to_lobe(centre));
    let (ellipse, extent) = Ellipse::of(lobe, wo, centre, narrow)?;
    let slopes = ellipse.slopes(ellipse.nearest(extent));
    Some(reflected(lobe, wo, slopes, 1.0).wi)
}

/// The direction that a half vector of slopes `slopes`, drawn with `density`, turns the viewer to.
/// `wo` is in the frame of the lobe.
pub fn reflected(lobe: &Lobe, wo: Vec3, slopes: [f64; 2], density: f64) -> GlintSample {
    let half = Vec3::new(slopes[0], slopes[1], 1.0).normalized();
    let wi = half * (2.0 * half.dot(wo)) - wo;
    GlintSample {
        wi: lobe.to_surface(wi),
        density: density * per_steradian(half, wo),
    }
}

/// What a density of slopes is to be multiplied by to be one of directions: h_z^3 from slopes to
/// half vectors, 4 h.wo from those to directions.
pub fn per_steradian(half: Vec3, wo: Vec3) -> f64 {
    1.0 / (4.0 * half.dot(wo) * half.z * half.z * half.z)
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::warp::Cone;

    pub const WO: Vec3 = Vec3::new(0.28, -0.6, 0.75);
    pub const LOBES: [(f64, f64); 4] = [(60.0, 0.0), (30.0, 0.6), (20.0, 0.9), (95.0, 0.3)];

    /// The middles of the cells of the unit square.
    pub fn grid(side: u32) -> impl Iterator<Item = [f64; 2]> {
        (0..side * side).map(move |index| {
            [index % side, index / side].map(|k| (f64::from(k) + 0.5) / f64::from(side))
        })
    }

    /// The lobe's light by half vectors and by the cone that the bulb fills.
    #[test]
    fn half_vectors_and_the_cone_agree() {
        let wo = WO.normalized();
        for (roughness, anisotropy) in LOBES {
            let lobe = Lobe::new(roughness, anisotropy, 35.0);
            let centre = Vec3::new(-0.4, 0.9, 1.1);
            let cone = Cone::new(Vec3::default(), centre, 0.2).expect("outside");
            let narrow = cone.one_minus_cos_max();
            let side = 400;
            let (mut by_half, mut by_cone) = (0.0, 0.0);
            let glint = Glint::new(&lobe, wo, cone.axis(), narrow).expect("an ellipse");
            for point in grid(side) {
                let glint = glint.sample(point).expect("a chord");
                assert!(cone.axis().dot(glint.wi) >= 1.0 - narrow - 1e-12);
                by_half += lobe.power(glint.wi + wo) / glint.density;
                by_cone += lobe.power(cone.sample(point) + wo) / cone.density();
            }
            assert!(
                (by_half / by_cone - 1.0).abs() < 1e-3,
                "{by_half} {by_cone}"
            );
        }
    }

    /// Grazing light draws a bulb out to a thin ellipse of slopes across the lobe's axes. Sampled along those, a path
    /// carried up to 2.8 times the mean.
    #[test]
    fn a_bulb_drawn_out_by_grazing_light_makes_no_rare_events() {
        let elevation = 0.02f64;
        let wo = Vec3::new(0.0, -1.0, elevation).normalized();
        let mut worst = 0.0f64;
        for (angle_deg, roughness) in [(20.0, 0.0), (45.0, 0.0), (70.0, 0.5), (110.0, 1.0)] {
            let lobe = Lobe::new(roughness, 0.3, angle_deg);
            for off in [0.0, 1e-3, 3e-3, 6e-3] {
                let centre = Vec3::new(0.05 * off, 1.0, elevation + off).normalized();
                let narrow = 1e-6;
                let glint = Glint::new(&lobe, wo, centre, narrow).expect("an ellipse");
                let weights = grid(100).filter_map(|point| {
                    let glint = glint.sample(point)?;
                    Some(lobe.power(glint.wi + wo) / glint.density)
                });
                let weights: Vec<f64> = weights.collect();
                let mean = weights.iter().sum::<f64>() / weights.len() as f64;
                let most = weights.iter().copied().fold(0.0, f64::max);
                worst = worst.max(most / mean);
            }
        }
        assert!(worst < 2.2, "{worst}");
    }

    #[test]
    fn a_glint_knows_the_density_of_its_samples() {
        for (roughness, anisotropy) in LOBES.into_iter().chain([(0.0, 0.9), (3.0, 1.0)]) {
            let lobe = Lobe::new(roughness, anisotropy, 35.0);
            let centre = Vec3::new(-0.4, 0.9, 0.1).normalized();
            let glint = Glint::new(&lobe, WO.normalized(), centre, 0.02).expect("an ellipse");
            for point in grid(20) {
                let sample = glint.sample(point).expect("a chord");
                let ratio = glint.density(sample.wi) / sample.density;
                assert!((ratio - 1.0).abs() < 1e-6, "{ratio}");
            }
        }
    }
}

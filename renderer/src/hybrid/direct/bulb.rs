//! The bulb's light off the sample, by cubature in the slope plane.
//!
//! A half vector h is written by its slopes (p, q) = (h_u, h_v)/h_z in the frame of the lobe. The
//! BRDF's denominator cancels the Jacobian of wi -> h -> (p, q), and what is left of the radiance
//! toward the viewer is smooth and bounded:
//!
//! ```text
//! L = Le Int_E  N/(2 pi) tint(cos_i, cos_o) min(1, cos_i/cos_o) (1+t)^(-3/2) (1+t)^(-e/2)  dp dq
//! ```
//!
//! with t = p^2 + q^2, e = (n_u p^2 + n_v q^2)/t and N the lobe's normalization. E, the half
//! vectors that see the bulb, is an ellipse. The narrow axis of the lobe is integrated outside;
//! the other order loses digits.

use super::breaks::Breaks;
use super::bulb_view::BulbView;
use super::chords::{Angles, Chords, Depth, Disc, LEVELS, MORE_POINTS, Pieces, cut, part};
use crate::hybrid::budget::direct::{SEARCH_WIDTH, SMALL_BULB};
use crate::numerics::batch::{Batch, FOUR, LANES, total};
use crate::numerics::gauss::GaussRule;
use crate::numerics::instructions::{Instructions, kernel};
use crate::numerics::tolerance::{Tolerance, rounded_up};
use crate::reflectance::lobe::Lobe;
use crate::reflectance::slope_plane::Slopes;
use crate::reflectance::{Reflectance, TintResponse, fresnel, specular};
use crate::vector::Vec3;
use std::f64::consts::{FRAC_PI_2, PI};

impl BulbView {
    /// The middle of the half vectors that see the bulb, in slopes, and their half extents.
    pub fn slopes(&self) -> [[f64; 2]; 2] {
        let disc = Ellipse::new(self).disc();
        [[disc.p, disc.q], [disc.radius, disc.height()]]
    }

    /// How many widths of the lobe its middle lies outside the half vectors that see the bulb, near their outline. A
    /// lobe that is wide along q has its edge where none of its middle line sees the bulb.
    pub fn widths_outside(&self, lobe: &Lobe) -> f64 {
        let Disc {
            p,
            q,
            radius,
            slant,
            half_chord,
        } = Ellipse::new(self).disc();
        if lobe.n_v * half_chord * half_chord < WIDE {
            return (p.abs() - radius) * lobe.n_u.sqrt();
        }
        let x = -p / radius;
        let y = -(q + slant * x) / half_chord;
        let form = 0.5 * (x * x + y * y - 1.0);
        let along_p = (x + slant / half_chord * y) / (radius * lobe.n_u.sqrt());
        let along_q = y / (half_chord * lobe.n_v.sqrt());
        form / (along_p * along_p + along_q * along_q).sqrt()
    }
}

/// The half vectors that see the bulb: a11 x^2 + 2 a12 x y + a22 y^2 - 2 (b1 x + b2 y) <= c about
/// the slopes of the bulb's centre. Written about that centre nothing cancels, however small the
/// bulb.
struct Ellipse {
    centre: [f64; 2],
    a11: f64,
    a12: f64,
    a22: f64,
    b1: f64,
    b2: f64,
    c: f64,
}

impl Ellipse {
    fn new(view: &BulbView) -> Self {
        let BulbView { wo, centre, sin2 } = *view;
        // One minus the cosine of the half angle.
        let narrow = sin2 / (1.0 + (1.0 - sin2).sqrt());
        let half = wo + centre;
        let (p, q) = (half.x / half.z, half.y / half.z);
        let base = 1.0 + wo.dot(centre) - narrow;
        Self {
            centre: [p, q],
            a11: base - 2.0 * wo.x * centre.x,
            a12: -(wo.x * centre.y + wo.y * centre.x),
            a22: base - 2.0 * wo.y * centre.y,
            b1: narrow * p,
            b2: narrow * q,
            c: narrow * (1.0 + p * p + q * q),
        }
    }

    /// The middle of the least and largest x, and half their distance.
    fn extent(&self) -> [f64; 2] {
        let k2 = self.a11 * self.a22 - self.a12 * self.a12;
        let k1 = self.a22 * self.b1 - self.a12 * self.b2;
        let k0 = self.b2 * self.b2 + self.a22 * self.c;
        [k1 / k2, (k1 * k1 + k2 * k0).max(0.0).sqrt() / k2]
    }

    /// The least and largest y at x.
    fn chord(&self, x: f64) -> [f64; 2] {
        let b = self.b2 - self.a12 * x;
        let c = self.c - x * (self.a11 * x - 2.0 * self.b1);
        let root = (b * b + self.a22 * c).max(0.0).sqrt();
        [(b - root) / self.a22, (b + root) / self.a22]
    }

    /// Its chords.
    fn disc(&self) -> Disc {
        let [middle, radius] = self.extent();
        let [low, high] = self.chord(middle);
        let [p, q] = self.centre;
        Disc {
            p: p + middle,
            q: q + 0.5 * (low + high),
            radius,
            // Chords' midpoints lie on a line.
            slant: -self.a12 / self.a22 * radius,
            half_chord: 0.5 * (high - low),
        }
    }
}

/// A lobe is wide along q if the bulb is narrower than so many of its widths, squared. Chosen.
const WIDE: f64 = 1.0;

/// Over such a bulb the logarithm of the lobe changes by c: a rule of degree 5 misses this much of
/// its value, times c^6.
const DISC_ERROR: f64 = 5e-4;

/// Radon's rule of degree 5 on the unit disc: the centre with a weight of 1/4, and a hexagon of
/// radius sqrt(2/3), 1/8 each.
const HEXAGON: [[f64; 2]; 6] = {
    const RADIUS: f64 = 0.816_496_580_927_726;
    const ACROSS: f64 = 0.707_106_781_186_547_5;
    const ALONG: f64 = 0.5 * RADIUS;
    [
        [RADIUS, 0.0],
        [ALONG, ACROSS],
        [-ALONG, ACROSS],
        [-RADIUS, 0.0],
        [-ALONG, -ACROSS],
        [ALONG, -ACROSS],
    ]
};

/// Points of a cubature in the slope plane: p, q, the weight, and what is added to the lobe's
/// exponent.
pub type SlopeBatch = Batch<4>;

/// Points brighter than the factor by so much have not been the ones that it was taken from.
const BRIGHTER: f64 = 1e100;

/// Which of a point's numbers is added to the exponent.
const SHIFT: usize = 3;

kernel! {
    /// The integrals of the integrand without its tint, times Fresnel's reflectance, and times what
    /// that exceeds the tint's knee by.
    pub fn integrals(
        batch: &SlopeBatch,
        wo: Vec3,
        exponents: [f64; 2],
        ior: f64,
        knee: f64,
    ) -> [f64; 3] {
        let per_viewer = 1.0 / wo.z;
        let mut sums = [[0.0; LANES]; 3];
        for [p, q, weight, shift] in batch.blocks() {
            let mut terms = [[0.0; LANES]; 3];
            for i in 0..LANES {
                let slopes = [p[i], q[i]];
                let [value, cos_i] = specular::at_slopes(exponents, &wo, slopes, shift[i]);
                let shade = cos_i * per_viewer;
                let shade = if shade < 1.0 { shade } else { 1.0 };
                // A chord's end can lie on the horizon, and a rounding below it.
                let shade = if shade > 0.0 { shade } else { 0.0 };
                let value = weight[i] * shade * value;
                let [fresnel, beyond] = specular::fresnel_moments(cos_i, ior, knee);
                terms[0][i] = value;
                terms[1][i] = value * fresnel;
                terms[2][i] = value * beyond;
            }
            for (sum, term) in sums.iter_mut().zip(&terms) {
                for i in 0..LANES {
                    sum[i] += term[i];
                }
            }
        }
        sums.map(total)
    }
}

/// The specular light of a bulb of radiance 1 toward the viewer: `radiance`, and what it would be
/// with a tint of 1, both times exp(-`log`). Scaled like this neither underflows, however far the
/// bulb lies out in the lobe's tail.
#[derive(Clone, Copy, Debug)]
pub struct ScaledRadiance {
    /// In each channel.
    pub radiance: [f64; 3],
    /// Without the tint.
    pub untinted: f64,
    /// The logarithm of the common factor.
    pub log: f64,
}

impl ScaledRadiance {
    /// No light.
    pub const NONE: Self = Self {
        radiance: [0.0; 3],
        untinted: 0.0,
        log: 0.0,
    };
}

/// The specular light toward the viewer for a bulb of radiance 1, to the relative error that
/// `tolerance` names, and how many evaluations it took.
pub fn specular(
    view: &BulbView,
    reflectance: &Reflectance,
    response: &TintResponse,
    tolerance: Tolerance,
    instructions: Instructions,
    batch: &mut SlopeBatch,
) -> (ScaledRadiance, u32) {
    let lobe = &reflectance.lobe;
    batch.clear();
    let slopes = Slopes::new(view.wo, lobe);
    // min(1, cos_i/cos_o) bends, and so does the tint at its knee.
    let [first, second] = fresnel::cosines(response.knee, reflectance.ior);
    let mut cubature = Cubature {
        slopes,
        levels: [view.wo.z, first, second],
        view,
        tolerance,
        instructions,
        batch,
        log: 0.0,
    };
    cubature.fill(&Ellipse::new(view).disc());
    let mut log = cubature.log;
    let exponents = [lobe.n_u, lobe.n_v];
    let (ior, knee) = (reflectance.ior, response.knee);
    let of = |batch: &SlopeBatch| integrals(instructions, batch, view.wo, exponents, ior, knee);
    let [mut untinted, mut fresnel, mut excess] = of(batch);
    if untinted.is_nan() || untinted.abs() > BRIGHTER {
        // Far out in its tail a narrow lobe changes by more than numbers can over a bulb, and the factor was that of a
        // darker point.
        log = brightest(batch, lobe);
        batch.set(SHIFT, -log);
        [untinted, fresnel, excess] = of(batch);
    }
    let scale = lobe.normalization / (2.0 * PI);
    let radiance = response.at_moments(fresnel, excess);
    let scaled = ScaledRadiance {
        radiance: radiance.map(|channel| channel * scale),
        untinted: untinted * scale,
        log,
    };
    (scaled, batch.count() as u32)
}

/// The logarithm of the lobe where it is brightest of all points.
fn brightest(batch: &SlopeBatch, lobe: &Lobe) -> f64 {
    let logs = (0..batch.count()).map(|index| {
        let [p, q, ..] = batch.point(index);
        let (p2, q2) = (p * p, q * q);
        let t = p2 + q2;
        -0.5 * (lobe.n_u * p2 + lobe.n_v * q2) / (t + f64::MIN_POSITIVE) * libm::log1p(t)
    });
    logs.fold(f64::NEG_INFINITY, f64::max)
}

/// The logarithm that stands for no light.
const DARK_LOG: f64 = -1e10;

struct Cubature<'a> {
    slopes: Slopes<'a>,
    /// Cosines of the light's direction at which the integrand bends.
    levels: [f64; LEVELS],
    view: &'a BulbView,
    tolerance: Tolerance,
    instructions: Instructions,
    batch: &'a mut SlopeBatch,
    /// Minus the lobe's least exponent on the bulb: the batch's weights are for the integrand
    /// divided by exp(`log`).
    log: f64,
}

impl Cubature<'_> {
    fn fill(&mut self, disc: &Disc) {
        let lobe = self.slopes.lobe;
        // A bulb so small that rounding swallows it is not positive here.
        if disc.radius.is_nan() || disc.radius <= 0.0 {
            self.log = DARK_LOG;
            return;
        }
        let (radius, height) = (disc.radius, disc.height());
        let steep_p = lobe.n_u * disc.p.abs() + lobe.n_u.sqrt();
        let steep_q = lobe.n_v * disc.q.abs() + lobe.n_v.sqrt();
        let change = radius * steep_p + height * steep_q;
        let change2 = change * change;
        let missed = DISC_ERROR * change2 * change2 * change2;
        let [least, largest] = self.view.cosines();
        let bends = self
            .levels
            .iter()
            .any(|&level| least < level && level < largest);
        if radius.max(height) < SMALL_BULB && missed < self.tolerance.error() && !bends {
            self.add_disc(disc);
            return;
        }
        // ln(1 + t)/t is least where the bulb lies farthest out.
        let flatness = |p: f64, q: f64| {
            let t = p * p + q * q;
            if t > 0.0 { libm::log1p(t) / t } else { 1.0 }
        };
        let far = flatness(disc.p.abs() + radius, disc.q.abs() + height);
        let nearest = self.nearest(disc);
        let (least, p, q) = self.least_on_chord(disc, nearest);
        let flat = flatness(p, q);
        self.log = -least * flat;
        let fall = self.tolerance.fall();
        let widened = (least * (flat / far - 1.0)).min(fall);
        let depth = Depth {
            nearest,
            least,
            most: least + widened + fall / far,
        };
        let ends = [-FRAC_PI_2, FRAC_PI_2].map(|end| self.end(disc, end, depth));
        self.add_chords(disc, ends, depth, bends);
    }

    /// On the chord at an angle the least exponent, and where it is.
    fn least_on_chord(&self, disc: &Disc, angle: f64) -> (f64, f64, f64) {
        let lobe = self.slopes.lobe;
        let (sin, cos) = libm::sincos(angle);
        let p = disc.p + disc.radius * sin;
        let middle = disc.q + disc.slant * sin;
        let half = disc.half_chord * cos;
        let q = 0f64.clamp(middle - half, middle + half);
        (0.5 * (lobe.n_u * p * p + lobe.n_v * q * q), p, q)
    }

    /// How many widths of the lobe an angle of 1 moves a chord's ends at most.
    fn widths(&self, disc: &Disc) -> f64 {
        let lobe = self.slopes.lobe;
        disc.radius * lobe.n_u.sqrt() + disc.height() * lobe.n_v.sqrt()
    }

    /// The angle of the chord with the least exponent, a convex function of p.
    fn nearest(&self, disc: &Disc) -> f64 {
        let lobe = self.slopes.lobe;
        let widths = self.widths(disc);
        let (mut low, mut high) = (-FRAC_PI_2, FRAC_PI_2);
        while (high - low) * widths > SEARCH_WIDTH && high - low > f64::EPSILON {
            let angle = 0.5 * (low + high);
            let (sin, cos) = libm::sincos(angle);
            let p = disc.p + disc.radius * sin;
            let middle = disc.q + disc.slant * sin;
            let half = disc.half_chord * cos;
            // The end of the chord that is nearer, and how it moves.
            let (q, moves) = if middle > half {
                (middle - half, disc.slant * cos + disc.half_chord * sin)
            } else if middle < -half {
                (middle + half, disc.slant * cos - disc.half_chord * sin)
            } else {
                (0.0, 0.0)
            };
            if lobe.n_u * p * disc.radius * cos + lobe.n_v * q * moves > 0.0 {
                high = angle;
            } else {
                low = angle;
            }
        }
        0.5 * (low + high)
    }

    /// From the nearest chord toward `end`: the angle beyond which no exponent counts.
    fn end(&self, disc: &Disc, end: f64, depth: Depth) -> f64 {
        let Depth { nearest, most, .. } = depth;
        let (mut inside, mut outside) = (nearest, end);
        let reach = (2.0 * most / self.slopes.lobe.n_u).sqrt() * end.signum();
        let sine = ((reach - disc.p) / disc.radius).clamp(-1.0, 1.0);
        let clipped = libm::asin(sine);
        if (clipped - nearest) * end > 0.0 {
            outside = clipped;
        }
        let spare = most + 0.2 * (most - depth.least);
        if self.least_on_chord(disc, outside).0 <= spare {
            return outside;
        }
        let widths = self.widths(disc);
        while (outside - inside).abs() * widths > SEARCH_WIDTH
            && (outside - inside).abs() > 0.1 * (outside - nearest).abs()
        {
            let angle = 0.5 * (inside + outside);
            if self.least_on_chord(disc, angle).0 > most {
                outside = angle;
            } else {
                inside = angle;
            }
        }
        outside
    }

    /// All chords between two angles, in intervals on which their integrals are smooth.
    fn add_chords(&mut self, disc: &Disc, [low, high]: [f64; 2], depth: Depth, bends: bool) {
        let mut from = low;
        if bends {
            let breaks = Breaks::new(
                self.view,
                &self.slopes,
                disc,
                &self.levels,
                [low, high],
                depth,
            );
            for &angle in breaks.angles() {
                if from < angle {
                    self.add_chords_between(disc, [from, angle], depth, bends);
                    from = angle;
                }
            }
        }
        if from < high {
            self.add_chords_between(disc, [from, high], depth, bends);
        }
    }

    /// The chords of an interval: x = radius sin, so that the sum is smooth where they close.
    fn add_chords_between(
        &mut self,
        disc: &Disc,
        [low, high]: [f64; 2],
        depth: Depth,
        bends: bool,
    ) {
        let exponents = [low, high].map(|end| self.least_on_chord(disc, end).0);
        // The largest term lies inside, or at the end that is nearer.
        let least = if (low..=high).contains(&depth.nearest) {
            depth.least
        } else {
            exponents[0].min(exponents[1])
        };
        let falls = exponents.map(|exponent| (exponent - least).max(0.0));
        // The chords' lengths change like the cosine of the angle.
        let more = MORE_POINTS + (high - low) / PI * self.tolerance.more_on_disc();
        let tolerance = self.tolerance.after_fall(least - depth.least);
        let points = tolerance.points_for_fall(falls, more);
        let rule = GaussRule::of(points);
        let mut nodes = rule.on(low, high);
        for first in (0..rule.size()).step_by(LANES) {
            let count = LANES.min(rule.size() - first);
            let mut angles = Angles::default();
            for (lane, (node, weight)) in nodes.by_ref().take(count).enumerate() {
                (angles.sin[lane], angles.cos[lane]) = libm::sincos(node);
                angles.weight[lane] = weight;
            }
            self.add_block(disc, &angles, count, depth, bends);
        }
    }

    /// The first `count` of some chords.
    fn add_block(&mut self, disc: &Disc, angles: &Angles, count: usize, depth: Depth, bends: bool) {
        let exponents = [self.slopes.lobe.n_u, self.slopes.lobe.n_v];
        let chords = cut(
            self.instructions,
            angles,
            disc,
            exponents,
            depth,
            self.tolerance,
        );
        if !bends {
            for lane in 0..count {
                let ends = [chords.low[lane], chords.high[lane]];
                self.add_piece(&chords, lane, ends, chords.points[lane]);
            }
            return;
        }
        let Pieces { ends, points } = part(
            self.instructions,
            &chords,
            &self.slopes.wo,
            &self.levels,
            exponents,
            depth.least,
            self.tolerance,
        );
        for lane in 0..count {
            for (piece, points) in points.iter().enumerate() {
                let ends = [ends[piece][lane], ends[piece + 1][lane]];
                self.add_piece(&chords, lane, ends, points[lane]);
            }
        }
    }

    /// All of a bulb over which the lobe changes little.
    fn add_disc(&mut self, disc: &Disc) {
        let area = PI * disc.radius * disc.half_chord;
        let lobe = self.slopes.lobe;
        let (p, q) = (disc.p, disc.q);
        let (p2, q2) = (p * p, q * q);
        let t = p2 + q2;
        let exponent = (lobe.n_u * p2 + lobe.n_v * q2) / (t + f64::MIN_POSITIVE);
        let shift = 0.5 * exponent * libm::log1p(t);
        self.log = -shift;
        self.batch.push([p, q, 0.25 * area, shift]);
        for [x, y] in HEXAGON {
            let along = disc.radius * x;
            let across = disc.slant * x + disc.half_chord * y;
            self.batch
                .push([p + along, q + across, 0.125 * area, shift]);
        }
    }

    /// A piece of a chord on which the integrand is smooth, with so many points, rounded up; nothing where it
    /// has no length.
    #[inline(always)]
    fn add_piece(&mut self, chords: &Chords, lane: usize, [from, to]: [f64; 2], points: f64) {
        if from < to {
            let (p, scale, shift) = (chords.p[lane], chords.scale[lane], -self.log);
            let rule = GaussRule::of(rounded_up(points));
            for (q, weights, count) in rule.fours_on(from, to) {
                let weights = weights.map(|weight| scale * weight);
                self.batch
                    .push_of_four([[p; FOUR], q, weights, [shift; FOUR]], count);
            }
        }
    }
}

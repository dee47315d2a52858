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

use super::batch::{Batch, LANES, total};
use super::elementary::{exp, log1p};
use super::gauss::GaussRule;
use super::slopes::{Fineness, Slopes};
use crate::instructions::{Instructions, kernel};
use crate::reflectance::{Reflectance, TintResponse, fresnel};
use crate::vector::Vec3;

/// From this exponent on the lobe is a normal density times a factor that five points tell.
const NARROW_EXPONENT: f64 = 400.0;

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
}

/// Digits beyond those that count at which the lobe's tail is cut: the bulb is three decades above
/// white, and faint pixels three and more below it.
const TAIL_DIGITS: f64 = 7.0;

/// A bulb of at most this half width in the slope plane may be small enough for few points.
const SMALL: f64 = 0.1;

/// Over such a bulb the logarithm of the lobe changes by c: a rule of degree 5 misses this much of
/// its value, times c^6.
const DISC_ERROR: f64 = 5e-5;

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

kernel! {
    /// The integrals of Fresnel's reflectance times the rest, and of what it exceeds the tint's
    /// knee by.
    pub fn integrals(
        batch: &SlopeBatch,
        wo: Vec3,
        exponents: [f64; 2],
        ior: f64,
        knee: f64,
    ) -> [f64; 2] {
        let per_viewer = 1.0 / wo.z;
        let mut sums = [[0.0; LANES]; 2];
        for [p, q, weight, shift] in batch.blocks() {
            let mut terms = [[0.0; LANES]; 2];
            for i in 0..LANES {
                let (p2, q2) = (p[i] * p[i], q[i] * q[i]);
                let t = p2 + q2;
                let inverse = 1.0 / (1.0 + t);
                let cos_i = 2.0 * (wo.x * p[i] + wo.y * q[i] + wo.z) * inverse - wo.z;
                // At the normal the quotient is 0/0 and the product 0.
                let exponent = (exponents[0] * p2 + exponents[1] * q2) / (t + f64::MIN_POSITIVE);
                let power = exp(shift[i] - 0.5 * exponent * log1p(t));
                let shade = cos_i * per_viewer;
                let shade = if shade < 1.0 { shade } else { 1.0 };
                // A chord's end can lie on the horizon, and a rounding below it.
                let shade = if shade > 0.0 { shade } else { 0.0 };
                let value = weight[i] * shade * power * inverse * inverse.sqrt();
                let fresnel = fresnel::reflectance(cos_i, ior);
                let beyond = fresnel - knee;
                let beyond = if beyond > 0.0 { beyond } else { 0.0 };
                terms[0][i] = value * fresnel;
                terms[1][i] = value * beyond;
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

/// The specular radiance toward the viewer for a bulb of radiance 1, and how many evaluations it
/// took.
pub fn specular(
    view: &BulbView,
    reflectance: &Reflectance,
    response: &TintResponse,
    fineness: Fineness,
    instructions: Instructions,
    batch: &mut SlopeBatch,
) -> ([f64; 3], u32) {
    let lobe = &reflectance.lobe;
    batch.clear();
    let slopes = Slopes::new(view.wo, lobe);
    // min(1, cos_i/cos_o) bends, and so does the tint at its knee.
    let [first, second] = fresnel::cosines(response.knee, reflectance.ior);
    let mut cubature = Cubature {
        slopes,
        levels: [view.wo.z, first, second],
        fineness,
        batch,
    };
    cubature.fill(&Ellipse::new(view));
    let exponents = [lobe.n_u, lobe.n_v];
    let (ior, knee) = (reflectance.ior, response.knee);
    let [fresnel, excess] = integrals(instructions, batch, view.wo, exponents, ior, knee);
    let scale = lobe.normalization / (2.0 * std::f64::consts::PI);
    let radiance = response.at_moments(fresnel, excess);
    (
        radiance.map(|channel| channel * scale),
        batch.count() as u32,
    )
}

/// How many there are.
const LEVELS: usize = 3;

/// The error below which it matters where on the bulb the integrand bends.
const BENDS_SHOW: f64 = 1e-7;

struct Cubature<'a> {
    slopes: Slopes<'a>,
    /// Cosines of the light's direction at which the integrand bends.
    levels: [f64; LEVELS],
    fineness: Fineness,
    batch: &'a mut SlopeBatch,
}

impl Cubature<'_> {
    fn fill(&mut self, ellipse: &Ellipse) {
        let lobe = self.slopes.lobe;
        let [middle, radius] = ellipse.extent();
        if radius <= 0.0 {
            return;
        }
        let [p0, q0] = ellipse.centre;
        let [low, high] = ellipse.chord(middle);
        let half_chord = 0.5 * (high - low);
        let slant = ellipse.a12.abs() / ellipse.a22 * radius;
        let half_width = radius.max(half_chord + slant);
        let half_height = half_chord + slant;
        let q_middle = q0 + 0.5 * (low + high);
        let steepness = lobe.n_u.max(lobe.n_v).sqrt() + lobe.n_u * p0.abs() + lobe.n_v * q0.abs();
        let change2 = half_width * half_width * steepness * steepness;
        let missed = DISC_ERROR * change2 * change2 * change2;
        let bends = self.levels.iter().any(|&level| {
            let above = [(-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0), (1.0, 1.0)].map(|(x, y)| {
                let (p, q) = (p0 + middle + x * radius, q_middle + y * half_height);
                self.slopes.is_above(p, q, level)
            });
            above.contains(&true) && above.contains(&false)
        });
        if half_width < SMALL && missed < self.fineness.error() && !bends {
            self.add_disc(ellipse, middle, radius);
            return;
        }
        // Far out along its wide axis the lobe is wider along the other, too.
        let far = q0.abs() + half_width;
        let t = far * far;
        let widening = if t > 0.0 {
            (t / libm::log1p(t)).sqrt()
        } else {
            1.0
        };
        let reach_p = self.fineness.reach(lobe.n_u, TAIL_DIGITS) * widening;
        let reach_q = self.fineness.reach(lobe.n_v, TAIL_DIGITS);
        let low = (middle - radius).max(-reach_p - p0);
        let high = (middle + radius).min(reach_p - p0);
        if low >= high {
            return;
        }
        // x = middle + radius sin: the chord closes like a cosine, and the sum is smooth at its
        // ends.
        let angle = |x: f64| libm::asin(((x - middle) / radius).clamp(-1.0, 1.0));
        let widths = (high - low) * lobe.n_u.sqrt();
        let points = self.fineness.points(widths, self.fineness.more_on_disc());
        // Where chords begin to bend, their integrals do so a little: more points make up for it.
        let points = if bends && self.fineness.error() < BENDS_SHOW {
            3 * points
        } else {
            points
        };
        let rule = GaussRule::of(points);
        for (node, weight) in rule.on(angle(low), angle(high)) {
            let (sin, cos) = libm::sincos(node);
            let x = middle + radius * sin;
            let [y_low, y_high] = ellipse.chord(x);
            let (q_low, q_high) = ((q0 + y_low).max(-reach_q), (q0 + y_high).min(reach_q));
            if q_low < q_high {
                self.add_chord(p0 + x, q_low, q_high, weight * radius * cos);
            }
        }
    }

    /// All of a bulb over which the lobe changes little.
    fn add_disc(&mut self, ellipse: &Ellipse, middle: f64, radius: f64) {
        let [low, high] = ellipse.chord(middle);
        let half_chord = 0.5 * (high - low);
        let area = std::f64::consts::PI * radius * half_chord;
        // Chords' midpoints lie on a line.
        let slope = -ellipse.a12 / ellipse.a22;
        let [p, q] = ellipse.centre;
        let (p, q) = (p + middle, q + 0.5 * (low + high));
        self.batch.push([p, q, 0.25 * area, 0.0]);
        for [x, y] in HEXAGON {
            let along = radius * x;
            let across = slope * along + half_chord * y;
            self.batch.push([p + along, q + across, 0.125 * area, 0.0]);
        }
    }

    /// The chord at p, in pieces between which the integrand bends.
    fn add_chord(&mut self, p: f64, low: f64, high: f64, scale: f64) {
        let root = self.slopes.lobe.n_v.sqrt();
        let mut ends = [high; 2 * LEVELS + 2];
        ends[0] = low;
        for (level, ends) in self.levels.iter().zip(ends[1..].chunks_exact_mut(2)) {
            let crossings = self.slopes.crossings(p, *level);
            ends.copy_from_slice(&crossings.map(|q| q.clamp(low, high)));
        }
        ends.sort_unstable_by(f64::total_cmp);
        for pair in ends.windows(2) {
            let (from, to) = (pair[0], pair[1]);
            if from >= to {
                continue;
            }
            let widths = (to - from) * root;
            let near = from.max(-to) * root < 3.0;
            if self.slopes.lobe.n_v > NARROW_EXPONENT && widths > 3.0 && near {
                self.add_normal(p, from, to, scale);
            } else {
                let rule = GaussRule::of(self.fineness.points(widths, 1.0));
                for (q, weight) in rule.on(from, to) {
                    self.batch.push([p, q, scale * weight, 0.0]);
                }
            }
        }
    }

    /// A piece of a narrow lobe: the normal density's moments in closed form times the quartic
    /// through five points of the rest.
    fn add_normal(&mut self, p: f64, from: f64, to: f64, scale: f64) {
        const SPACING: f64 = 1.5;
        let root = self.slopes.lobe.n_v.sqrt();
        let (a, b) = (from * root, to * root);
        let (ea, eb) = (libm::exp(-0.5 * a * a), libm::exp(-0.5 * b * b));
        let half = std::f64::consts::FRAC_1_SQRT_2;
        let m0 = (0.5 * std::f64::consts::PI).sqrt() * (libm::erf(b * half) - libm::erf(a * half));
        let m1 = ea - eb;
        let m2 = m0 + a * ea - b * eb;
        let m3 = 2.0 * m1 + a * a * ea - b * b * eb;
        let m4 = 3.0 * m2 + a * a * a * ea - b * b * b * eb;
        let square = SPACING * SPACING;
        let (u1, u2) = (m1 / SPACING, m2 / square);
        let (u3, u4) = (m3 / (square * SPACING), m4 / (square * square));
        // Lagrange's polynomials on -2, -1, 0, 1, 2.
        let weights = [
            (u4 - u2) / 24.0 - (u3 - u1) / 12.0,
            -(u4 - 4.0 * u2) / 6.0 + (u3 - 4.0 * u1) / 6.0,
            m0 - 1.25 * u2 + 0.25 * u4,
            -(u4 - 4.0 * u2) / 6.0 - (u3 - 4.0 * u1) / 6.0,
            (u4 - u2) / 24.0 + (u3 - u1) / 12.0,
        ];
        for (step, weight) in [-2.0, -1.0, 0.0, 1.0, 2.0].into_iter().zip(weights) {
            let z = SPACING * step;
            self.batch
                .push([p, z / root, scale * weight / root, 0.5 * z * z]);
        }
    }
}

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

use super::gauss::GaussRule;
use super::slopes::{Slopes, lobe_reach, points};
use crate::reflectance::{Reflectance, TintResponse};
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

    /// The least and largest x.
    fn extent(&self) -> [f64; 2] {
        let k2 = self.a11 * self.a22 - self.a12 * self.a12;
        let k1 = self.a22 * self.b1 - self.a12 * self.b2;
        let k0 = self.b2 * self.b2 + self.a22 * self.c;
        let root = (k1 * k1 + k2 * k0).max(0.0).sqrt();
        [(k1 - root) / k2, (k1 + root) / k2]
    }

    /// The least and largest y at x.
    fn chord(&self, x: f64) -> [f64; 2] {
        let b = self.b2 - self.a12 * x;
        let c = self.c - x * (self.a11 * x - 2.0 * self.b1);
        let root = (b * b + self.a22 * c).max(0.0).sqrt();
        [(b - root) / self.a22, (b + root) / self.a22]
    }
}

/// The specular radiance toward the viewer for a bulb of radiance 1, with `density` times the
/// usual number of points (1 misses up to 1e-3 of a lobe's faint tail, 1.5 about 1e-6), and how many it took.
pub fn specular(
    view: &BulbView,
    reflectance: &Reflectance,
    response: &TintResponse,
    density: f64,
) -> ([f64; 3], u32) {
    let lobe = &reflectance.lobe;
    let ellipse = Ellipse::new(view);
    let mut integral = Integral {
        slopes: Slopes::new(view.wo, lobe),
        ior: reflectance.ior,
        knee: response.knee,
        fresnel: 0.0,
        excess: 0.0,
        evaluations: 0,
    };
    let (reach_p, reach_q) = (lobe_reach(lobe.n_u), lobe_reach(lobe.n_v));
    let [x_low, x_high] = ellipse.extent();
    let (middle, radius) = (0.5 * (x_low + x_high), 0.5 * (x_high - x_low));
    let [p0, q0] = ellipse.centre;
    let (low, high) = (x_low.max(-reach_p - p0), x_high.min(reach_p - p0));
    if low >= high || radius <= 0.0 {
        return ([0.0; 3], 0);
    }
    // x = middle + radius sin: the chord closes like a cosine, and the sum is smooth at its ends.
    let angle = |x: f64| libm::asin(((x - middle) / radius).clamp(-1.0, 1.0));
    let rule = GaussRule::of(points((high - low) * lobe.n_u.sqrt(), 5.0, density));
    for (node, weight) in rule.on(angle(low), angle(high)) {
        let (sin, cos) = libm::sincos(node);
        let x = middle + radius * sin;
        let [y_low, y_high] = ellipse.chord(x);
        let (q_low, q_high) = ((q0 + y_low).max(-reach_q), (q0 + y_high).min(reach_q));
        if q_low < q_high {
            integral.add_chord(p0 + x, q_low, q_high, weight * radius * cos, density);
        }
    }
    let scale = lobe.normalization / (2.0 * std::f64::consts::PI);
    (
        response
            .at_moments(integral.fresnel, integral.excess)
            .map(|channel| channel * scale),
        integral.evaluations,
    )
}

/// Sums over the ellipse: of the weight times Fresnel's reflectance, and of the weight times what
/// that exceeds the tint's knee by. The tint is linear in both.
struct Integral<'a> {
    slopes: Slopes<'a>,
    ior: f64,
    knee: f64,
    fresnel: f64,
    excess: f64,
    evaluations: u32,
}

impl Integral<'_> {
    /// The chord at p, in pieces between which min(1, cos_i/cos_o) bends.
    fn add_chord(&mut self, p: f64, low: f64, high: f64, scale: f64, density: f64) {
        let root = self.slopes.lobe.n_v.sqrt();
        let [first, second] = self.slopes.level_with_viewer(p, low, high);
        for [from, to] in [[low, first], [first, second], [second, high]] {
            if from >= to {
                continue;
            }
            let lit = self.slopes.light_above_viewer(p, 0.5 * (from + to));
            let widths = (to - from) * root;
            let near = from.max(-to) * root < 3.0;
            if self.slopes.lobe.n_v > NARROW_EXPONENT && widths > 3.0 && near {
                self.add_normal(p, from, to, lit, scale);
            } else {
                let rule = GaussRule::of(points(widths, 3.0, density));
                for (q, weight) in rule.on(from, to) {
                    self.add_point(p, q, lit, scale * weight, 0.0);
                }
            }
        }
    }

    /// A piece of a narrow lobe: the normal density's moments in closed form times the quartic
    /// through five points of the rest.
    fn add_normal(&mut self, p: f64, from: f64, to: f64, lit: bool, scale: f64) {
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
            self.add_point(p, z / root, lit, scale * weight / root, 0.5 * z * z);
        }
    }

    fn add_point(&mut self, p: f64, q: f64, lit: bool, weight: f64, exponent_shift: f64) {
        let point = self.slopes.at(p, q);
        let shade = if lit {
            1.0
        } else {
            point.cos_i / self.slopes.wo.z
        };
        let power = libm::exp(point.exponent + exponent_shift);
        let fresnel = crate::reflectance::fresnel::reflectance(point.cos_i, self.ior);
        let contribution = weight * shade * point.h_z3 * power;
        self.fresnel += contribution * fresnel;
        self.excess += contribution * (fresnel - self.knee).max(0.0);
        self.evaluations += 1;
    }
}

//! Cubature over the sample for one receiver on the chart.
//!
//! The sample is cut into lines of constant v. The outer rule runs over v in a variable s with
//! v = nearest + delta sinh s, about the point of the sample nearest to the receiver. It is parted at the
//! square's corners, and where a lobe that is narrow along the lines begins to leave the square and has
//! left it: in between the integral along a line falls like an error function. [`super::transfer`]
//! integrates along each line, and [`super::bulb_arcs`] where the bulb looks wider than the lobe.

use super::bulb::Bulb;
use super::bulb_arcs::ArcRules;
use super::ridge::{Ridge, span_along};
use super::transfer::{Along, Receiver};
use crate::hybrid::budget::interreflection::{
    ARCS_HALF_ANGLE_MAX, BESIDE_RIDGE_EXPONENT, BULB_WIDTHS, ROTATED_FROM, TAIL_DIGITS,
};
use crate::numerics::elementary::{asinh, exp};
use crate::numerics::gauss::{GaussRule, POINTS_MAX};
use crate::numerics::instructions::Instructions;
use crate::numerics::tolerance::Tolerance;
use crate::reflectance::Reflectance;
use crate::vector::Vec3;

/// A lobe of exponent n falls by exp(-1/2) over a slope of 1/sqrt(n), which is an angle of about
/// twice that between the receiver's directions.
const WIDTHS_PER_ANGLE: f64 = 0.5;

/// Intervals of s shorter than this are corners that coincide.
const SHORTEST: f64 = 1e-9;

/// So much of an interval lies outside of the lines that tell how the lobe leaves the square on it: its
/// own ends may be corners, where lines have no length.
const INSIDE: f64 = 1e-6;

/// Lines that a rule is likely to have.
const LINES_LIKELY: usize = 32;

/// A right angle.
const QUARTER: f64 = std::f64::consts::FRAC_PI_2;

/// The sample and the frame (u, v, z) in which its lines run along u.
#[derive(Clone, Copy, Debug)]
pub struct SampleFrame {
    half: f64,
    /// The u axis in the world.
    pub u_axis: [f64; 2],
    /// Whether the lines turn with the lobe.
    rotated: bool,
    /// Whether h_u is the slope along which the lobe is narrow, so that lines can be cut to it.
    aligned: bool,
    /// Whether a bulb that looks wider than the lobe is cut into arcs about the lines.
    arcs: bool,
    n_u: f64,
    n_v: f64,
    instructions: Instructions,
}

/// v of a line, its weight, and its least and largest u.
type Line = [f64; 4];

/// The lines for a receiver, and what runs along each.
pub struct SampleRule<Rules> {
    pub lines: Vec<Line>,
    pub along: Rules,
    /// Whether the rules have points enough for the lobe.
    pub resolved: bool,
}

/// What runs along each line for the bulb.
pub enum ForBulb {
    /// A rule for each point of a cubature over the bulb.
    Points(Along),
    /// Rules over arcs of the bulb.
    Arcs(ArcRules),
}

/// The axis of the world along which the lobe is narrow.
fn narrow_axis(reflectance: &Reflectance) -> [f64; 2] {
    let axis = reflectance.lobe.to_surface(Vec3::new(1.0, 0.0, 0.0));
    [axis.x, axis.y]
}

impl SampleFrame {
    /// The frame for a material on a square of this half side.
    pub fn new(half: f64, reflectance: &Reflectance, instructions: Instructions) -> Self {
        let lobe = &reflectance.lobe;
        let isotropic = lobe.n_u <= lobe.n_v;
        let rotated = lobe.n_u > ROTATED_FROM && !isotropic;
        Self {
            half,
            u_axis: if rotated {
                narrow_axis(reflectance)
            } else {
                [1.0, 0.0]
            },
            rotated,
            aligned: rotated || isotropic,
            arcs: rotated && reflectance.specular_share == 1.0,
            n_u: lobe.n_u,
            n_v: if rotated { lobe.n_v } else { lobe.n_u },
            instructions,
        }
    }

    /// The same rules with lines that run across the lobe of a material beside this one.
    pub fn turned_to(mut self, reflectance: &Reflectance) -> Self {
        if self.rotated {
            self.u_axis = narrow_axis(reflectance);
        }
        self
    }

    /// A vector of the world in the frame.
    pub fn to_frame(self, w: Vec3) -> Vec3 {
        let [cos, sin] = self.u_axis;
        Vec3::new(w.x * cos + w.y * sin, w.y * cos - w.x * sin, w.z)
    }

    /// The least and largest u of a line, the former above the latter where it misses the square.
    fn line(&self, v: f64) -> [f64; 2] {
        let ([cos, sin], half) = (self.u_axis, self.half);
        // -half <= slope u + offset <= half
        let bound = |slope: f64, offset: f64| {
            if slope.abs() < 1e-12 {
                [f64::NEG_INFINITY, f64::INFINITY]
            } else {
                let ends = [(-half - offset) / slope, (half - offset) / slope];
                [ends[0].min(ends[1]), ends[0].max(ends[1])]
            }
        };
        let (x, y) = (bound(cos, -v * sin), bound(sin, v * cos));
        [x[0].max(y[0]), x[1].min(y[1])]
    }

    /// The middle of the lobe between a receiver and the bulb, if lines run across a narrow one. `radius` is
    /// the bulb's, or 0 for its centre.
    fn ridge(
        &self,
        receiver: Vec3,
        (source, radius): (Vec3, f64),
        tolerance: Tolerance,
    ) -> Option<Ridge> {
        (self.aligned && self.n_u > ROTATED_FROM).then(|| Ridge {
            receiver,
            source,
            n_u: self.n_u,
            reach: 0.5 * tolerance.reach_widths(TAIL_DIGITS),
            radius,
            instructions: self.instructions,
        })
    }

    /// The rule for a receiver and any sources (in the frame).
    pub fn rule(&self, receiver: &Receiver, tolerance: Tolerance) -> SampleRule<Along> {
        let (lines, resolved) = self.lines(receiver, None, tolerance);
        self.with_points(receiver, lines, None, (tolerance, resolved))
    }

    /// The bulb's half width, in widths of the lobe along its narrow axis.
    pub fn widths_of(&self, bulb: &Bulb) -> f64 {
        WIDTHS_PER_ANGLE * bulb.half_angle() * self.n_u.sqrt()
    }

    /// The rule for a receiver and the bulb.
    pub fn rule_for_bulb(
        &self,
        receiver: &Receiver,
        bulb: &Bulb,
        tolerance: Tolerance,
    ) -> SampleRule<ForBulb> {
        let c = receiver.position;
        let half_angle = bulb.half_angle();
        let arcs =
            self.arcs && half_angle < ARCS_HALF_ANGLE_MAX && self.widths_of(bulb) > BULB_WIDTHS;
        let radius = if arcs { bulb.radius } else { 0.0 };
        let ridge = self.ridge(c, (bulb.centre, radius), tolerance);
        let (lines, resolved) = self.lines(receiver, ridge.as_ref(), tolerance);
        if arcs {
            let widths = 2.0 * WIDTHS_PER_ANGLE * half_angle * self.n_v.sqrt();
            let points = tolerance.points(widths, 0.0);
            let rules = ArcRules {
                across: tolerance.midpoints(),
                arcs: GaussRule::of(tolerance.points_of_arcs()),
                along: GaussRule::of(points),
            };
            return SampleRule {
                lines,
                along: ForBulb::Arcs(rules),
                resolved: resolved && points <= POINTS_MAX,
            };
        }
        let rule = self.with_points(receiver, lines, ridge.as_ref(), (tolerance, resolved));
        SampleRule {
            lines: rule.lines,
            along: ForBulb::Points(rule.along),
            resolved: rule.resolved,
        }
    }

    /// Lines for a receiver, and for what mirrors the bulb if all share one; whether they are enough.
    fn lines(
        &self,
        receiver: &Receiver,
        ridge: Option<&Ridge>,
        tolerance: Tolerance,
    ) -> (Vec<Line>, bool) {
        let (nearest, delta) = self.nearest(receiver);
        let mut lines = Vec::with_capacity(LINES_LIKELY);
        let mut resolved = true;
        let exponent = match ridge {
            Some(_) => self.n_v.max(BESIDE_RIDGE_EXPONENT),
            None => self.n_v,
        };
        let v_of = |s: f64| {
            let e = exp(s);
            nearest + 0.5 * delta * (e - 1.0 / e)
        };
        let ends = self.ends(ridge, |v| asinh((v - nearest) / delta));
        for pair in ends.windows(2) {
            let [from, to] = [pair[0], pair[1]];
            if to - from < SHORTEST {
                continue;
            }
            let line = |share: f64| {
                let v = v_of(from + share * (to - from));
                let [low, high] = self.line(v);
                [v, low, high]
            };
            let passed = ridge.map_or(Some(0.0), |ridge| {
                ridge.widths_passed([line(INSIDE), line(0.5), line(1.0 - INSIDE)])
            });
            let Some(widths) = passed else {
                // The lobe sends nothing from here.
                continue;
            };
            let points = self.points(exponent, [from, to], widths, tolerance);
            resolved &= points <= POINTS_MAX;
            for (s, weight) in GaussRule::of(points).on(from, to) {
                let e = exp(s);
                let cosh = 0.5 * (e + 1.0 / e);
                let v = v_of(s);
                let [low, high] = self.line(v);
                if low < high {
                    lines.push([v, weight * delta * cosh, low, high]);
                }
            }
        }
        (lines, resolved)
    }

    /// The same with a rule along each line, which serves any source there.
    fn with_points(
        &self,
        receiver: &Receiver,
        lines: Vec<Line>,
        ridge: Option<&Ridge>,
        (tolerance, resolved): (Tolerance, bool),
    ) -> SampleRule<Along> {
        let most = match ridge {
            Some(ridge) => ridge.points_along(&lines, tolerance),
            None => self.points_along(receiver, &lines, tolerance),
        };
        let within = tolerance.points(tolerance.reach_widths(TAIL_DIGITS), 1.0);
        let cut = self.aligned && within < most;
        SampleRule {
            lines,
            along: Along {
                rule: GaussRule::of(if cut { within } else { most }),
                reach: cut.then(|| 0.5 * tolerance.reach_widths(TAIL_DIGITS)),
            },
            resolved: resolved && (cut || most <= POINTS_MAX),
        }
    }

    /// The v of the sample's point that is nearest to a receiver, and how far that is.
    fn nearest(&self, receiver: &Receiver) -> (f64, f64) {
        let ([cos, sin], half, c) = (self.u_axis, self.half, receiver.position);
        let (x, y) = (c.x * cos - c.y * sin, c.x * sin + c.y * cos);
        let (near_x, near_y) = (x.clamp(-half, half), y.clamp(-half, half));
        let delta = Vec3::new(x - near_x, y - near_y, c.z).length();
        (near_y * cos - near_x * sin, delta)
    }

    /// Points along every line, by the longest and the one nearest to the receiver.
    fn points_along(&self, receiver: &Receiver, lines: &[Line], tolerance: Tolerance) -> usize {
        let (nearest, _) = self.nearest(receiver);
        let length = |[_, _, low, high]: &Line| high - low;
        let off = |[v, ..]: &Line| (v - nearest).abs();
        let longest = lines.iter().max_by(|a, b| length(a).total_cmp(&length(b)));
        let closest = lines.iter().min_by(|a, b| off(a).total_cmp(&off(b)));
        let points = longest
            .into_iter()
            .chain(closest)
            .map(|line| self.points_along_one(receiver, *line, tolerance));
        points.fold(1, usize::max)
    }

    fn points_along_one(
        &self,
        receiver: &Receiver,
        [v, _, low, high]: Line,
        tolerance: Tolerance,
    ) -> usize {
        let span = span_along(&receiver.position, [v, low, high]);
        self.points(self.n_u, span, 0.0, tolerance)
    }

    /// Where the outer rule is parted, as values of s: at the square's corners, and where a lobe that is
    /// narrow along u begins to leave the square and has left it.
    fn ends(&self, ridge: Option<&Ridge>, s_of: impl Fn(f64) -> f64) -> Vec<f64> {
        let ([cos, sin], half) = (self.u_axis, self.half);
        let corners = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]
            .map(|(x, y)| [half * (x * cos + y * sin), half * (y * cos - x * sin)]);
        let mut ends: Vec<f64> = corners.iter().map(|&[_, v]| s_of(v)).collect();
        if let Some(ridge) = ridge {
            ridge.crossings(&corners, |v| ends.push(s_of(v)));
        }
        ends.sort_unstable_by(f64::total_cmp);
        ends
    }

    /// Gauss points for an interval of a variable whose hyperbolic sine is the tangent of an angle,
    /// over which a lobe of exponent `n` varies, and `widths` of another one.
    fn points(&self, n: f64, [from, to]: [f64; 2], widths: f64, tolerance: Tolerance) -> usize {
        // atan(sinh s) is 2 atan(tanh(s / 2)): at most s, and at most a right angle.
        let angle = (to.min(QUARTER) - from.max(-QUARTER)).max(0.0);
        let widths = widths + WIDTHS_PER_ANGLE * angle * n.sqrt();
        tolerance.points(widths, tolerance.more_beside(to - from))
    }
}

//! The directions in which a point of the sample sees the chart.
//!
//! In the plane across the chart's x axis, s = asinh(way up the chart / distance to it). In a plane
//! through the x axis, ln t = asinh(way along the chart / distance to it in that plane). The solid
//! angle is ds dt / (t cosh s cosh^2 ln t).
//! Rows of patches are intervals of s, and columns, for each s, of t; and however close the sample
//! comes to the chart, the integrand stays smooth. Intervals are parted where it bends, at three
//! cosines of the light's direction.

use super::integrals::Integrals;
use super::lit_chart::{RadiantChart, polynomial};
use super::window::Window;
use crate::numerics::batch::FOUR;
use crate::numerics::elementary::{asinh, exp};
use crate::numerics::gauss::{GaussRule, POINTS_MAX};
use crate::numerics::instructions::kernel;
use crate::numerics::tolerance::Tolerance;
use crate::scene::ChartPlane;
use crate::vector::Vec3;
use std::f64::consts::PI;

/// Where the integrand bends: at three cosines of the light's direction, on either side.
const BENDS: usize = 6;

/// Farther out than any s or t: no bend.
const NOWHERE: f64 = f64::INFINITY;

/// e^-3 to e^3 without e^0, about.
const POWERS_OF_E: [f64; BENDS] = [0.05, 0.135, 0.37, 2.7, 7.4, 20.0];

/// Far beyond any s that meets the chart.
const EXP_MAX: f64 = 600.0;

kernel! {
    /// Gathers the directions of a product rule from `position` and the light from them.
    pub fn directions<const NODES: usize>(
        chart: &RadiantChart<NODES>,
        position: Vec3,
        levels: [f64; 3],
        window: &Window,
        tolerance: Tolerance,
        integrals: &mut Integrals<'_>,
    ) {
        let plane = &chart.plane;
        let offset = position - plane.corner;
        // The distance to the chart's plane, and the b of the nearest point of it.
        let (height, foot) = (plane.z.dot(offset), plane.y.dot(offset));
        let s_of = |b: f64| asinh((b - foot) / height);
        // In the plane across x, light stands as high as a level at two angles from the chart's
        // normal: s is the inverse Gudermannian of these.
        let bends = both_signs(levels.map(|level| {
            if level < 1.0 {
                0.5 * PI - libm::asin(level)
            } else {
                NOWHERE
            }
        }))
        .map(|off_zenith| s_at(plane, 0.5 * PI + off_zenith));
        let [low, high] = [window.low[1], window.high[1]].map(|beta| s_at(plane, beta));
        let mut next = s_of(0.0);
        for row in 0..plane.rows {
            let start = next;
            next = s_of(f64::from(row + 1) * plane.pitch);
            let ends = [start.max(low), next.min(high)];
            if ends[0] >= ends[1] {
                continue;
            }
            let (inner, count) = sorted_between(ends, &bends);
            let end_at = |s: f64| {
                let per_angle = widths_up(plane, window, [-offset.x, height], s);
                (s, gudermann(s), per_angle)
            };
            let mut begin = end_at(ends[0]);
            for to in inner[..count].iter().copied().chain([ends[1]]) {
                let (from, low, per_angle) = begin;
                begin = end_at(to);
                let (_, high, per_angle_at_end) = begin;
                let widths = (high - low) * per_angle.max(per_angle_at_end);
                let more = tolerance.more_beside(to - from);
                let (parts, rule) = parts(widths, more, tolerance, window.is_ridge());
                let mut low = from;
                for part in 0..parts {
                    let high = end_of_part([from, to], part, parts);
                    for (s, weight) in rule.on(low, high) {
                        let line = Line::new(plane, row, [height, foot], s, &levels);
                        let weight = weight * line.cos_gamma;
                        gather_line(chart, position, &line, weight, window, tolerance, integrals);
                    }
                    low = high;
                }
            }
        }
    }
}

/// The same for directions of one s.
#[inline(always)]
fn gather_line<const NODES: usize>(
    chart: &RadiantChart<NODES>,
    position: Vec3,
    line: &Line,
    weight_s: f64,
    window: &Window,
    tolerance: Tolerance,
    integrals: &mut Integrals<'_>,
) {
    let plane = &chart.plane;
    // From the sample's point to the column's left edge.
    let along = |column: u32| plane.corner.x - position.x + f64::from(column) * plane.pitch;
    let per_reach = 1.0 / line.reach;
    let t_of = |along: f64| exp_asinh(along * per_reach);
    let [low, high] = [window.low[0], window.high[0]].map(t_at_sine);
    let (half_reach, per_pitch) = (0.5 * line.reach / plane.pitch, 1.0 / plane.pitch);
    let (left, right) = (t_of(along(0)), t_of(along(plane.columns)));
    let ends = [left.max(low), right.min(high)];
    if ends[0] >= ends[1] {
        return;
    }
    let (bends, count) = sorted_between(ends, &line.bends);
    let mut bends = bends[..count].iter().copied().peekable();
    let up = chart.weights_up(line.row, line.height);
    let mut from = Place::new(ends[0]);
    let mut per_angle = window.widths_sideways(from.sine, [line.cos, line.sin]);
    for column in 0..plane.columns {
        let edge = t_of(along(column + 1)).min(high);
        if edge <= from.t {
            continue;
        }
        let light = chart.radiance_across(column, line.row, &up);
        let along = along(column) * per_pitch;
        while from.t < edge {
            let to = Place::new(bends.next_if(|bend| *bend < edge).unwrap_or(edge));
            let more = tolerance.more_beside((to.t - from.t) / (from.root * to.root));
            let end = window.widths_sideways(to.sine, [line.cos, line.sin]);
            let widths = match (per_angle, end) {
                (Some(one), Some(other)) => from.angle_to(&to) * one.max(other),
                _ => (to.sine - from.sine) / window.width[0],
            };
            per_angle = end;
            let (parts, rule) = parts(widths, more, tolerance, window.is_ridge());
            let mut low = from.t;
            for part in 0..parts {
                let high = end_of_part([from.t, to.t], part, parts);
                for (t, weight_t, count) in rule.fours_on(low, high) {
                    let mut points = [[0.0; FOUR]; 6];
                    for i in 0..FOUR {
                        let t2 = t[i] * t[i];
                        let share = 1.0 / (1.0 + t2);
                        let cos = 2.0 * t[i] * share;
                        let position = half_reach * (t[i] - 1.0 / t[i]) - along;
                        let weight = weight_s * weight_t[i] * 2.0 * cos * share;
                        let [r, g, b] = polynomial(&light, position).map(|light| weight * light);
                        let sin = (t2 - 1.0) * share;
                        let point = [sin, cos * line.cos, cos * line.sin, r, g, b];
                        for (column, value) in points.iter_mut().zip(point) {
                            column[i] = value;
                        }
                    }
                    integrals.push_of_four(points, count);
                }
                low = high;
            }
            from = to;
        }
    }
}

/// Into how many parts an interval of this many widths is cut, and the rule that each takes: for a ridge more than one
/// where no rule has as many points as the whole takes.
///
/// `more` grows without bounds where the sample's point comes to touch the chart: there an interval reaches far beyond
/// the bends, to where next to nothing is left of the light, and the largest rule does for it. Parts by it took
/// more memory than there was.
#[inline(always)]
fn parts(
    widths: f64,
    more: f64,
    tolerance: Tolerance,
    is_ridge: bool,
) -> (usize, &'static GaussRule) {
    let more = more.min(POINTS_MAX as f64);
    let points = tolerance.points(widths, more);
    if points <= POINTS_MAX || !is_ridge {
        return (1, GaussRule::of(points));
    }
    let parts = points.div_ceil(POINTS_MAX);
    let share = 1.0 / parts as f64;
    let points = tolerance.points(widths * share, more * share);
    (parts, GaussRule::of(points))
}

/// Where a part of an interval that is cut into so many ends.
#[inline(always)]
fn end_of_part([from, to]: [f64; 2], part: usize, parts: usize) -> f64 {
    if part + 1 == parts {
        to
    } else {
        from + (to - from) * (part + 1) as f64 / parts as f64
    }
}

/// The most of the lobe's widths for each radian at an s; `left` is how far the chart's left edge lies from the
/// sample's point along x, and `height` how far its plane.
#[inline(always)]
fn widths_up(plane: &ChartPlane, window: &Window, [left, height]: [f64; 2], s: f64) -> f64 {
    let right = left + f64::from(plane.columns) * plane.pitch;
    let e = exp(s);
    let (sinh, cosh) = (0.5 * (e - 1.0 / e), 0.5 * (e + 1.0 / e));
    let across = (plane.y * sinh - plane.z) * (1.0 / cosh);
    let reach = height * cosh;
    let mut most = 0.0f64;
    for along in [left, 0.0f64.clamp(left, right), right] {
        let sine = along / (along * along + reach * reach).sqrt();
        let sine = sine.clamp(window.low[0], window.high[0]);
        let Some(widths) = window.widths_up(sine, [across.y, across.z]) else {
            return 1.0 / window.width[1];
        };
        most = most.max(widths);
    }
    most
}

/// A t, and what of it tells how many points an interval takes.
#[derive(Clone, Copy)]
struct Place {
    t: f64,
    root: f64,
    sine: f64,
}

impl Place {
    #[inline(always)]
    fn new(t: f64) -> Self {
        Self {
            t,
            root: t.sqrt(),
            sine: sine(t),
        }
    }

    /// About the angle to a farther place, and never less: t is the tangent of a half and of an eighth of a turn.
    #[inline(always)]
    fn angle_to(&self, farther: &Self) -> f64 {
        let tangent = (farther.t - self.t) / (1.0 + self.t * farther.t);
        (2.0 * tangent).min(PI)
    }
}

/// The bends that lie between two ends, in ascending order, and how many they are.
#[inline(always)]
fn sorted_between<const N: usize>([low, high]: [f64; 2], bends: &[f64; N]) -> ([f64; N], usize) {
    let (mut sorted, mut count) = ([high; N], 0);
    for &bend in bends {
        if bend > low && bend < high {
            let mut at = count;
            while at > 0 && sorted[at - 1] > bend {
                sorted[at] = sorted[at - 1];
                at -= 1;
            }
            sorted[at] = bend;
            count += 1;
        }
    }
    (sorted, count)
}

/// Directions of one s in a row of patches.
struct Line {
    row: u32,
    /// Of the angle from +y.
    sin: f64,
    cos: f64,
    /// Of the angle to the chart's normal.
    cos_gamma: f64,
    /// From the sample's point to the chart, across its x axis.
    reach: f64,
    /// The height on the chart in metres.
    height: f64,
    /// The t at which the integrand bends, and some at which long intervals are parted.
    bends: [f64; 2 * BENDS],
}

impl Line {
    #[inline(always)]
    fn new(
        plane: &ChartPlane,
        row: u32,
        [height, foot]: [f64; 2],
        s: f64,
        levels: &[f64; 3],
    ) -> Self {
        let e = exp(s);
        let (sinh, cosh) = (0.5 * (e - 1.0 / e), 0.5 * (e + 1.0 / e));
        let cos_gamma = 1.0 / cosh;
        let across = plane.y * (sinh * cos_gamma) - plane.z * cos_gamma;
        Self {
            row,
            sin: across.z,
            cos: across.y,
            cos_gamma,
            reach: height * cosh,
            height: foot + height * sinh,
            bends: {
                let bends = levels.map(|level| {
                    // cosh ln t is this where light stands at the level.
                    let ratio = across.z / level;
                    if ratio > 1.0 {
                        ratio + (ratio * ratio - 1.0).sqrt()
                    } else {
                        NOWHERE
                    }
                });
                let ([a, b, c], [d, e, f]) = (bends, bends.map(|bend| 1.0 / bend));
                let [g, h, i, j, k, l] = POWERS_OF_E;
                [a, b, c, d, e, f, g, h, i, j, k, l]
            },
        }
    }
}

/// The s of a direction across the x axis of this angle from +y, 0 to pi; infinite for one that
/// passes over the chart.
fn s_at(plane: &ChartPlane, beta: f64) -> f64 {
    let (sin, cos) = libm::sincos(beta);
    let approach = -(plane.z.y * cos + plane.z.z * sin);
    let up = plane.y.y * cos + plane.y.z * sin;
    if approach > 0.0 {
        asinh(up / approach)
    } else {
        f64::INFINITY
    }
}

/// The angle whose tangent is sinh s.
fn gudermann(s: f64) -> f64 {
    let e = exp(s.min(EXP_MAX));
    2.0 * libm::atan(e) - 0.5 * PI
}

/// The sine of [`t_at_sine`].
#[inline(always)]
fn sine(t: f64) -> f64 {
    1.0 - 2.0 / (t * t + 1.0)
}

/// exp(asinh(x)).
#[inline(always)]
fn exp_asinh(x: f64) -> f64 {
    let sum = x.abs() + (1.0 + x * x).sqrt();
    if x < 0.0 { 1.0 / sum } else { sum }
}

/// The t of directions of this sine, -1 to 1, from the plane across x.
#[inline(always)]
fn t_at_sine(sine: f64) -> f64 {
    ((1.0 + sine) / (1.0 - sine)).sqrt()
}

/// Bends on both sides of 0.
#[inline(always)]
fn both_signs([a, b, c]: [f64; 3]) -> [f64; BENDS] {
    [a, b, c, -a, -b, -c]
}

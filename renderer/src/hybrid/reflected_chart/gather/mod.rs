//! The directions in which a point of the sample sees the chart.
//!
//! In the plane across the chart's x axis, s = asinh(way up the chart / distance to it). In a plane
//! through the x axis, ln t = asinh(way along the chart / distance to it in that plane). The solid
//! angle is ds dt / (t cosh s cosh^2 ln t).
//! Rows of patches are intervals of s, and columns, for each s, of t; and however close the sample
//! comes to the chart, the integrand stays smooth. Intervals are parted where it bends, at three
//! cosines of the light's direction.

#![allow(
    clippy::needless_range_loop,
    reason = "loops over lanes of several arrays: the compiler turns no other form into vectors"
)]

mod across;
mod lines;

use super::integrals::Integrals;
use super::lit_chart::RadiantChart;
use super::window::Window;
use crate::numerics::batch::LANES;
use crate::numerics::elementary::{asinh, exp};
use crate::numerics::gauss::{GaussRule, POINTS_MAX};
use crate::numerics::instructions::kernel;
use crate::numerics::tolerance::Tolerance;
use crate::scene::ChartPlane;
use crate::vector::Vec3;
use across::{ChartFromPoint, t_at_sine};
use std::f64::consts::PI;

/// Where the integrand bends: at three cosines of the light's direction, on either side.
const BENDS: usize = 6;

/// Farther out than any s or t: no bend.
const NOWHERE: f64 = f64::INFINITY;

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
        let bends = bends_up(plane, levels);
        let [low, high] = [window.low[1], window.high[1]].map(|beta| s_at(plane, beta));
        let seen = ChartFromPoint {
            chart,
            left: plane.corner.x - position.x,
            height,
            foot,
            levels,
            window,
            ends: [window.low[0], window.high[0]].map(t_at_sine),
            tolerance,
        };
        let mut next = s_of(0.0);
        let mut edges = [0.0; LANES];
        for row in 0..plane.rows {
            let start = next;
            let index = row as usize % LANES;
            if index == 0 {
                for i in 0..LANES {
                    edges[i] = s_of((f64::from(row) + (i + 1) as f64) * plane.pitch);
                }
            }
            next = edges[index];
            let range = [start.max(low), next.min(high)];
            if range[0] >= range[1] {
                continue;
            }
            let (inner, count) = sorted_between(range, &bends);
            let end_at = |s: f64| {
                let per_angle = widths_up(plane, window, [-offset.x, height], s);
                (s, gudermann(s), per_angle)
            };
            let mut begin = end_at(range[0]);
            for to in inner[..count].iter().copied().chain([range[1]]) {
                let (from, low, per_angle) = begin;
                begin = end_at(to);
                let (_, high, per_angle_at_end) = begin;
                let widths = (high - low) * per_angle.max(per_angle_at_end);
                let more = tolerance.more_beside(to - from);
                let (parts, rule) = parts(widths, more, tolerance, window.is_ridge());
                let mut low = from;
                for part in 0..parts {
                    let high = end_of_part([from, to], part, parts);
                    for (s, weights, count) in rule.fours_on(low, high) {
                        seen.gather_lines(row, (&s, &weights), count, integrals);
                    }
                    low = high;
                }
            }
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
    if !window.is_ridge() {
        return 1.0 / window.width[1];
    }
    let right = left + f64::from(plane.columns) * plane.pitch;
    let e = exp(s);
    let (sinh, cosh) = (0.5 * (e - 1.0 / e), 0.5 * (e + 1.0 / e));
    let across = (plane.y * sinh - plane.z) * (1.0 / cosh);
    let reach = height * cosh;
    let mut most = 0.0f64;
    for along in [left, 0.0f64.clamp(left, right), right] {
        let sine = along / (along * along + reach * reach).sqrt();
        let sine = sine.clamp(window.low[0], window.high[0]);
        let widths = window.widths_up(sine, [across.y, across.z]);
        most = widths.map_or(most, |widths| most.max(widths));
    }
    most
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

/// The s at which light stands as high as one of some levels, sines of its direction.
fn bends_up(plane: &ChartPlane, levels: [f64; 3]) -> [f64; BENDS] {
    // In the plane across x, light stands as high as a level at two angles from the chart's
    // normal: s is the inverse Gudermannian of these.
    let off_zenith = levels.map(|level| {
        if level < 1.0 {
            0.5 * PI - libm::asin(level)
        } else {
            NOWHERE
        }
    });
    both_signs(off_zenith).map(|off_zenith| s_at(plane, 0.5 * PI + off_zenith))
}

/// Bends on both sides of 0.
#[inline(always)]
fn both_signs([a, b, c]: [f64; 3]) -> [f64; BENDS] {
    [a, b, c, -a, -b, -c]
}

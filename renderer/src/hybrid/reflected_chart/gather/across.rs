//! The directions of one s across the columns of patches.

use super::lines::{Line, Lines, OfFour};
use super::{end_of_part, parts, sorted_between};
use crate::hybrid::reflected_chart::integrals::Integrals;
use crate::hybrid::reflected_chart::lit_chart::{RadiantChart, UP_MAX, polynomial};
use crate::hybrid::reflected_chart::window::Window;
use crate::numerics::batch::{FOUR, LANES};
use crate::numerics::tolerance::Tolerance;
use std::f64::consts::PI;

/// Numbers side by side.
type Lanes = [f64; LANES];

/// The chart as a point of the sample sees it.
pub struct ChartFromPoint<'a, const NODES: usize> {
    pub chart: &'a RadiantChart<NODES>,
    /// From the point to the chart's left edge, in metres.
    pub left: f64,
    /// The distance to the chart's plane, and how far up it the nearest point lies.
    pub height: f64,
    pub foot: f64,
    /// The sines of the light's direction at which the integrand bends.
    pub levels: [f64; 3],
    pub window: &'a Window,
    /// The t between which the window lies.
    pub ends: [f64; 2],
    pub tolerance: Tolerance,
}

impl<const NODES: usize> ChartFromPoint<'_, NODES> {
    /// Gathers the directions of some s in a row of patches, the first `count` of four, and the light from them.
    #[inline(always)]
    pub fn gather_lines(
        &self,
        row: u32,
        (s, weights): (&OfFour, &OfFour),
        count: usize,
        integrals: &mut Integrals<'_>,
    ) {
        let lines = Lines::new(&self.chart.plane, [self.height, self.foot], s, &self.levels);
        let up = self.chart.weights_up(row, &lines.height);
        for i in 0..count {
            let across = Across {
                seen: self,
                row,
                line: lines.line(i),
                up: up.map(|up| up[i]),
                weight: weights[i] * lines.cos_gamma[i],
            };
            across.gather(integrals);
        }
    }
}

/// The directions of one s in a row of patches.
struct Across<'a, const NODES: usize> {
    seen: &'a ChartFromPoint<'a, NODES>,
    row: u32,
    line: Line,
    /// The weights of the nodes up the row.
    up: [f64; UP_MAX],
    /// What the rule over s weighs them with.
    weight: f64,
}

/// Intervals of t that follow each other, up to seven.
struct Intervals {
    /// Where they end, from where the first begins.
    t: Lanes,
    /// The column that each lies in.
    columns: [u32; LANES],
    /// How many ends there are.
    count: usize,
}

impl Intervals {
    #[inline(always)]
    fn from(t: f64) -> Self {
        Self {
            t: [t; LANES],
            columns: [0; LANES],
            count: 1,
        }
    }

    /// Where the last one ends.
    #[inline(always)]
    fn end(&self) -> f64 {
        self.t[self.count - 1]
    }

    #[inline(always)]
    fn is_full(&self) -> bool {
        self.count == LANES
    }

    #[inline(always)]
    fn push(&mut self, to: f64, column: u32) {
        self.columns[self.count - 1] = column;
        self.t[self.count..].fill(to);
        self.count += 1;
    }
}

impl<const NODES: usize> Across<'_, NODES> {
    /// Gathers them and the light from them.
    #[inline(always)]
    fn gather(&self, integrals: &mut Integrals<'_>) {
        let (plane, per_reach) = (&self.seen.chart.plane, 1.0 / self.line.reach);
        let t_of = |column: f64| exp_asinh((self.seen.left + column * plane.pitch) * per_reach);
        let [low, high] = self.seen.ends;
        let (left, right) = (t_of(0.0), t_of(f64::from(plane.columns)));
        let ends = [left.max(low), right.min(high)];
        if ends[0] >= ends[1] {
            return;
        }
        let (bends, count) = sorted_between(ends, &self.line.bends);
        let mut bends = bends[..count].iter().copied().peekable();
        let mut intervals = Intervals::from(ends[0]);
        for first in (0..plane.columns).step_by(LANES) {
            let mut edges = [0.0; LANES];
            for i in 0..LANES {
                edges[i] = t_of(f64::from(first) + (i + 1) as f64);
            }
            for (column, edge) in (first..plane.columns).zip(edges) {
                let edge = edge.min(high);
                while intervals.end() < edge {
                    if intervals.is_full() {
                        self.add(&intervals, integrals);
                        intervals = Intervals::from(intervals.end());
                    }
                    let to = bends.next_if(|bend| *bend < edge).unwrap_or(edge);
                    intervals.push(to, column);
                }
            }
        }
        self.add(&intervals, integrals);
    }

    /// Adds intervals.
    #[inline(always)]
    fn add(&self, intervals: &Intervals, integrals: &mut Integrals<'_>) {
        let (widths, more) = self.lengths(&intervals.t);
        let mut light = None;
        for (index, ends) in intervals.t[..intervals.count].windows(2).enumerate() {
            let column = intervals.columns[index];
            let of_column = match light {
                Some((known, light)) if known == column => light,
                _ => self.seen.chart.radiance_across(column, self.row, &self.up),
            };
            light = Some((column, of_column));
            let [from, to] = [ends[0], ends[1]];
            let (parts, rule) = parts(
                widths[index],
                more[index],
                self.seen.tolerance,
                self.seen.window.is_ridge(),
            );
            let mut low = from;
            for part in 0..parts {
                let high = end_of_part([from, to], part, parts);
                for (t, weight, count) in rule.fours_on(low, high) {
                    let points = self.points(column, &of_column, &t, &weight);
                    integrals.push_of_four(points, count);
                }
                low = high;
            }
        }
    }

    /// Four points of a column, with the light of its nodes.
    #[inline(always)]
    fn points(
        &self,
        column: u32,
        light: &[[f64; 3]; NODES],
        t: &[f64; FOUR],
        weight: &[f64; FOUR],
    ) -> [[f64; FOUR]; 6] {
        let (line, plane) = (&self.line, &self.seen.chart.plane);
        let (half_reach, per_pitch) = (0.5 * line.reach / plane.pitch, 1.0 / plane.pitch);
        let along = (self.seen.left + f64::from(column) * plane.pitch) * per_pitch;
        let mut points = [[0.0; FOUR]; 6];
        for i in 0..FOUR {
            let t2 = t[i] * t[i];
            // One division for both quotients.
            let inverse = 1.0 / (t[i] * (1.0 + t2));
            let share = t[i] * inverse;
            let cos = 2.0 * t[i] * share;
            let position = half_reach * ((t2 - 1.0) * (1.0 + t2) * inverse) - along;
            let weight = self.weight * weight[i] * 2.0 * cos * share;
            let [r, g, b] = polynomial(light, position).map(|light| weight * light);
            let sin = (t2 - 1.0) * share;
            let point = [sin, cos * line.cos, cos * line.sin, r, g, b];
            for (column, value) in points.iter_mut().zip(point) {
                column[i] = value;
            }
        }
        points
    }

    /// How many widths of the lobe each interval is long, and how many points it takes more, next to where the
    /// integrand has poles.
    #[inline(always)]
    fn lengths(&self, t: &Lanes) -> (Lanes, Lanes) {
        let [mut root, mut sines] = [[0.0; LANES]; 2];
        for i in 0..LANES {
            root[i] = t[i].sqrt();
            sines[i] = sine(t[i]);
        }
        let (to, next_root, next_sine) = (following(t), following(&root), following(&sines));
        let [mut widths, mut more] = [[0.0; LANES]; 2];
        for i in 0..LANES {
            more[i] = self
                .seen
                .tolerance
                .more_beside((to[i] - t[i]) / (root[i] * next_root[i]));
        }
        let across = [self.line.cos, self.line.sin];
        if let Some(per_angle) = self.seen.window.widths_sideways(&sines, across) {
            let next = following(&per_angle);
            for i in 0..LANES {
                widths[i] = angle(t[i], to[i]) * per_angle[i].max(next[i]);
            }
        } else {
            for i in 0..LANES {
                widths[i] = (next_sine[i] - sines[i]) / self.seen.window.width[0];
            }
        }
        (widths, more)
    }
}

/// What follows each number; the last one follows itself.
#[inline(always)]
fn following(numbers: &Lanes) -> Lanes {
    let [_, b, c, d, e, f, g, h] = *numbers;
    [b, c, d, e, f, g, h, h]
}

/// About the angle from a t to a larger one, and never less: t is the tangent of a half and of an eighth of a turn.
#[inline(always)]
fn angle(from: f64, to: f64) -> f64 {
    let tangent = (to - from) / (1.0 + from * to);
    (2.0 * tangent).min(PI)
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
    // One division for both: of two arms that divide the compiler makes a branch.
    let above = if x < 0.0 { 1.0 } else { sum };
    let below = if x < 0.0 { sum } else { 1.0 };
    above / below
}

/// The t of directions of this sine, -1 to 1, from the plane across x.
#[inline(always)]
pub fn t_at_sine(sine: f64) -> f64 {
    ((1.0 + sine) / (1.0 - sine)).sqrt()
}

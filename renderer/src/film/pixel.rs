//! One pixel of a function that is not smooth on it: nested adaptive quadrature.

#[cfg(test)]
mod tests;

use super::edge::{Edge, OnPixel, StraightEdge, Turned};
use super::interval::{Interval, Rule};
use crate::numerics::channels::add_scaled;
use crate::numerics::gauss::KRONROD;
use crate::numerics::polygon::{Polygon, Rectangle};
use std::cell::Cell;

/// Halvings of a line across a pixel: edges of 1/4,000 of a pixel are resolved.
const HALVINGS_MAX: u32 = 12;

/// The most points of a line across a pixel: what is left out then shows in the error. Enough for two
/// edges of 1/4,000 of a pixel.
const LINE_POINTS_MAX: u64 = 780;

/// The first lines over a pixel may take this many times the work after which none are added: an edge
/// along them is followed to its end before another line tells anything. Chosen.
const FIRST_LINES: u64 = 4;

/// Halvings of the interval that lines are spread over.
const SPREAD_HALVINGS_MAX: u32 = 6;

/// Over lines, whose integrals have kinks where the corners of a feature lie, 15 points are off by up to
/// this many times what null rules show (found by trying).
const KINKS: f64 = 3.0;

/// Lines over less than this share of the band about an edge begin with the short rule. Chosen.
const MUCH_OF_BAND: f64 = 0.5;

/// The pieces of a line with an edge, and their points: 15 within each and those between them.
const EDGE_PIECES: usize = 3;
const EDGE_LINE_POINTS: u64 = (EDGE_PIECES * (KRONROD.len() + 1) + 1) as u64;

/// What the integral over a pixel may take.
pub struct Work {
    pub points_max: u64,
    pub evaluations_max: u64,
}

/// The integral of `function` over a polygon no larger than a pixel and its estimated error, to
/// `tolerance` if it can be had. Lines run along `axis`, which should be the one along which the function
/// changes faster. After so much `work` no more lines are added, and the first lines together take at most
/// [`FIRST_LINES`] times as much, or 17 points each: what is left out then shows in the error.
pub fn integrate(
    polygon: &Polygon,
    axis: usize,
    tolerance: f64,
    work: &Work,
    function: impl OnPixel,
) -> ([f64; 3], f64) {
    if polygon.is_empty() {
        return ([0.0; 3], 0.0);
    }
    let lines = Lines {
        function,
        polygon,
        axis,
        band: None,
        tolerance,
        spent: Spent::on(work),
    };
    match StraightEdge::of(&lines.function, polygon, axis) {
        Some(edge) => lines.along(edge, &edge.turned(polygon)).integral(),
        None => lines.integral(),
    }
}

/// What the lines over a pixel took, and may take.
struct Spent<'a> {
    evaluations: Cell<u64>,
    work: &'a Work,
    line_points_max: u64,
}

impl<'a> Spent<'a> {
    fn on(work: &'a Work) -> Self {
        let of_one = FIRST_LINES * work.points_max / KRONROD.len() as u64;
        Self {
            evaluations: Cell::new(0),
            work,
            line_points_max: of_one.min(LINE_POINTS_MAX),
        }
    }

    /// Whether a line may take so many points.
    fn leaves_line(&self, points: u64) -> bool {
        let evaluations_max = FIRST_LINES.saturating_mul(self.work.evaluations_max);
        points <= self.line_points_max && self.evaluations.get() < evaluations_max
    }

    /// Whether there may be more lines than those with so many points.
    fn leaves_more(&self, points: u64) -> bool {
        points < self.work.points_max && self.evaluations.get() < self.work.evaluations_max
    }
}

/// The lines over a pixel.
struct Lines<'a, F> {
    function: F,
    polygon: &'a Polygon,
    axis: usize,
    /// Two lines, if the function is known to change between them: beyond them it changes little from line to line, and
    /// along none of them much.
    band: Option<[f64; 2]>,
    /// Of the whole integral. A line gets half of it.
    tolerance: f64,
    spent: Spent<'a>,
}

impl<'a, F: OnPixel> Lines<'a, F> {
    /// Lines along an edge, over the polygon as seen along it.
    fn along(self, edge: StraightEdge, turned: &'a Polygon) -> Lines<'a, Turned<F>> {
        Lines {
            function: Turned {
                function: self.function,
                edge,
            },
            polygon: turned,
            axis: Turned::<F>::ALONG,
            band: Some(edge.band()),
            tolerance: self.tolerance,
            spent: self.spent,
        }
    }

    /// The integral over the polygon, and its error.
    fn integral(mut self) -> ([f64; 3], f64) {
        let breaks = self.breaks();
        let per_length = match breaks[..] {
            [first, .., last] => 1.0 / (last - first),
            _ => return ([0.0; 3], 0.0),
        };
        let (mut total, mut error) = ([0.0; 3], 0.0);
        let mut points = 0u64;
        let mut open = self.intervals(&breaks);
        while let Some(interval) = open.pop() {
            let mut line_error = 0.0;
            let integral = interval.integral(|at, weight| {
                let line = self.line(at);
                line_error += weight * line.missed;
                points += line.points;
                line.value
            });
            let missed = KINKS * integral.missed;
            let share = (interval.high - interval.low) * per_length;
            let has_more = self.spent.leaves_more(points);
            if missed > self.tolerance * share && interval.depth < SPREAD_HALVINGS_MAX && has_more {
                open.extend(interval.finer(&integral));
                continue;
            }
            add_scaled(&mut total, integral.value, 1.0);
            error += line_error + missed;
        }
        (total, error)
    }

    /// The intervals between some places.
    fn intervals(&mut self, places: &[f64]) -> Vec<Interval> {
        let mut ends = Vec::with_capacity(places.len());
        ends.extend(places.iter().map(|&at| (at, self.line(at).value)));
        let interval = |pair: &[(f64, [f64; 3])]| {
            let [(low, first), (high, last)] = [pair[0], pair[1]];
            Interval {
                low,
                high,
                ends: [first, last],
                depth: 0,
                rule: self.rule_over([low, high]),
            }
        };
        ends.windows(2).map(interval).collect()
    }

    /// Places between which the integrals along lines change smoothly: the polygon's corners, where an edge crosses a
    /// side of its box across the lines, and the sides of the band.
    fn breaks(&self) -> Vec<f64> {
        let (axis, across) = (self.axis, 1 - self.axis);
        let corners = self.polygon.corners().iter();
        let mut breaks: Vec<f64> = corners.map(|corner| corner[across]).collect();
        let Rectangle { low, high } = self.polygon.bounds();
        let crossed = [low, high].map(|end| {
            let between = [low[across], high[across]];
            self.edge(across, end[axis], between)
        });
        breaks.extend(crossed.iter().flatten().map(|edge| edge.at));
        let band = self.band.into_iter().flatten();
        breaks.extend(band.filter(|&at| low[across] < at && at < high[across]));
        breaks.sort_unstable_by(f64::total_cmp);
        breaks.dedup();
        breaks
    }

    /// The rule that is tried first over lines from one to another.
    fn rule_over(&self, [from, to]: [f64; 2]) -> Rule {
        let shared = |[low, high]: [f64; 2]| (to.min(high) - from.max(low)) / (high - low);
        match self.band {
            Some(band) if shared(band) < MUCH_OF_BAND => Rule::Short,
            _ => Rule::Full,
        }
    }

    /// A narrow edge on a line along `axis`, if a line about an edge may take its points.
    fn edge(&self, axis: usize, across: f64, between: [f64; 2]) -> Option<Edge> {
        if !self.spent.leaves_line(EDGE_LINE_POINTS) {
            return None;
        }
        let edge = self.function.edge(axis, across, between)?;
        edge.is_narrow(between).then_some(edge)
    }

    /// The integral along the line at a coordinate.
    fn line(&mut self, at: f64) -> Line {
        let Some([from, to]) = self.polygon.chord(1 - self.axis, at) else {
            return Line::default();
        };
        let edge = self.edge(self.axis, at, [from, to]);
        let (function, spent, axis) = (&mut self.function, &self.spent, self.axis);
        let along = |position: f64| {
            let mut film_point = [at; 2];
            film_point[axis] = position;
            let (value, evaluations) = function.at(film_point);
            let before = spent.evaluations.get();
            spent.evaluations.set(before + evaluations);
            value
        };
        let may_halve = |points| spent.leaves_line(points);
        let rule = match self.band {
            Some(_) => Rule::Short,
            None => Rule::Full,
        };
        line_integral(
            along,
            [from, to],
            (edge, rule),
            0.5 * self.tolerance,
            may_halve,
        )
    }
}

/// The integral along a line.
#[derive(Default)]
struct Line {
    value: [f64; 3],
    /// What it may be off by.
    missed: f64,
    /// Points that it took.
    points: u64,
}

/// The integral along a line by halving where 7 and 15 points disagree, and their disagreement. It is
/// parted about a known edge first. It takes 17 points, or those about an edge, and more as long as
/// `may_halve` says so of how many they would become.
fn line_integral(
    mut function: impl FnMut(f64) -> [f64; 3],
    [from, to]: [f64; 2],
    (edge, rule): (Option<Edge>, Rule),
    tolerance: f64,
    may_halve: impl Fn(u64) -> bool,
) -> Line {
    let mut open = Vec::with_capacity(EDGE_PIECES);
    let (mut low, mut at_low) = (from, function(from));
    let parts = edge.into_iter().flat_map(|edge| edge.parts([from, to]));
    for high in parts.chain([to]) {
        let at_high = function(high);
        open.push(Interval {
            low,
            high,
            ends: [at_low, at_high],
            depth: 0,
            rule,
        });
        (low, at_low) = (high, at_high);
    }
    let mut line = Line {
        points: open.len() as u64 * (rule.points() + 1) + 1,
        ..Line::default()
    };
    while let Some(interval) = open.pop() {
        let integral = interval.integral(|at, _| function(at));
        let points = line.points + interval.points_of_finer();
        if integral.missed > tolerance && interval.depth < HALVINGS_MAX && may_halve(points) {
            line.points = points;
            open.extend(interval.finer(&integral));
            continue;
        }
        add_scaled(&mut line.value, integral.value, 1.0);
        line.missed += integral.missed;
    }
    line
}

//! Interreflection: what sample and colour chart send each other.
//!
//! Order k is the light that reaches the chart after k reflections. Order 1 goes from the bulb off
//! the sample to the chart. Order 2 goes from the bulb off the chart and the sample. Each further
//! order is the one two below it, sent off the chart and the sample once more: one linear operator
//! makes all of them, and its matrix is worked out once ([`higher`]).
//!
//! Irradiance on the chart is a smooth function of the position. It is interpolated on tiles that
//! span a and ln(1 + b/gap), because it changes fastest near the sample. Every value is an integral
//! over the sample ([`sample_rule`], [`transfer`]). A tile's error has two parts: what its series
//! leaves out, and what the rules miss against finer ones at several nodes, the worst of them.
//!
//! What a narrow lobe can send to the chart is bounded first ([`bound`]). If the bound is a small
//! share of the tolerance, nothing is worked out and the bound is added to the stated error. If the
//! bound is large and no rule resolves the lobe, the answer is [`Unresolved`].

mod bound;
mod higher;
mod order_1;
mod sample_rule;
mod sources;
mod surface;
mod transfer;

use super::Stage;
use super::chebyshev::{Tile, add_scaled};
use super::panel::PanelOnFilm;
use super::polygon::Rectangle;
use super::slopes::Fineness;
use crate::reflectance::Reflectance;
use crate::vector::Vec3;
use bound::{Bounds, form_factor_max};
use higher::Higher;
use sample_rule::SampleFrame;
use surface::Surface;
use transfer::Receiver;

/// The least scale of the tiles' logarithmic coordinate, as a share of the sample's side. It only
/// spreads the nodes and approximates nothing.
const SCALE_MIN: f64 = 5e-3;

/// The shares of the chart's tolerance that order 1 and all higher orders may miss. The rest is
/// left to the chart's tiles on the film.
const ORDER_1_SHARE: f64 = 0.8;
const HIGHER_SHARE: f64 = 0.4;

/// The share of the chart's tolerance below which a bound stands for the light itself.
const LEFT_OUT_SHARE: f64 = 0.05;

/// Of an error that is allowed, the share that the rules over the sample may miss; the rest is left
/// to the series.
const RULE_SHARE: f64 = 0.4;

/// Decimal digits of the rules over the sample, from coarse to fine. The finest is only for
/// comparison.
const DIGITS: [f64; 7] = [2.0, 2.7, 3.5, 4.5, 6.0, 8.0, 10.0];

/// Evaluations of the reflectance for order 1, and for the higher ones: about a tenth of a second.
const EVALUATIONS_MAX: u64 = 6_000_000;

/// A rule is taken not to resolve the lobe if the next finer one moves the result by more than this
/// share of it.
const UNRESOLVED_SHARE: f64 = 0.25;

/// Light that no rule resolves, but that is below this much of white at every node that was tried, is
/// stated as an error: the path tracer's own is as large.
const UNRESOLVED_MAX: f64 = 2e-3;

/// The error to state for such light, twice what it and its rules' differences come to.
///
/// # Errors
/// When it is brighter: the path tracer renders such a view.
fn unresolved_error(largest: f64, missed: f64) -> Result<f64, Unresolved> {
    if largest + missed > UNRESOLVED_MAX {
        return Err(Unresolved);
    }
    Ok(2.0 * (largest + missed))
}

/// Terms of the series for order 1, and for the higher orders.
const ORDER_1_TERMS: usize = 8;
const HIGHER_TERMS: usize = 8;

/// Interreflection that no rule over the sample resolves: a lobe so narrow that it throws a caustic
/// on the chart.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the lobe is too narrow to work out what the sample sends to the chart")]
pub struct Unresolved;

/// Irradiance over pi on the chart, in units of white, by light that was off the sample before.
#[derive(Debug)]
pub struct Interreflection {
    order_1: Vec<Tile<ORDER_1_TERMS>>,
    /// The orders from 2 on that a path of `max_bounces` hits takes, and one of a hit less.
    higher: Option<[Tile<HIGHER_TERMS>; 2]>,
    /// A bound of what the sum is off by.
    error: f64,
    evaluations: u64,
    gap: f64,
    /// The chart on the tiles.
    bounds: Rectangle,
    bounces_max: u32,
}

impl Interreflection {
    /// Works out all orders that paths of the view's `max_bounces` hits take. It does not depend on
    /// the camera.
    pub(in crate::hybrid) fn new(
        stage: &Stage,
        panel: &PanelOnFilm,
        reflectance: &Reflectance,
    ) -> Result<Self, Unresolved> {
        let frame = Frame::new(stage, panel, reflectance);
        let mut found = Self {
            order_1: Vec::new(),
            higher: None,
            error: 0.0,
            evaluations: 0,
            gap: frame.gap,
            bounds: frame.bounds(),
            bounces_max: stage.bounces_max,
        };
        let form_factor = form_factor_max(&panel.panel);
        if stage.bounces_max < 2 || form_factor <= 0.0 {
            return Ok(found);
        }
        let tolerance = frame.tolerance(&found.bounds);
        let left_out = LEFT_OUT_SHARE * tolerance;
        let bounds = Bounds::new(&frame, reflectance);
        let mut order_1_max = bounds.order_1;
        if bounds.order_1 <= left_out {
            found.error += bounds.order_1;
        } else {
            let order_1 = order_1::solve(&frame, ORDER_1_SHARE)?;
            order_1_max = order_1.largest + order_1.error;
            found.error += order_1.error;
            found.evaluations += order_1.evaluations;
            found.order_1 = order_1.tiles;
        }
        if stage.bounces_max < 3 {
            return Ok(found);
        }
        // The sum of a geometric series in steps of two orders.
        let reflected = bounds.transfer * frame.reflectance_max();
        let most = reflected * (frame.direct_max() + order_1_max) / (1.0 - reflected);
        if most <= left_out {
            found.error += most;
            return Ok(found);
        }
        let allowed = HIGHER_SHARE * tolerance;
        let higher = Higher::solve(&frame, allowed, |at| found.order_1_at(frame.place(at)))?;
        // An error of order 1 comes back in the orders above it.
        found.error = (found.error + higher.error) / (1.0 - reflected);
        found.evaluations += higher.evaluations;
        found.higher = Some(higher.tiles);
        Ok(found)
    }

    /// How many evaluations it took.
    pub fn evaluations(&self) -> u64 {
        self.evaluations
    }

    /// How far [`Interreflection::on_chart`] may be off.
    pub fn error(&self) -> f64 {
        self.error
    }

    /// What reaches the chart at (a, b) before it goes to the camera.
    pub fn on_chart(&self, at: [f64; 2]) -> [f64; 3] {
        self.sum(at, self.bounces_max, 0)
    }

    /// What reaches it before it goes to the camera off the sample, one hit more.
    pub fn on_chart_for_sample(&self, at: [f64; 2]) -> [f64; 3] {
        self.sum(at, self.bounces_max - 1, 1)
    }

    fn sum(&self, at: [f64; 2], bounces_max: u32, which: usize) -> [f64; 3] {
        let at = place(at, self.gap);
        let mut sum = [0.0; 3];
        if bounces_max > 1 {
            sum = self.order_1_at(at);
        }
        if let Some(higher) = &self.higher {
            let Rectangle { low, high } = self.bounds;
            let at = std::array::from_fn(|axis| at[axis].clamp(low[axis], high[axis]));
            add_scaled(&mut sum, higher[which].value(at), 1.0);
        }
        sum.map(|channel| channel.max(0.0))
    }

    fn order_1_at(&self, at: [f64; 2]) -> [f64; 3] {
        let Rectangle { low, high } = self.bounds;
        // Rounding can lead off the chart.
        let at: [f64; 2] = std::array::from_fn(|axis| at[axis].clamp(low[axis], high[axis]));
        let holds = |tile: &&Tile<ORDER_1_TERMS>| {
            let Rectangle { low, high } = tile.rectangle;
            (0..2).all(|axis| at[axis] >= low[axis] && at[axis] <= high[axis])
        };
        let tile = self.order_1.iter().find(holds);
        tile.map_or([0.0; 3], |tile| tile.value(at))
    }
}

/// The position on the tiles of (a, b).
fn place([a, b]: [f64; 2], gap: f64) -> [f64; 2] {
    [a, libm::log1p(b.max(0.0) / gap)]
}

/// Decimal digits as an argument of [`Fineness`].
fn fineness(level: usize) -> Fineness {
    Fineness::new(libm::exp10(-DIGITS[level.min(DIGITS.len() - 1)]))
}

/// The levels of [`DIGITS`] that have a finer one to compare with.
const LEVEL_MAX: usize = DIGITS.len() - 2;

/// Sample and chart, with the material in the sample's frame.
pub(in crate::hybrid) struct Frame<'a> {
    stage: &'a Stage,
    panel: &'a PanelOnFilm,
    gap: f64,
    sample: SampleFrame,
    surface: Surface,
}

impl<'a> Frame<'a> {
    fn new(stage: &'a Stage, panel: &'a PanelOnFilm, reflectance: &Reflectance) -> Self {
        let half = stage.sample_half;
        let sample = SampleFrame::new(half, &reflectance.lobe);
        Self {
            stage,
            panel,
            gap: (panel.panel.corner.y - half).max(2.0 * SCALE_MIN * half),
            surface: Surface::new(reflectance, sample.u_axis),
            sample,
        }
    }

    /// All of the chart on the tiles.
    fn bounds(&self) -> Rectangle {
        let [width, height] = self.panel.panel.size();
        let [_, top] = self.place([0.0, height]);
        Rectangle {
            low: [0.0; 2],
            high: [width, top],
        }
    }

    fn place(&self, at: [f64; 2]) -> [f64; 2] {
        place(at, self.gap)
    }

    /// The point of the world at a position on the tiles.
    fn point(&self, [a, s]: [f64; 2]) -> Vec3 {
        self.panel.panel.point(a, self.gap * libm::expm1(s))
    }

    /// The same as a receiver in the sample's frame.
    fn receiver(&self, at: [f64; 2]) -> Receiver {
        Receiver {
            position: self.sample.to_frame(self.point(at)),
            normal: self.sample.to_frame(self.panel.panel.z),
        }
    }

    /// The tolerance of the irradiance over pi where the bulb lights a part of the chart least.
    fn tolerance(&self, part: &Rectangle) -> f64 {
        let Rectangle { low, high } = part;
        let up = |s: f64| self.gap * libm::expm1(s);
        let corners = [
            [low[0], up(low[1])],
            [high[0], up(low[1])],
            [low[0], up(high[1])],
            [high[0], up(high[1])],
        ];
        let least = corners
            .map(|at| self.stage.bulb_on_chart(self.panel, at))
            .into_iter()
            .fold(f64::INFINITY, f64::min);
        let accuracy = &self.stage.chart_accuracy;
        accuracy.absolute.max(accuracy.relative * least)
    }

    /// The largest irradiance over pi by the bulb itself: at most that of a surface which faces the
    /// bulb at the chart's nearest point.
    fn direct_max(&self) -> f64 {
        let panel = &self.panel.panel;
        let [width, height] = panel.size();
        let offset = self.stage.bulb_centre - panel.corner;
        let a = offset.dot(panel.x).clamp(0.0, width);
        let b = offset.dot(panel.y).clamp(0.0, height);
        let distance2 = (self.stage.bulb_centre - panel.point(a, b)).length_squared();
        let radius = self.stage.bulb_radius;
        self.stage.bulb_radiance * (radius * radius / distance2).min(1.0)
    }

    /// The largest reflectance of a patch.
    fn reflectance_max(&self) -> f64 {
        let channels = self.panel.patches.iter().flatten();
        channels.copied().fold(0.0, f64::max)
    }
}

/// The nodes of a square grid at which rules are compared with finer ones: its corners and its
/// middle.
fn compared(terms: usize) -> [usize; 5] {
    let (middle, last) = (terms / 2, terms - 1);
    let at = |column: usize, row: usize| row * terms + column;
    [
        at(0, 0),
        at(last, 0),
        at(0, last),
        at(last, last),
        at(middle, middle),
    ]
}

/// The largest channel.
fn largest(value: [f64; 3]) -> f64 {
    value[0].max(value[1]).max(value[2])
}

#[cfg(test)]
mod tests;

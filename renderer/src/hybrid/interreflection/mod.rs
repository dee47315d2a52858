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
//! leaves out, and what the rules miss against finer ones, at the worst of several points.
//!
//! What a narrow lobe can send to the chart is bounded first ([`bound`]). If the bound is a small
//! share of the tolerance, nothing is worked out and the bound is added to the stated error. If the
//! bound is large and no rule resolves the lobe, or the coarsest ones take too much, the answer is
//! [`Unresolved`].
//!
//! A material may also be worked out like another: on the same tiles and by the same rules. Then the
//! light is as smooth a function of the material as the rules are, which differences need.

mod bound;
mod bulb;
mod bulb_arcs;
mod bulb_transfer;
pub mod cache;
mod chart_transfer;
mod frame;
mod higher;
mod levels;
mod matrix;
mod order_1;
mod ridge;
mod sample_rule;
mod sources;
mod surface;
mod tiles;
mod transfer;
mod unresolved;

use super::budget::interreflection::{HIGHER_SHARE, LEFT_OUT_SHARE, ORDER_1_SHARE};
use super::chart_on_film::ChartOnFilm;
use super::view::View;
use crate::film::demand::FunctionError;
use crate::numerics::channels::add_scaled;
use crate::numerics::polygon::Rectangle;
use crate::reflectance::Reflectance;
use bound::{Bounds, form_factor_max};
use frame::{Frame, tile_position};
use higher::Higher;
use order_1::Order1;
pub use unresolved::Unresolved;

/// Irradiance over pi on the chart, in units of white, by light that was off the sample before.
#[derive(Debug)]
pub struct Interreflection {
    /// `None` where it is too dark to be worked out.
    order_1: Option<Order1>,
    /// The orders from 2 on; `None` where they are too dark to be worked out.
    higher: Option<Higher>,
    /// A bound of what the sum is off by.
    error: f64,
    /// The least irradiance over pi on the chart by the bulb itself.
    direct_least: f64,
    evaluations: u64,
    gap: f64,
    /// The chart on the tiles.
    bounds: Rectangle,
    bounces_max: u32,
}

impl Interreflection {
    /// Works out all orders that paths of the view's `max_bounces` hits take. It does not depend on
    /// the camera.
    pub(super) fn new(
        view: &View,
        chart: &ChartOnFilm,
        reflectance: &Reflectance,
    ) -> Result<Self, Unresolved> {
        let frame = Frame::new(view, chart, reflectance);
        Self::solve(&frame, reflectance, None)
    }

    /// The same for a material beside another, on the tiles and by the rules of that. They are taken to miss as much.
    pub(super) fn like(
        (like, of): (&Self, &Reflectance),
        view: &View,
        chart: &ChartOnFilm,
        reflectance: &Reflectance,
    ) -> Result<Self, Unresolved> {
        let frame = Frame::like(of, view, chart, reflectance);
        Self::solve(&frame, reflectance, Some(like))
    }

    fn solve(
        frame: &Frame<'_>,
        reflectance: &Reflectance,
        like: Option<&Self>,
    ) -> Result<Self, Unresolved> {
        let (view, chart) = (frame.view, frame.chart);
        let mut found = Self {
            order_1: None,
            higher: None,
            error: 0.0,
            direct_least: frame.direct_least(&frame.bounds()),
            evaluations: 0,
            gap: frame.gap,
            bounds: frame.bounds(),
            bounces_max: view.bounces_max,
        };
        let form_factor = form_factor_max(&chart.plane);
        if view.bounces_max < 2 || form_factor <= 0.0 {
            return Ok(found);
        }
        let tolerance = frame.tolerance(&found.bounds);
        let left_out = LEFT_OUT_SHARE * tolerance;
        let bounds = Bounds::new(frame, reflectance, tolerance);
        let reflected = bounds.transfer * frame.reflectance_max();
        // An error of one order comes back in the orders above it: a geometric series in steps of two.
        let once = match view.bounces_max {
            2 => 1.0,
            _ => 1.0 - reflected,
        };
        let mut order_1_max = bounds.order_1;
        let is_dark = |bound: f64, worked_out: Option<bool>| {
            match worked_out {
                None => bound <= left_out,
                // What was too dark there may not be here.
                Some(false) => bound <= tolerance,
                Some(true) => false,
            }
        };
        if is_dark(bounds.order_1, like.map(|like| like.order_1.is_some())) {
            found.error += bounds.order_1;
        } else {
            let order_1 = match like.and_then(|like| like.order_1.as_ref()) {
                Some(like) => order_1::solve_like(frame, like),
                None => order_1::solve(frame, once * ORDER_1_SHARE)?,
            };
            order_1_max = order_1.largest + order_1.tiles.error();
            found.error += order_1.tiles.error();
            found.evaluations += order_1.evaluations;
            found.order_1 = Some(order_1);
        }
        if view.bounces_max < 3 {
            return Ok(found);
        }
        let most = reflected * (frame.direct_max() + order_1_max) / once;
        if is_dark(most, like.map(|like| like.higher.is_some())) {
            found.error += most;
            return Ok(found);
        }
        let order_1 = |at| found.order_1(frame.on_tiles(at));
        let higher = match like.and_then(|like| like.higher.as_ref()) {
            Some(like) => Higher::solve_like(frame, like, order_1),
            None => Higher::solve(frame, once * HIGHER_SHARE, order_1)?,
        };
        found.error = (found.error + higher.tiles[0].error()) / once;
        found.evaluations += higher.evaluations;
        found.higher = Some(higher);
        Ok(found)
    }

    /// Order 1 at a position on the tiles.
    fn order_1(&self, at: [f64; 2]) -> [f64; 3] {
        let order_1 = self.order_1.as_ref();
        order_1.map_or([0.0; 3], |order_1| order_1.tiles.value(at))
    }

    /// How many evaluations it took.
    pub fn evaluations(&self) -> u64 {
        self.evaluations
    }

    /// The scale in metres of heights above the sample over which the light changes: the distance from
    /// sample to chart, or a small share of the sample's side where that is more.
    pub fn gap(&self) -> f64 {
        self.gap
    }

    /// How far [`Interreflection::on_chart`] may be off, and what reflects it.
    ///
    /// The light on the chart is off by at most this share of itself everywhere. So is what a patch or the
    /// sample reflects of it; and neither reflects more than it receives. Where the bulb does not light all
    /// of the chart the share is no number, and only the second holds.
    pub(super) fn function_error(&self) -> FunctionError {
        FunctionError {
            absolute: self.error,
            relative: self.error / self.direct_least,
        }
    }

    /// The same on a part of the chart, from (a, b) at its low corner to the high one; everywhere for `None`.
    ///
    /// What the tiles are off by stays where it is, but for what comes back in the orders above: of that the bound
    /// is one for all of the chart.
    pub(super) fn function_error_on(&self, part: Option<Rectangle>) -> FunctionError {
        let less = part.map_or(0.0, |Rectangle { low, high }| {
            let [low, high] = [low, high].map(|at| tile_position(at, self.gap));
            let part = Rectangle { low, high };
            let order_1 = self.order_1.as_ref().map(|order_1| &order_1.tiles);
            let higher = self.higher.as_ref().map(|higher| &higher.tiles[0]);
            let all = order_1.into_iter().chain(higher);
            all.map(|tiles| tiles.error() - tiles.error_on(&part)).sum()
        });
        let error = self.error - less;
        FunctionError {
            absolute: error,
            relative: error / self.direct_least,
        }
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
        let at = self.bounds.nearest(tile_position(at, self.gap));
        let mut sum = [0.0; 3];
        if bounces_max > 1 {
            sum = self.order_1(at);
        }
        if let Some(higher) = &self.higher {
            add_scaled(&mut sum, higher.tiles[which].value(at), 1.0);
        }
        sum.map(|channel| channel.max(0.0))
    }
}

#[cfg(test)]
mod tests;

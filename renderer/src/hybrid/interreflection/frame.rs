//! Sample and chart in the frame in which the sample's lines run along u.

use super::bulb::Bulb;
use super::sample_rule::SampleFrame;
use super::surface::Surface;
use super::transfer::Receiver;
use crate::hybrid::chart_on_film::ChartOnFilm;
use crate::hybrid::view::View;
use crate::numerics::elementary::log1p;
use crate::numerics::polygon::Rectangle;
use crate::reflectance::Reflectance;
use crate::vector::Vec3;

/// The least scale of the tiles' logarithmic coordinate, as a share of the sample's side. It only
/// spreads the nodes and approximates nothing.
const SCALE_MIN: f64 = 5e-3;

/// Sample and chart, with the material in the sample's frame.
pub struct Frame<'a> {
    /// The view.
    pub view: &'a View,
    /// The chart.
    pub chart: &'a ChartOnFilm,
    /// The scale of the tiles' logarithmic coordinate: the distance from sample to chart.
    pub gap: f64,
    /// The sample.
    pub sample: SampleFrame,
    /// Its material.
    pub surface: Surface,
}

impl<'a> Frame<'a> {
    /// The frame of a view, its chart and a material.
    pub fn new(view: &'a View, chart: &'a ChartOnFilm, reflectance: &Reflectance) -> Self {
        let sample = SampleFrame::new(view.sample_half, reflectance, view.instructions);
        Self::of(sample, view, chart, reflectance)
    }

    /// The same with the rules over the sample that a material like it has.
    pub fn like(
        like: &Reflectance,
        view: &'a View,
        chart: &'a ChartOnFilm,
        reflectance: &Reflectance,
    ) -> Self {
        let sample = SampleFrame::new(view.sample_half, like, view.instructions);
        Self::of(sample.turned_to(reflectance), view, chart, reflectance)
    }

    fn of(
        sample: SampleFrame,
        view: &'a View,
        chart: &'a ChartOnFilm,
        reflectance: &Reflectance,
    ) -> Self {
        let half = view.sample_half;
        Self {
            view,
            chart,
            gap: (chart.plane.corner.y - half).max(2.0 * SCALE_MIN * half),
            surface: Surface::new(reflectance, sample.u_axis),
            sample,
        }
    }

    /// All of the chart on the tiles.
    pub fn bounds(&self) -> Rectangle {
        let [width, height] = self.chart.plane.size();
        let [_, top] = self.tile_position([0.0, height]);
        Rectangle {
            low: [0.0; 2],
            high: [width, top],
        }
    }

    /// The position on the tiles of (a, b).
    pub fn tile_position(&self, at: [f64; 2]) -> [f64; 2] {
        tile_position(at, self.gap)
    }

    /// The same for a point of the chart: rounding can lead off it.
    pub fn on_tiles(&self, at: [f64; 2]) -> [f64; 2] {
        self.bounds().nearest(self.tile_position(at))
    }

    /// The point of the world at a position on the tiles.
    pub fn point(&self, [a, s]: [f64; 2]) -> Vec3 {
        self.chart.plane.point(a, self.gap * libm::expm1(s))
    }

    /// The same as a receiver in the sample's frame.
    pub fn receiver(&self, at: [f64; 2]) -> Receiver {
        Receiver {
            position: self.sample.to_frame(self.point(at)),
            normal: self.sample.to_frame(self.chart.plane.z),
        }
    }

    /// The bulb in the sample's frame.
    pub fn bulb(&self) -> Bulb {
        let bulb = &self.view.bulb;
        let [cos, sin] = self.sample.u_axis;
        Bulb {
            centre: self.sample.to_frame(bulb.centre),
            radius: bulb.radius,
            radiance: bulb.radiance,
            x_axis: [cos, -sin],
        }
    }

    /// The tolerance of the irradiance over pi where the bulb lights a part of the chart least.
    pub fn tolerance(&self, part: &Rectangle) -> f64 {
        let accuracy = &self.view.budget.chart;
        let relative = accuracy.relative * self.direct_least(part);
        accuracy.absolute.max(relative)
    }

    /// The least irradiance over pi by the bulb itself on a part of the chart: that of a corner, because it
    /// falls with the distance from the foot of the bulb's perpendicular.
    pub fn direct_least(&self, part: &Rectangle) -> f64 {
        let Rectangle { low, high } = part;
        let up = |s: f64| self.gap * libm::expm1(s);
        let corners = [
            [low[0], up(low[1])],
            [high[0], up(low[1])],
            [low[0], up(high[1])],
            [high[0], up(high[1])],
        ];
        let lights = corners.map(|at| self.view.bulb_on_chart(&self.chart.plane, at));
        lights.into_iter().fold(f64::INFINITY, f64::min)
    }

    /// The largest irradiance over pi by the bulb itself: at most that of a surface which faces the
    /// bulb at the chart's nearest point.
    pub fn direct_max(&self) -> f64 {
        let plane = &self.chart.plane;
        let [width, height] = plane.size();
        let offset = self.view.bulb.centre - plane.corner;
        let a = offset.dot(plane.x).clamp(0.0, width);
        let b = offset.dot(plane.y).clamp(0.0, height);
        let distance2 = (self.view.bulb.centre - plane.point(a, b)).length_squared();
        let radius = self.view.bulb.radius;
        self.view.bulb.radiance * (radius * radius / distance2).min(1.0)
    }

    /// The largest reflectance of a patch.
    pub fn reflectance_max(&self) -> f64 {
        let channels = self.chart.patches.iter().flatten();
        channels.copied().fold(0.0, f64::max)
    }
}

/// The position on the tiles of (a, b).
pub fn tile_position([a, b]: [f64; 2], gap: f64) -> [f64; 2] {
    [a, log1p(b.max(0.0) / gap)]
}

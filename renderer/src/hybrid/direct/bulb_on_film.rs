//! The bulb's light off the sample, as a function of the film.

use super::bulb::SlopeBatch;
use super::bulb_light::{BulbLight, bulb_view};
use super::bulb_view::BulbView;
use crate::film::log_tile::TintedLog;
use crate::film::log_tiling::LogShade;
use crate::film::tiling::Edge;
use crate::film::tiling::Shade;
use crate::hybrid::budget::direct::{CURVATURE_MAX, DARK_EXPONENT, EDGE_WIDTHS};
use crate::hybrid::view::View;
use crate::numerics::polygon::Rectangle;
use crate::numerics::tolerance::Tolerance;
use crate::reflectance::Reflectance;
use crate::vector::Vec3;
use std::f64::consts::PI;

/// Slopes over a rectangle lie in the box of those at its corners, widened by this many times what
/// its middle is off the corners' mean. For a parabola it is 1.
const CURVATURE: f64 = 2.0;

/// The bulb's half extent in slopes is taken this much larger than at corners and middle.
const BULB_MARGIN: f64 = 1.1;

/// How many widths an edge may be misplaced. Chosen.
const EDGE_OFF: f64 = 0.1;

/// Steps toward an edge, at most: a limit on work. Along a pixel one takes two or three.
const EDGE_STEPS_MAX: u32 = 16;

/// An edge's slope is looked at over this share of a line to either side.
const SLOPE_STEP: f64 = 1e-3;

/// The bulb's light off the sample.
pub struct BulbOffSample<'a> {
    pub view: &'a View,
    pub reflectance: &'a Reflectance,
}

impl Shade for BulbOffSample<'_> {
    type Scratch = SlopeBatch;

    fn at(
        &self,
        scratch: &mut SlopeBatch,
        film_point: [f64; 2],
        tolerance: Tolerance,
    ) -> ([f64; 3], u32) {
        if self.is_dark(film_point) {
            return ([0.0; 3], 1);
        }
        let (position, wo) = self.view.sample_point(film_point);
        let (light, spent) = self.light(position, wo, tolerance, scratch);
        let scale = libm::exp(light.log);
        (light.tint.map(|channel| scale * channel), spent)
    }

    /// The edge of the bulb's image, as wide as the lobe.
    fn edge(&self, axis: usize, across: f64, [from, to]: [f64; 2]) -> Option<Edge> {
        let outside = |at: f64| {
            let mut film_point = [across; 2];
            film_point[axis] = at;
            let view = self.bulb_from(film_point);
            view.widths_outside(&self.reflectance.lobe)
        };
        let at = zero(outside, [from, to])?;
        let step = SLOPE_STEP * (to - from);
        let slope = (outside(at + step) - outside(at - step)) / (2.0 * step);
        let width = 1.0 / slope.abs();
        width.is_finite().then_some(Edge { at, width })
    }
}

impl LogShade for BulbOffSample<'_> {
    type Scratch = SlopeBatch;

    fn at(
        &self,
        scratch: &mut SlopeBatch,
        film_point: [f64; 2],
        tolerance: Tolerance,
    ) -> (TintedLog, u32) {
        let (position, wo) = self.view.sample_point(film_point);
        self.light(position, wo, tolerance, scratch)
    }

    /// The lobe's integral over the bulb by the least exponent on it, for the whole rectangle.
    fn most(&self, rectangle: &Rectangle) -> f64 {
        let radiance = self.view.bulb.radiance;
        if self.reflectance.specular_share < 1.0 {
            return radiance;
        }
        let [low, high] = [rectangle.low, rectangle.high];
        let corners = [low, [high[0], low[1]], high, [low[0], high[1]]];
        let corners = corners.map(|corner| self.bulb_box(corner));
        let middle = self.bulb_box([0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1])]);
        let largest = |axis: usize| {
            let half = corners.iter().map(|corner| corner.half[axis]);
            half.fold(middle.half[axis], f64::max)
        };
        let half = [largest(0), largest(1)];
        let mut near = [0.0; 2];
        let mut far = [0.0; 2];
        for axis in 0..2 {
            let at = corners.map(|corner| corner.centre[axis]);
            let low = at.into_iter().fold(middle.centre[axis], f64::min);
            let high = at.into_iter().fold(middle.centre[axis], f64::max);
            let mean = 0.25 * ((at[0] + at[1]) + (at[2] + at[3]));
            let bent = (middle.centre[axis] - mean).abs();
            if bent > CURVATURE_MAX * (high - low) || half[axis].is_nan() {
                return radiance;
            }
            let margin = CURVATURE * bent + BULB_MARGIN * half[axis];
            let (low, high) = (low - margin, high + margin);
            near[axis] = 0f64.clamp(low, high);
            far[axis] = low.abs().max(high.abs());
        }
        let lobe = &self.reflectance.lobe;
        let t = far[0] * far[0] + far[1] * far[1];
        let flat = if t > 0.0 { libm::log1p(t) / t } else { 1.0 };
        let form = lobe.n_u * near[0] * near[0] + lobe.n_v * near[1] * near[1];
        let area = 4.0 * half[0] * half[1];
        // The lobe's integral is 1, and its part beyond an exponent x is at most exp(-x).
        let share = (lobe.normalization / (2.0 * PI) * area).min(1.0);
        radiance * share * libm::exp(-0.5 * form * flat)
    }

    /// The edge of the bulb's image is as wide as the lobe. It runs through a rectangle whose corners
    /// see the lobe's centre on and off the bulb.
    fn edge_along(&self, rectangle: &Rectangle) -> Option<usize> {
        let [low, high] = [rectangle.low, rectangle.high];
        let corners = [low, [high[0], low[1]], high, [low[0], high[1]]];
        let corners = corners.map(|corner| self.bulb_box(corner));
        let on = corners.map(|SlopeBox { centre, half }| {
            let [p, q] = [centre[0] / half[0], centre[1] / half[1]];
            p * p + q * q < 1.0
        });
        if on.iter().all(|&on| on) || on.iter().all(|&on| !on) {
            return None;
        }
        let lobe = &self.reflectance.lobe;
        let widths = |a: &SlopeBox, b: &SlopeBox| {
            let (p, q) = (a.centre[0] - b.centre[0], a.centre[1] - b.centre[1]);
            (lobe.n_u * p * p + lobe.n_v * q * q).sqrt()
        };
        let across = widths(&corners[0], &corners[1]);
        let along = widths(&corners[0], &corners[3]);
        (across.max(along) > EDGE_WIDTHS).then_some(usize::from(along > across))
    }
}

/// A box in the slope plane around the half vectors that see the bulb.
#[derive(Clone, Copy)]
struct SlopeBox {
    centre: [f64; 2],
    half: [f64; 2],
}

impl BulbOffSample<'_> {
    /// The bulb's light off the sample at `position` toward `wo`, and evaluations spent.
    fn light(
        &self,
        position: Vec3,
        wo: Vec3,
        tolerance: Tolerance,
        batch: &mut SlopeBatch,
    ) -> (TintedLog, u32) {
        let to_bulb = self.view.bulb.centre - position;
        let light = BulbLight {
            reflectance: self.reflectance,
            radius: self.view.bulb.radius,
            radiance: self.view.bulb.radiance,
            tolerance,
            instructions: self.view.instructions,
        };
        light.toward(wo, to_bulb, batch)
    }

    /// Whether nothing of the lobe lies on the bulb. The lobe's integral is 1, and its part beyond an exponent x is at
    /// most exp(-x).
    fn is_dark(&self, film_point: [f64; 2]) -> bool {
        if self.reflectance.specular_share < 1.0 {
            return false;
        }
        let SlopeBox { centre, half } = self.bulb_box(film_point);
        let [near, far] = [-1.0, 1.0]
            .map(|side| [0, 1].map(|axis| (centre[axis].abs() + side * half[axis]).max(0.0)));
        let lobe = &self.reflectance.lobe;
        let t = far[0] * far[0] + far[1] * far[1];
        let flat = if t > 0.0 { libm::log1p(t) / t } else { 1.0 };
        let form = lobe.n_u * near[0] * near[0] + lobe.n_v * near[1] * near[1];
        0.5 * form * flat > DARK_EXPONENT
    }

    fn bulb_box(&self, film_point: [f64; 2]) -> SlopeBox {
        let [centre, half] = self.bulb_from(film_point).slopes();
        SlopeBox { centre, half }
    }

    /// The bulb and the viewer from what a point of the film sees.
    fn bulb_from(&self, film_point: [f64; 2]) -> BulbView {
        let (position, wo) = self.view.sample_point(film_point);
        let bulb = &self.view.bulb;
        bulb_view(
            &self.reflectance.lobe,
            wo,
            bulb.centre - position,
            bulb.radius,
        )
    }
}

/// Where a function of one coordinate changes its sign once between two places, to [`EDGE_OFF`] of its value; `None`
/// where it has the same sign at both.
///
/// By false position, in which the end that stays counts by half (the Illinois algorithm).
fn zero(function: impl Fn(f64) -> f64, [from, to]: [f64; 2]) -> Option<f64> {
    let (mut low, mut high) = ((from, function(from)), (to, function(to)));
    if (low.1 > 0.0) == (high.1 > 0.0) {
        return None;
    }
    for _ in 0..EDGE_STEPS_MAX {
        let share = low.1 / (low.1 - high.1);
        let at = low.0 + share * (high.0 - low.0);
        let value = function(at);
        if value.abs() <= EDGE_OFF {
            return Some(at);
        }
        if (value > 0.0) == (low.1 > 0.0) {
            (low, high.1) = ((at, value), 0.5 * high.1);
        } else {
            (high, low.1) = ((at, value), 0.5 * low.1);
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::BackendChoice;
    use crate::hybrid::PreparedView;
    use crate::scene::Scene;
    use dataset::Specification;

    /// The edges of the bulb's image in a material, across pixels of every eighth row and column: what shows four
    /// widths to the darker side of each, at it, and to the brighter side.
    fn lights_at_edges(material: u32, view: usize) -> Vec<[f64; 3]> {
        let specification = Specification::preset();
        let material = specification.material(material).material;
        let scene = Scene::new(&specification, view, BackendChoice::Native)
            .expect("a backend")
            .expect("a scene");
        let rotation = specification.views[view].rotation_deg;
        let reflectance = Reflectance::new(&material, rotation, specification.tint);
        let PreparedView { view, .. } =
            PreparedView::new(&scene, &specification).expect("a view for hybrid");
        let shade = BulbOffSample {
            view: &view,
            reflectance: &reflectance,
        };
        let (rule, mut scratch) = (view.budget.bulb_linear_rule(), SlopeBatch::default());
        let mut lights = Vec::new();
        for line in 0..16 * 128 * 2 {
            let (axis, line) = (line % 2, line / 2);
            let across = 8.0 * f64::from(line / 128) + 0.3;
            let from = f64::from(line % 128);
            let Some(Edge { at, width }) = shade.edge(axis as usize, across, [from, from + 1.0])
            else {
                continue;
            };
            let mut light = [-4.0, 0.0, 4.0].map(|widths| {
                let mut film_point = [across; 2];
                film_point[axis as usize] = at + widths * width;
                Shade::at(&shade, &mut scratch, film_point, rule).0[0]
            });
            if light[2] < light[0] {
                light.reverse();
            }
            lights.push(light);
        }
        lights
    }

    #[test]
    fn light_rises_over_an_edge() {
        // A mirror in both axes: half of the lobe is on the bulb at the edge.
        for view in [0, 3] {
            let lights = lights_at_edges(928, view);
            assert!(lights.len() > 5, "{view}: {}", lights.len());
            for [dark, at_edge, bright] in lights {
                assert!(dark < 1e-3 * bright, "{dark} {bright}");
                let share = at_edge / bright;
                assert!((0.4..0.6).contains(&share), "{share}");
            }
        }
        // A mirror in one: the image begins like a root.
        for material in [416, 1952] {
            for view in [0, 3] {
                let lights = lights_at_edges(material, view);
                assert!(lights.len() > 30, "{material} {view}: {}", lights.len());
                for [dark, at_edge, bright] in lights {
                    assert!(dark < 1e-3 * bright, "{dark} {bright}");
                    let share = at_edge / bright;
                    assert!((0.1..0.5).contains(&share), "{share}");
                }
            }
        }
    }
}

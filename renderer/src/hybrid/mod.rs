//! The hybrid integrator: nothing is traced that can be worked out.
//!
//! A scene of a flat sample, a bulb and a chart in front of which the bulb stands has no shadows.
//! So the bulb's light off the sample is a cubature over the bulb (`direct`), the bulb's light on
//! the chart a closed form, what the chart sends to the sample a cubature over its patches
//! (`reflected_chart`), and what the sample sends to the chart one over the sample
//! (`interreflection`). Each is a smooth function of the film, or one with edges at known scales,
//! and pixels are its integrals (`crate::film::tiling`).
//!
//! A view that is not of this kind goes to the path tracer: see [`PreparedView::new`].

mod budget;
mod chart_itself;
mod chart_on_film;
pub(crate) mod direct;
mod finer_view;
pub(crate) mod interreflection;
#[cfg(test)]
mod kinks;
mod reflected_chart;
mod view;

use crate::film::canvas::Canvas;
use crate::film::{Film, FilmPixel};
use crate::numerics::instructions::Instructions;
use crate::phase_time::{PhaseTime, timed};
use crate::reflectance::Reflectance;
use crate::scene::{Bulb, ChartPlane, Scene};
use crate::vector::Vec3;
use chart_on_film::ChartOnFilm;
use dataset::specification::Specification;
pub use interreflection::{Interreflection, Unresolved};
use view::View;

/// A view that the hybrid integrator can render.
#[derive(Debug)]
pub struct PreparedView {
    view: View,
    chart: Option<ChartOnFilm>,
}

impl PreparedView {
    /// Prepares a view; `None` where the hybrid integrator cannot render it: the sample is curved, the
    /// sample or the chart reaches behind the camera, the camera sees the bulb itself, or the bulb stands between chart
    /// and sample.
    pub fn new(scene: &Scene, specification: &Specification) -> Option<Self> {
        if !specification.sample.shape.is_square() {
            return None;
        }
        if scene.camera.may_see(scene.bulb.centre, scene.bulb.radius) {
            return None;
        }
        let view = View::new(scene, specification)?;
        let chart = match &scene.chart {
            None => None,
            Some(chart) => Some(ChartOnFilm::new(chart, &scene.camera, view.size)?),
        };
        if let Some(chart) = &chart
            && !stands_clear(&scene.bulb, view.sample_half, &chart.plane)
        {
            return None;
        }
        Some(Self { view, chart })
    }

    /// The same on another instruction set: the same bits, sooner or later.
    pub fn with_instructions(mut self, instructions: Instructions) -> Self {
        self.view.instructions = instructions;
        self
    }

    /// What sample and chart send each other: the same for all views with one light and one rotation of
    /// the sample. `None` for a view without chart.
    ///
    /// # Errors
    /// When the lobe is too narrow for it to be worked out. The path tracer renders such a view.
    pub fn interreflection(
        &self,
        reflectance: &Reflectance,
    ) -> Result<Option<Interreflection>, Unresolved> {
        self.chart
            .as_ref()
            .map(|chart| Interreflection::new(&self.view, chart, reflectance))
            .transpose()
    }

    /// The same on the tiles and by the rules of another material's, where reflectance and rotation are `of`'s.
    ///
    /// # Errors
    /// None that [`PreparedView::interreflection`] has not had for the other.
    pub fn interreflection_like(
        &self,
        (like, of): (&Interreflection, &Reflectance),
        reflectance: &Reflectance,
    ) -> Result<Option<Interreflection>, Unresolved> {
        let chart = self.chart.as_ref();
        chart
            .map(|chart| Interreflection::like((like, of), &self.view, chart, reflectance))
            .transpose()
    }

    /// Renders the view, counts evaluations of the reflectance, and times the phases.
    /// `interreflection` is that of [`PreparedView::interreflection`]; if it is not at hand it is worked
    /// out as a phase.
    ///
    /// # Errors
    /// Those of [`PreparedView::interreflection`].
    pub fn render(
        &self,
        reflectance: &Reflectance,
        interreflection: Option<&Interreflection>,
    ) -> Result<(Film, u64, Vec<PhaseTime>), Unresolved> {
        let [width, height] = self.view.size;
        let mut pixels = vec![FilmPixel::default(); width as usize * height as usize];
        let mut canvas = Canvas {
            width,
            height,
            pixels: &mut pixels,
        };
        let mut phases = Vec::new();
        let mut evaluations = timed(&mut phases, "bulb", || {
            direct::add(&self.view, &mut canvas, reflectance)
        });
        if let Some(chart) = &self.chart {
            let mut own = None;
            let interreflection = match interreflection {
                Some(interreflection) => interreflection,
                None => timed(&mut phases, "interreflection", || {
                    Interreflection::new(&self.view, chart, reflectance)
                        .map(|made| own.insert(made))
                })?,
            };
            // Counted with every view, so that an image's label does not tell what was at hand.
            evaluations += interreflection.evaluations();
            timed(&mut phases, "chart", || {
                chart_itself::add(&self.view, &mut canvas, chart, interreflection);
            });
            if self.view.bounces_max > 1 {
                evaluations += timed(&mut phases, "reflected chart", || {
                    reflected_chart::add(
                        &self.view,
                        &mut canvas,
                        chart,
                        interreflection,
                        reflectance,
                    )
                });
            }
        }
        for pixel in &mut pixels {
            // A series that interpolates darkness swings about it, within its bound.
            pixel.value = pixel.value.map(|channel| channel.max(0.0));
            if pixel.error > 0.0 {
                let least = self.view.budget.stated_least(pixel.value);
                pixel.error = pixel.error.max(least);
            }
        }
        let film = Film {
            width,
            height,
            pixels,
        };
        Ok((film, evaluations, phases))
    }
}

/// Whether the bulb stands beyond every line between a sample of half side `half` and the chart.
///
/// All of them lie below the plane through the sample's far edge and the chart's upper one, which
/// both run along x, as seen from the side where the bulb stands in front of the chart.
fn stands_clear(bulb: &Bulb, half: f64, plane: &ChartPlane) -> bool {
    let far = Vec3::new(0.0, -half, 0.0);
    let [_, height] = plane.size();
    let rise = plane.point(0.0, height) - far;
    let upward = Vec3::new(0.0, -rise.z, rise.y);
    upward.dot(bulb.centre - far) > bulb.radius * upward.length()
}

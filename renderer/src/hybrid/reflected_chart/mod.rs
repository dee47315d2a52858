//! The colour chart in the sample.

mod gather;
pub mod glossy;
pub mod lit_chart;
mod wide;
mod window;

use super::budget::{
    TILING, edged_tile_pixels, glossy as glossy_budget, is_glossy, reflected_chart,
};
use super::chart_on_film::ChartOnFilm;
use super::interreflection::Interreflection;
use super::view::View;
use crate::film::canvas::Canvas;
use crate::film::tiling::{Demand, Region, Shade, integrate};
use crate::numerics::channels::largest_difference;
use crate::numerics::tolerance::Tolerance;
use crate::reflectance::Reflectance;
use glossy::GlossyChart;
use lit_chart::LitChart;
use wide::ChartOffWideLobe;

/// Adds the chart in the sample to the film; returns evaluations.
pub fn add(
    view: &View,
    canvas: &mut Canvas<'_>,
    chart: &ChartOnFilm,
    interreflection: &Interreflection,
    reflectance: &Reflectance,
) -> u64 {
    // Only the bulb's own light can need smaller parts: what the sample sends is a few hundredths
    // of it, and its part shows in `light_error`.
    let parts = LitChart::parts(chart, view.budget.parabolas(), |at| {
        [view.bulb_on_chart(&chart.plane, at); 3]
    });
    let irradiance = |at: [f64; 2]| {
        let direct = view.bulb_on_chart(&chart.plane, at);
        interreflection
            .on_chart_for_sample(at)
            .map(|channel| channel + direct)
    };
    let lit = LitChart::new(chart, parts, irradiance);
    let finer = LitChart::new(chart, 2 * parts, irradiance);
    let add = if is_glossy(reflectance) {
        add_glossy
    } else {
        add_wide
    };
    // A sample reflects at most all of the light that it receives.
    let error = interreflection.error();
    add(view, canvas, [&lit, &finer], error, reflectance)
}

/// Adds the chart off a lobe that is not glossy; returns evaluations.
fn add_wide(
    view: &View,
    canvas: &mut Canvas<'_>,
    [chart, finer]: [&LitChart; 2],
    function_error: f64,
    reflectance: &Reflectance,
) -> u64 {
    let demand = Demand {
        accuracy: &view.budget.chart,
        faint: view.budget.chart.absolute,
        side_max: view.budget.wide_tile * edge_pixels(view, chart, reflectance),
        evaluations_max: view.evaluations_max(reflected_chart::LIMIT),
        tolerance: view.budget.wide_rule,
        function_error,
        shares: TILING,
    };
    let shade = ChartOffWideLobe {
        view,
        chart,
        finer,
        reflectance,
    };
    integrate(canvas, &view.sample, &[whole(view)], &demand, &shade)
}

/// Adds the chart off a glossy lobe; returns evaluations.
fn add_glossy(
    view: &View,
    canvas: &mut Canvas<'_>,
    charts: [&LitChart; 2],
    function_error: f64,
    reflectance: &Reflectance,
) -> u64 {
    let demand = Demand {
        accuracy: &view.budget.chart,
        faint: view.budget.chart.absolute,
        side_max: glossy_budget::TILE * edge_pixels(view, charts[0], reflectance),
        evaluations_max: view.evaluations_max(glossy_budget::LIMIT),
        tolerance: view.budget.glossy_rule,
        function_error,
        shares: TILING,
    };
    let [chart, finer] =
        charts.map(|chart| GlossyChart::new(chart, reflectance, view.instructions));
    let shade = ChartOffGlossyLobe {
        view,
        chart: &chart,
        finer: &finer,
    };
    integrate(canvas, &view.sample, &[whole(view)], &demand, &shade)
}

/// All of the sample.
fn whole(view: &View) -> Region {
    Region {
        outline: view.sample,
        factor: [1.0; 3],
    }
}

/// The length in pixels of a tile at whose nodes the blurred edge of a patch shows.
fn edge_pixels(view: &View, chart: &LitChart, reflectance: &Reflectance) -> f64 {
    let [_, height] = chart.plane.size();
    let distance = 0.5 * (chart.plane.corner.y.abs() + height);
    let blur = (1.0 / reflectance.lobe.n_u).sqrt();
    edged_tile_pixels(view.slope_pixels(blur, distance))
}

/// The chart off a glossy lobe.
struct ChartOffGlossyLobe<'a> {
    view: &'a View,
    chart: &'a GlossyChart<'a>,
    /// The same with the chart in smaller parts.
    finer: &'a GlossyChart<'a>,
}

impl Shade for ChartOffGlossyLobe<'_> {
    type Scratch = glossy::Scratch;

    fn at(
        &self,
        scratch: &mut glossy::Scratch,
        film_point: [f64; 2],
        tolerance: Tolerance,
    ) -> ([f64; 3], u32) {
        let (position, wo) = self.view.sample_point(film_point);
        self.chart.reflected(position, wo, tolerance, scratch)
    }

    fn light_error(
        &self,
        scratch: &mut glossy::Scratch,
        film_point: [f64; 2],
        tolerance: Tolerance,
    ) -> (f64, u32) {
        let (position, wo) = self.view.sample_point(film_point);
        let [(coarse, first), (fine, second)] =
            [self.chart, self.finer].map(|chart| chart.reflected(position, wo, tolerance, scratch));
        (largest_difference(coarse, fine), first + second)
    }
}

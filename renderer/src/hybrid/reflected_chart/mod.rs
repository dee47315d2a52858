//! The colour chart in the sample.

pub mod anisotropic;
mod gather;
pub mod glossy;
pub mod lit_chart;
mod smooth;
mod window;

use super::chart_on_film::PanelOnFilm;
use super::interreflection::Interreflection;
use super::view::{
    CHART_EVALUATIONS_MIN, EVALUATIONS_PER_PIXEL, GLOSSY_EVALUATIONS_MIN,
    GLOSSY_EVALUATIONS_PER_PIXEL, GLOSSY_TILE, View,
};
use crate::film::canvas::Canvas;
use crate::film::tiling::{self, Demand, Region, Shade};
use crate::numerics::channels::largest_difference;
use crate::numerics::tolerance::Fineness;
use crate::reflectance::Reflectance;
use anisotropic::GlossyChart;
use glossy::MirroredChart;
use lit_chart::LitChart;
use smooth::ChartOffSample;

/// The chart's reflection is at least so much of white where its relative target counts.
const FAINT_CHART: f64 = 0.1;

/// Adds the chart in the sample to the film; returns evaluations.
pub fn add(
    view: &View,
    canvas: &mut Canvas<'_>,
    panel: &PanelOnFilm,
    interreflection: &Interreflection,
    reflectance: &Reflectance,
    key: u64,
) -> u64 {
    // Only the bulb's own light can need smaller parts: what the sample sends is a few hundredths
    // of it, and its part shows in `light_error`.
    let least = view.chart_accuracy.absolute;
    let allowed = least.max(view.chart_accuracy.relative * FAINT_CHART);
    let (parts, missed) = LitChart::parts(panel, allowed, |at| {
        [view.bulb_on_chart(&panel.panel, at); 3]
    });
    let irradiance = |at: [f64; 2]| {
        let direct = view.bulb_on_chart(&panel.panel, at);
        interreflection
            .on_chart_for_sample(at)
            .map(|channel| channel + direct)
    };
    let chart = LitChart::new(panel, parts, irradiance);
    if !anisotropic::wanted(reflectance) && glossy::wanted(reflectance) {
        let chart_error = interreflection.error() + missed;
        return add_mirrored(view, canvas, &chart, chart_error, reflectance, key);
    }
    let finer = LitChart::new(panel, 2 * parts, irradiance);
    let [_, height] = panel.panel.size();
    let distance = 0.5 * (panel.panel.corner.y.abs() + height);
    let feature = view.feature_pixels(0.0, distance, reflectance);
    let mut demand = Demand {
        accuracy: &view.chart_accuracy,
        faint: view.chart_accuracy.absolute,
        // What is as fine as the blur of a patch's edge shows at a tile's nodes.
        side_max: view.chart_tile * feature,
        evaluations_max: view.evaluations_max(EVALUATIONS_PER_PIXEL, CHART_EVALUATIONS_MIN),
        fineness: view.chart_fineness,
        // A sample reflects at most all of the light that it receives.
        function_error: interreflection.error(),
    };
    let regions = [Region {
        outline: view.sample,
        factor: [1.0; 3],
    }];
    if anisotropic::wanted(reflectance) {
        demand.side_max = GLOSSY_TILE * feature;
        demand.evaluations_max =
            view.evaluations_max(GLOSSY_EVALUATIONS_PER_PIXEL, GLOSSY_EVALUATIONS_MIN);
        demand.fineness = view.glossy_fineness;
        let glossy =
            [&chart, &finer].map(|chart| GlossyChart::new(chart, reflectance, view.instructions));
        let shade = ChartOffGlossySample {
            view,
            glossy: &glossy[0],
            finer: &glossy[1],
        };
        return tiling::integrate(canvas, &view.sample, &regions, &demand, &shade);
    }
    let shade = ChartOffSample {
        view,
        chart: &chart,
        finer: &finer,
        reflectance,
    };
    tiling::integrate(canvas, &view.sample, &regions, &demand, &shade)
}

/// The chart, known to `chart_error`, in a smooth sample; returns evaluations.
fn add_mirrored(
    view: &View,
    canvas: &mut Canvas<'_>,
    chart: &LitChart,
    chart_error: f64,
    reflectance: &Reflectance,
    key: u64,
) -> u64 {
    let Some(bounds) = view.sample.bounds().intersection(&canvas.bounds()) else {
        return 0;
    };
    let bounds = bounds.rounded_out();
    let mirrored = MirroredChart {
        chart,
        reflectance,
        camera: &view.camera,
        outline: &view.sample,
        accuracy: &view.chart_accuracy,
        key,
        instructions: view.instructions,
    };
    let (pixels, evaluations) = mirrored.render(&bounds, |column, row| canvas.value((column, row)));
    for (place, pixel) in bounds.pixels().zip(pixels) {
        // A mirror passes on what its chart is off by, where it shows anything of it.
        let shown = pixel.value.iter().any(|&channel| channel > 0.0);
        let inherited = if shown { chart_error } else { 0.0 };
        canvas.add(place, pixel.value, pixel.error + inherited);
    }
    evaluations
}

/// The chart in a sample of a narrow lobe.
struct ChartOffGlossySample<'a> {
    view: &'a View,
    glossy: &'a GlossyChart<'a>,
    /// The same with the chart in smaller parts.
    finer: &'a GlossyChart<'a>,
}

impl Shade for ChartOffGlossySample<'_> {
    type Scratch = anisotropic::Scratch;

    fn at(
        &self,
        scratch: &mut anisotropic::Scratch,
        place: [f64; 2],
        fineness: Fineness,
    ) -> ([f64; 3], u32) {
        let (position, wo) = self.view.sample_point(place);
        self.glossy.reflected(position, wo, fineness, scratch)
    }

    fn light_error(
        &self,
        scratch: &mut anisotropic::Scratch,
        place: [f64; 2],
        fineness: Fineness,
    ) -> (f64, u32) {
        let (position, wo) = self.view.sample_point(place);
        let [(coarse, first), (fine, second)] = [self.glossy, self.finer]
            .map(|glossy| glossy.reflected(position, wo, fineness, scratch));
        (largest_difference(coarse, fine), first + second)
    }
}

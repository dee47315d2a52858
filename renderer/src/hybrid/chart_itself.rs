//! The colour chart that the camera sees: a closed form by the bulb, and a series by interreflection.

use super::chart_on_film::PanelOnFilm;
use super::interreflection::Interreflection;
use super::view::{CHART_EVALUATIONS_MIN, EVALUATIONS_PER_PIXEL, View};
use crate::film::canvas::Canvas;
use crate::film::tiling::{Demand, Region, Shade, integrate};
use crate::numerics::tolerance::Fineness;

/// Adds the chart itself to the film.
pub fn add(
    view: &View,
    canvas: &mut Canvas<'_>,
    panel: &PanelOnFilm,
    interreflection: &Interreflection,
) {
    let regions: Vec<Region> = panel
        .regions(&view.camera)
        .filter(|region| {
            region
                .outline
                .bounds()
                .intersection(&canvas.bounds())
                .is_some()
        })
        .collect();
    let demand = Demand {
        accuracy: &view.chart_accuracy,
        faint: view.chart_accuracy.absolute,
        side_max: f64::from(view.size[0]),
        evaluations_max: view.evaluations_max(EVALUATIONS_PER_PIXEL, CHART_EVALUATIONS_MIN),
        fineness: view.chart_fineness,
        function_error: interreflection.error(),
    };
    let shade = ChartItself {
        view,
        panel,
        interreflection,
    };
    integrate(canvas, &panel.outline, &regions, &demand, &shade);
}

/// The chart itself, but for the reflectance of its patches.
struct ChartItself<'a> {
    view: &'a View,
    panel: &'a PanelOnFilm,
    interreflection: &'a Interreflection,
}

impl Shade for ChartItself<'_> {
    type Scratch = ();

    fn at(&self, (): &mut (), [column, row]: [f64; 2], _: Fineness) -> ([f64; 3], u32) {
        let ray = self.view.camera.ray(column, row);
        let panel = &self.panel.panel;
        // Nodes of a tile can lie beyond the panel's vanishing line.
        let at = panel.meet(ray.origin, ray.direction).unwrap_or([0.0; 2]);
        let direct = self.view.bulb_on_chart(panel, at);
        let indirect = self.interreflection.on_chart(at);
        (indirect.map(|channel| channel + direct), 0)
    }
}

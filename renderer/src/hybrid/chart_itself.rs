//! The colour chart that the camera sees: a closed form by the bulb, and a series by interreflection.

use super::budget::interreflection::{HIGHER_SHARE, ORDER_1_SHARE};
use super::budget::reflected_chart;
use super::chart_on_film::ChartOnFilm;
use super::interreflection::Interreflection;
use super::view::View;
use crate::film::canvas::Canvas;
use crate::film::demand::{Demand, FunctionError};
use crate::film::region::Region;
use crate::film::tiling::{Shade, integrate};
use crate::numerics::polygon::Rectangle;
use crate::numerics::tolerance::Tolerance;

/// Adds the chart itself to the film.
pub fn add(
    view: &View,
    canvas: &mut Canvas<'_>,
    chart: &ChartOnFilm,
    interreflection: &Interreflection,
) {
    let regions: Vec<Region<'_>> = chart
        .regions(&view.camera)
        .filter(|region| {
            region
                .outline
                .bounds()
                .intersection(&canvas.bounds())
                .is_some()
        })
        .collect();
    let function_error = interreflection.function_error();
    let accuracy = view
        .budget
        .chart_beside(function_error, reflected_chart::SHARE_LEAST_STRAIGHT);
    let demand = Demand {
        accuracy: &accuracy,
        faint: view.budget.chart.absolute,
        terms: view.budget.smooth_terms(),
        side_max: f64::from(view.size[0]),
        feature: None,
        evaluations_max: view.evaluations_max(reflected_chart::LIMIT),
        tolerance: view.budget.wide_rule,
        shares: view.budget.tiling(),
        instructions: view.instructions,
    };
    // Within its share of the target it takes nothing from the tiles, on whatever part of the chart.
    let share = ORDER_1_SHARE + HIGHER_SHARE;
    let everywhere =
        (function_error.absolute <= share * view.budget.chart.absolute).then_some(function_error);
    let shade = ChartItself {
        view,
        chart,
        interreflection,
        everywhere,
    };
    integrate(canvas, &chart.outline, &regions, &demand, &shade);
}

/// The chart itself, but for the reflectance of its patches.
struct ChartItself<'a> {
    view: &'a View,
    chart: &'a ChartOnFilm,
    interreflection: &'a Interreflection,
    /// What interreflection may be off by, where that needs no look at the part of the chart.
    everywhere: Option<FunctionError>,
}

impl ChartItself<'_> {
    /// The box on the chart around what a part of the film shows of it; `None` where that reaches beyond its
    /// vanishing line.
    fn on_chart(&self, cell: &Rectangle) -> Option<Rectangle> {
        let mut around = Rectangle {
            low: [f64::INFINITY; 2],
            high: [f64::NEG_INFINITY; 2],
        };
        for [column, row] in cell.corners() {
            let ray = self.view.camera.ray(column, row);
            let at = self.chart.plane.intersect(ray.origin, ray.direction)?;
            for (axis, at) in at.into_iter().enumerate() {
                around.low[axis] = around.low[axis].min(at);
                around.high[axis] = around.high[axis].max(at);
            }
        }
        Some(around)
    }
}

impl Shade for ChartItself<'_> {
    type Scratch = ();

    fn at(&self, (): &mut (), [column, row]: [f64; 2], _: Tolerance) -> ([f64; 3], u32) {
        let ray = self.view.camera.ray(column, row);
        let plane = &self.chart.plane;
        // Nodes of a tile can lie beyond the chart's vanishing line.
        let at = plane
            .intersect(ray.origin, ray.direction)
            .unwrap_or([0.0; 2]);
        let direct = self.view.bulb_on_chart(plane, at);
        let indirect = self.interreflection.on_chart(at);
        (indirect.map(|channel| channel + direct), 0)
    }

    /// Where the sample's sides point at the chart, light off the sample falls within a few pixels. The last terms of a
    /// tile of 20 pixels told a third of what it was off by (draw 525 of seed 20261217 of the search).
    fn is_cheap(&self) -> bool {
        true
    }

    fn function_error(&self, cell: &Rectangle) -> FunctionError {
        self.everywhere
            .unwrap_or_else(|| self.interreflection.function_error_on(self.on_chart(cell)))
    }
}

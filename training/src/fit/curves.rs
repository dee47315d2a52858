//! The log as a plot: every network's excess on the validation split over its epochs.

use super::state::EpochLine;
use crate::error::TrainingError;
use plotters::prelude::*;
use std::collections::BTreeMap;

const SIZE_PIXELS: (u32, u32) = (900, 540);

/// Room above the curves, as a factor.
const ROOM: f64 = 1.05;

/// An SVG file.
pub(super) fn svg(log: &[EpochLine]) -> Result<String, TrainingError> {
    let mut svg = String::new();
    draw(log, &mut svg).map_err(|error| TrainingError::Weights(error.to_string()))?;
    Ok(svg)
}

fn draw(log: &[EpochLine], svg: &mut String) -> Result<(), Box<dyn std::error::Error>> {
    let mut curves: BTreeMap<&str, Vec<(f64, f64)>> = BTreeMap::new();
    for line in log {
        let point = (f64::from(line.epoch), line.excess);
        curves.entry(&line.stage).or_default().push(point);
    }
    let points = || curves.values().flatten();
    let epochs = points().map(|(epoch, _)| *epoch).fold(1.0, f64::max);
    let high = points().map(|(_, excess)| *excess).fold(1e-6, f64::max);
    let area = SVGBackend::with_string(svg, SIZE_PIXELS).into_drawing_area();
    area.fill(&WHITE).map_err(|error| error.to_string())?;
    let mut chart = ChartBuilder::on(&area)
        .margin(12)
        .x_label_area_size(40)
        .y_label_area_size(64)
        .build_cartesian_2d(0.0..epochs, 0.0..high * ROOM)
        .map_err(|error| error.to_string())?;
    chart
        .configure_mesh()
        .light_line_style(TRANSPARENT)
        .x_desc("epoch")
        .y_desc("validation loss less entropy, nats")
        .draw()
        .map_err(|error| error.to_string())?;
    for (number, (stage, points)) in curves.into_iter().enumerate() {
        let colour = Palette99::pick(number).to_rgba();
        chart
            .draw_series(LineSeries::new(points, colour.stroke_width(2)))
            .map_err(|error| error.to_string())?
            .label(stage)
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 20, y)], colour.stroke_width(2)));
    }
    chart
        .configure_series_labels()
        .background_style(WHITE.mix(0.8))
        .draw()
        .map_err(|error| error.to_string())?;
    area.present().map_err(|error| error.to_string())?;
    Ok(())
}

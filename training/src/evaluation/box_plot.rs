//! Errors of estimators beside each other, as the paper's figure 6: boxes from quartile to quartile
//! with the median, whiskers from the 5th to the 95th percentile, on a logarithmic axis.

use super::statistics::quantile;
use crate::error::TrainingError;
use plotters::prelude::*;

const ROW_PIXELS: u32 = 36;
const MARGIN_PIXELS: u32 = 90;
const WIDTH_PIXELS: u32 = 900;

/// Errors below this are drawn here: an image that is equal has an error of 0.
const ERROR_MIN: f64 = 1e-12;

/// Height of a box, rows being 1 apart.
const BOX: f64 = 0.3;

const BOX_COLOUR: RGBColor = RGBColor(76, 114, 176);

/// An SVG file of samples with names, the first at the top.
///
/// # Errors
/// When the plot cannot be drawn.
pub fn svg(samples: &[(String, Vec<f64>)]) -> Result<String, TrainingError> {
    let mut svg = String::new();
    draw(samples, &mut svg).map_err(|error| TrainingError::Weights(error.to_string()))?;
    Ok(svg)
}

fn draw(
    samples: &[(String, Vec<f64>)],
    svg: &mut String,
) -> Result<(), Box<dyn std::error::Error>> {
    let boxes: Vec<[f64; 5]> = samples
        .iter()
        .map(|(_, errors)| {
            let mut sorted = errors.clone();
            sorted.sort_by(f64::total_cmp);
            [0.05, 0.25, 0.5, 0.75, 0.95].map(|at| quantile(&sorted, at).max(ERROR_MIN))
        })
        .collect();
    let low = boxes.iter().map(|five| five[0]).fold(1.0, f64::min);
    let high = boxes.iter().map(|five| five[4]).fold(low, f64::max);
    let rows = samples.len();
    let size = (WIDTH_PIXELS, MARGIN_PIXELS + ROW_PIXELS * rows as u32);
    let area = SVGBackend::with_string(svg, size).into_drawing_area();
    area.fill(&WHITE).map_err(|error| error.to_string())?;
    let mut chart = ChartBuilder::on(&area)
        .margin(12)
        .x_label_area_size(44)
        .y_label_area_size(120)
        .build_cartesian_2d((low / 1.5..high * 1.5).log_scale(), 0.0..rows as f64)
        .map_err(|error| error.to_string())?;
    let name = |place: &f64| {
        let row = rows as f64 - place - 0.5;
        let index = row.round();
        let named = samples
            .get(index as usize)
            .filter(|_| (row - index).abs() < 1e-6);
        named.map_or(String::new(), |(name, _)| name.clone())
    };
    chart
        .configure_mesh()
        .disable_y_mesh()
        .light_line_style(TRANSPARENT)
        .x_desc("mean squared difference of sRGB codes, an image")
        .x_label_formatter(&|error| format!("{error:.0e}"))
        .y_labels(2 * rows + 1)
        .y_label_formatter(&name)
        .draw()
        .map_err(|error| error.to_string())?;
    for (row, [p5, lower, median, upper, p95]) in boxes.into_iter().enumerate() {
        let y = rows as f64 - row as f64 - 0.5;
        let line = |points: Vec<(f64, f64)>, width| {
            PathElement::new(points, BOX_COLOUR.stroke_width(width))
        };
        let frame = Rectangle::new(
            [(lower, y - BOX), (upper, y + BOX)],
            BOX_COLOUR.mix(0.25).filled(),
        );
        chart
            .draw_series([frame])
            .map_err(|error| error.to_string())?;
        let lines = [
            line(vec![(p5, y), (lower, y)], 1),
            line(vec![(upper, y), (p95, y)], 1),
            line(vec![(median, y - BOX), (median, y + BOX)], 3),
        ];
        chart
            .draw_series(lines)
            .map_err(|error| error.to_string())?;
    }
    area.present().map_err(|error| error.to_string())?;
    Ok(())
}

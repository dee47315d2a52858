//! Histograms of the ten parameters, as SVG.

use super::Described;
use crate::error::ExportError;
use dataset::{colour::BIN_RANGES, sobol::DIMENSIONS};
use plotters::prelude::*;

/// The size of the plot.
const SIZE_PIXELS: (u32, u32) = (1200, 520);

/// Bars in a histogram: each is four of the labels' bins.
const BARS: usize = 25;

/// Bins of a label, as [`dataset::colour`] has them.
const BINS: usize = 100;

const BAR_COLOUR: RGBColor = RGBColor(76, 114, 176);

/// What each panel is called, in the order of [`BIN_RANGES`].
const TITLES: [&str; DIMENSIONS] = [
    "roughness (%)",
    "anisotropy",
    "angle (deg)",
    "index of refraction",
    "L* at 0 deg",
    "a* at 0 deg",
    "b* at 0 deg",
    "L* at 90 deg",
    "a* at 90 deg",
    "b* at 90 deg",
];

/// One panel a parameter: how many materials fall into each twenty-fifth of its range.
pub(super) fn parameters(described: &Described<'_>) -> Result<String, ExportError> {
    let specification = described.store.specification();
    let mut counts = [[0u32; BARS]; DIMENSIONS];
    for &material in &described.chosen.materials {
        let bins = specification.material(material).bins();
        for (counts, bin) in counts.iter_mut().zip(bins) {
            counts[usize::from(bin) * BARS / BINS] += 1;
        }
    }
    let mut svg = String::new();
    draw(&counts, &mut svg).map_err(ExportError::encode("a plot"))?;
    Ok(svg)
}

fn draw(
    counts: &[[u32; BARS]; DIMENSIONS],
    svg: &mut String,
) -> Result<(), Box<dyn std::error::Error>> {
    let area = SVGBackend::with_string(svg, SIZE_PIXELS).into_drawing_area();
    area.fill(&WHITE).map_err(|error| error.to_string())?;
    let panels = area.split_evenly((2, DIMENSIONS / 2));
    for (number, panel) in panels.iter().enumerate() {
        let (_, [low, high]) = BIN_RANGES[number];
        let highest = counts[number].iter().copied().max().unwrap_or(0).max(1);
        let mut chart = ChartBuilder::on(panel)
            .caption(TITLES[number], ("sans-serif", 16))
            .margin(8)
            .x_label_area_size(28)
            .y_label_area_size(44)
            .build_cartesian_2d(low..high, 0.0..f64::from(highest) * 1.05)
            .map_err(|error| error.to_string())?;
        chart
            .configure_mesh()
            .disable_x_mesh()
            .light_line_style(TRANSPARENT)
            .x_labels(4)
            .y_labels(4)
            .label_style(("sans-serif", 12))
            .y_label_formatter(&|count| match count.fract() {
                0.0 => format!("{count}"),
                _ => String::new(),
            })
            .x_label_formatter(&|value| format!("{}", (value * 100.0).round() / 100.0))
            .draw()
            .map_err(|error| error.to_string())?;
        let width = (high - low) / BARS as f64;
        let bars = counts[number].iter().enumerate().map(|(bar, &count)| {
            let left = low + width * bar as f64;
            let corners = [(left, 0.0), (left + 0.9 * width, f64::from(count))];
            Rectangle::new(corners, BAR_COLOUR.filled())
        });
        chart.draw_series(bars).map_err(|error| error.to_string())?;
    }
    area.present().map_err(|error| error.to_string())?;
    Ok(())
}

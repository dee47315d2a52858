//! Where the time of a view goes.

use super::Plot;
use super::axes::{Axis, Entry, Frame, Mark, draw as frame};
use crate::findings;
use crate::numbers::{exact, group};
use crate::{Report, ReportError};
use dataset::{Specification, specification::IntegratorKind};
use plotters::prelude::*;
use plotters::style::RGBColor;

const WIDTH: u32 = 1016;

/// Of five stages at most; told apart by lightness as well as by hue.
const COLOURS: [RGBColor; 5] = [
    RGBColor(0x1b, 0x5e, 0xa6),
    RGBColor(0xf2, 0xc1, 0x4e),
    RGBColor(0x5b, 0xa0, 0x8a),
    RGBColor(0xc8, 0x55, 0x1b),
    RGBColor(0x6f, 0x6f, 0x78),
];

/// The hybrid integrator's stages at its usual setting.
pub fn draw(report: &Report) -> Result<Option<Plot>, ReportError> {
    const FILE: &str = "stages.svg";
    let settings = findings::settings(&report.plan.settings, IntegratorKind::Hybrid);
    let Some(setting) = findings::usual(&settings) else {
        return Ok(None);
    };
    let bars = findings::stages(&report.measurements, setting, &report.plan.views);
    let names = findings::stage_names(&bars);
    let y = Axis::names(
        "view",
        bars.iter().map(|&(view, _)| view_name(view)).collect(),
    );
    let totals = bars.iter().map(|(_, parts)| {
        let seconds: f64 = parts.iter().map(|(_, seconds)| seconds).sum();
        1e3 * seconds
    });
    let x = Axis::linear(
        "mean time of a view over materials, one core (ms)",
        totals.fold(0.0, f64::max),
        |milliseconds| {
            let text = format!("{milliseconds:.3}");
            group(text.trim_end_matches('0').trim_end_matches('.'))
        },
    );
    let coloured = || names.iter().zip(COLOURS.iter().cycle());
    let entries = coloured().map(|(name, &colour)| Entry {
        text: (*name).to_owned(),
        colour,
        mark: Mark::Bar,
    });
    let frame_of = Frame {
        name: FILE,
        size: (WIDTH, 90 + 26 * bars.len().max(4) as u32),
        x: &x,
        y: &y,
        y_label_pixels: 160,
        legend: entries.collect(),
    };
    let svg = frame(&frame_of, |chart| {
        for (place, (_, parts)) in bars.iter().enumerate() {
            let middle = -(place as f64);
            let mut from = 0.0;
            for (name, seconds) in parts {
                let to = from + 1e3 * seconds;
                let known = coloured().find(|(known, _)| *known == name);
                let colour = known.map_or(BLACK, |(_, colour)| *colour);
                chart.plotting_area().draw(&Rectangle::new(
                    [(from, middle - 0.36), (to, middle + 0.36)],
                    colour.filled(),
                ))?;
                from = to;
            }
        }
        Ok(())
    })?;
    Ok(Some(Plot {
        file: FILE,
        caption: format!(
            "Time of each stage of the hybrid integrator at a relative accuracy of {}, mean over \
             materials. Views are named by the elevation of the camera.",
            exact(setting.value())
        ),
        svg,
    }))
}

/// A view of the preset by its number and what it shows.
fn view_name(view: u32) -> String {
    let described = &Specification::preset().views[view as usize];
    let chart = if described.checker { "" } else { ", no chart" };
    format!("{view}: {}°{chart}", described.camera_elevation_deg)
}

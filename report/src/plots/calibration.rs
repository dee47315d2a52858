//! True error over stated error: how many pixels lie within a given multiple of their bounds.

use super::axes::{Axis, Entry, Frame, Mark, draw as frame, power_of_ten};
use super::{Plot, shade};
use crate::findings;
use crate::numbers::group;
use crate::plan::Setting;
use crate::{Report, ReportError};
use dataset::specification::IntegratorKind;
use plotters::prelude::*;

const SIZE: (u32, u32) = (500, 420);

/// The decades of the ratio that are shown.
const DECADES: [i32; 2] = [-5, 2];

pub fn draw(report: &Report) -> Result<Vec<Plot>, ReportError> {
    let mut plots = Vec::new();
    for (kind, file, caption) in [
        (
            IntegratorKind::Hybrid,
            "calibration-hybrid.svg",
            "Hybrid, by relative accuracy: share of pixels whose true error is at most a multiple of \
             the stated one.",
        ),
        (
            IntegratorKind::Path,
            "calibration-path.svg",
            "Path tracer, by samples a pixel: the same. It states a 95 percent interval from eight \
             replicates, which knows nothing of light that none of its paths has met.",
        ),
    ] {
        let settings = findings::settings(&report.plan.settings, kind);
        let curves: Vec<_> = settings
            .into_iter()
            .filter_map(|setting| {
                let found = findings::calibration(&report.measurements, setting)?;
                Some((setting, found.ratios.cumulative()))
            })
            .filter(|(_, curve)| !curve.is_empty())
            .collect();
        if !curves.is_empty() {
            plots.push(Plot {
                file,
                caption: format!(
                    "{caption} The curve should pass above the mark: 95 percent of pixels at 1."
                ),
                svg: plot(kind, file, &curves)?,
            });
        }
    }
    Ok(plots)
}

fn plot(
    kind: IntegratorKind,
    file: &'static str,
    curves: &[(Setting, Vec<(f64, f64)>)],
) -> Result<String, ReportError> {
    let x = Axis::decades("true error / stated error", DECADES, power_of_ten);
    let y = Axis::linear("share of pixels", 1.0, |share| {
        format!("{:.0} %", 100.0 * share)
    });
    let [low, high] = x.ends();
    let entries = curves
        .iter()
        .enumerate()
        .map(|(place, (setting, _))| Entry {
            text: match setting {
                Setting::Accuracy(relative) => power_of_ten(libm::log10(*relative).round() as i32),
                Setting::Samples(samples) => group(&samples.to_string()),
            },
            colour: shade(kind, place, curves.len()),
            mark: Mark::Line,
        });
    let frame_of = Frame {
        name: file,
        size: SIZE,
        x: &x,
        y: &y,
        y_label_pixels: 70,
        legend: entries.collect(),
    };
    frame(&frame_of, |chart| {
        let area = chart.plotting_area();
        for (place, (_, curve)) in curves.iter().enumerate() {
            let line: Vec<_> = curve
                .iter()
                .copied()
                .filter(|(decade, _)| (low..=high).contains(decade))
                .collect();
            let stroke = shade(kind, place, curves.len()).stroke_width(2);
            area.draw(&PathElement::new(line, stroke))?;
        }
        for line in [[(0.0, 0.0), (0.0, 1.0)], [(low, 0.95), (high, 0.95)]] {
            area.draw(&PathElement::new(line, BLACK.mix(0.45).stroke_width(1)))?;
        }
        area.draw(&Cross::new((0.0, 0.95), 6, BLACK.stroke_width(2)))
    })
}

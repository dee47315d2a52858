//! Time against error of both integrators.

use super::axes::{
    Axis, Chart, DrawError, Entry, Frame, Mark, draw as frame, power_of_ten, seconds,
};
use super::{Plot, colour};
use crate::findings::{self, Quantity, cpu_seconds, mean_error};
use crate::plan::integrator_name;
use crate::survey::Measurement;
use crate::{Report, ReportError};
use dataset::{Specification, specification::IntegratorKind};
use plotters::prelude::*;

const WIDE: (u32, u32) = (1016, 560);
const HALF: (u32, u32) = (500, 420);

/// See [`View::floor`].
pub const ERROR_FLOOR: f64 = 1e-8;

/// Times below are not told apart.
const SECONDS_FLOOR: f64 = 1e-6;

struct View {
    file: &'static str,
    size: (u32, u32),
    label: &'static str,
    quantity: Quantity,
    /// Smaller errors are drawn on the lower edge: below, rounding and the reference show.
    floor: f64,
    /// Whether every rendering is drawn, not just the medians.
    dots: bool,
    /// Views with the chart, without it, or all.
    chart: Option<bool>,
    caption: &'static str,
}

const VIEWS: [View; 5] = [
    View {
        file: "time-error.svg",
        size: WIDE,
        label: "mean relative error of a view",
        quantity: mean_error,
        floor: ERROR_FLOOR,
        dots: true,
        chart: None,
        caption: "Time against mean relative error. Every dot is a rendering; marks are medians \
                  over materials and views at one setting, bars reach from the 10th to the 90th \
                  percentile of both axes. Errors below 1e−8 are drawn on the lower edge.",
    },
    View {
        file: "time-p95-error.svg",
        size: HALF,
        label: "95th percentile of relative error",
        quantity: |one| one.comparison.p95_relative_error,
        floor: ERROR_FLOOR,
        dots: false,
        chart: None,
        caption: "The same for the 95th percentile over the pixels of a view.",
    },
    View {
        file: "time-relative-mse.svg",
        size: HALF,
        label: "relative MSE",
        quantity: |one| one.comparison.relative_mse,
        floor: ERROR_FLOOR * ERROR_FLOOR,
        dots: false,
        chart: None,
        caption: "The same for the relative mean squared error.",
    },
    View {
        file: "time-error-with-chart.svg",
        size: HALF,
        label: "mean relative error of a view",
        quantity: mean_error,
        floor: ERROR_FLOOR,
        dots: false,
        chart: Some(true),
        caption: "The views with the chart alone: interreflection is part of the work.",
    },
    View {
        file: "time-error-without-chart.svg",
        size: HALF,
        label: "mean relative error of a view",
        quantity: mean_error,
        floor: ERROR_FLOOR,
        dots: false,
        chart: Some(false),
        caption: "The views without the chart alone: direct light and nothing else.",
    },
];

pub fn draw(report: &Report) -> Result<Vec<Plot>, ReportError> {
    let preset = Specification::preset();
    let mut plots = Vec::new();
    for view in &VIEWS {
        let shown: Vec<Measurement> = report
            .measurements
            .iter()
            .filter(|one| {
                let checker = preset.views[one.view as usize].checker;
                findings::is_lit(one) && view.chart.is_none_or(|wanted| wanted == checker)
            })
            .cloned()
            .collect();
        if !shown.is_empty() {
            plots.push(Plot {
                file: view.file,
                caption: view.caption.to_owned(),
                svg: plot(report, view, &shown)?,
            });
        }
    }
    Ok(plots)
}

fn plot(report: &Report, view: &View, shown: &[Measurement]) -> Result<String, ReportError> {
    let spreads = |quantity: Quantity| {
        report
            .plan
            .settings
            .iter()
            .filter_map(move |&setting| findings::spread(shown, setting, quantity))
            .flat_map(|spread| [spread.low, spread.high])
    };
    let dots = |quantity: Quantity| {
        let dots = shown.iter().filter(|_| view.dots);
        dots.map(quantity)
    };
    let x = Axis::logarithmic(
        "processor time of a view, one core",
        SECONDS_FLOOR,
        spreads(cpu_seconds).chain(dots(cpu_seconds)),
        seconds,
    );
    let y = Axis::logarithmic(
        view.label,
        view.floor,
        spreads(view.quantity).chain(dots(view.quantity)),
        power_of_ten,
    );
    let kinds: Vec<_> = [IntegratorKind::Path, IntegratorKind::Hybrid]
        .into_iter()
        .filter(|&kind| shown.iter().any(|one| one.setting.integrator() == kind))
        .collect();
    let entries = kinds.iter().map(|&kind| Entry {
        text: integrator_name(kind).to_owned(),
        colour: colour(kind),
        mark: mark(kind),
    });
    let frame_of = Frame {
        name: view.file,
        size: view.size,
        x: &x,
        y: &y,
        y_label_pixels: 70,
        legend: entries.collect(),
    };
    frame(&frame_of, |chart| {
        if view.dots {
            for one in shown {
                let at = (x.log(cpu_seconds(one)), y.log((view.quantity)(one)));
                let faint = colour(one.setting.integrator()).mix(0.3);
                chart
                    .plotting_area()
                    .draw(&Circle::new(at, 2, faint.filled()))?;
            }
        }
        for &kind in &kinds {
            medians(chart, report, shown, view.quantity, kind, (&x, &y))?;
        }
        Ok(())
    })
}

/// A mark a setting at the medians, bars from the 10th to the 90th percentile, and a line.
fn medians(
    chart: &mut Chart<'_>,
    report: &Report,
    shown: &[Measurement],
    quantity: Quantity,
    kind: IntegratorKind,
    (x, y): (&Axis, &Axis),
) -> Result<(), DrawError> {
    let full = colour(kind);
    let mut line = Vec::new();
    let area = chart.plotting_area();
    for setting in findings::settings(&report.plan.settings, kind) {
        let both = findings::spread(shown, setting, cpu_seconds)
            .zip(findings::spread(shown, setting, quantity));
        let Some((time, error)) = both else { continue };
        let at = (x.log(time.median), y.log(error.median));
        for bar in [
            [(x.log(time.low), at.1), (x.log(time.high), at.1)],
            [(at.0, y.log(error.low)), (at.0, y.log(error.high))],
        ] {
            area.draw(&PathElement::new(bar, full.mix(0.55).stroke_width(1)))?;
        }
        line.push(at);
    }
    area.draw(&PathElement::new(line.clone(), full.stroke_width(3)))?;
    for at in line {
        draw_mark(chart, at, kind)?;
    }
    Ok(())
}

/// The mark of an integrator.
pub fn mark(kind: IntegratorKind) -> Mark {
    match kind {
        IntegratorKind::Hybrid => Mark::Disc,
        IntegratorKind::Path => Mark::Triangle,
    }
}

pub fn draw_mark(
    chart: &mut Chart<'_>,
    at: (f64, f64),
    kind: IntegratorKind,
) -> Result<(), DrawError> {
    let area = chart.plotting_area();
    match mark(kind) {
        Mark::Triangle => area.draw(&TriangleMarker::new(at, 7, colour(kind).filled())),
        _ => area.draw(&Circle::new(at, 6, colour(kind).filled())),
    }
}

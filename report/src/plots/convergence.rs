//! Error against what was asked for: samples a pixel, or accuracy.

use super::axes::{Axis, Chart, DrawError, Entry, Frame, Mark, draw as frame, power_of_ten};
use super::time_error::{ERROR_FLOOR, draw_mark, mark};
use super::{Plot, colour};
use crate::findings::{self, mean_error};
use crate::plan::{Setting, integrator_name};
use crate::statistics::{Spread, slope};
use crate::{Report, ReportError};
use dataset::specification::IntegratorKind;
use plotters::prelude::*;
use plotters::style::RGBColor;

const SIZE: (u32, u32) = (500, 420);
/// Below every setting.
const SETTING_FLOOR: f64 = 1e-12;

const GREY: RGBColor = RGBColor(0x77, 0x77, 0x77);

pub fn draw(report: &Report) -> Result<Vec<Plot>, ReportError> {
    let mut plots = Vec::new();
    for kind in [IntegratorKind::Hybrid, IntegratorKind::Path] {
        let rungs: Vec<(Setting, Spread)> = findings::settings(&report.plan.settings, kind)
            .into_iter()
            .filter_map(|setting| {
                let spread = findings::spread(&report.measurements, setting, mean_error)?;
                Some((setting, spread))
            })
            .collect();
        if !rungs.is_empty() {
            plots.push(plot(kind, &rungs)?);
        }
    }
    Ok(plots)
}

fn plot(kind: IntegratorKind, rungs: &[(Setting, Spread)]) -> Result<Plot, ReportError> {
    let (file, label, caption) = match kind {
        IntegratorKind::Hybrid => (
            "convergence-hybrid.svg",
            "relative accuracy asked for",
            "What the hybrid integrator reaches against what it is asked for. On the dashed line \
             the mean error would be all that was allowed.",
        ),
        IntegratorKind::Path => (
            "convergence-path.svg",
            "samples a pixel",
            "How the path tracer converges. The dashed line falls with the square root of the \
             samples, through the first median.",
        ),
    };
    let expected = expected(kind, rungs);
    let [x, y] = axes(label, rungs, &expected);
    let medians: Vec<(f64, f64)> = rungs
        .iter()
        .map(|(rung, spread)| (x.log(rung.value()), y.log(spread.median)))
        .collect();
    let frame_of = Frame {
        name: file,
        size: SIZE,
        x: &x,
        y: &y,
        y_label_pixels: 70,
        legend: legend(kind, rungs),
    };
    let svg = frame(&frame_of, |chart| {
        let line = expected.map(|[setting, error]| (x.log(setting), y.log(error)));
        dashed(chart, line)?;
        let full = colour(kind);
        let area = chart.plotting_area();
        for (&(place, _), (_, spread)) in medians.iter().zip(rungs) {
            let bar = [(place, y.log(spread.low)), (place, y.log(spread.high))];
            area.draw(&PathElement::new(bar, full.mix(0.55).stroke_width(1)))?;
        }
        area.draw(&PathElement::new(medians.clone(), full.stroke_width(3)))?;
        for &at in &medians {
            draw_mark(chart, at, kind)?;
        }
        Ok(())
    })?;
    Ok(Plot {
        file,
        caption: format!("{caption} Bars reach from the 10th to the 90th percentile."),
        svg,
    })
}

/// The axes of settings and errors, on which everything fits.
fn axes(label: &'static str, rungs: &[(Setting, Spread)], expected: &[[f64; 2]; 2]) -> [Axis; 2] {
    let x = Axis::logarithmic(
        label,
        SETTING_FLOOR,
        rungs.iter().map(|(rung, _)| rung.value()),
        |decade| match decade {
            0..=5 => ["1", "10", "100", "1,000", "10,000", "100,000"][decade as usize].to_owned(),
            _ => power_of_ten(decade),
        },
    );
    let values = rungs
        .iter()
        .flat_map(|(_, spread)| [spread.low, spread.high])
        .chain(expected.iter().map(|[_, error]| *error));
    let y = Axis::logarithmic(
        "mean relative error of a view",
        ERROR_FLOOR,
        values,
        power_of_ten,
    );
    [x, y]
}

/// The integrator with the slope of its medians, and the line that is hoped for.
fn legend(kind: IntegratorKind, rungs: &[(Setting, Spread)]) -> Vec<Entry> {
    let points = rungs
        .iter()
        .filter(|(_, spread)| spread.median > 0.0)
        .map(|(rung, spread)| [libm::log10(rung.value()), libm::log10(spread.median)]);
    let name = integrator_name(kind);
    let reached = Entry {
        text: match slope(&points.collect::<Vec<_>>()) {
            Some(slope) => format!("{name}, slope {slope:.2}").replace('-', "−"),
            None => name.to_owned(),
        },
        colour: colour(kind),
        mark: mark(kind),
    };
    let hoped = Entry {
        text: match kind {
            IntegratorKind::Hybrid => "what is allowed".to_owned(),
            IntegratorKind::Path => "slope −0.5".to_owned(),
        },
        colour: GREY,
        mark: Mark::Line,
    };
    vec![reached, hoped]
}

/// Both ends of the line that is hoped for, as setting and error.
fn expected(kind: IntegratorKind, rungs: &[(Setting, Spread)]) -> [[f64; 2]; 2] {
    let (first, last) = (&rungs[0], &rungs[rungs.len() - 1]);
    [first, last].map(|(rung, _)| {
        let setting = rung.value();
        let error = match kind {
            IntegratorKind::Hybrid => setting,
            IntegratorKind::Path => first.1.median * (first.0.value() / setting).sqrt(),
        };
        [setting, error]
    })
}

fn dashed(chart: &mut Chart<'_>, [from, to]: [(f64, f64); 2]) -> Result<(), DrawError> {
    const DASHES: u32 = 40;
    let at = |place: u32| {
        let part = f64::from(place) / f64::from(DASHES);
        (
            from.0 + part * (to.0 - from.0),
            from.1 + part * (to.1 - from.1),
        )
    };
    for dash in (0..DASHES).step_by(2) {
        let ends = [at(dash), at(dash + 1)];
        chart
            .plotting_area()
            .draw(&PathElement::new(ends, GREY.stroke_width(2)))?;
    }
    Ok(())
}

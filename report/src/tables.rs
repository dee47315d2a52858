//! The measurements as CSV.

use crate::plan::integrator_name;
use crate::survey::Measurement;
use crate::{File, Report, ReportError, findings};
use dataset::Specification;
use serde::Serialize;

/// A row of `renderings.csv`. Errors and times as in [`crate::comparison`] and [`crate::survey`].
#[derive(Serialize)]
struct RenderingRow<'a> {
    material: &'a str,
    hard_case: bool,
    view: u32,
    chart: bool,
    integrator: &'static str,
    /// Relative accuracy of the hybrid integrator, samples a pixel of the path tracer.
    setting: f64,
    wall_seconds: f64,
    cpu_seconds: f64,
    evaluations: u64,
    samples: u64,
    pixels_compared: usize,
    relative_mse: f64,
    mean_relative_error: f64,
    p95_relative_error: f64,
    smape: f64,
    mean_difference: f64,
    stated_mean_relative_error: f64,
    stated_p95_relative_error: f64,
    stated_max_error: f64,
    reference_p95_relative_error: f64,
    share_within_stated_error: f64,
    share_meeting_target: f64,
}

/// A row of `stages.csv`.
#[derive(Serialize)]
struct StageRow<'a> {
    material: &'a str,
    view: u32,
    integrator: &'static str,
    setting: f64,
    stage: &'static str,
    wall_seconds: f64,
}

/// A row of `calibration.csv`: the share of pixels whose true error is at most this multiple of the
/// stated one.
#[derive(Serialize)]
struct CalibrationRow {
    integrator: &'static str,
    setting: f64,
    true_over_stated: f64,
    share: f64,
}

/// A row of `backends.csv`.
#[derive(Serialize)]
struct BackendRow {
    contender: String,
    setting: f64,
    wall_seconds: Option<f64>,
    cpu_seconds: Option<f64>,
    work: Option<u64>,
    digest: Option<String>,
    unavailable: Option<String>,
}

/// A row of `shapes.csv`.
#[derive(Serialize)]
struct ShapeRow {
    shape: String,
    view: u32,
    relative_accuracy: f64,
    wall_seconds: f64,
    cpu_seconds: f64,
    pixels_compared: usize,
    mean_relative_error: f64,
    p95_relative_error: f64,
    reference_p95_relative_error: f64,
    share_within_stated_error: f64,
    share_stated_within_target: f64,
}

/// Every table.
pub fn write(report: &Report) -> Result<Vec<File>, ReportError> {
    let name = |one: &Measurement| report.plan.materials[one.material].name.as_str();
    let stages = report.measurements.iter().flat_map(|one| {
        one.phases.iter().map(move |stage| StageRow {
            material: name(one),
            view: one.view,
            integrator: integrator_name(one.setting.integrator()),
            setting: one.setting.value(),
            stage: stage.name,
            wall_seconds: stage.seconds,
        })
    });
    Ok(vec![
        file("renderings.csv", renderings(report))?,
        file("stages.csv", stages)?,
        file("calibration.csv", calibration(report))?,
        file("backends.csv", backends(report))?,
        file("shapes.csv", shapes(report))?,
    ])
}

fn file(
    name: &'static str,
    rows: impl IntoIterator<Item = impl Serialize>,
) -> Result<File, ReportError> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    for row in rows {
        writer.serialize(row)?;
    }
    let bytes = writer
        .into_inner()
        .map_err(|error| csv::Error::from(error.into_error()))?;
    Ok(File {
        name,
        text: String::from_utf8_lossy(&bytes).into_owned(),
    })
}

fn renderings(report: &Report) -> impl Iterator<Item = RenderingRow<'_>> {
    let views = Specification::preset().views;
    report.measurements.iter().map(move |one| {
        let material = &report.plan.materials[one.material];
        let comparison = &one.comparison;
        RenderingRow {
            material: &material.name,
            hard_case: material.is_hard(),
            view: one.view,
            chart: views[one.view as usize].checker,
            integrator: integrator_name(one.setting.integrator()),
            setting: one.setting.value(),
            wall_seconds: one.cost.wall_seconds,
            cpu_seconds: one.cost.cpu_seconds,
            evaluations: one.stated.evaluations,
            samples: one.stated.samples,
            pixels_compared: comparison.pixels,
            relative_mse: comparison.relative_mse,
            mean_relative_error: comparison.mean_relative_error,
            p95_relative_error: comparison.p95_relative_error,
            smape: comparison.smape,
            mean_difference: comparison.mean_difference,
            stated_mean_relative_error: comparison.stated_mean_relative_error,
            stated_p95_relative_error: comparison.stated_p95_relative_error,
            stated_max_error: one.stated.max,
            reference_p95_relative_error: comparison.reference_p95_relative_error,
            share_within_stated_error: comparison.within_bound,
            share_meeting_target: comparison.within_target,
        }
    })
}

fn calibration(report: &Report) -> Vec<CalibrationRow> {
    let mut rows = Vec::new();
    for &setting in &report.plan.settings {
        let Some(found) = findings::calibration(&report.measurements, setting) else {
            continue;
        };
        rows.extend(
            found
                .ratios
                .cumulative()
                .into_iter()
                .map(|(decade, share)| CalibrationRow {
                    integrator: integrator_name(setting.integrator()),
                    setting: setting.value(),
                    true_over_stated: libm::pow(10.0, decade),
                    share,
                }),
        );
    }
    rows
}

fn shapes(report: &Report) -> impl Iterator<Item = ShapeRow> {
    report.shapes.iter().map(|one| ShapeRow {
        shape: one.shape.to_string(),
        view: one.view,
        relative_accuracy: one.relative,
        wall_seconds: one.cost.wall_seconds,
        cpu_seconds: one.cost.cpu_seconds,
        pixels_compared: one.comparison.pixels,
        mean_relative_error: one.comparison.mean_relative_error,
        p95_relative_error: one.comparison.p95_relative_error,
        reference_p95_relative_error: one.comparison.reference_p95_relative_error,
        share_within_stated_error: one.comparison.within_bound,
        share_stated_within_target: one.within_target,
    })
}

fn backends(report: &Report) -> impl Iterator<Item = BackendRow> {
    report.backends.iter().map(|outcome| {
        let run = outcome.result.as_ref().ok();
        BackendRow {
            contender: outcome.contender.name(),
            setting: outcome.contender.setting.value(),
            wall_seconds: run.map(|run| run.cost.wall_seconds),
            cpu_seconds: run.map(|run| run.cost.cpu_seconds),
            work: run.map(|run| run.work),
            digest: run.map(|run| run.digest.to_string()),
            unavailable: outcome.result.as_ref().err().cloned(),
        }
    })
}

//! The tables of results.

use crate::Report;
use crate::backends::{MATERIAL, VIEW};
use crate::findings::{
    self, DARK, Quantity, SPREAD_SHARE, cpu_seconds, is_lit, ladders, mean_error, race, usual,
};
use crate::numbers::{
    self, NOT_REACHED, exact, group, percent, scientific, seconds, significant, times,
};
use crate::plan::{Setting, integrator_name};
use crate::shapes;
use crate::statistics::Spread;
use crate::survey::Measurement;
use dataset::{HARD_CASES, Specification, specification::IntegratorKind};
use maud::{Markup, html};

/// Errors to which the integrators race.
const RACES: [f64; 3] = [1e-2, 1e-3, 1e-4];

const KINDS: [IntegratorKind; 2] = [IntegratorKind::Hybrid, IntegratorKind::Path];

/// What both integrators take to come to an error.
pub fn summary(report: &Report) -> Markup {
    let [hybrid, path] = KINDS.map(|kind| ladders(&report.measurements, kind));
    if hybrid.is_empty() || path.is_empty() {
        return html! {};
    }
    let cells = hybrid.len();
    html! {
        table {
            thead {
                tr {
                    th.name rowspan="2" { "Mean relative" br; "error" }
                    th.over-group colspan="2" { "Hybrid" } th.over-group colspan="2" { "Path tracer" }
                    th.over-group colspan="3" { "Path tracer / hybrid" }
                }
                tr {
                    th { "time" } th { "views" } th { "time" } th { "views" }
                    th { "least" } th { "median" } th { "largest" }
                }
            }
            tbody {
                @for error in RACES {
                    @let race = race(&hybrid, &path, error);
                    tr {
                        td.name { (exact(error)) }
                        @for place in 0..2 {
                            td { (seconds(race.median_seconds[place])) }
                            td { (race.reached[place]) }
                        }
                        @match race.factors {
                            Some([least, median, largest]) => {
                                td { (times(least)) }
                                td.lead { (times(median)) }
                                td { (times(largest)) }
                            }
                            None => td colspan="3" { (NOT_REACHED) }
                        }
                    }
                }
            }
        }
        p.note {
            "Median processor time of a view until its mean relative error is reached, between \
            the settings that were rendered; how many of " (cells) " views of materials get \
            there; and how many times longer the path tracer takes, over those that the hybrid \
            integrator brings there."
        }
    }
}

/// Everything that plots show, in numbers.
pub fn ladder(report: &Report) -> Markup {
    let row = |setting: Setting| -> Option<Markup> {
        let of = |quantity: Quantity| findings::spread(&report.measurements, setting, quantity);
        let (time, error) = (of(cpu_seconds)?, of(mean_error)?);
        let median = |quantity: Quantity| of(quantity).map_or(0.0, |spread| spread.median);
        Some(html! {
            tr {
                td.name { (setting_name(setting)) }
                td { (seconds(time.median)) }
                td { (range(&time, seconds)) }
                td { (scientific(error.median)) }
                td { (range(&error, scientific)) }
                td { (scientific(median(|one| one.comparison.p95_relative_error))) }
                td { (scientific(median(|one| one.comparison.relative_mse))) }
                td { (scientific(median(|one| one.comparison.smape))) }
                td { (work(median(|one| {
                    (one.stated.evaluations + one.stated.samples) as f64
                }))) }
            }
        })
    };
    html! {
        div.wide {
            table {
                thead {
                    tr {
                        th.name { "Setting" } th { "Time" } th {}
                        th { "Mean" br; "relative error" } th {}
                        th { "95th" br; "percentile" } th { "Relative" br; "MSE" } th { "SMAPE" }
                        th { "Spent" br; "a view" }
                    }
                }
                tbody {
                    @for &setting in &report.plan.settings { @if let Some(row) = row(setting) { (row) } }
                }
            }
            p.note {
                "Medians over materials and views, with the 10th to 90th percentile in \
                brackets. Spent: evaluations of the reflectance (hybrid), paths from the camera \
                (path)."
            }
        }
    }
}

fn work(count: f64) -> String {
    if count < 1e6 {
        group(&format!("{count:.0}"))
    } else {
        format!("{} M", significant(1e-6 * count, 3))
    }
}

fn range(spread: &Spread, format: fn(f64) -> String) -> String {
    format!("({} … {})", format(spread.low), format(spread.high))
}

fn setting_name(setting: Setting) -> String {
    let name = integrator_name(setting.integrator());
    match setting {
        Setting::Accuracy(relative) => format!("{name}, accuracy {}", exact(relative)),
        Setting::Samples(samples) => {
            format!("{name}, {} samples", group(&samples.to_string()))
        }
    }
}

/// Slopes of log error, fitted to the ladder of every material and view.
pub fn slopes(report: &Report) -> Markup {
    let asked: Quantity = |one| one.setting.value();
    let row = |kind, what: &str, abscissa: Quantity| {
        let slopes = findings::slopes(&ladders(&report.measurements, kind), abscissa);
        let count = slopes.len();
        let spread = Spread::new(slopes, SPREAD_SHARE)?;
        Some(html! {
            tr {
                td.name { (integrator_name(kind)) }
                td.name { (what) }
                td { (slope(spread.median)) }
                td { "(" (slope(spread.low)) " … " (slope(spread.high)) ")" }
                td { (count) }
            }
        })
    };
    let rows = [
        row(IntegratorKind::Hybrid, "accuracy asked for", asked),
        row(IntegratorKind::Hybrid, "processor time", cpu_seconds),
        row(IntegratorKind::Path, "samples a pixel", asked),
        row(IntegratorKind::Path, "processor time", cpu_seconds),
    ];
    html! {
        table {
            thead {
                tr {
                    th.name { "Integrator" } th.name { "Error against" }
                    th { "Slope" } th {} th { "Ladders" }
                }
            }
            tbody { @for row in rows.into_iter().flatten() { (row) } }
        }
        p.note {
            "Slopes of the mean relative error on logarithmic axes, fitted by least squares to \
            the ladder of every material and view: medians, with the 10th to 90th percentile in \
            brackets. Independent samples have −0.5."
        }
    }
}

fn slope(value: f64) -> String {
    format!("{value:.2}").replace('-', "−")
}

/// Time, stated and true error of every hard case in every view.
pub fn hard_cases(report: &Report) -> Markup {
    let settings = findings::settings(&report.plan.settings, IntegratorKind::Hybrid);
    let any = report.plan.materials.iter().any(|one| one.is_hard());
    let Some(setting) = usual(&settings).filter(|_| any) else {
        return html! { p { "None were rendered with the hybrid integrator." } };
    };
    let relative = setting.value();
    let milliseconds: Quantity = |one| 1e3 * cpu_seconds(one);
    let in_targets = move |error: f64| {
        let targets = error / relative;
        (numbers::ratio(targets), targets > 1.0)
    };
    let stated: Quantity = |one| one.comparison.stated_p95_relative_error;
    let found: Quantity = |one| one.comparison.p95_relative_error;
    html! {
        p {
            "The hybrid integrator at a relative accuracy of " (exact(relative)) ". Errors are \
            95th percentiles over the pixels of a view, in units of the target: a number above 1, \
            marked, misses it. A dash stands for a view in which nothing is brighter than " (exact(DARK)) " of white."
        }
        (matrix(report, setting, "Processor time, in milliseconds",
            |one| (significant(milliseconds(one), 2), false)))
        (matrix(report, setting, "Stated error, in units of the target",
            |one| in_targets(stated(one))))
        (matrix(report, setting, "True error, in units of the target",
            |one| in_targets(found(one))))
    }
}

/// A row a hard case, a column a view; `cell` gives the text and whether it is marked.
fn matrix(
    report: &Report,
    setting: Setting,
    title: &str,
    cell: impl Fn(&Measurement) -> (String, bool),
) -> Markup {
    let find = |material: usize, view: u32| {
        report
            .measurements
            .iter()
            .find(|one| (one.material, one.view, one.setting) == (material, view, setting))
    };
    let hard = report
        .plan
        .materials
        .iter()
        .enumerate()
        .filter(|(_, material)| material.is_hard());
    html! {
        h3 { (title) }
        div.wide {
            table.matrix {
                thead {
                    tr {
                        th.name { "View" }
                        @for view in &report.plan.views { th { (view) } }
                    }
                }
                tbody {
                    @for (index, material) in hard {
                        tr {
                            td.name { (material.name) }
                            @for &view in &report.plan.views {
                                @match find(index, view) {
                                    Some(one) if is_lit(one) => {
                                        @let (text, marked) = cell(one);
                                        td class=[marked.then_some("over")] { (text) }
                                    }
                                    _ => td { "–" }
                                }
                            }
                        }
                    }
                }
            }
        }
    }
}

/// How stated errors bear out at each setting.
pub fn calibration(report: &Report) -> Markup {
    let rows = report.plan.settings.iter().filter_map(|&setting| {
        let found = findings::calibration(&report.measurements, setting)?;
        Some((setting, found))
    });
    html! {
        table {
            thead {
                tr {
                    th.name { "Setting" } th { "Pixels" } th { "Within the" br; "stated error" }
                    th { "Meet the" br; "target" } th { "Coarse" br; "references" }
                }
            }
            tbody {
                @for (setting, found) in rows {
                    tr {
                        td.name { (setting_name(setting)) }
                        td { (group(&found.pixels.to_string())) }
                        td class=[(found.within_bound < 0.95).then_some("over")] {
                            (percent(found.within_bound))
                        }
                        td { (percent(found.within_target)) }
                        td { (found.coarse_references) }
                    }
                }
            }
        }
        p.note {
            "Over all pixels of all materials and views. The target of the hybrid integrator is \
            its setting, that of the path tracer the preset’s. Coarse references: views whose \
            reference states an error of more than a third of what the rendering states; there \
            the test is weak."
        }
    }
}

/// The stages of both integrators in numbers.
pub fn stages(report: &Report) -> Markup {
    let tables = KINDS.into_iter().filter_map(|kind| {
        let settings = findings::settings(&report.plan.settings, kind);
        let setting = usual(&settings)?;
        let bars = findings::stages(&report.measurements, setting, &report.plan.views);
        let names = findings::stage_names(&bars);
        Some(html! {
            h3 { (setting_name(setting)) }
            p.note { "Mean over materials, in milliseconds by the clock on the wall, one thread." }
            div.wide {
                table {
                    thead {
                        tr {
                            th.name { "View" } @for name in &names { th { (name) } } th { "sum" }
                        }
                    }
                    tbody {
                        @for (view, parts) in &bars {
                            @let sum: f64 = parts.iter().map(|(_, seconds)| seconds).sum();
                            tr {
                                td.name { (view_name(*view)) }
                                @for name in &names {
                                    @match parts.iter().find(|(known, _)| known == name) {
                                        Some((_, seconds)) => td { (milliseconds(*seconds)) }
                                        None => td { "–" }
                                    }
                                }
                                td.lead { (milliseconds(sum)) }
                            }
                        }
                    }
                }
            }
        })
    });
    html! { @for table in tables { (table) } }
}

fn milliseconds(seconds: f64) -> String {
    format!("{:.2}", 1e3 * seconds)
}

fn view_name(view: u32) -> String {
    let described = &Specification::preset().views[view as usize];
    let chart = if described.checker {
        "chart"
    } else {
        "no chart"
    };
    format!(
        "{view}: camera {}°, light {}°, turned {}°, {chart}",
        described.camera_elevation_deg, described.light_elevation_deg, described.rotation_deg
    )
}

/// Square, sphere and mesh beside each other.
pub fn shapes(report: &Report) -> Markup {
    if report.shapes.is_empty() {
        return html! { p { "Not measured." } };
    }
    html! {
        p {
            "The material " code { (HARD_CASES[shapes::MATERIAL].name) } " on a square, a sphere and a mesh, "
            (report.plan.size_pixels.min(shapes::SIZE_PIXELS_MAX)) " pixels a side, on one thread. The light on a \
            square is worked out; on others a part of it is traced, by as many paths as the accuracy takes, \
            up to a limit. The last column says how many pixels state that they meet the accuracy."
        }
        table.tall {
            thead {
                tr {
                    th.name { "Shape" } th.name { "View" } th { "Accuracy" } th { "Processor time" }
                    th { "Mean error" } th { "95th percentile" } th { "Within stated error" }
                    th { "Stated within accuracy" }
                }
            }
            tbody {
                @for one in &report.shapes {
                    tr {
                        td.name { (shapes::name(one.shape)) }
                        td.text { (view_name(one.view)) }
                        td { (exact(one.relative)) }
                        td { (seconds(one.cost.cpu_seconds)) }
                        td { (scientific(one.comparison.mean_relative_error)) }
                        td { (scientific(one.comparison.p95_relative_error)) }
                        td { (percent(one.comparison.within_bound)) }
                        td { (percent(one.within_target)) }
                    }
                }
            }
        }
    }
}

/// One view by every backend and instruction set.
pub fn backends(report: &Report) -> Markup {
    html! {
        p {
            "View " (VIEW) " of the material " code { (HARD_CASES[MATERIAL].name) } ", "
            (report.plan.size_pixels) " × " (report.plan.size_pixels) " pixels, on one thread. All \
            backends and instruction sets give the same bytes."
        }
        table {
            thead {
                tr {
                    th.name { "Contender" } th.name { "Setting" } th { "Processor time" } th { "Wall time" }
                    th { "Spent" } th { "A second" } th.name { "Digest" } th.name { "Bytes" }
                }
            }
            tbody {
                @for outcome in &report.backends {
                    @let contender = &outcome.contender;
                    tr {
                        td.name { (contender.name()) }
                        td.name { (match contender.setting {
                            Setting::Accuracy(relative) => format!("accuracy {}", exact(relative)),
                            Setting::Samples(samples) => format!("{samples} samples"),
                        }) }
                        @match &outcome.result {
                            Ok(run) => {
                                td { (seconds(run.cost.cpu_seconds)) }
                                td { (seconds(run.cost.wall_seconds)) }
                                td { (work(run.work as f64)) }
                                td { (work(run.work as f64 / run.cost.cpu_seconds)) }
                                td.name { code { (run.digest.to_string()[..12]) } }
                                td.name { @if run.same_bytes { "the same" } @else { span.over { "others" } } }
                            }
                            Err(reason) => td.text colspan="6" { "not here: " (reason) }
                        }
                    }
                }
            }
        }
    }
}

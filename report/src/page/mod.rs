//! The page: one HTML file that needs nothing but itself.

mod method;
mod results;

use crate::Report;
use crate::plots::Plot;
use maud::{DOCTYPE, Markup, PreEscaped, html};

const STYLE: &str = include_str!("style.css");

/// The sections, by anchor.
const SECTIONS: [(&str, &str); 9] = [
    ("time", "Time against error"),
    ("convergence", "Convergence"),
    ("hard", "Hard cases"),
    ("calibration", "Calibration of the stated error"),
    ("stages", "Where the time goes"),
    ("backends", "Backends and instruction sets"),
    ("shapes", "Spheres and meshes"),
    ("method", "Method"),
    ("machine", "Machine"),
];

/// The whole page.
pub fn compose(report: &Report, plots: &[Plot]) -> String {
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                title { "brdfarm: speed against error" }
                style { (PreEscaped(STYLE)) }
            }
            body {
                h1 { "Speed against error of brdfarm’s renderer" }
                p.byline { (method::byline(report)) }
                (results::summary(report))
                nav { @for (anchor, title) in SECTIONS { a href={ "#" (anchor) } { (title) } } }
                @for (anchor, title) in SECTIONS {
                    section id=(anchor) {
                        h2 { (title) }
                        (section(anchor, report, plots))
                    }
                }
            }
        }
    };
    page.into_string()
}

fn section(anchor: &str, report: &Report, plots: &[Plot]) -> Markup {
    match anchor {
        "time" => html! {
            (figures(plots, &["time-error.svg"]))
            (figures(plots, &["time-p95-error.svg", "time-relative-mse.svg"]))
            (figures(plots, &["time-error-with-chart.svg", "time-error-without-chart.svg"]))
            (results::ladder(report))
        },
        "convergence" => html! {
            (figures(plots, &["convergence-hybrid.svg", "convergence-path.svg"]))
            (results::slopes(report))
        },
        "hard" => results::hard_cases(report),
        "calibration" => html! {
            (figures(plots, &["calibration-hybrid.svg", "calibration-path.svg"]))
            (results::calibration(report))
        },
        "stages" => html! {
            (figures(plots, &["stages.svg"]))
            (results::stages(report))
        },
        "backends" => results::backends(report),
        "shapes" => results::shapes(report),
        "method" => method::method(report),
        _ => method::machine(report),
    }
}

/// The plots of these files that there are, side by side where there are two.
fn figures(plots: &[Plot], files: &[&str]) -> Markup {
    let there: Vec<_> = files
        .iter()
        .filter_map(|file| plots.iter().find(|plot| plot.file == *file))
        .collect();
    let class = match (files.len(), there.len()) {
        (2, 2) => "pair",
        (2, 1) => "alone",
        _ => "",
    };
    html! {
        div class=(class) {
            @for plot in there {
                figure {
                    (PreEscaped(&plot.svg))
                    figcaption { (plot.caption) }
                }
            }
        }
    }
}

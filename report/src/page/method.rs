//! What was done, on what, and what the words mean.

use crate::Report;
use crate::comparison::{RELATIVE_FLOOR, RELATIVE_MSE_FLOOR, SMAPE_FLOOR};
use crate::findings::{DARK, SPREAD_SHARE};
use crate::numbers::{exact, group, significant};
use dataset::Specification;
use maud::{Markup, html};

/// Program, machine and date in a line.
pub fn byline(report: &Report) -> Markup {
    let fact = |wanted: &str| {
        let found = report.machine.iter().find(|(name, _)| *name == wanted);
        found.map_or("", |(_, fact)| fact.as_str())
    };
    html! {
        (fact("Program")) ", renderer " (fact("Renderer")) ". "
        (fact("Processor")) ", " (fact("Cores")) " cores. " (fact("Date")) "."
    }
}

/// What is compared with what, and every constant.
pub fn method(report: &Report) -> Markup {
    let plan = &report.plan;
    html! {
        p {
            "Rendered are " (plan.materials.len()) " materials in " (plan.views.len())
            " views of the preset " code { "maxbrdf" } " on a film of " (plan.size_pixels) " × "
            (plan.size_pixels) " pixels, each at " (plan.settings.len())
            " settings. Two integrators share the model and the scene and nothing else: "
            code { "hybrid" } " works out what can be worked out, to an accuracy that is asked for; "
            code { "path" } " traces paths, as many as it is told. Every rendering runs on one \
            thread, " (plan.threads) " of them at a time. Views that take less than 30 ms are \
            rendered up to five times, and the run of median processor time counts. Encoding the \
            file is part of the time."
        }
        p {
            "The reference of a view is the hybrid integrator at a relative accuracy of "
            (exact(plan.reference_relative)) ", from a seed of its own. So a fault that both \
            renderings of the hybrid integrator share would not show in its own error; it would \
            show as a floor under the error of the path tracer, which knows nothing of it."
        }
        p {
            "Times in plots and tables are processor seconds unless they say otherwise. Spreads \
            reach from the " (100.0 * SPREAD_SHARE) "th to the " (100.0 * (1.0 - SPREAD_SHARE))
            "th percentile. Views in which nothing is brighter than " (exact(DARK)) " of white, as the mirror’s with \
            the light overhead, are right at any setting; all but the tables as CSV leave them out."
        }
        dl.terms {
            dt { "white" }
            dd { "1: the radiance of a perfect diffuser at the origin that faces the bulb." }
            dt { "relative error" }
            dd {
                "of a pixel: the largest difference of a channel, over the reference’s largest \
                channel or " (RELATIVE_FLOOR) " of white, whichever is larger. At the preset’s \
                accuracy the target of every pixel is a relative error of 1e−3: 1e−3 of its value \
                or 1e−4 of white."
            }
            dt { "relative MSE" }
            dd {
                "mean over pixels and channels of (v − r)² / (r² + " (significant(RELATIVE_MSE_FLOOR, 1))
                ")."
            }
            dt { "SMAPE" }
            dd {
                "mean over pixels and channels of |v − r| / (|v| + |r| + " (SMAPE_FLOOR)
                "); in " code { "renderings.csv" } "."
            }
            dt { "stated error" }
            dd {
                "what a rendering says of each of its pixels: a bound (hybrid), or half the 95 \
                percent t-interval of eight replicates (path)."
            }
            dt { "true error" }
            dd {
                "the difference from the reference. It counts as within the stated error where it \
                is at most the sum of what both renderings state."
            }
            dt { "pixels" }
            dd { "that neither sample nor chart covers are left out." }
        }
        (materials(report))
        p {
            "Beside this page lie " code { "renderings.csv" } " (a row a rendering), "
            code { "stages.csv" } ", " code { "calibration.csv" } ", " code { "backends.csv" }
            " and every plot as SVG, where it was written by " code { "brdfarm report" } "."
        }
    }
}

fn materials(report: &Report) -> Markup {
    html! {
        div.wide {
            table {
                thead {
                    tr {
                        th.name { "Material" } th.name { "What makes it hard" }
                        th { "Roughness" br; "percent" } th { "Anisotropy" } th { "Angle" br; "degrees" }
                        th { "Index" } th { "At 0°" } th { "At 90°" }
                    }
                }
                tbody {
                    @for one in &report.plan.materials {
                        @let m = &one.material;
                        tr {
                            td.name { (one.name) }
                            td.name { (one.reason) }
                            td { (shortest(m.roughness)) }
                            td { (shortest(m.anisotropy)) }
                            td { (shortest(m.angle_deg)) }
                            td { (shortest(m.ior)) }
                            td { (colour(m.rgb0)) }
                            td { (colour(m.rgb90)) }
                        }
                    }
                }
            }
            p.note { "The materials. Colours are linear Rec.709." }
        }
    }
}

/// A parameter: as it is where that is short, to three places elsewhere, but never as another
/// number than it is that tables would show alike.
fn shortest(value: f64) -> String {
    let exact = format!("{value}");
    if exact.len() <= 9 {
        exact
    } else {
        format!("{value:.3}")
    }
}

fn colour(rgb: [f64; 3]) -> String {
    rgb.map(|channel| format!("{channel:.2}")).join("  ")
}

/// Every fact of the machine, and how the run was set up.
pub fn machine(report: &Report) -> Markup {
    let views = Specification::preset().views.len();
    html! {
        table {
            tbody {
                @for (name, fact) in &report.machine {
                    tr { th.name { (name) } td.name { (fact) } }
                }
                tr {
                    th.name { "Renderings" }
                    td.name { (group(&report.plan.renderings().to_string())) ", "
                        (report.plan.views.len()) " of " (views) " views" }
                }
            }
        }
    }
}

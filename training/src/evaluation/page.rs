//! The page of an evaluation: one HTML file that needs nothing but itself.

use super::bounds;
use super::paired::Group;
use super::statistics::Quartiles;
use super::tables::Summary;
use crate::fit::options::{LossWeights, Options, Whiten};
use crate::labels::axes::Colours;
use maud::{DOCTYPE, Markup, PreEscaped, html};

const STYLE: &str = "body { font: 16px/1.5 system-ui, sans-serif; max-width: 84rem; margin: 2rem auto; \
    padding: 0 1rem; } table { border-collapse: collapse; display: block; overflow-x: auto; } \
    th, td { padding: .2rem .7rem; text-align: right; border-bottom: 1px solid #ccc; \
    white-space: nowrap; } \
    th:first-child, td:first-child { text-align: left; } svg { max-width: 100%; height: auto; }";

/// What the page says beside the figures.
#[derive(Clone, Debug)]
pub struct Context {
    /// The dataset's name and specification hash.
    pub dataset: String,
    /// Materials judged.
    pub materials: usize,
    /// Those of the judged views that estimators saw.
    pub seen: Vec<u32>,
    /// The noise of the photographs that networks and the nearest material read: its standard
    /// deviation in steps of an 8-bit code.
    pub noise: Option<f32>,
    /// The machine: processor, cores.
    pub machine: String,
    /// The networks' names and how they were trained.
    pub networks: Vec<(String, Options)>,
    /// Where Cramer-Rao bounds are known, what they are for and the plot of errors over them.
    pub bounds: Option<Bounds>,
}

/// What the page says of Cramer-Rao bounds.
#[derive(Clone, Debug)]
pub struct Bounds {
    /// The standard deviation of the noise that they are for, where white is 1.
    pub noise_sd: f64,
    /// The encoding of the pixels that have it.
    pub codes: &'static str,
    /// Errors over them, as SVG.
    pub plot: String,
}

/// The whole page.
pub fn compose(
    context: &Context,
    summaries: &[Summary],
    groups: &[Group],
    box_plot: &str,
) -> String {
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                title { "brdfarm: estimators of materials" }
                style { (PreEscaped(STYLE)) }
            }
            body {
                h1 { "How far estimates of materials are off" }
                p {
                    "Each estimator read two photographs, those of the views "
                    (format!("{:?}", context.seen)) ", of " (context.materials) " materials of the test split of " (context.dataset)
                    ". Its estimates were rendered again in every view, at 32 pixels a side, and "
                    "compared with the truth. Machine: " (context.machine) "."
                }
                @if let Some(steps) = context.noise {
                    p { "The photographs that networks and nearest read had noise of a standard "
                        "deviation of " (steps) " steps of an 8-bit code, in the codes that each of "
                        "them reads; nearest reads logarithmic ones." }
                }
                @if !context.networks.is_empty() {
                    h2 { "Networks" }
                    (networks(&context.networks))
                }
                h2 { "Images" }
                (PreEscaped(box_plot))
                p { "Boxes reach from quartile to quartile, whiskers from the 5th to the 95th "
                    "percentile of all images." }
                (images(summaries))
                h2 { "Pair by pair" }
                p { "Median over materials of the ratio of the row's error to the column's, with an "
                    "interval of 95 percent by the bootstrap over materials. Trainings that differ by "
                    "their seed alone count together: a material's error is the mean over them. Where "
                    "the interval lies below 1, the row is better." }
                (pairs(groups))
                h2 { "Parameters" }
                p { "Mean absolute errors; psi where it shows (R below 90 and A cubed above 0.3 of "
                    "the isotropic width)." }
                (parameters(summaries))
                @if let Some(Bounds { noise_sd, codes, plot }) = &context.bounds {
                    h2 { "Against what is possible" }
                    p { "Median over materials of the absolute error over the Cramer-Rao bound, the "
                        "least standard deviation that an unbiased estimate from the two photographs "
                        "can have, for noise of " (format!("{:.1}", 255.0 * noise_sd)) " steps of an "
                        "8-bit " (codes) " code. Materials count whose photographs tell more of the parameter than "
                        "its range does. A perfect estimator of so noisy photographs has 0.67." }
                    (against_bounds(summaries))
                    (PreEscaped(plot))
                    p { "Materials are sorted by the least standard deviation that the photographs and "
                        "the parameter's range allow, and divided into eight groups; a dot is the median "
                        "error of a group. The dashed line is a perfect estimator's, for photographs with "
                        "this noise. Estimators that see less noise can lie below it. Trainings that "
                        "differ by their seed alone share a curve." }
                }
            }
        }
    };
    page.into_string()
}

fn networks(networks: &[(String, Options)]) -> Markup {
    html! {
        table {
            thead { tr {
                th { "network" } th { "preset" } th { "variant" } th { "pixels a side" }
                th { "pixel codes" } th { "colours of labels" } th { "CNN_w's whitening" }
                th { "loss weights" } th { "metric loss" } th { "noise" } th { "epochs, CNN and block" } th { "seed" }
            } }
            tbody { @for (name, options) in networks { tr {
                td { (name) }
                td { (options.preset.name()) }
                td { (options.variant.name()) }
                td { (options.architecture.side) }
                td { (options.encoding.name()) }
                td { (options.colours.name()) }
                td { @match options.whiten {
                    Whiten::Dataset => "of the dataset",
                    Whiten::Image => "of each photograph",
                } }
                td { @match options.weights {
                    LossWeights::Paper => "the variant's",
                    LossWeights::Observable { .. } => "observable",
                } }
                td { @match &options.metric {
                    Some(metric) => (metric.share),
                    None => "none",
                } }
                td { @if options.noise { "yes" } @else { "no" } }
                td { (options.cnn_epochs) ", " (options.block_epochs) }
                td { (options.seed) }
            } } }
        }
    }
}

fn images(summaries: &[Summary]) -> Markup {
    let first = summaries
        .first()
        .map_or("", |summary| summary.name.as_str());
    html! {
        table {
            thead { tr {
                th { "estimator" }
                th { "median MSE" } th { "quartiles" }
                th { "views seen" } th { "views not seen" } th { "log codes" }
                th { "ratio to " (first) " (95%)" }
            } }
            tbody { @for summary in summaries { tr {
                td { (summary.name) }
                td { (scientific(summary.all.median)) }
                td { (range(summary.all)) }
                td { (scientific(summary.seen.median)) }
                td { (scientific(summary.unseen.median)) }
                td { (scientific(summary.log.median)) }
                td {
                    (format!("{:.3} ({:.3} to {:.3})", summary.ratio.value, summary.ratio.low,
                        summary.ratio.high))
                }
            } } }
        }
    }
}

fn pairs(groups: &[Group]) -> Markup {
    html! {
        table {
            thead { tr {
                th { "estimator (trainings)" }
                @for group in groups { th { (group.name) } }
            } }
            tbody { @for row in groups { tr {
                td { (row.name) " (" (row.trainings) ")" }
                @for column in groups { td {
                    @if row.name != column.name {
                        @let ratio = row.ratio_to(column);
                        (times(ratio.value)) " (" (times(ratio.low)) " to " (times(ratio.high)) ")"
                    }
                } }
            } } }
        }
    }
}

fn parameters(summaries: &[Summary]) -> Markup {
    html! {
        table {
            thead { tr {
                th { "estimator" }
                @for axis in Colours::Lab.axes() { th { (axis.name) } }
            } }
            tbody { @for summary in summaries { tr {
                td { (summary.name) }
                @for error in summary.parameters { td { (format!("{error:.3}")) } }
            } } }
        }
    }
}

fn against_bounds(summaries: &[Summary]) -> Markup {
    html! {
        table {
            thead { tr {
                th { "estimator" }
                @for axis in bounds::axes() { th { (axis.name) } }
            } }
            tbody { @for summary in summaries { tr {
                td { (summary.name) }
                @for ratio in summary.over_bounds.iter().flatten() { td { (times(*ratio)) } }
            } } }
        }
    }
}

/// A ratio: with two decimals where these tell what it is and no digits more than they do.
fn times(ratio: f64) -> String {
    if (0.1..1e3).contains(&ratio) {
        format!("{ratio:.2}")
    } else {
        scientific(ratio)
    }
}

fn scientific(value: f64) -> String {
    format!("{value:.2e}")
}

fn range(quartiles: Quartiles) -> String {
    format!(
        "{} to {}",
        scientific(quartiles.lower),
        scientific(quartiles.upper)
    )
}

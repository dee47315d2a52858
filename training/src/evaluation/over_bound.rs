//! Errors over what the photographs show: a panel for each parameter, a curve for each estimator.

use super::bounds::{self, BOUNDED};
use super::paired::without_number;
use super::statistics::quantile;
use super::{Estimates, Judged};
use crate::error::TrainingError;
use crate::labels::axes::Axis;
use export::observability::Observed;
use plotters::coord::Shift;
use plotters::prelude::*;

/// Points of a curve; each stands for as many materials as the others.
const POINTS: usize = 8;

const SIZE_PIXELS: (u32, u32) = (1000, 860);

/// Errors below this fraction of the smallest standard deviation are drawn at it: a renderer that sees
/// exact films has errors near 0.
const FLOOR: f64 = 1e-2;

/// The median of a normal deviate's absolute value.
const MEDIAN_DEVIATION: f64 = 0.674_489_750_196_081_7;

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
type DrawingFailure = Box<dyn std::error::Error>;

/// One estimator's errors of one parameter.
#[derive(Clone, Debug, PartialEq)]
struct Curve {
    name: String,
    /// Least standard deviation and median absolute error, in units of the label.
    points: Vec<(f64, f64)>,
}

/// An SVG file. Trainings that differ by their seed alone share a curve.
///
/// # Errors
/// When the plot cannot be drawn.
pub fn svg(
    all: &[Estimates],
    judged: &[Vec<Judged>],
    observed: &Observed,
) -> Result<String, TrainingError> {
    let mut svg = String::new();
    draw(all, judged, observed, &mut svg)
        .map_err(|error| TrainingError::Weights(error.to_string()))?;
    Ok(svg)
}

fn draw(
    all: &[Estimates],
    judged: &[Vec<Judged>],
    observed: &Observed,
    svg: &mut String,
) -> Result<(), DrawingFailure> {
    let area = SVGBackend::with_string(svg, SIZE_PIXELS).into_drawing_area();
    area.fill(&WHITE).map_err(|error| error.to_string())?;
    let axes = bounds::axes();
    for (parameter, panel) in area.split_evenly((2, BOUNDED / 2)).iter().enumerate() {
        let curves = curves(all, judged, observed, parameter);
        draw_panel(panel, &axes[parameter], &curves, parameter == 0)?;
    }
    area.present().map_err(|error| error.to_string())?;
    Ok(())
}

fn draw_panel(
    panel: &Area<'_>,
    axis: &Axis,
    curves: &[Curve],
    with_names: bool,
) -> Result<(), DrawingFailure> {
    let bounds = || curves.iter().flat_map(|curve| &curve.points);
    let low = bounds().map(|(bound, _)| *bound).fold(f64::MAX, f64::min);
    let high = bounds().map(|(bound, _)| *bound).fold(0.0, f64::max);
    if low > high {
        return Ok(());
    }
    let least = low * FLOOR;
    let errors = bounds().map(|(_, error)| error.max(least));
    let lowest = errors.clone().fold(low * MEDIAN_DEVIATION, f64::min);
    let highest = errors.fold(high * MEDIAN_DEVIATION, f64::max);
    let room = |low: f64, high: f64| (low / 1.5..high * 1.5).log_scale();
    let mut chart = ChartBuilder::on(panel)
        .margin(12)
        .x_label_area_size(40)
        .y_label_area_size(64)
        .build_cartesian_2d(room(low, high), room(lowest, highest))
        .map_err(|error| error.to_string())?;
    let number = |value: &f64| format!("{value:.0e}");
    chart
        .configure_mesh()
        .light_line_style(TRANSPARENT)
        .x_desc(format!("{}: least standard deviation", axis.name))
        .y_desc("median error")
        .x_label_formatter(&number)
        .y_label_formatter(&number)
        .draw()
        .map_err(|error| error.to_string())?;
    let possible = [low, high].map(|bound| (bound, bound * MEDIAN_DEVIATION));
    chart
        .draw_series(DashedLineSeries::new(possible, 6, 4, BLACK.stroke_width(1)))
        .map_err(|error| error.to_string())?;
    for (number, curve) in curves.iter().enumerate() {
        let colour = Palette99::pick(number).to_rgba();
        let points = curve.points.iter();
        let points: Vec<(f64, f64)> = points
            .map(|&(bound, error)| (bound, error.max(least)))
            .collect();
        let dots = points.iter().map(|&at| Circle::new(at, 3, colour.filled()));
        chart.draw_series(dots).map_err(|error| error.to_string())?;
        let line = chart
            .draw_series(LineSeries::new(points, colour.stroke_width(2)))
            .map_err(|error| error.to_string())?;
        line.label(&curve.name)
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 20, y)], colour.stroke_width(2)));
    }
    if with_names {
        chart
            .configure_series_labels()
            .position(SeriesLabelPosition::UpperLeft)
            .background_style(WHITE.mix(0.8))
            .draw()
            .map_err(|error| error.to_string())?;
    }
    Ok(())
}

/// The curves of one parameter. Estimators whose names differ by a number behind their last hyphen
/// are one.
fn curves(
    all: &[Estimates],
    judged: &[Vec<Judged>],
    observed: &Observed,
    parameter: usize,
) -> Vec<Curve> {
    let mut samples: Vec<(&str, Vec<(f64, f64)>)> = Vec::new();
    for (estimates, judged) in all.iter().zip(judged) {
        let name = without_number(&estimates.name);
        let errors = judged
            .iter()
            .filter_map(|one| bounds::least_sd_and_error(one, observed, parameter));
        match samples.iter_mut().find(|(known, _)| *known == name) {
            Some((_, known)) => known.extend(errors),
            None => samples.push((name, errors.collect())),
        }
    }
    let curve = |(name, mut sample): (&str, Vec<(f64, f64)>)| {
        sample.sort_by(|one, other| one.0.total_cmp(&other.0));
        let share = sample.len().div_ceil(POINTS).max(1);
        Curve {
            name: name.to_owned(),
            points: sample.chunks(share).map(medians).collect(),
        }
    };
    samples.into_iter().map(curve).collect()
}

fn medians(sample: &[(f64, f64)]) -> (f64, f64) {
    let middle = |values: &mut Vec<f64>| {
        values.sort_by(f64::total_cmp);
        quantile(values, 0.5)
    };
    let (mut bounds, mut errors) = sample.iter().copied().unzip();
    (middle(&mut bounds), middle(&mut errors))
}

#[cfg(test)]
mod tests {
    use super::*;
    use dataset::{Digest, Material, Specification};
    use export::observability::ObservedMaterial;

    /// Sixteen materials, the bound of each larger than that of the one before.
    fn observed() -> Observed {
        let material = |index: u32| ObservedMaterial {
            information: [0.0; 100],
            bound: [1e-4 * f64::from(index + 1); 10],
        };
        Observed {
            digest: Digest::of(b""),
            specification: String::new(),
            renderer_version: String::new(),
            noise_sd: 1e-3,
            materials: (0..16).map(|index| (index, material(index))).collect(),
        }
    }

    /// Judged materials whose roughness is off by `off` times what the bound says.
    fn judged(off: f64) -> Vec<Judged> {
        let truth = Specification::preset().material(3).material;
        let one = |index: u32| Judged {
            index,
            estimate: Material {
                roughness: truth.roughness + off * 1e-2 * f64::from(index + 1),
                ..truth
            },
            truth,
            views: Vec::new(),
        };
        (0..16).map(one).collect()
    }

    fn estimates(name: &str) -> Estimates {
        Estimates {
            name: name.to_owned(),
            materials: Vec::new(),
        }
    }

    #[test]
    fn curves_are_medians_over_materials_in_the_order_of_their_bounds() {
        let all = ["a-0", "a-1", "b"].map(estimates);
        let errors = [judged(1.0), judged(3.0), judged(2.0)];
        let curves = curves(&all, &errors, &observed(), 0);
        assert_eq!(curves.len(), 2);
        for curve in &curves {
            assert_eq!(curve.points.len(), POINTS, "{}", curve.name);
            for (place, (bound, error)) in curve.points.iter().enumerate() {
                let expected = 1e-2 * (2.0 * place as f64 + 1.5);
                assert!((bound / expected - 1.0).abs() < 1e-3, "{bound} {expected}");
                let ratio = error / bound;
                assert!((1.4..2.6).contains(&ratio), "{}: {ratio}", curve.name);
            }
        }
    }

    #[test]
    fn plots_are_drawn_of_anything() {
        let all = ["exact", "off"].map(estimates);
        let errors = [judged(0.0), judged(1.0)];
        let plot = svg(&all, &errors, &observed()).expect("a plot");
        assert!(plot.contains("exact") && plot.contains("</svg>"));
        svg(&[], &[], &observed()).expect("an empty plot");
    }
}

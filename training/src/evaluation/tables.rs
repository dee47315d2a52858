//! What was found, as CSV and as a summary.

use super::bounds::{self, BOUNDED, over_bounds};
use super::statistics::{Interval, Quartiles, median_ratio, quartiles};
use super::{Estimates, Judged};
use crate::labels::PARAMETERS;
use crate::labels::axes::{Colours, PSI};
use export::observability::Observed;
use std::fmt::Write;

/// The seed of the bootstrap.
const BOOTSTRAP_SEED: u64 = 1;

/// R above which, and a + A^3 below which, psi does not show: see [`psi_shows`].
const ROUGH_PERCENT: f64 = 90.0;

/// One estimator in figures.
#[derive(Clone, Debug)]
pub struct Summary {
    /// Its name.
    pub name: String,
    /// Mean squared differences of sRGB codes over all materials and views.
    pub all: Quartiles,
    /// The same in the two views that it saw.
    pub seen: Quartiles,
    /// The same in the others.
    pub unseen: Quartiles,
    /// The same of logarithmic codes, all views.
    pub log: Quartiles,
    /// Mean absolute error of each label, colours as CIELAB; of psi where it shows.
    pub parameters: [f64; PARAMETERS],
    /// Median error over the Cramer-Rao bound: see [`over_bounds`].
    pub over_bounds: Option<[f64; BOUNDED]>,
    /// Median over materials of the ratio of its mean error to the first estimator's.
    pub ratio: Interval,
}

/// One row an image: estimator, material, view, whether the estimator saw it, and both errors.
pub fn errors_csv(all: &[Estimates], judged: &[Vec<Judged>], seen: &[u32]) -> String {
    let mut text = "estimator,material,view,seen,mse_srgb,mse_log\n".to_owned();
    for (estimates, judged) in all.iter().zip(judged) {
        for one in judged {
            for (view, error) in one.views.iter().enumerate() {
                let was_seen = seen.contains(&(view as u32));
                // Writing to a string cannot fail.
                let _ = writeln!(
                    text,
                    "{},{},{view},{was_seen},{:.6e},{:.6e}",
                    estimates.name, one.index, error.srgb, error.log
                );
            }
        }
    }
    text
}

/// One row a material: estimator, material, then label and estimate of every parameter, then the
/// Cramer-Rao bounds of the first four where they are known.
pub fn parameters_csv(
    all: &[Estimates],
    judged: &[Vec<Judged>],
    observed: Option<&Observed>,
) -> String {
    let mut text = "estimator,material".to_owned();
    for axis in Colours::Lab.axes() {
        let _ = write!(text, ",{0},estimated_{0}", axis.name);
    }
    if observed.is_some() {
        for axis in bounds::axes() {
            let _ = write!(text, ",bound_{}", axis.name);
        }
    }
    text.push('\n');
    for (estimates, judged) in all.iter().zip(judged) {
        for one in judged {
            let _ = write!(text, "{},{}", estimates.name, one.index);
            let truth = Colours::Lab.values(&one.truth);
            let estimate = Colours::Lab.values(&one.estimate);
            for (truth, estimate) in truth.into_iter().zip(estimate) {
                let _ = write!(text, ",{truth:.6},{estimate:.6}");
            }
            let found = observed.and_then(|observed| bounds::bounds(observed, one.index));
            for bound in found.iter().flatten() {
                let _ = write!(text, ",{bound:.6e}");
            }
            text.push('\n');
        }
    }
    text
}

/// Whether a material's anisotropy is strong enough, and its surface smooth enough, for psi to show:
/// A^3 > 0.3 a with a = 0.001 + 0.00999 R, and R < 90.
pub fn psi_shows(material: &dataset::Material) -> bool {
    let isotropic = 0.001 + 0.009_99 * material.roughness;
    let a = material.anisotropy;
    material.roughness < ROUGH_PERCENT && a * a * a > 0.3 * isotropic
}

/// The figures of every estimator.
pub fn summaries(
    all: &[Estimates],
    judged: &[Vec<Judged>],
    seen: &[u32],
    observed: Option<&Observed>,
) -> Vec<Summary> {
    let first = judged.first().map(|judged| mean_errors(judged));
    let pairs = all.iter().zip(judged);
    let summaries = pairs.map(|(estimates, judged)| {
        let of_views = |keep: &dyn Fn(u32) -> bool| -> Vec<f64> {
            let views = judged.iter().flat_map(|one| one.views.iter().enumerate());
            views
                .filter(|(view, _)| keep(*view as u32))
                .map(|(_, error)| error.srgb)
                .collect()
        };
        let log = judged.iter().flat_map(|one| &one.views);
        let log: Vec<f64> = log.map(|error| error.log).collect();
        let first = first.as_deref().unwrap_or_default();
        Summary {
            name: estimates.name.clone(),
            all: quartiles(&of_views(&|_| true)),
            seen: quartiles(&of_views(&|view| seen.contains(&view))),
            unseen: quartiles(&of_views(&|view| !seen.contains(&view))),
            log: quartiles(&log),
            parameters: parameter_errors(judged),
            over_bounds: observed.map(|observed| over_bounds(judged, observed)),
            ratio: median_ratio(&mean_errors(judged), first, BOOTSTRAP_SEED),
        }
    });
    summaries.collect()
}

/// The mean over views of each material's error.
pub(super) fn mean_errors(judged: &[Judged]) -> Vec<f64> {
    let mean = |one: &Judged| {
        let sum: f64 = one.views.iter().map(|error| error.srgb).sum();
        sum / one.views.len() as f64
    };
    judged.iter().map(mean).collect()
}

fn parameter_errors(judged: &[Judged]) -> [f64; PARAMETERS] {
    let axes = Colours::Lab.axes();
    let errors = |parameter: usize| {
        let shown = judged
            .iter()
            .filter(|one| parameter != PSI || psi_shows(&one.truth));
        let errors: Vec<f64> = shown
            .map(|one| {
                let truth = Colours::Lab.values(&one.truth)[parameter];
                let estimate = Colours::Lab.values(&one.estimate)[parameter];
                axes[parameter].distance(truth, estimate)
            })
            .collect();
        errors.iter().sum::<f64>() / errors.len() as f64
    };
    std::array::from_fn(errors)
}

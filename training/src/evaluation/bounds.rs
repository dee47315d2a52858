//! How far an estimator is from what any estimator can reach.

use super::Judged;
use super::statistics::quantile;
use crate::error::TrainingError;
use crate::labels::axes::{Axis, Colours};
use export::observability::Observed;

/// Parameters that are labels themselves: R, A, psi and N_d. Colours are labels in CIELAB.
pub const BOUNDED: usize = 4;

/// The standard deviation of a parameter that is uniform over its range: a bound above it says that
/// the images tell less than the range.
const UNIFORM_SD: f64 = 0.288_675_134_594_812_9;

/// The axes of the parameters that have bounds.
pub fn axes() -> [Axis; BOUNDED] {
    let all = Colours::Lab.axes();
    std::array::from_fn(|parameter| all[parameter])
}

/// The Cramer-Rao bounds of a material in units of the labels; infinite where nothing observes one.
pub fn bounds(observed: &Observed, index: u32) -> Option<[f64; BOUNDED]> {
    let found = observed.materials.get(&index)?;
    let axes = axes();
    Some(std::array::from_fn(|parameter| {
        let [low, high] = axes[parameter].range;
        found.bound[parameter] * (high - low)
    }))
}

/// The least standard deviation that photographs and range leave together, 1/sqrt(1/b^2 + 12/range^2)
/// with the bound b, and the absolute error, both in units of the label.
pub fn least_sd_and_error(
    judged: &Judged,
    observed: &Observed,
    parameter: usize,
) -> Option<(f64, f64)> {
    let bound = bounds(observed, judged.index)?[parameter];
    let axis = &axes()[parameter];
    let [low, high] = axis.range;
    let range = UNIFORM_SD * (high - low);
    // An infinite bound leaves the range.
    let least = 1.0 / (1.0 / (bound * bound) + 1.0 / (range * range)).sqrt();
    Some((least, error(axis, parameter, judged)))
}

fn error(axis: &Axis, parameter: usize, judged: &Judged) -> f64 {
    let value = |material| Colours::Lab.values(material)[parameter];
    axis.distance(value(&judged.truth), value(&judged.estimate))
}

/// Refuses a table without one of the materials.
///
/// # Errors
/// Names the first that is missing.
pub fn check(
    observed: &Observed,
    indices: impl IntoIterator<Item = u32>,
) -> Result<(), TrainingError> {
    let mut indices = indices.into_iter();
    match indices.find(|index| !observed.materials.contains_key(index)) {
        None => Ok(()),
        Some(index) => Err(TrainingError::Input(format!(
            "the table of observability lacks material {index}"
        ))),
    }
}

/// For each parameter the median, over materials whose images tell more of it than its range, of the
/// absolute error over the bound; NaN where there is none.
pub fn over_bounds(judged: &[Judged], observed: &Observed) -> [f64; BOUNDED] {
    let axes = axes();
    std::array::from_fn(|parameter| {
        let axis = &axes[parameter];
        let [low, high] = axis.range;
        let ratios = judged.iter().filter_map(|one| {
            let bound = bounds(observed, one.index)?[parameter];
            let told = bound < UNIFORM_SD * (high - low);
            told.then(|| error(axis, parameter, one) / bound)
        });
        let mut ratios: Vec<f64> = ratios.collect();
        ratios.sort_by(f64::total_cmp);
        quantile(&ratios, 0.5)
    })
}

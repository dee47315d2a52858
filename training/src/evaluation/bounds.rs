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
            let values = |material| Colours::Lab.values(material)[parameter];
            told.then(|| axis.distance(values(&one.truth), values(&one.estimate)) / bound)
        });
        let mut ratios: Vec<f64> = ratios.collect();
        ratios.sort_by(f64::total_cmp);
        quantile(&ratios, 0.5)
    })
}

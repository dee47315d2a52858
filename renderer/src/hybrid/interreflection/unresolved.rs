//! Light that no rule over the sample resolves.

use crate::hybrid::budget::interreflection::UNRESOLVED_MAX;

/// Interreflection that no rule over the sample resolves: a lobe so narrow that it throws a caustic
/// on the chart.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the lobe is too narrow to work out what the sample sends to the chart")]
pub struct Unresolved;

/// The error to state for such light, twice what it and its rules' differences come to.
///
/// # Errors
/// When it is brighter: the path tracer renders such a view.
pub fn unresolved_error(largest: f64, missed: f64) -> Result<f64, Unresolved> {
    if largest + missed > UNRESOLVED_MAX {
        return Err(Unresolved);
    }
    Ok(2.0 * (largest + missed))
}

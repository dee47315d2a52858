//! Light that no rule over the sample resolves.

use crate::hybrid::budget::interreflection::UNRESOLVED_MAX;

/// Interreflection that no rule over the sample resolves: a lobe so narrow that it throws a caustic
/// on the chart, or a chart of so many patches that even a first look takes too much.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "the lobe is too narrow, or the chart has too many patches, to work out what the sample sends to the chart"
)]
pub struct Unresolved;

/// Twice what such light and its rules' differences come to.
pub fn unresolved_at_most(largest: f64, missed: f64) -> f64 {
    2.0 * (largest + missed)
}

/// The error to state for it.
///
/// # Errors
/// When it is brighter: the path tracer renders such a view.
pub fn unresolved_error(largest: f64, missed: f64) -> Result<f64, Unresolved> {
    if largest + missed > UNRESOLVED_MAX {
        return Err(Unresolved);
    }
    Ok(unresolved_at_most(largest, missed))
}

//! Light that no rule over the sample resolves.

/// Interreflection that no rule over the sample resolves: a lobe so narrow that it throws a caustic
/// on the chart.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the lobe is too narrow to work out what the sample sends to the chart")]
pub struct Unresolved;

/// A rule is taken not to resolve the lobe if the next finer one moves the result by more than this
/// share of it.
pub const UNRESOLVED_SHARE: f64 = 0.25;

/// Light that no rule resolves, but that is below this much of white at every node that was tried, is
/// stated as an error: the path tracer's own is as large.
pub const UNRESOLVED_MAX: f64 = 2e-3;

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

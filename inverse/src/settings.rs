//! How a fit is done, and why it ended.

use crate::nuisance::Nuisances;

/// A fit ends at this mean square of the residual: below it lie the errors of renderings.
pub(crate) const MEAN_SQUARE_LEAST: f64 = 1e-14;

/// How a fit is done.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// The most images rendered from one start. Those for `covariance` are not counted.
    pub renderings_max: u32,
    /// The difference of a parameter over its range by which the images are differentiated.
    pub difference: f64,
    /// The largest step of a parameter over its range.
    pub step_max: f64,
    /// The noise of each encoded channel that weighs the images against the priors of nuisance
    /// parameters. Without nuisance parameters it changes nothing.
    pub noise_sd: f64,
    /// The least noise of each encoded channel that a covariance is for, and below which no fit goes
    /// on, whatever the residual: what codes were rounded by, say.
    pub noise_least_sd: f64,
    /// What is fitted beside the material.
    pub nuisances: Nuisances,
    /// Whether to work out the covariance at the solution, which takes
    /// [`crate::derivatives::RENDERINGS_MAX`] renderings of each view.
    pub covariance: bool,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            renderings_max: 250,
            difference: 0.01,
            step_max: 0.25,
            noise_sd: 2.0 / 255.0,
            noise_least_sd: MEAN_SQUARE_LEAST.sqrt(),
            nuisances: Nuisances::default(),
            covariance: false,
        }
    }
}

/// Why a fit ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stop {
    /// No step promises to lower the cost noticeably, or the images agree.
    Converged,
    /// No step, however small, lowers the cost.
    Stuck,
    /// The renderings were spent.
    RenderingsSpent,
}

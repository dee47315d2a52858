//! What the networks are asked for: ten parameters, each as one of a hundred bins.
//!
//! | module | what |
//! | --- | --- |
//! | [`axes`] | the ten parameters, their ranges, and three ways to write colours |
//! | [`target`] | a label as a smoothed distribution over bins |
//! | [`loss`] | the cross-entropy of logits and targets, in 64 bits |
//! | [`observable`] | how much a material's photographs tell of each |
//! | [`metric`] | how much they change with each |
//! | [`reading`] | a distribution over bins as one position |
//! | [`interval`] | and as an interval |

pub mod axes;
pub mod interval;
pub mod loss;
pub mod metric;
pub mod observable;
pub mod reading;
pub mod target;

/// Bins of a parameter.
pub const BINS: usize = dataset::colour::BINS as usize;

/// Parameters of the reflectance model.
pub const PARAMETERS: usize = dataset::colour::BIN_RANGES.len();

//! The paper's networks (section 4.1 and 4.2), in burn.
//!
//! | module | what |
//! | --- | --- |
//! | [`architecture`] | sizes |
//! | `weights` | first weights |
//! | [`trunk`] | the convolutions: a pair of photographs to features |
//! | [`head`] | the dense layers: features to a distribution over bins for each parameter |
//! | [`dropout`] | which activations are dropped in a step |
//! | [`loss`] | the training loss |
//! | [`estimator`] | trunks and heads of a variant together |

pub mod architecture;
pub mod dropout;
pub mod estimator;
pub mod head;
pub mod loss;
pub mod trunk;
pub(crate) mod weights;

pub use architecture::Architecture;

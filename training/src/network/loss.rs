//! The training loss, in 32 bits on any device; [`crate::labels::loss`] has it in 64.

use burn::tensor::Tensor;
use burn::tensor::activation::log_softmax;

/// Mean over the batch, for each parameter, of -sum_j target_j log softmax(logits)_j, in nats.
///
/// Logits and targets are (batch, parameters, 100); the result is (batch, parameters).
pub fn cross_entropies(logits: Tensor<3>, targets: Tensor<3>) -> Tensor<2> {
    let [batch, parameters, _] = logits.dims();
    let terms = log_softmax(logits, 2) * targets;
    terms.sum_dim(2).neg().reshape([batch, parameters])
}

/// sum w L / sum w over a batch: losses and weights are (batch, parameters); the result has one
/// number. The weights' sum is above 0.
pub fn weighted_mean(losses: Tensor<2>, weights: Tensor<2>) -> Tensor<1> {
    (losses * weights.clone()).sum() / weights.sum()
}

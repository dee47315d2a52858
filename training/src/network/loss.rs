//! The training loss, in 32 bits on any device; [`crate::labels::loss`] has it in 64.

use burn::tensor::Tensor;
use burn::tensor::activation::{log_softmax, softmax};

/// Mean over the batch, for each parameter, of -sum_j target_j log softmax(logits)_j, in nats.
///
/// Logits and targets are (batch, parameters, 100); the result is (batch, parameters).
pub fn cross_entropies(logits: Tensor<3>, targets: Tensor<3>) -> Tensor<2> {
    let [batch, parameters, _] = logits.dims();
    let terms = log_softmax(logits, 2) * targets;
    terms.sum_dim(2).neg().reshape([batch, parameters])
}

/// The metric loss, mean over the batch of ln(1 + e' M e): e is the mean of each parameter's
/// distribution less its label, and e' M e to second order the squared change of the photographs in
/// standard deviations of a camera's noise ([`crate::labels::metric`]).
///
/// The logarithm holds where the second order does not: a highlight that moves by more than its width
/// changes its photographs no further.
///
/// Logits and `offsets`, those of the bins from the label as shares of the range, are (batch,
/// parameters, 100), `metrics` are (batch, parameters, parameters); the result has one number.
pub fn metric_loss(logits: Tensor<3>, offsets: Tensor<3>, metrics: Tensor<3>) -> Tensor<1> {
    let error = (softmax(logits, 2) * offsets).sum_dim(2);
    let changes = error.clone().swap_dims(1, 2).matmul(metrics).matmul(error);
    changes.clamp_min(0.0).log1p().mean()
}

/// sum w L / sum w over a batch: losses and weights are (batch, parameters); the result has one
/// number. The weights' sum is above 0.
pub fn weighted_mean(losses: Tensor<2>, weights: Tensor<2>) -> Tensor<1> {
    (losses * weights.clone()).sum() / weights.sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::labels::BINS;
    use burn::tensor::{Device, TensorData};

    /// A distribution that has all of its weight in one bin.
    fn certain(bin: usize) -> [f32; BINS] {
        std::array::from_fn(|at| if at == bin { 100.0 } else { 0.0 })
    }

    fn offsets(label: f32) -> [f32; BINS] {
        std::array::from_fn(|at| (at as f32 - label) / BINS as f32)
    }

    #[test]
    fn the_metric_loss_is_what_the_mean_of_the_distribution_would_change() {
        let device = Device::flex();
        // Errors of 0.1 and -0.2 of one material, none of the other.
        let logits = [certain(30), certain(20), certain(50), certain(60)].concat();
        let offsets = [offsets(20.0), offsets(40.0), offsets(50.0), offsets(60.0)].concat();
        let metrics = [3e4, 1e4, 1e4, 2e4, 1.0, 0.0, 0.0, 1.0_f32];
        let loss = metric_loss(
            Tensor::from_data(TensorData::new(logits, [2, 2, BINS]), &device),
            Tensor::from_data(TensorData::new(offsets, [2, 2, BINS]), &device),
            Tensor::from_data(TensorData::new(metrics.to_vec(), [2, 2, 2]), &device),
        );
        let change = 3e4 * 0.01 + 2.0 * 1e4 * -0.02 + 2e4 * 0.04;
        let expected = libm::log1p(change) / 2.0;
        let found = f64::from(loss.into_scalar::<f32>());
        assert!((found - expected).abs() < 1e-5, "{found} {expected}");
    }
}

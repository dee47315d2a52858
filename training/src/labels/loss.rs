//! The cross-entropy of logits and smoothed targets, and its gradient, in 64 bits.
//!
//! Networks are trained with the same formula in 32 bits ([`crate::network::loss`]); this one is
//! for measuring.

/// softmax(logits): exp(z_j) / sum exp(z_k), without overflow for any finite logits.
pub fn softmax<const N: usize>(logits: &[f64; N]) -> [f64; N] {
    let largest = logits.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let exponentials = logits.map(|logit| libm::exp(logit - largest));
    let sum: f64 = exponentials.iter().sum();
    exponentials.map(|value| value / sum)
}

/// -sum_j target_j log softmax(logits)_j, in nats. Both have the same length.
pub fn cross_entropy(
    logits: impl Iterator<Item = f64> + Clone,
    targets: impl Iterator<Item = f64>,
) -> f64 {
    let largest = logits.clone().fold(f64::NEG_INFINITY, f64::max);
    let sum: f64 = logits.clone().map(|logit| libm::exp(logit - largest)).sum();
    let log_sum = libm::log(sum);
    let term = |(logit, target): (f64, f64)| target * (log_sum - (logit - largest));
    logits.zip(targets).map(term).sum()
}

/// The derivative of [`cross_entropy`] by each logit: softmax(logits) - target.
pub fn gradient<const N: usize>(logits: &[f64; N], target: &[f64; N]) -> [f64; N] {
    let probabilities = softmax(logits);
    std::array::from_fn(|bin| probabilities[bin] - target[bin])
}

/// sum_i weight_i loss_i / sum_i weight_i; `None` where no weight is above 0.
pub fn weighted_mean(losses: &[f64], weights: &[f64]) -> Option<f64> {
    let total: f64 = weights.iter().sum();
    let sum: f64 = losses.iter().zip(weights).map(|(loss, w)| loss * w).sum();
    (total > 0.0).then(|| sum / total)
}

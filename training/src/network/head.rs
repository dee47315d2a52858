//! The dense layers: features to logits, a hundred for each parameter.

use super::architecture::Architecture;
use super::dropout::Dropout;
use super::weights::Initialiser;
use crate::labels::BINS;
use burn::module::Module;
use burn::nn::Linear;
use burn::tensor::Tensor;
use burn::tensor::activation::relu;

/// Layers that a head has, for numbering those behind it.
pub(crate) const LAYERS: u64 = 3;

/// The first layer that drops here; a trunk's are before it.
const FIRST_DROPOUT: u64 = 2;

/// Two hidden layers with ReLU and dropout, and a layer of logits without (paper, sections 4.1 and
/// 4.2).
#[derive(Module, Debug)]
pub struct Head {
    fc1: Linear,
    fc2: Linear,
    out: Linear,
}

impl Head {
    /// With its first weights: `inputs` numbers to `parameters` times a hundred logits.
    pub(crate) fn new(
        architecture: Architecture,
        inputs: usize,
        parameters: usize,
        layers: &mut Initialiser<'_>,
    ) -> Self {
        let [first, second] = architecture.hidden;
        Self {
            fc1: layers.linear(inputs, first),
            fc2: layers.linear(first, second),
            out: layers.linear(second, parameters * BINS),
        }
    }

    /// Features (batch, inputs) to logits (batch, parameters x 100).
    pub fn forward(&self, features: Tensor<2>, dropout: Option<Dropout>) -> Tensor<2> {
        let mut x = features;
        for (layer, dense) in [&self.fc1, &self.fc2].into_iter().enumerate() {
            x = relu(dense.forward(x));
            if let Some(dropout) = dropout {
                x = dropout.apply(x, FIRST_DROPOUT + layer as u64);
            }
        }
        self.out.forward(x)
    }
}

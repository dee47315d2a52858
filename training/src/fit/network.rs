//! What a stage trains: a CNN as a whole, or one block.

use crate::network::dropout::Dropout;
use crate::network::head::Head;
use crate::network::trunk::Trunk;
use crate::pixels::CHANNELS;
use burn::module::Module;
use burn::tensor::Tensor;

/// Rows of numbers to logits.
pub trait Network: Module {
    /// Inputs (batch, width) to logits (batch, parameters x 100); with dropout while it learns.
    fn logits(&self, inputs: Tensor<2>, dropout: Option<Dropout>) -> Tensor<2>;
}

/// A trunk with a head for all parameters.
#[derive(Module, Debug)]
pub struct Cnn {
    /// The convolutions.
    pub trunk: Trunk,
    /// The dense layers.
    pub head: Head,
    /// Pixels a side of its photographs.
    pub side: usize,
}

impl Cnn {
    /// The trunk's features of rows of pixels, (batch, features).
    pub fn features(&self, inputs: Tensor<2>, dropout: Option<Dropout>) -> Tensor<2> {
        let [batch, _] = inputs.dims();
        let photographs = inputs.reshape([batch, CHANNELS, self.side, self.side]);
        self.trunk.forward(photographs, dropout)
    }
}

impl Network for Cnn {
    fn logits(&self, inputs: Tensor<2>, dropout: Option<Dropout>) -> Tensor<2> {
        self.head.forward(self.features(inputs, dropout), dropout)
    }
}

impl Network for Head {
    fn logits(&self, inputs: Tensor<2>, dropout: Option<Dropout>) -> Tensor<2> {
        self.forward(inputs, dropout)
    }
}

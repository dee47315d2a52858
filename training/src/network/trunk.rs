//! The convolutions: two photographs to features.

use super::architecture::Architecture;
use super::dropout::Dropout;
use super::weights::Initialiser;
use crate::pixels::CHANNELS;
use burn::module::Module;
use burn::nn::BatchNorm;
use burn::nn::conv::Conv2d;
use burn::tensor::Tensor;
use burn::tensor::activation::relu;
use burn::tensor::module::max_pool2d;
use burn::tensor::ops::MaxPoolOptions;

/// Layers that a trunk has, for numbering those behind it.
pub(crate) const LAYERS: u64 = 4;

/// Channels on either side whose squares a response is normalised by: five in all, itself included.
const NEIGHBOURS: usize = 2;

/// alpha of the local response normalisation: PyTorch's default. beta is 3/4, k is 1.
const RESPONSE_ALPHA: f64 = 1e-4;

/// Twice: convolution 5 x 5, ReLU, batch normalisation, local response normalisation, 2 x 2 maximum,
/// dropout (paper, section 4.1).
#[derive(Module, Debug)]
pub struct Trunk {
    conv1: Conv2d,
    norm1: BatchNorm,
    conv2: Conv2d,
    norm2: BatchNorm,
}

impl Trunk {
    /// With its first weights.
    pub(crate) fn new(architecture: Architecture, layers: &mut Initialiser<'_>) -> Self {
        let [first, second] = architecture.filters;
        Self {
            conv1: layers.convolution([CHANNELS, first]),
            norm1: layers.batch_norm(first),
            conv2: layers.convolution([first, second]),
            norm2: layers.batch_norm(second),
        }
    }

    /// Photographs (batch, 6, side, side) to features (batch, filters x side/4 x side/4).
    pub fn forward(&self, photographs: Tensor<4>, dropout: Option<Dropout>) -> Tensor<2> {
        let mut x = photographs;
        let layers = [(&self.conv1, &self.norm1), (&self.conv2, &self.norm2)];
        for (layer, (convolution, norm)) in layers.into_iter().enumerate() {
            x = norm.forward(relu(convolution.forward(x)));
            x = max_pool2d(
                normalise_response(x),
                MaxPoolOptions::new([2, 2]).with_stride([2, 2]),
            );
            if let Some(dropout) = dropout {
                x = dropout.apply(x, layer as u64);
            }
        }
        x.flatten(1, 3)
    }
}

/// x / (1 + alpha/5 s)^(3/4), where s is the sum of squares over the channel and two on either side
/// (Krizhevsky et al. 2012, section 3.3, with PyTorch's defaults).
fn normalise_response(x: Tensor<4>) -> Tensor<4> {
    let [batch, channels, height, width] = x.dims();
    let squares = x.clone() * x.clone();
    let beside = Tensor::zeros([batch, NEIGHBOURS, height, width], &x.device());
    let squares = Tensor::cat(vec![beside.clone(), squares, beside], 1);
    let window = 2 * NEIGHBOURS + 1;
    let mut sum = squares.clone().narrow(1, 0, channels);
    for first in 1..window {
        sum = sum + squares.clone().narrow(1, first, channels);
    }
    let root = sum
        .mul_scalar(RESPONSE_ALPHA / window as f64)
        .add_scalar(1.0)
        .sqrt();
    // (1 + ..)^(3/4) is the root times the root's root.
    x / (root.clone() * root.sqrt())
}

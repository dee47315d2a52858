//! First weights, drawn as PyTorch draws them: uniformly between -1/sqrt(n) and 1/sqrt(n) for a layer
//! whose units read n numbers.
//!
//! Each layer draws from its own keystream, and its parameters have names that follow from its
//! number: two runs have the same weights, and an optimiser's state finds its parameters again.

use crate::keystream::{Purpose, keystream};
use burn::module::{Param, ParamId, RunningState};
use burn::nn::conv::{Conv2d, Conv2dConfig};
use burn::nn::{BatchNorm, BatchNormConfig, Linear, LinearConfig, PaddingConfig2d};
use burn::tensor::{Device, Tensor, TensorData};
use rand_distr::{Distribution, Uniform};

/// Side of a convolution's kernel in pixels (paper, section 4.1).
pub(crate) const KERNEL: usize = 5;

/// Parameters of a layer: weight, bias, running mean and variance.
const PARAMETERS_OF_A_LAYER: u64 = 4;

/// Makes layers, one after the other.
pub(crate) struct Initialiser<'a> {
    seed: u64,
    layer: u64,
    device: &'a Device,
}

impl<'a> Initialiser<'a> {
    /// The layers that follow are numbered from `first`.
    pub fn new(seed: u64, first: u64, device: &'a Device) -> Self {
        Self {
            seed,
            layer: first,
            device,
        }
    }

    fn id(&self, parameter: u64) -> ParamId {
        ParamId::from(1 + self.layer * PARAMETERS_OF_A_LAYER + parameter)
    }

    fn uniform<const D: usize>(
        &self,
        shape: [usize; D],
        reads: usize,
        parameter: u64,
    ) -> Param<Tensor<D>> {
        let bound = 1.0 / (reads as f32).sqrt();
        let stream = self.layer * PARAMETERS_OF_A_LAYER + parameter;
        let rng = keystream(self.seed, Purpose::Weights, stream);
        let Ok(range) = Uniform::new_inclusive(-bound, bound) else {
            unreachable!("the bound is finite and above 0");
        };
        let count = shape.iter().product();
        let values: Vec<f32> = range.sample_iter(rng).take(count).collect();
        let tensor = Tensor::from_data(TensorData::new(values, shape), self.device);
        Param::initialized(self.id(parameter), self.trained(tensor))
    }

    /// Asks for derivatives where the device has them: a model that is read to be applied is on one
    /// without.
    fn trained<const D: usize>(&self, weights: Tensor<D>) -> Tensor<D> {
        match self.device.is_autodiff() {
            true => weights.require_grad(),
            false => weights,
        }
    }

    /// 5 x 5, stride 1, as many pixels out as in.
    pub fn convolution(&mut self, channels: [usize; 2]) -> Conv2d {
        let [inputs, outputs] = channels;
        let reads = inputs * KERNEL * KERNEL;
        let half = KERNEL / 2;
        let mut layer = Conv2dConfig::new(channels, [KERNEL, KERNEL])
            .with_padding(PaddingConfig2d::Explicit(half, half, half, half))
            .init(self.device);
        layer.weight = self.uniform([outputs, inputs, KERNEL, KERNEL], reads, 0);
        layer.bias = Some(self.uniform([outputs], reads, 1));
        self.layer += 1;
        layer
    }

    pub fn linear(&mut self, inputs: usize, outputs: usize) -> Linear {
        let mut layer = LinearConfig::new(inputs, outputs).init(self.device);
        layer.weight = self.uniform([inputs, outputs], inputs, 0);
        layer.bias = Some(self.uniform([outputs], inputs, 1));
        self.layer += 1;
        layer
    }

    pub fn batch_norm(&mut self, channels: usize) -> BatchNorm {
        let mut layer = BatchNormConfig::new(channels).init(self.device);
        let ones = Tensor::ones([channels], self.device);
        let zeros = Tensor::zeros([channels], self.device);
        layer.gamma = Param::initialized(self.id(0), self.trained(ones.clone()));
        layer.beta = Param::initialized(self.id(1), self.trained(zeros.clone()));
        layer.running_mean = RunningState::with_id(self.id(2), zeros);
        layer.running_var = RunningState::with_id(self.id(3), ones);
        self.layer += 1;
        layer
    }
}

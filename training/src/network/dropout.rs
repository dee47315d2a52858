//! Dropout with masks from a keystream: a step's masks are a function of seed, stage and step, on
//! every device.

use crate::keystream::{Purpose, keystream};
use burn::tensor::{Tensor, TensorData};
use rand_chacha::rand_core::Rng;

/// Of 256 activations this many are kept: 75 percent (paper, section 4.1).
const KEPT_OF_256: u8 = 192;

/// Layers of a network that drop, at most.
const LAYERS_MAX: u64 = 8;

/// Drops activations of one step.
#[derive(Clone, Copy, Debug)]
pub struct Dropout {
    seed: u64,
    step: u64,
}

impl Dropout {
    /// Of step `step` of a stage with the seed `seed`.
    pub fn new(seed: u64, step: u64) -> Self {
        Self { seed, step }
    }

    /// Keeps each number of `x` with a probability of 0.75, times 4/3, and sets the others to 0.
    /// Layers of one step have different masks.
    pub fn apply<const D: usize>(&self, x: Tensor<D>, layer: u64) -> Tensor<D> {
        let mut bytes = vec![0; x.shape().num_elements()];
        let stream = self.step * LAYERS_MAX + layer;
        keystream(self.seed, Purpose::Dropout, stream).fill_bytes(&mut bytes);
        let scale = 256.0 / f32::from(KEPT_OF_256);
        let mask: Vec<f32> = bytes
            .iter()
            .map(|&byte| if byte < KEPT_OF_256 { scale } else { 0.0 })
            .collect();
        let mask = Tensor::from_data(TensorData::new(mask, x.shape()), &x.device());
        x * mask
    }
}

//! Dropout with masks from a keystream: a step's masks are a function of seed, stage and step, on
//! every device.

use crate::keystream::{Purpose, keystream};
use burn::tensor::{Tensor, TensorData};
use rand_chacha::rand_core::Rng;
use rayon::prelude::*;

/// Of 256 activations this many are kept: 75 percent (paper, section 4.1).
const KEPT_OF_256: u8 = 192;

/// Layers of a network that drop, at most.
const LAYERS_MAX: u64 = 8;

/// Activations whose mask one thread draws at a time; a multiple of the keystream's word of four
/// bytes.
const PIECE: usize = 1 << 16;

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
        let mask = self.mask(x.shape().num_elements(), layer);
        let mask = Tensor::from_data(TensorData::new(mask, x.shape()), &x.device());
        x * mask
    }

    /// The factors of a layer's first `count` activations: one byte of the keystream decides each.
    fn mask(&self, count: usize, layer: u64) -> Vec<f32> {
        let stream = self.step * LAYERS_MAX + layer;
        let scale = 256.0 / f32::from(KEPT_OF_256);
        let mut mask = vec![0.0; count];
        let pieces = mask.par_chunks_mut(PIECE).enumerate();
        pieces.for_each_init(
            || vec![0; PIECE],
            |bytes, (piece, mask)| {
                let mut rng = keystream(self.seed, Purpose::Dropout, stream);
                rng.set_word_pos((piece * PIECE / size_of::<u32>()) as u128);
                let bytes = &mut bytes[..mask.len()];
                rng.fill_bytes(bytes);
                for (factor, &byte) in mask.iter_mut().zip(&*bytes) {
                    *factor = if byte < KEPT_OF_256 { scale } else { 0.0 };
                }
            },
        );
        mask
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pieces_of_a_mask_are_one_keystream() {
        let dropout = Dropout::new(3, 7);
        for count in [1, PIECE - 1, PIECE, 2 * PIECE + 5] {
            let mut bytes = vec![0; count];
            keystream(3, Purpose::Dropout, 7 * LAYERS_MAX + 1).fill_bytes(&mut bytes);
            let one_by_one = bytes.iter().map(|byte| match byte {
                0..192 => 4.0 / 3.0,
                _ => 0.0,
            });
            let expected: Vec<f32> = one_by_one.collect();
            assert_eq!(dropout.mask(count, 1), expected, "{count}");
        }
    }

    #[test]
    fn three_quarters_are_kept() {
        let count = 1_000_000;
        let mask = Dropout::new(0, 0).mask(count, 0);
        let kept = mask.iter().filter(|factor| **factor > 0.0).count() as f64;
        // Six standard deviations: a false alarm in 5e8 seeds.
        let deviation = (0.75 * 0.25 / count as f64).sqrt();
        assert!((kept / count as f64 - 0.75).abs() < 6.0 * deviation);
    }
}

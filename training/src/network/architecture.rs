//! Sizes of a network.

use crate::labels::BINS;
use crate::pixels::CHANNELS;
use crate::variant::Variant;
use serde::{Deserialize, Serialize};

/// Pixels a side of a photograph: from and to.
pub const SIDES: [u32; 2] = [4, 2048];

/// The most filters and units of a layer.
const WIDTH_MAX: usize = 1 << 16;

/// Weights of a filter for each channel that it reads: 5 x 5 pixels.
const FILTER: usize = 25;

/// Sizes that the paper gives or leaves open.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Architecture {
    /// Pixels a side of a photograph; a multiple of 4.
    pub side: u32,
    /// Filters of the first and the second convolution.
    pub filters: [usize; 2],
    /// Units of the two hidden dense layers.
    pub hidden: [usize; 2],
}

impl Architecture {
    /// The paper's, on 64 pixels a side: 34,808,232 weights a CNN.
    pub const PAPER: Self = Self {
        side: 64,
        filters: [64, 128],
        hidden: [1024, 512],
    };

    /// What two processor cores train within minutes: 862,680 weights a CNN.
    pub const CPU: Self = Self {
        side: 32,
        filters: [16, 32],
        hidden: [256, 256],
    };

    /// Weights of a variant's networks, without the running means and variances of the trunks;
    /// `None` for sizes that no network has.
    pub fn weights(&self, variant: Variant) -> Option<u64> {
        let [least, most] = SIDES;
        let widths = [self.filters, self.hidden].concat();
        let sound = (least..=most).contains(&self.side)
            && self.side.is_multiple_of(4)
            && widths.iter().all(|width| (1..=WIDTH_MAX).contains(width));
        if !sound {
            return None;
        }
        let dense = |inputs: usize, outputs: usize| (inputs * outputs + outputs) as u64;
        let [first, second] = self.filters;
        // With scale and shift of the batch normalisations.
        let trunk = dense(CHANNELS * FILTER, first)
            + dense(first * FILTER, second)
            + 2 * (first + second) as u64;
        let trunks = variant.trunks().into_iter().filter(|&there| there).count() as u64;
        let heads = variant.heads().into_iter().map(|head| {
            let inputs = head.inputs(self);
            let [one, two] = self.hidden;
            dense(inputs, one) + dense(one, two) + dense(two, head.outputs.len() * BINS)
        });
        Some(trunks * trunk + heads.sum::<u64>())
    }

    /// Length of a trunk's output: the second convolution's after its pool.
    pub fn features(&self) -> usize {
        let side = self.side as usize / 4;
        self.filters[1] * side * side
    }
}

//! What is trained: the paper's variants, and the two controls that it lacks.

use crate::labels::{BINS, PARAMETERS};
use crate::network::Architecture;
use serde::{Deserialize, Serialize};

/// Positions of theta: R, A, psi, N_d, then RGB0 and RGB90.
const R: usize = 0;
const RGB90_END: usize = PARAMETERS;

/// A variant of the paper's figure 6, or a control.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Variant {
    /// One CNN on photographs as they are.
    Cnn0,
    /// One CNN on whitened photographs.
    Cnnw,
    /// CNN_0 with R, A, psi and N_d counted twice.
    Weights,
    /// Five blocks on the features of both CNNs, each told what the blocks before it found.
    Nested,
    /// Control: one block on the features of both CNNs.
    Flat,
    /// Control: the five blocks, told nothing.
    Separate,
}

/// What one head reads and tells.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct HeadPlan {
    /// Whether it reads the features of CNN_0 and of CNN_w.
    pub features: [bool; 2],
    /// Parameters whose probabilities it is told by earlier heads, in order.
    pub given: Vec<usize>,
    /// Parameters whose probabilities it tells, in order.
    pub outputs: Vec<usize>,
}

impl HeadPlan {
    /// Numbers that it reads: features, then probabilities.
    pub fn inputs(&self, architecture: &Architecture) -> usize {
        let trunks = self.features.iter().filter(|&&wanted| wanted).count();
        trunks * architecture.features() + self.given.len() * BINS
    }
}

impl Variant {
    /// All of them.
    pub const ALL: [Self; 6] = [
        Self::Cnn0,
        Self::Cnnw,
        Self::Weights,
        Self::Nested,
        Self::Flat,
        Self::Separate,
    ];

    /// Its name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Cnn0 => "cnn0",
            Self::Cnnw => "cnnw",
            Self::Weights => "weights",
            Self::Nested => "nested",
            Self::Flat => "flat",
            Self::Separate => "separate",
        }
    }

    /// Whether it has CNN_0's trunk and CNN_w's.
    pub fn trunks(self) -> [bool; 2] {
        match self {
            Self::Cnn0 | Self::Weights => [true, false],
            Self::Cnnw => [false, true],
            Self::Nested | Self::Flat | Self::Separate => [true, true],
        }
    }

    /// Whether its heads are trained on features of frozen trunks.
    pub fn has_blocks(self) -> bool {
        self.trunks() == [true, true]
    }

    /// Its heads in the order in which they are trained (paper, section 4.2: roughness first, from
    /// whitened features; then anisotropy and its angle; the rest from the photographs as they are).
    pub fn heads(self) -> Vec<HeadPlan> {
        let all: Vec<usize> = (R..RGB90_END).collect();
        let whole = |features| HeadPlan {
            features,
            given: Vec::new(),
            outputs: all.clone(),
        };
        match self {
            Self::Cnn0 | Self::Weights | Self::Cnnw | Self::Flat => vec![whole(self.trunks())],
            Self::Nested | Self::Separate => {
                let outputs: [&[usize]; 5] = [&[0], &[1, 2], &[3], &[4, 5, 6], &[7, 8, 9]];
                let blocks = outputs.into_iter().enumerate();
                let blocks = blocks.map(|(block, outputs)| HeadPlan {
                    features: if block < 2 {
                        [false, true]
                    } else {
                        [true, false]
                    },
                    given: if self == Self::Nested {
                        (R..outputs[0]).collect()
                    } else {
                        Vec::new()
                    },
                    outputs: outputs.to_vec(),
                });
                blocks.collect()
            }
        }
    }

    /// The weight of each parameter's loss.
    pub fn weights(self) -> [f32; PARAMETERS] {
        let mut weights = [1.0; PARAMETERS];
        if self == Self::Weights {
            weights[..4].fill(2.0);
        }
        weights
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::network::estimator::Estimator;
    use burn::module::Module;
    use burn::tensor::Device;

    fn weights(variant: Variant, architecture: Architecture) -> usize {
        let estimator = Estimator::new(variant, architecture, 0, &Device::flex());
        // Running means and variances of the trunks are no weights.
        let trunks = variant.trunks().into_iter().filter(|&there| there).count();
        let [first, second] = architecture.filters;
        let weights = estimator.num_params() - trunks * 2 * (first + second);
        assert_eq!(architecture.weights(variant), Some(weights as u64));
        weights
    }

    #[test]
    fn networks_have_as_many_weights_as_the_design_says() {
        let cpu = Architecture::CPU;
        assert_eq!(weights(Variant::Cnn0, cpu), 862_680);
        assert_eq!(weights(Variant::Cnnw, cpu), 862_680);
        // Two convolutions with their normalisation, once for each trunk.
        let trunk = 6 * 16 * 25 + 16 + 2 * 16 + 16 * 32 * 25 + 32 + 2 * 32;
        assert_eq!(weights(Variant::Nested, cpu), 3_592_680 + 2 * trunk);
        assert_eq!(weights(Variant::Cnn0, Architecture::PAPER), 34_808_232);
    }

    #[test]
    fn every_parameter_is_told_once_and_known_before_it_is_given() {
        for variant in Variant::ALL {
            let mut told = Vec::new();
            for head in variant.heads() {
                assert!(head.given.iter().all(|given| told.contains(given)));
                assert!(head.features.contains(&true));
                told.extend(head.outputs);
            }
            assert_eq!(told, (0..PARAMETERS).collect::<Vec<_>>());
        }
    }

    #[test]
    fn blocks_read_what_the_paper_says() {
        let heads = Variant::Nested.heads();
        let given: Vec<usize> = heads.iter().map(|head| head.given.len()).collect();
        assert_eq!(given, [0, 1, 3, 4, 7]);
        let whitened: Vec<bool> = heads.iter().map(|head| head.features[1]).collect();
        assert_eq!(whitened, [true, true, false, false, false]);
    }
}

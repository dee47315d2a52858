//! What decides a training.

use super::stage_name::StageName;
use crate::labels::axes::Colours;
use crate::labels::target::Smoothing;
use crate::network::Architecture;
use crate::pixels::encoding::Encoding;
use crate::variant::Variant;
use serde::{Deserialize, Serialize};

/// Materials of a step.
pub const BATCH: usize = 32;

/// Named sets of options.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Preset {
    /// As the paper says: 64 pixels, its widths, sRGB codes, CIELAB, plain SGD.
    Paper,
    /// What two cores train within minutes.
    Cpu,
    /// The paper's widths with what was found to learn better. For a GPU.
    Best,
}

/// Which photographs CNN_w reads.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Whiten {
    /// One whitening for all, from the training split.
    Dataset,
    /// One for each photograph, from its own colours: it erases the colours that are sought.
    Image,
}

/// How weights follow gradients.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Optimiser {
    /// Plain gradient descent at constant rates (paper, section 4.3).
    Sgd {
        /// Of a CNN.
        cnn_rate: f64,
        /// Of a block.
        block_rate: f64,
    },
    /// AdamW, its rate falling to 0 along a cosine.
    AdamW {
        /// At the beginning.
        rate: f64,
    },
}

/// How much the loss of each parameter counts.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LossWeights {
    /// The same in every material, as the variant says.
    #[default]
    Paper,
    /// That, times how much the two photographs of the material tell of the parameter.
    Observable {
        /// Digest of the table that says it.
        table: String,
    },
}

/// What is added to the loss for what readings would change in the two photographs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MetricLoss {
    /// How much a nat of it counts beside one of cross-entropy; above 0.
    pub share: f64,
    /// Digest of the table that says how much photographs change.
    pub table: String,
}

/// Everything that decides the weights, with the pairs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Options {
    /// Where the other options come from.
    pub preset: Preset,
    /// What is trained.
    pub variant: Variant,
    /// Sizes.
    pub architecture: Architecture,
    /// How pixels are written.
    pub encoding: Encoding,
    /// How colours are written in labels.
    pub colours: Colours,
    /// How labels become targets.
    pub smoothing: Smoothing,
    /// Whether targets are centred on the value instead of on its bin.
    pub continuous: bool,
    /// Which photographs CNN_w reads.
    pub whiten: Whiten,
    /// How much the loss of each parameter counts.
    #[serde(default)]
    pub weights: LossWeights,
    /// What is added to the loss for what readings would change, if anything.
    #[serde(default)]
    pub metric: Option<MetricLoss>,
    /// Whether photographs get noise.
    pub noise: bool,
    /// Whether a quarter of activations is dropped while learning.
    pub dropout: bool,
    /// How weights follow gradients.
    pub optimiser: Optimiser,
    /// Epochs of a CNN, at most.
    pub cnn_epochs: u32,
    /// Epochs of a block, at most.
    pub block_epochs: u32,
    /// Epochs without a better excess on the validation split after which a network is finished.
    pub patience: u32,
    /// Of weights, order, noise and dropout.
    pub seed: u64,
}

impl Options {
    /// Epochs of a network, at most.
    pub(super) fn epochs(&self, stage: StageName) -> u32 {
        match stage {
            StageName::Cnn(_) => self.cnn_epochs,
            StageName::Block(_) => self.block_epochs,
        }
    }
}

impl Preset {
    /// Its name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Paper => "paper",
            Self::Cpu => "cpu",
            Self::Best => "best",
        }
    }

    /// The options of a variant.
    pub fn options(self, variant: Variant) -> Options {
        let (architecture, cnn_epochs, block_epochs) = match self {
            Self::Paper => (Architecture::PAPER, 300, 50),
            Self::Cpu => (Architecture::CPU, 25, 12),
            Self::Best => (Architecture::PAPER, 100, 50),
        };
        let (encoding, colours, optimiser) = match self {
            Self::Paper => (
                Encoding::Srgb,
                Colours::Lab,
                Optimiser::Sgd {
                    cnn_rate: 0.003,
                    block_rate: 0.03,
                },
            ),
            Self::Cpu | Self::Best => (
                Encoding::Log,
                Colours::Scaled,
                Optimiser::AdamW { rate: 1e-3 },
            ),
        };
        Options {
            preset: self,
            variant,
            architecture,
            encoding,
            colours,
            smoothing: Smoothing::default(),
            continuous: false,
            whiten: Whiten::Dataset,
            weights: LossWeights::Paper,
            metric: None,
            noise: false,
            dropout: true,
            optimiser,
            cnn_epochs,
            block_epochs,
            patience: 20,
            seed: 0,
        }
    }
}

//! Names of a training's networks.

/// Names of the two CNNs in the log.
pub(super) const CNN_NAMES: [&str; 2] = ["cnn0", "cnnw"];

/// A network of a training.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum StageName {
    /// CNN_0 or CNN_w.
    Cnn(usize),
    /// A block, counted from 0.
    Block(usize),
}

impl StageName {
    /// As the log has it.
    pub fn text(self) -> String {
        match self {
            Self::Cnn(which) => CNN_NAMES[which].to_owned(),
            Self::Block(block) => format!("block{}", block + 1),
        }
    }

    /// In the streams of order and dropout.
    pub fn number(self) -> u32 {
        match self {
            Self::Cnn(which) => which as u32,
            Self::Block(block) => (CNN_NAMES.len() + block) as u32,
        }
    }
}

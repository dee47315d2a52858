//! Where networks are computed.

use crate::error::TrainingError;
use burn::tensor::Device;
use std::str::FromStr;

/// A processor or a graphics card.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Accelerator {
    /// The processor.
    Cpu,
    /// The NVIDIA card of this number.
    Cuda(usize),
}

impl FromStr for Accelerator {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let unknown = || format!("{text:?} is no device: cpu, cuda or cuda:NUMBER");
        match text.split_once(':') {
            None if text == "cpu" => Ok(Self::Cpu),
            None if text == "cuda" => Ok(Self::Cuda(0)),
            Some(("cuda", number)) => number.parse().map(Self::Cuda).map_err(|_| unknown()),
            _ => Err(unknown()),
        }
    }
}

impl Accelerator {
    /// The device, without derivatives.
    ///
    /// # Errors
    /// When the program was built without it.
    pub fn open(self) -> Result<Device, TrainingError> {
        match self {
            Self::Cpu => Ok(Device::flex()),
            #[cfg(feature = "cuda")]
            Self::Cuda(number) => Ok(Device::cuda(number)),
            #[cfg(not(feature = "cuda"))]
            Self::Cuda(_) => Err(TrainingError::Input(
                "this program was built without CUDA: build it with --features cuda".to_owned(),
            )),
        }
    }
}

//! Where networks are computed.

use crate::error::TrainingError;
use burn::tensor::Device;
use std::str::FromStr;

/// A processor or a graphics card.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Accelerator {
    /// The processor.
    Cpu,
    /// The NVIDIA card of this number, through CUDA.
    Cuda(usize),
    /// The fastest graphics card that Vulkan or Metal finds.
    Wgpu,
}

impl FromStr for Accelerator {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let unknown = || format!("{text:?} is no device: cpu, cuda, cuda:NUMBER or wgpu");
        match text.split_once(':') {
            None if text == "cpu" => Ok(Self::Cpu),
            None if text == "cuda" => Ok(Self::Cuda(0)),
            None if text == "wgpu" => Ok(Self::Wgpu),
            Some(("cuda", number)) => number.parse().map(Self::Cuda).map_err(|_| unknown()),
            _ => Err(unknown()),
        }
    }
}

impl Accelerator {
    /// The device, without derivatives.
    ///
    /// # Errors
    /// When the program was built without it, or the device cannot be used.
    pub fn open(self) -> Result<Device, TrainingError> {
        match self {
            Self::Cpu => Ok(Device::flex()),
            #[cfg(feature = "cuda")]
            Self::Cuda(number) => probed("CUDA", Device::cuda(number)),
            #[cfg(feature = "wgpu")]
            Self::Wgpu => probed("Vulkan or Metal", Device::wgpu(Default::default())),
            #[cfg(not(all(feature = "cuda", feature = "wgpu")))]
            missing => {
                let feature = match missing {
                    Self::Wgpu => "wgpu",
                    _ => "cuda",
                };
                Err(TrainingError::Input(format!(
                    "this program was built without {feature}: build it with --features {feature}"
                )))
            }
        }
    }
}

/// The device, if a number comes back from it. burn panics where there is no driver or no such card;
/// what it says then is part of the error.
#[cfg(any(feature = "cuda", feature = "wgpu"))]
fn probed(driver: &str, device: Device) -> Result<Device, TrainingError> {
    use burn::tensor::Tensor;
    use std::panic::{catch_unwind, set_hook, take_hook};
    use std::sync::mpsc::channel;

    let (tell, told) = channel();
    let hook = take_hook();
    set_hook(Box::new(move |panic| {
        let _ = tell.send(panic.payload_as_str().unwrap_or_default().to_owned());
    }));
    let one = catch_unwind(|| {
        let one: Tensor<1> = Tensor::ones([1], &device);
        one.into_scalar::<f32>()
    });
    set_hook(hook);
    if matches!(one, Ok(1.0)) {
        return Ok(device);
    }
    let reason: String = told.try_recv().unwrap_or_default();
    let reason: String = reason.chars().take(REASON_CHARS).collect();
    Err(TrainingError::Input(format!(
        "no device can be used through {driver}: look at the driver, or choose --device cpu \
         ({reason})"
    )))
}

/// How much is told of what burn said.
#[cfg(any(feature = "cuda", feature = "wgpu"))]
const REASON_CHARS: usize = 200;

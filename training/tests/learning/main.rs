//! Trainings from end to end, in process: on rendered pairs, and on drawn ones where the pixels do
//! not matter.

#![allow(clippy::unwrap_used, reason = "a panic here is a failed test")]

mod overfit;
mod pairs;
mod twin;

use burn::tensor::Device;
use training::device::Accelerator;

/// Where networks are computed: on the processor, or where TRAINING_TEST_DEVICE says, as tests/gpu.sh
/// does.
fn device() -> Device {
    let name = std::env::var("TRAINING_TEST_DEVICE").unwrap_or_else(|_| "cpu".to_owned());
    name.parse::<Accelerator>().unwrap().open().unwrap()
}

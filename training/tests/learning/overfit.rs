//! A network that cannot learn 32 materials by heart learns nothing.

use crate::device;
use crate::pairs::rendered;
use std::cell::Cell;
use training::fit::options::{Optimiser, Preset};
use training::fit::{Files, Progress, train};
use training::network::Architecture;
use training::variant::Variant;

#[test]
fn thirty_two_materials_are_learned_by_heart_in_100_steps() {
    let pairs = rendered(32, Architecture::CPU.side);
    let mut options = Preset::Cpu.options(Variant::Cnn0);
    options.dropout = false;
    options.optimiser = Optimiser::AdamW { rate: 3e-3 };
    // One step an epoch; the materials that train are those that validate.
    (options.cnn_epochs, options.patience) = (100, 100);
    let out = tempfile::tempdir().unwrap();
    let files = Files {
        out: out.path(),
        cnns: None,
        observed: None,
        tensorboard: false,
    };
    let least = Cell::new(f64::INFINITY);
    train(&pairs, &options, files, &device(), &|event| {
        if let Progress::Epoch { line, .. } = event {
            least.set(least.get().min(line.excess));
        }
    })
    .unwrap();
    let least = least.get();
    assert!(least < 0.05, "the least excess is {least} nats");
}

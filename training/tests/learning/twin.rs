//! One model file read by burn, by NumPy and, once, by PyTorch: all say the same.
//!
//! `reference/logits-*.json` are what `examples/model.py` said in PyTorch 2.15 of the files that this
//! test writes. To write them anew: `WRITE_MODELS=DIR cargo test -p training --test learning twin`,
//! then `python training/tests/torch_logits.py DIR training/tests/reference`.

use crate::device;
use crate::pairs::drawn;
use burn::tensor::{Tensor, TensorData};
use safetensors::tensor::{Dtype, TensorView, serialize};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::{env, fs};
use training::fit::inputs::{Codes, Inputs, Photographs};
use training::fit::options::Preset;
use training::fit::{Files, train};
use training::labels::{BINS, PARAMETERS};
use training::model::Model;
use training::pixels::noise::Noise;
use training::variant::Variant;

/// Materials whose logits are compared.
const MATERIALS: usize = 2;

/// How far logits may be apart.
const TOLERANCE: f64 = 1e-4;

/// The logits of stored runs are of a network after one step, which another processor takes to other
/// last bits. The step is plain gradient descent's: AdamW's first goes by the signs of gradients, so that
/// last bits decide, and between two kinds of x86-64 logits were 1.3e-4 apart.
fn check(preset: Preset, variant: Variant) {
    let name = format!("{}-{}", preset.name(), variant.name());
    let mut options = preset.options(variant);
    (options.cnn_epochs, options.block_epochs) = (1, 1);
    options.optimiser = Preset::Paper.options(variant).optimiser;
    let pairs = drawn(options.architecture.side);
    let folder = tempfile::tempdir().unwrap();
    let files = Files {
        out: folder.path(),
        cnns: None,
        observed: None,
        tensorboard: false,
    };
    let device = device();
    let path = train(&pairs, &options, files, &device, &|_| {}).unwrap();
    let model = Model::read(&path, &device).unwrap();
    let codes = Codes::new(&pairs, options.encoding);
    let positions: Vec<usize> = (0..MATERIALS).collect();
    let side = pairs.side();
    let rows = model.options.normalisations.clone().map(|normalisation| {
        let photographs = Photographs {
            codes: &codes,
            normalisation: normalisation?,
            noise: Noise::Exact,
        };
        Some(photographs.rows(&positions, None))
    });
    let inputs = write_inputs(folder.path(), &rows, side);
    if let Some(out) = env::var_os("WRITE_MODELS") {
        let out = Path::new(&out);
        fs::copy(&path, out.join(format!("{name}.safetensors"))).unwrap();
        fs::copy(&inputs, out.join(format!("{name}.inputs.safetensors"))).unwrap();
    }
    let photographs = rows.map(|rows| {
        let data = TensorData::new(rows?, [MATERIALS, 6, side, side]);
        Some(Tensor::from_data(data, &device))
    });
    let ours = model.estimator.logits(variant, photographs).into_data();
    let ours: Vec<f64> = ours.iter::<f32>().map(f64::from).collect();
    let torch = format!("tests/reference/logits-{name}.json");
    let torch = Path::new(env!("CARGO_MANIFEST_DIR")).join(torch);
    compare(
        "burn",
        &ours,
        &read_logits(&fs::read_to_string(torch).unwrap()),
    );
    compare("NumPy", &numpy(&path, &inputs), &ours);
}

fn write_inputs(folder: &Path, rows: &[Option<Vec<f32>>; 2], side: usize) -> PathBuf {
    let bytes: Vec<(&str, Vec<u8>)> = ["zero", "whitened"]
        .into_iter()
        .zip(rows)
        .filter_map(|(name, rows)| {
            let rows = rows.as_ref()?;
            Some((
                name,
                rows.iter().flat_map(|value| value.to_le_bytes()).collect(),
            ))
        })
        .collect();
    let tensors = bytes.iter().map(|(name, bytes)| {
        let shape = vec![MATERIALS, 6, side, side];
        (*name, TensorView::new(Dtype::F32, shape, bytes).unwrap())
    });
    let path = folder.join("inputs.safetensors");
    fs::write(&path, serialize(tensors, None).unwrap()).unwrap();
    path
}

fn numpy(model: &Path, inputs: &Path) -> Vec<f64> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let clients = root.join("../target/python-clients");
    assert!(
        clients.exists(),
        "the Python readers are missing: run tests/clients/install.sh, or tests/run.sh for all tests"
    );
    let output = Command::new("python3")
        .arg(root.join("tests/numpy_model.py"))
        .args([model, inputs])
        .env("PYTHONPATH", clients)
        .output()
        .unwrap();
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{errors}");
    read_logits(&String::from_utf8(output.stdout).unwrap())
}

fn read_logits(json: &str) -> Vec<f64> {
    let logits: Vec<Vec<Vec<f64>>> = serde_json::from_str(json).unwrap();
    logits.into_iter().flatten().flatten().collect()
}

#[track_caller]
fn compare(who: &str, actual: &[f64], expected: &[f64]) {
    assert_eq!(actual.len(), MATERIALS * PARAMETERS * BINS);
    assert_eq!(expected.len(), actual.len());
    let spread = expected
        .iter()
        .fold(0.0, |most: f64, logit| most.max(logit.abs()));
    assert!(spread > 0.01, "logits of {spread} tell nothing");
    let errors = actual
        .iter()
        .zip(expected)
        .map(|(one, other)| (one - other).abs());
    let worst = errors.fold(0.0, f64::max);
    assert!(worst <= TOLERANCE, "{who} is off by {worst}");
}

#[test]
fn nested_blocks_of_the_preset_cpu_say_the_same_in_pytorch_and_numpy() {
    check(Preset::Cpu, Variant::Nested);
}

#[test]
fn a_cnn_of_the_preset_paper_says_the_same_in_pytorch_and_numpy() {
    check(Preset::Paper, Variant::Cnn0);
}

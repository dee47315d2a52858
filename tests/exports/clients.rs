//! The exports, opened by the loaders that readers have: `tests/clients/install.sh` installs them.

use crate::readers::python;
use crate::small::rendered;
use std::fs;
use std::path::Path;

#[test]
fn stock_loaders_find_the_labels_splits_and_pixels() {
    let place = rendered(12);
    for format in ["parquet", "csv", "jsonl"] {
        place.succeed(&format!(
            "dataset manifest export --format {format} --out manifest.{format}"
        ));
    }
    for layout in ["files", "webdataset", "huggingface"] {
        place.succeed(&format!(
            "dataset export {layout} --layout {layout} --npy --png --rectified 16 --licence \
             cc-by-4.0 --creator nobody --url https://example.org --published 2026-01-31"
        ));
    }
    let arguments = ["store", ".", "files", "webdataset", "huggingface"];
    let said = python(&place, "tests/clients/read_layouts.py", &arguments);
    assert!(said.contains("168 images in three layouts"), "{said}");
}

#[test]
fn the_example_loads_training_pairs() {
    let place = rendered(12);
    place.succeed("dataset export pairs --layout files --views 5,8 --split train --rectified 64");
    let said = python(&place, "examples/load.py", &["pairs"]);
    let pairs: Vec<&str> = said
        .lines()
        .filter(|line| line.contains("(2, 64, 64, 3)"))
        .collect();
    assert_eq!(pairs.len(), 8, "{said}");

    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let example = fs::read_to_string(root.join("examples/load.py")).unwrap();
    let readme = fs::read_to_string(root.join("README.md")).unwrap();
    let begin = example.find("import sys").unwrap();
    assert!(
        readme.contains(&example[begin..]),
        "the README shows another example"
    );
}

//! What is wrong is told in one sentence that names it, and the last checkpoint stays.

use crate::pairs::{TRAIN, exported, fail};
use crate::workplace::Workplace;
use std::fs;
use std::path::PathBuf;
use std::thread::sleep;
use std::time::Duration;

fn rectified(place: &Workplace) -> PathBuf {
    let split = place.path().join("pairs/train");
    let mut materials: Vec<PathBuf> = fs::read_dir(split)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .collect();
    materials.sort();
    materials[1].join("v01.rectified.exr")
}

#[track_caller]
fn assert_says(said: &str, parts: &[&str]) {
    for part in parts {
        assert!(said.contains(part), "{said:?} does not say {part:?}");
    }
}

#[test]
fn bad_input_is_told_with_its_place() {
    let place = exported();
    let train = |out: &str| format!("{TRAIN} --variant cnn0 --out {out}");

    let image = rectified(&place);
    let sound = fs::read(&image).unwrap();
    fs::remove_file(&image).unwrap();
    let said = fail(&place, &train("a"), 2);
    assert_says(&said, &["v01.rectified.exr", "missing"]);
    fs::write(&image, &sound[..sound.len() / 2]).unwrap();
    let said = fail(&place, &train("a"), 2);
    assert_says(&said, &["v01.rectified.exr", "OpenEXR"]);
    fs::write(&image, nan_image(32)).unwrap();
    let said = fail(&place, &train("a"), 2);
    assert_says(&said, &["v01.rectified.exr", "NaN"]);
    fs::write(&image, nan_image(16)).unwrap();
    let said = fail(&place, &train("a"), 2);
    assert_says(&said, &["v01.rectified.exr", "16 x 16", "32 x 32"]);
    fs::write(&image, claiming_a_million_rows(&sound)).unwrap();
    let said = fail(&place, &train("a"), 2);
    assert_says(&said, &["v01.rectified.exr"]);
    fs::write(&image, sound).unwrap();

    let manifest = place.path().join("pairs/manifest.parquet");
    let aside = place.path().join("manifest.parquet");
    fs::rename(&manifest, &aside).unwrap();
    let said = fail(&place, &train("a"), 2);
    assert_says(&said, &["pairs", "not finished"]);
    fs::rename(&aside, &manifest).unwrap();

    let said = fail(&place, &format!("{TRAIN} --out a --preset paper"), 2);
    assert_says(&said, &["32 pixels", "64"]);
    let said = fail(&place, "train nowhere --out a", 2);
    assert_says(&said, &["nowhere", "no export"]);
    let said = fail(&place, &format!("{TRAIN} --out a --views 0,7"), 2);
    assert_says(&said, &["view 7"]);
    let said = fail(&place, &format!("{TRAIN} --out store"), 2);
    assert_says(&said, &["store", "holds"]);

    place.succeed(&train("a"));
    let said = fail(&place, &format!("{} --seed 1", train("a")), 2);
    assert_says(&said, &["another training", "seed", "0", "1"]);
}

/// The image with a header that claims a million rows and columns: 12 TB of pixels.
fn claiming_a_million_rows(image: &[u8]) -> Vec<u8> {
    let mut image = image.to_owned();
    for window in ["dataWindow\0box2i\0", "displayWindow\0box2i\0"] {
        let window = window.as_bytes();
        let found = image
            .windows(window.len())
            .position(|bytes| bytes == window);
        // Behind the size of the value and its first corner, 4 bytes a number.
        let corner = found.unwrap() + window.len() + 4 + 8;
        for place in [corner, corner + 4] {
            image[place..place + 4].copy_from_slice(&999_999_i32.to_le_bytes());
        }
    }
    image
}

/// A square of this many pixels whose first is not a number.
fn nan_image(side: usize) -> Vec<u8> {
    use exr::prelude::*;
    let channels = SpecificChannels::rgb(|position: Vec2<usize>| {
        let value = if position == Vec2(0, 0) {
            f32::NAN
        } else {
            0.5
        };
        (value, 0.5_f32, 0.5_f32)
    });
    let mut bytes = std::io::Cursor::new(Vec::new());
    Image::from_channels((side, side), channels)
        .write()
        .non_parallel()
        .to_buffered(&mut bytes)
        .unwrap();
    bytes.into_inner()
}

#[test]
fn a_damaged_cache_is_made_anew_and_a_model_of_another_dataset_is_refused() {
    let place = exported();
    let train = format!("{TRAIN} --variant cnn0 --out");
    place.succeed(&format!("{train} first"));
    let cache = fs::read_dir(place.path().join("pairs/cache")).unwrap();
    let cache = cache.last().unwrap().unwrap().path();
    let mut bytes = fs::read(&cache).unwrap();
    *bytes.last_mut().unwrap() ^= 1;
    fs::write(&cache, bytes).unwrap();
    place.succeed(&format!("{train} second"));
    let model =
        |folder: &str| fs::read(place.path().join(folder).join("model.safetensors")).unwrap();
    assert!(model("first") == model("second"));

    let other = fs::read_to_string(place.path().join("spec.toml")).unwrap();
    let other = other.replace("materials = 24", "materials = 24\nseed = 5");
    fs::write(place.path().join("other.toml"), other).unwrap();
    place.succeed("run --spec other.toml --store other");
    place.succeed("dataset export elsewhere --store other --layout files --rectified 32");
    let said = fail(
        &place,
        "evaluate first/model.safetensors --data elsewhere --out judged",
        2,
    );
    assert_says(&said, &["first/model.safetensors", "specification"]);
    fs::create_dir(place.path().join("nearest")).unwrap();
    fs::copy(
        place.path().join("first/model.safetensors"),
        place.path().join("nearest/model.safetensors"),
    )
    .unwrap();
    let said = fail(
        &place,
        "evaluate nearest/model.safetensors --data pairs --out judged",
        2,
    );
    assert_says(&said, &["nearest/model.safetensors", "rename"]);
    fs::write(place.path().join("taken"), b"").unwrap();
    let said = fail(
        &place,
        "evaluate first/model.safetensors --data pairs --out taken",
        2,
    );
    assert_says(&said, &["taken", "not a folder"]);
    fs::write(place.path().join("junk.safetensors"), b"junk").unwrap();
    let said = fail(
        &place,
        "evaluate junk.safetensors --data pairs --out judged",
        2,
    );
    assert_says(&said, &["junk.safetensors", "no model"]);
}

/// The row of an estimator in the table that an evaluation prints.
fn row<'a>(table: &'a str, name: &str) -> &'a str {
    let mut lines = table.lines();
    lines.find(|line| line.starts_with(name)).unwrap()
}

#[test]
fn an_evaluation_judges_models_and_baselines() {
    let place = exported();
    place.succeed(&format!("{TRAIN} --variant nested --out nested"));
    let table = place.succeed("evaluate nested/model.safetensors --data pairs --out judged");
    let same = place.succeed("evaluate nested --data pairs --out judged");
    assert_eq!(same, table, "a folder is the model that is in it");
    for name in ["guess", "nearest", "nested"] {
        assert!(table.contains(name), "{table}");
    }
    let judged = place.path().join("judged");
    let errors = fs::read_to_string(judged.join("errors.csv")).unwrap();
    // Four materials of 24 test, in two views, by three estimators.
    assert_eq!(errors.lines().count(), 1 + 4 * 2 * 3);
    let page = fs::read_to_string(judged.join("report.html")).unwrap();
    assert!(page.contains("<svg") && page.contains("Pair by pair"));
    let renderer = "--materials 1 --baselines refine-off,refine-off-fitted --out off";
    let table = place.succeed(&format!("evaluate --data pairs {renderer}"));
    let median = |name: &str| -> f64 {
        row(&table, name)
            .split_whitespace()
            .nth(1)
            .unwrap()
            .parse()
            .unwrap()
    };
    // A degree shows in what is found where nobody looks for it.
    assert!(
        median("refine-off-fitted ") < median("refine-off "),
        "{table}"
    );
}

#[test]
fn noise_of_photographs_shows_in_what_is_made_of_them() {
    let place = exported();
    place.succeed(&format!("{TRAIN} --variant cnn0 --out cnn0"));
    let evaluate = "evaluate cnn0 --data pairs --out judged";
    let exact = place.succeed(evaluate);
    assert_eq!(place.succeed(&format!("{evaluate} --noise 0")), exact);
    let noisy = place.succeed(&format!("{evaluate} --noise 255"));
    for name in ["nearest", "cnn0"] {
        assert_ne!(row(&noisy, name), row(&exact, name));
    }
    assert_eq!(row(&noisy, "guess"), row(&exact, "guess"));
    let page = fs::read_to_string(place.path().join("judged/report.html")).unwrap();
    assert!(
        page.contains("deviation of 255 steps of an 8-bit code"),
        "{page}"
    );
    for steps in ["-1", "nan", "256"] {
        let output = place.run(&format!("{evaluate} --noise={steps}"));
        assert_eq!(output.status.code(), Some(2));
        let said = String::from_utf8(output.stderr).unwrap();
        assert_says(&said, &["--noise", "from 0 to 255"]);
    }
}

#[test]
fn a_full_disk_stops_a_training_and_its_last_checkpoint_goes_on() {
    let place = exported();
    let command = format!("{TRAIN} --variant cnn0 --threads 1");
    place.succeed(&format!("{command} --out whole"));
    let state = place.path().join("full/state.json");
    let mut child = place.spawn(&format!("{command} --out full"));
    while !state.exists() {
        assert!(child.try_wait().unwrap().is_none(), "no checkpoint");
        sleep(Duration::from_millis(5));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    let checkpoint = fs::read(&state).unwrap();
    // No file may grow beyond 1 MiB: a checkpoint's optimiser is larger, as a full disk would be met.
    let program = env!("CARGO_BIN_EXE_brdfarm");
    let limited = format!("trap '' XFSZ; ulimit -f 1024; exec {program} {command} --out full");
    let output = std::process::Command::new("bash")
        .args(["-c", &limited])
        .current_dir(place.path())
        .output()
        .unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert_says(&said, &["cannot write", "full"]);
    assert!(fs::read(&state).unwrap() == checkpoint);
    place.succeed(&format!("{command} --out full"));
    let model =
        |folder: &str| fs::read(place.path().join(folder).join("model.safetensors")).unwrap();
    assert!(model("full") == model("whole"));
}

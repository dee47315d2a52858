//! A training killed at any instant goes on with the same command and ends with the same bytes, and
//! so do trainings on one thread and on two.

use crate::pairs::{TRAIN, exported, fail};
use crate::readers::python;
use crate::workplace::Workplace;
use std::fs;
use std::path::Path;
use std::thread::sleep;
use std::time::Instant;

/// Kills in all.
const KILLS: u32 = 10;

fn result(place: &Workplace, out: &str) -> [Vec<u8>; 3] {
    let folder = place.path().join(out);
    ["model.safetensors", "log.csv", "curves.svg"].map(|name| fs::read(folder.join(name)).unwrap())
}

/// Checkpoints that are left in a folder.
fn leftovers(folder: &Path) -> Vec<String> {
    let names = fs::read_dir(folder).unwrap();
    let names = names.map(|entry| entry.unwrap().file_name().into_string().unwrap());
    names
        .filter(|name| name.contains(".new") || name.matches('-').count() == 2)
        .collect()
}

#[test]
fn a_training_killed_ten_times_ends_as_if_undisturbed_on_any_threads() {
    let place = exported();
    let start = Instant::now();
    place.succeed(&format!("{TRAIN} --out whole --threads 1"));
    let took = start.elapsed();
    let expected = result(&place, "whole");
    place.succeed(&format!("{TRAIN} --out two --threads 2"));
    assert!(
        result(&place, "two") == expected,
        "two threads differ from one"
    );

    // A training that ends before its kill counts as none: the next one gets a new folder.
    let (mut kills, mut trainings) = (0, 0);
    while kills < KILLS {
        let out = format!("killed-{trainings}");
        let mut child = place.spawn(&format!("{TRAIN} --out {out} --threads 1 --tensorboard"));
        // Sevenths of a turn: instants all over a training, in no order.
        sleep(took.mul_f64(f64::from((kills + trainings) * 7 % KILLS + 1) / f64::from(KILLS + 1)));
        if child.try_wait().unwrap().is_some() {
            trainings += 1;
            continue;
        }
        child.kill().unwrap();
        child.wait().unwrap();
        kills += 1;
    }
    for training in 0..=trainings {
        let out = format!("killed-{training}");
        place.succeed(&format!("{TRAIN} --out {out} --threads 2 --tensorboard"));
        assert!(
            result(&place, &out) == expected,
            "a killed training differs"
        );
        assert_eq!(leftovers(&place.path().join(&out)), Vec::<String>::new());
    }

    let said = python(&place, "tests/clients/read_events.py", &["killed-0"]);
    assert!(said.contains("values of 16 epochs"), "{said}");

    // What is finished is not trained again, and what a kill left after the last stage goes away.
    let folder = place.path().join("killed-0");
    fs::create_dir(folder.join("stage-6-1")).unwrap();
    let said = place.succeed(&format!("{TRAIN} --out killed-0"));
    assert!(!said.contains("epoch"), "{said}");
    assert!(result(&place, "killed-0") == expected);
    assert_eq!(leftovers(&folder), Vec::<String>::new());
}

#[test]
fn cnns_of_another_variant_are_those_that_would_be_trained() {
    let place = exported();
    let command = format!("{TRAIN} --threads 2 --out");
    place.succeed(&format!("{command} nested"));
    for variant in ["cnn0", "cnnw", "flat"] {
        place.succeed(&format!("{command} {variant} --variant {variant}"));
        let taken = format!("{variant}-taken");
        let said = place.succeed(&format!(
            "{command} {taken} --variant {variant} --cnns nested"
        ));
        assert!(!said.contains("cnn0 epoch"), "{said}");
        assert!(
            result(&place, variant) == result(&place, &taken),
            "{variant}"
        );
    }
    let refused = |arguments: &str, words: &str| {
        let said = fail(&place, &format!("{command} other {arguments}"), 2);
        assert!(said.contains(words), "{said}");
    };
    refused("--variant weights --cnns nested", "other weights");
    refused("--cnns nested --seed 1", "seed 0 where 1");
    refused("--cnns cnn0", "not finished cnnw");
    refused("--cnns nowhere", "nowhere");
}

//! Files that are damaged: images, the completion log, the ledger.

use crate::harness::{Draws, Harness, patience, seed, wait_for};
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};

fn damage(path: &Path, change: impl FnOnce(&mut Vec<u8>)) {
    let mut bytes = fs::read(path).expect("a file");
    change(&mut bytes);
    fs::write(path, bytes).expect("written");
}

/// A farm whose set is complete, and which nobody serves any more.
fn complete(materials: u32) -> Harness {
    let mut harness = Harness::new(materials, 16);
    harness.start();
    let worker = harness.worker("sound", &harness.address);
    harness.wait_until_finished();
    assert_eq!(worker.ended(patience()).code(), Some(0));
    harness.kill_coordinator();
    harness
}

/// Where the images of a store are, by material and view.
fn images(harness: &Harness) -> Vec<PathBuf> {
    let rows = harness.manifest("farm");
    let rows = rows
        .lines()
        .map(|row| serde_json::from_str(row).expect("JSON"));
    let path = |row: Value| harness.store().join(row["path"].as_str().expect("a path"));
    rows.map(path).collect()
}

#[test]
fn damaged_images_are_found_and_rendered_again_to_the_same_bytes() {
    let harness = complete(3);
    let before = harness.manifest("farm");
    let images = images(&harness);
    // Views 2, 7 and 11 of the three materials.
    let [flipped, cut, gone] = [2, 14 + 7, 28 + 11].map(|row: usize| &images[row]);
    let whole = fs::read(flipped).expect("an image");
    damage(flipped, |bytes| bytes[whole.len() / 2] ^= 4);
    damage(cut, |bytes| bytes.truncate(bytes.len() / 2));
    fs::remove_file(gone).expect("removed");

    let verify = "dataset verify --store farm --report report.json";
    assert_eq!(harness.run(verify).status.code(), Some(1));
    let report = fs::read(harness.path().join("report.json")).expect("a report");
    let report: Value = serde_json::from_slice(&report).expect("JSON");
    let found: Vec<(u64, u64, &str)> = report["faults"]
        .as_array()
        .expect("faults")
        .iter()
        .map(|fault| {
            let number = |name: &str| fault[name].as_u64().expect("a number");
            let kind = fault["kind"].as_str().expect("a kind");
            (number("material"), number("view"), kind)
        })
        .collect();
    assert_eq!(
        found,
        [(0, 2, "digest"), (1, 7, "size"), (2, 11, "missing")]
    );

    harness.succeed("dataset repair --store farm");
    assert_eq!(fs::read(flipped).expect("an image"), whole);
    assert_eq!(harness.manifest("farm"), before);
    harness.succeed("dataset verify --store farm --rerender 100%");
    harness.expect_undisturbed();
}

/// Whatever befalls the log, the ledger and the images say what it said.
#[test]
fn a_log_that_is_cut_flipped_or_gone_is_written_again() {
    let mut draws = Draws(seed());
    let mut harness = complete(6);
    let before = harness.manifest("farm");
    let path = harness.store().join("completions.log");
    let whole = fs::read(&path).expect("a log");
    for round in 0..6 {
        let log = fs::read(&path).expect("a log");
        match round {
            0 => fs::remove_file(&path).expect("removed"),
            1 => fs::write(&path, b"").expect("written"),
            2 | 3 => {
                let place = draws.below(whole.len() as u64) as usize;
                fs::write(&path, &whole[..place]).expect("written");
            }
            // A digit that becomes another: only its checksum says that the line is wrong.
            4 => damage(&path, |bytes| {
                let name = b"\"bytes\":";
                let place = bytes.windows(name.len()).position(|found| found == name);
                let digit = &mut bytes[place.expect("a size") + name.len()];
                *digit = if *digit == b'1' { b'2' } else { b'1' };
            }),
            // Any bit of a line that still counts: the first one is dead since round 4.
            _ => damage(&path, |bytes| {
                let newline = bytes.iter().position(|&byte| byte == b'\n');
                let start = newline.expect("a line") + 1;
                let place = start + draws.below((bytes.len() - start) as u64) as usize;
                bytes[place] ^= 1 << draws.below(8);
            }),
        }
        if fs::read(&path).ok().is_some_and(|damaged| damaged == log) {
            continue;
        }
        let said = harness.log().len();
        harness.start();
        harness.kill_coordinator();
        assert!(
            harness.log()[said..].contains("ledger and completion log agree again"),
            "round {round}: {}",
            harness.log()
        );
        assert_eq!(harness.manifest("farm"), before, "round {round}");
    }
    harness.succeed("dataset verify --store farm");
}

/// In the middle of a run, again and again: nothing that a worker was told of is lost.
#[test]
fn a_ledger_that_is_gone_cut_or_flipped_is_rebuilt_and_the_run_goes_on() {
    const ROUNDS: u64 = 8;
    let mut draws = Draws(seed());
    let mut harness = Harness::new(20, 64);
    harness.start();
    let worker = harness.worker("sound", &harness.address);
    let mut rebuilt = 0;
    for round in 0..ROUNDS {
        let before = harness.completed().len();
        wait_for("a completion", || harness.completed().len() > before);
        let acknowledged = harness.acknowledged();
        harness.kill_coordinator();
        let ledger = harness.store().join("ledger");
        let file = ledger.join("db");
        match round % 3 {
            0 => fs::remove_dir_all(&ledger).expect("removed"),
            1 => damage(&file, |bytes| {
                bytes.truncate(draws.below(bytes.len() as u64) as usize);
            }),
            _ => damage(&file, |bytes| {
                for _ in 0..64 {
                    let place = draws.below(bytes.len() as u64) as usize;
                    bytes[place] ^= 1 << draws.below(8);
                }
            }),
        }
        let said = harness.log().len();
        harness.start();
        let said = &harness.log()[said..];
        rebuilt += u32::from(said.contains("agree again"));
        let kept = harness.completed();
        for material in acknowledged {
            assert!(
                kept.contains(&material),
                "round {round}: material {material} was acknowledged and is gone"
            );
        }
        let status = harness.status();
        assert_eq!(
            status["completed"].as_u64(),
            Some(kept.len() as u64),
            "round {round}: {said}"
        );
    }
    assert!(rebuilt > 2, "no ledger was hurt");
    harness.wait_until_finished();
    assert_eq!(harness.status()["set_aside"], 0);
    assert_eq!(worker.ended(patience()).code(), Some(0));
    harness.kill_coordinator();
    harness.expect_undisturbed();
}

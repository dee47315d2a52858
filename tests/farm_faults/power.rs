//! The power fails: the store's disk is a file system in an image file, and what that file holds at
//! a random instant is what a dead machine's disk would. What was written and not synced is in the
//! page cache of the file system above, and so is lost.

use crate::harness::{Draws, Harness, Process, seed};
use dataset::Digest;
use serde_json::Value;
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::Command;
use std::thread;
use std::time::Duration;

/// Bytes of the disk.
const DISK_BYTES: u64 = 256 << 20;

/// More than the rounds leave time for.
const MATERIALS: u32 = 5000;

/// A mounted image file.
struct Disk<'a>(&'a Path);

impl<'a> Disk<'a> {
    fn mount(image: &Path, place: &'a Path) -> Self {
        fs::create_dir_all(place).expect("a folder");
        must(
            Command::new("mount")
                .args(["-o", "loop"])
                .arg(image)
                .arg(place),
        );
        Self(place)
    }
}

impl Drop for Disk<'_> {
    fn drop(&mut self) {
        // Without a wait where a failed test's processes still hold it.
        let _ = Command::new("umount").arg("-l").arg(self.0).status();
    }
}

fn must(command: &mut Command) {
    let output = command.output().expect("it runs");
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{command:?} (as root?): {said}");
}

/// 40 power losses: `tests/power-loss.sh`.
#[test]
#[ignore = "needs root, for loop devices: tests/power-loss.sh runs it"]
fn what_was_acknowledged_survives_power_losses() {
    const ROUNDS: usize = 40;
    let mut draws = Draws(seed());
    let mut harness = Harness::new(MATERIALS, 16);
    let path = harness.path().to_owned();
    let image = path.join("disk.img");
    let file = fs::File::create(&image).expect("an image");
    file.set_len(DISK_BYTES).expect("its size");
    must(Command::new("mkfs.ext4").arg("-q").arg(&image));
    let place = path.join("disk");
    let _disk = Disk::mount(&image, &place);
    fs::create_dir(place.join("farm")).expect("a folder");
    std::os::unix::fs::symlink("disk/farm", path.join("farm")).expect("a link");
    harness.start();
    let workers: Vec<Process> = ["a", "b"]
        .map(|name| harness.worker(name, &harness.address))
        .into();
    let mut most = 0;
    for round in 0..ROUNDS {
        thread::sleep(Duration::from_millis(100 + draws.below(500)));
        let acknowledged = harness.acknowledged();
        let coordinator = harness.coordinator.as_ref().expect("a coordinator");
        coordinator.signal("STOP");
        let kept = path.join("kept.img");
        fs::copy(&image, &kept).expect("a copy");
        coordinator.signal("CONT");
        // The set does not grow while it is looked at.
        workers.iter().for_each(|worker| worker.signal("STOP"));
        let after = path.join("after");
        let _disk = Disk::mount(&kept, &after);
        let rows = reopened(&harness);
        for material in &acknowledged {
            let rows = rows.get(material).map_or(&[][..], Vec::as_slice);
            assert_eq!(
                rows.len(),
                14,
                "round {round}: material {material} was acknowledged"
            );
            for row in rows {
                let blob = after
                    .join("farm")
                    .join(row["path"].as_str().expect("a path"));
                let bytes = fs::read(&blob).expect("an image that was acknowledged");
                let digest = Digest::of(&bytes).to_string();
                assert_eq!(digest, row["digest"], "round {round}: material {material}");
            }
        }
        workers.iter().for_each(|worker| worker.signal("CONT"));
        most = most.max(acknowledged.len());
    }
    assert!(
        most > ROUNDS,
        "only {most} completions were there to be lost"
    );
    drop(workers);
    println!(
        "power loss: {ROUNDS} rounds, up to {most} acknowledged materials each, every store \
         opened, 0 acknowledged lost"
    );
}

/// Opens the store as it was when the power failed, and lists its images by material.
fn reopened(harness: &Harness) -> BTreeMap<u64, Vec<Value>> {
    let serve = "coordinator serve --spec spec.toml --store after/farm --listen 127.0.0.1:0";
    let mut command = harness.command(env!("CARGO_BIN_EXE_brdfarm"), serve);
    let (coordinator, _) = Process::serving(&mut command).expect("the store opens");
    coordinator.kill();
    let export =
        "dataset manifest export --store after/farm --format jsonl --partial --out after.jsonl";
    harness.succeed(export);
    let rows = fs::read_to_string(harness.path().join("after.jsonl")).expect("a manifest");
    let mut materials: BTreeMap<u64, Vec<Value>> = BTreeMap::new();
    for row in rows.lines() {
        let row: Value = serde_json::from_str(row).expect("JSON");
        let material = row["material"].as_u64().expect("a number");
        materials.entry(material).or_default().push(row);
    }
    materials
}

//! One fault at a time.

use crate::harness::{Harness, patience, wait_for};
use std::fs;
use std::time::Duration;

/// A lease within which a worker is heard of also on a machine that has much else to do.
const HEARD_SECONDS: u32 = 10;

#[test]
fn a_frozen_worker_s_work_goes_to_others_and_what_it_brings_late_changes_nothing() {
    let mut harness = Harness::new(6, 64);
    harness.lease_seconds = HEARD_SECONDS;
    harness.start();
    let frozen = harness.worker("frozen", &harness.address);
    // Both: one that is asked for when it freezes would be given out after they are counted.
    wait_for("leases", || harness.leases_known_to("frozen") >= 2);
    frozen.signal("STOP");
    let held = harness.status()["leased"].clone();
    assert_ne!(held, 0, "it was frozen too late");
    let export = "dataset manifest export --store farm --out early.csv --format csv";
    let refused = harness.run(export);
    assert_eq!(refused.status.code(), Some(1), "a manifest with holes");
    assert!(!harness.path().join("early.csv").exists());
    let sound = harness.worker("sound", &harness.address);
    harness.wait_until_finished();
    assert_eq!(harness.status()["leases_lost"], held);
    frozen.signal("CONT");
    assert_eq!(
        frozen.ended(patience()).code(),
        Some(0),
        "it learns that nothing is left"
    );
    assert_eq!(sound.ended(patience()).code(), Some(0));
    harness.kill_coordinator();
    harness.expect_undisturbed();
}

/// Longer than leases live. They get their full time again when it is back, and nobody's work is
/// lost.
#[test]
fn a_coordinator_that_was_away_costs_nobody_a_lease() {
    let mut harness = Harness::new(4, 256);
    harness.lease_seconds = HEARD_SECONDS;
    harness.start();
    let worker = harness.worker("patient", &harness.address);
    // A lease whose answer dies with the coordinator is nobody's: it runs out, and that counts.
    wait_for("leases", || harness.leases_known_to("patient") >= 2);
    harness.kill_coordinator();
    std::thread::sleep(Duration::from_secs(u64::from(HEARD_SECONDS) + 1));
    harness.start();
    harness.wait_until_finished();
    assert_eq!(harness.status()["set_aside"], 0);
    assert_eq!(worker.ended(patience()).code(), Some(0));
    let said = fs::read_to_string(harness.path().join("patient.worker")).expect("a log");
    assert!(!said.contains("too late"), "{said}");
    let jobs = harness.succeed(&format!(
        "jobs list --json --coordinator http://{}",
        harness.address
    ));
    for job in jobs.lines() {
        assert!(job.contains("\"leases_lost\":0"), "{job}");
    }
    harness.kill_coordinator();
    harness.expect_undisturbed();
}

/// More than the ledger grows by while a small set is rendered.
const LEDGER_GROWTH_BYTES: usize = 8 << 20;

/// A write fails, whatever room there seemed to be: a limit on the size of files sees to it. (Of a
/// disk that fills up `worker/tests/farm/disk.rs` knows.)
#[test]
fn a_write_that_fails_ends_the_coordinator_with_a_clear_message_and_a_restart_goes_on() {
    let mut harness = Harness::new(8, 16);
    harness.start();
    let worker = harness.worker("patient", &harness.address);
    wait_for("a completion", || !harness.completed().is_empty());
    worker.signal("STOP");
    harness.kill_coordinator();
    // The log is made the largest file by saying again what it says, so that it fills first.
    let path = harness.store().join("completions.log");
    let log = fs::read(&path).expect("a log");
    let ledger = fs::metadata(harness.store().join("ledger/db")).expect("a ledger");
    let copies = (ledger.len() as usize + LEDGER_GROWTH_BYTES) / log.len();
    fs::write(&path, log.repeat(copies)).expect("written");
    let blocks = (log.len() * copies).div_ceil(1024);
    // With the signal ignored a write beyond the limit is an error.
    let arguments = harness.serve();
    let script = format!("trap '' XFSZ; ulimit -f {blocks}; exec \"$0\" {arguments}");
    let mut command = harness.command("bash", "");
    command.args(["-c", &script, env!("CARGO_BIN_EXE_brdfarm")]);
    harness.start_as(command);
    worker.signal("CONT");
    let failing = harness.coordinator.take().expect("a coordinator");
    assert_eq!(failing.ended(patience()).code(), Some(1));
    let said = harness.log();
    assert!(
        said.contains("the store can no longer be written"),
        "{said}"
    );
    assert!(
        said.contains("File too large") || said.contains("completions.log"),
        "{said}"
    );
    let kept = harness.completed();
    assert!(
        kept.iter().max() < Some(&7),
        "there was room for everything"
    );
    for material in harness.acknowledged() {
        assert!(
            kept.contains(&material),
            "material {material} was acknowledged and is gone"
        );
    }
    let full = fs::read(&path).expect("a log");
    let once = [&log[..], &full[log.len() * copies..]].concat();
    fs::write(&path, once).expect("written");

    harness.start();
    harness.wait_until_finished();
    assert_eq!(
        worker.ended(patience()).code(),
        Some(0),
        "the worker waited and went on"
    );
    harness.kill_coordinator();
    harness.expect_undisturbed();
}

//! Coordinator and workers killed again and again in one run.

use crate::harness::{Draws, Harness, Process, patience, seed};
use std::collections::BTreeSet;
use std::thread;
use std::time::{Duration, Instant};

const WORKERS: usize = 3;

/// Short enough for every test run.
#[test]
fn random_kills_lose_and_change_nothing() {
    campaign(Harness::new(12, 64), 12, 6, 900);
}

/// At least 100 kills in one run of 60 materials: `tests/campaign.sh`.
#[test]
#[ignore = "takes minutes: tests/campaign.sh runs it"]
fn campaign_of_a_hundred_kills() {
    campaign(Harness::new(60, 256), 60, 100, 700);
}

/// Kills the coordinator and starts it again: what it acknowledged is still complete.
fn restart_coordinator(harness: &mut Harness) {
    let acknowledged = harness.acknowledged();
    harness.kill_coordinator();
    harness.start();
    let kept: BTreeSet<u64> = harness.completed().into_iter().collect();
    for material in acknowledged {
        assert!(
            kept.contains(&material),
            "material {material} was acknowledged and is gone"
        );
    }
}

/// Renders `materials`, all of a farm's, killing somebody every `pause_ms` at the most, at least
/// `kills_min` times.
pub fn campaign(mut harness: Harness, materials: u32, kills_min: u32, pause_ms: u64) {
    let began = Instant::now();
    let mut draws = Draws(seed());
    harness.start();
    let worker = |harness: &Harness, number: usize| -> Process {
        harness.worker(&format!("w{number}"), &harness.address)
    };
    let mut workers: Vec<Process> = (0..WORKERS)
        .map(|number| worker(&harness, number))
        .collect();
    let (mut coordinator_kills, mut worker_kills) = (0, 0);
    while harness.completed().len() < materials as usize {
        // At a random instant, or sooner where the set would be complete before enough were killed.
        let until = Instant::now() + Duration::from_millis(draws.below(pause_ms));
        assert!(began.elapsed() < patience(), "the set is never complete");
        let due = (coordinator_kills + worker_kills + 1) * materials / (kills_min + 2);
        while Instant::now() < until && harness.completed().len() < due as usize {
            thread::sleep(Duration::from_millis(2));
        }
        // A worker, the coordinator, or it and a worker at once.
        let victim = draws.below(WORKERS as u64 + 2) as usize;
        if victim > WORKERS {
            workers.remove(0).kill();
        }
        if victim >= WORKERS {
            restart_coordinator(&mut harness);
            coordinator_kills += 1;
            if victim > WORKERS {
                workers.insert(0, worker(&harness, 0));
                worker_kills += 1;
            }
        } else {
            workers.remove(victim).kill();
            workers.insert(victim, worker(&harness, victim));
            worker_kills += 1;
        }
    }
    harness.wait_until_finished();
    let status = harness.status();
    assert_eq!(
        (&status["set_aside"], &status["disputed"]),
        (&0.into(), &0.into())
    );
    drop(workers);
    harness.kill_coordinator();
    let acknowledged = harness.acknowledged();
    let told: BTreeSet<u64> = acknowledged.iter().copied().collect();
    assert_eq!(
        told.len(),
        acknowledged.len(),
        "a material was acknowledged to two workers"
    );
    harness.expect_undisturbed();
    let kills = coordinator_kills + worker_kills;
    println!(
        "campaign: {kills} kills ({coordinator_kills} of the coordinator, {worker_kills} of \
         workers), {materials} materials and {} images complete, each once, equal to an \
         undisturbed run's; {} completions acknowledged, 0 lost; 0 quarantined; {:.0} s",
        14 * materials,
        acknowledged.len(),
        began.elapsed().as_secs_f64()
    );
    assert!(
        kills >= kills_min,
        "only {kills} kills before the set was complete"
    );
}

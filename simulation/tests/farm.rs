//! Small farms against what can be worked out, and against what has to be so.

#![allow(clippy::unwrap_used, reason = "a panic here is a failed test")]

use jobqueue::Stage;
use simulation::{
    costs::{Calls, Costs, Files, Postgres},
    farm::{Farm, Rendering, Store},
    figures::Figures,
    simulate,
};
use std::time::Duration;

const MS: Duration = Duration::from_millis(1);

/// Workers that render for so long each, before coordinators of one core.
fn farm(workers: usize, materials: u32, rendering: Duration) -> Farm {
    let mut farm = Farm::of_workers(workers);
    farm.workers.jobs_held = 1;
    farm.workers.asks_missing = false;
    farm.workers.ramp = Duration::ZERO;
    Farm {
        materials,
        views: 1,
        rendering: Rendering::Fixed(rendering),
        coordinator_cores: 1,
        round_trip: Duration::ZERO,
        database_round_trip: Duration::ZERO,
        redundant_per_million: 0,
        warm_up: Duration::ZERO,
        ends: Duration::from_secs(100_000),
        costs: Costs::default(),
        ..farm
    }
}

/// Simulates to the end of the set: every material is completed, and what was said to its worker
/// was said once.
fn complete(farm: Farm) -> Figures {
    let materials = farm.materials;
    let (figures, queue) = simulate(farm).unwrap();
    assert!(figures.complete, "{figures}");
    assert!(queue.is_finished());
    assert_eq!(queue.counts().completed, materials);
    let stages = queue.jobs_from(0).map(|(_, job)| job.state.stage());
    assert_eq!(
        stages.filter(|stage| *stage == Stage::Completed).count(),
        materials as usize
    );
    let counted = &figures.counted;
    assert_eq!(counted.recorded, u64::from(materials));
    assert_eq!(counted.contradicted, 0);
    // Every lease ends one way.
    assert_eq!(
        counted.leases,
        counted.recorded + counted.agreed + counted.leases_lost
    );
    figures
}

fn seconds(figures: &Figures, expected: Duration) {
    let off = figures.seconds - expected.as_secs_f64();
    assert!(off.abs() < 1e-9, "{off} s beside {expected:?}\n{figures}");
}

#[test]
fn one_worker_takes_what_its_parts_add_up_to() {
    let costs = Costs {
        calls: Calls {
            lease: MS,
            complete: 2 * MS,
            ..Calls::default()
        },
        files: Files {
            commit_sync: 3 * MS,
            publish_sync: 4 * MS,
            ..Files::default()
        },
        ..Costs::default()
    };
    // A lease, a rendering, a completion with its publication and its commit; a round trip is so
    // long that no batch waits for its interval. The last lease has nothing to commit.
    let (lease, rendering, completion) = (40 + 1 + 3, 50, 40 + 2 + 4 + 3);
    let figures = complete(Farm {
        round_trip: 40 * MS,
        costs,
        ..farm(1, 100, 50 * MS)
    });
    seconds(
        &figures,
        MS * (100 * (lease + rendering + completion) + 40 + 1),
    );
    let [p50, p99] = figures.lease_ms;
    assert_eq!([p50, p99], [44.0, 44.0]);
}

#[test]
fn a_second_job_hides_the_coordinator_behind_rendering() {
    let mut farm = farm(1, 100, 50 * MS);
    farm.workers.jobs_held = 2;
    farm.costs.files.commit_sync = 3 * MS;
    let figures = complete(farm);
    // Nothing but rendering, a lease before it, and what follows the last job: its publication
    // takes no time, and its commit 3 ms. The last two leases find nothing.
    seconds(&figures, MS * (3 + 100 * 50 + 3));
}

#[test]
fn a_saturated_core_gives_what_its_service_time_allows() {
    let saturated = |store, costs| {
        let (figures, _) = simulate(Farm {
            store,
            costs,
            warm_up: Duration::from_secs(2),
            ends: Duration::from_secs(12),
            ..farm(500, 100_000, Duration::ZERO)
        })
        .unwrap();
        let jobs = figures.jobs_per_second;
        assert!((jobs / 500.0 - 1.0).abs() < 0.01, "{figures}");
        figures.bottleneck()
    };
    let mut costs = Costs::default();
    (costs.calls.lease, costs.calls.complete) = (MS, MS);
    assert_eq!(saturated(Store::Files, costs), "the coordinators' cores");
    let postgres = Postgres {
        claim: MS,
        completion: MS,
        ..Postgres::default()
    };
    let costs = Costs {
        postgres,
        ..Costs::default()
    };
    let store = Store::Postgres { cores: Some(1) };
    assert_eq!(saturated(store, costs), "the database's cores");
}

#[test]
fn workers_with_enough_to_do_are_the_bottleneck_themselves() {
    let (figures, _) = simulate(Farm {
        warm_up: Duration::from_secs(5),
        ends: Duration::from_secs(25),
        ..farm(50, 10_000, Duration::from_secs(1))
    })
    .unwrap();
    // An interval of group commit each for lease and completion at most.
    assert!(
        (46.0..=50.0).contains(&figures.jobs_per_second),
        "{figures}"
    );
    assert_eq!(figures.bottleneck(), "the workers");
}

/// A farm as it is at work, small.
fn at_work(store: Store, coordinators: usize) -> Farm {
    Farm {
        store,
        coordinators,
        coordinator_cores: 4,
        redundant_per_million: 100_000,
        materials: 2_000,
        ends: Duration::from_secs(100_000),
        warm_up: Duration::ZERO,
        ..Farm::of_workers(60)
    }
}

const POSTGRES: Store = Store::Postgres { cores: Some(4) };

#[test]
fn every_material_is_completed_once_and_one_in_ten_twice() {
    for (store, coordinators) in [(Store::Files, 1), (POSTGRES, 3)] {
        let figures = complete(at_work(store, coordinators));
        assert_eq!(figures.counted.leases_lost, 0);
        assert!((140..=260).contains(&figures.counted.agreed), "{figures}");
    }
}

#[test]
fn what_is_drawn_follows_from_the_seed() {
    let run = |seed| {
        let farm = Farm {
            seed,
            ..at_work(POSTGRES, 2)
        };
        complete(farm)
    };
    assert_eq!(run(1), run(1));
    assert_ne!(run(1).seconds, run(2).seconds);
}

#[test]
fn leases_of_dead_workers_run_out_and_their_jobs_are_done_by_others() {
    for (store, coordinators) in [(Store::Files, 1), (POSTGRES, 2)] {
        let mut farm = Farm {
            rendering: Rendering::Fixed(Duration::from_secs(5)),
            ..at_work(store, coordinators)
        };
        farm.workers.dies_every = Some(Duration::from_secs(120));
        let figures = complete(farm);
        let counted = &figures.counted;
        assert!(counted.workers_died > 50, "{figures}");
        // Two at most were held; in the end some died that held none.
        assert!(counted.leases_lost > counted.workers_died / 2, "{figures}");
        assert!(counted.leases_lost <= 2 * counted.workers_died, "{figures}");
    }
}

#[test]
fn a_dead_coordinators_workers_go_on_with_another() {
    let farm = Farm {
        coordinator_dies_at: Some(Duration::from_secs(3)),
        ..at_work(POSTGRES, 3)
    };
    let figures = complete(farm);
    // A lease that was made and never told runs out.
    assert!(figures.counted.leases_lost < 60, "{figures}");
}

#[test]
fn connections_beyond_the_limit_are_turned_away() {
    let (figures, _) = simulate(Farm {
        connections_max: 40,
        ends: Duration::from_secs(20),
        ..farm(100, 10_000, Duration::from_secs(1))
    })
    .unwrap();
    assert_eq!((figures.connected, figures.turned_away), (40, 60));
    assert!(figures.bottleneck().starts_with("connections"), "{figures}");
}

#[test]
fn calls_that_take_too_long_are_asked_again_and_nothing_is_lost() {
    let mut farm = farm(200, 400, Duration::ZERO);
    (farm.costs.calls.lease, farm.costs.calls.complete) = (200 * MS, 200 * MS);
    let figures = complete(farm);
    assert!(figures.counted.given_up > 0, "{figures}");
}

#[test]
fn farms_that_cannot_be_are_refused() {
    let sound = || at_work(Store::Files, 1);
    for farm in [
        Farm {
            coordinators: 2,
            ..sound()
        },
        Farm {
            coordinators: 0,
            ..sound()
        },
        Farm {
            views: 0,
            ..sound()
        },
        Farm {
            warm_up: Duration::from_secs(100_000),
            ..sound()
        },
        Farm {
            coordinator_dies_at: Some(MS),
            ..sound()
        },
        Farm {
            rendering: Rendering::LogNormal {
                mean_seconds: f64::NAN,
                sigma: 1.0,
            },
            ..sound()
        },
        Farm {
            rendering: Rendering::LogNormal {
                mean_seconds: 1.0,
                sigma: -1.0,
            },
            ..sound()
        },
        Farm {
            workers: simulation::farm::Workers {
                count: 0,
                ..sound().workers
            },
            ..sound()
        },
    ] {
        assert!(simulate(farm).is_err());
    }
}

//! A store with a job in every state, and all that a store in a folder holds.

use crate::cheap_image::small_specification;
use crate::complete_store::completion;
use crate::place::Place;
use dataset::{CompletedView, Digest, Specification};
use datastore::{ReadOnlyStore, Store};
use jobqueue::Completion;
use jobqueue::token::{Token, WorkerId};
use jobqueue::{
    Block, BlockCause, Changes, Dispute, Failure, Fingerprint, Holder, JobChange, JobRecord,
    JobState, Mode, RedundantRender, WorkerChange, WorkerFailure, WorkerRecord,
};
use jobstore::completion_log::Completions;
use jobstore::ledger::{Ledger, SledLedger};
use std::path::Path;

pub const MATERIALS: u32 = 40;

/// Those that are complete, disputed or not.
pub const COMPLETE: u32 = 35;

/// Everything that a store holds but its images, which are read and have to be what is recorded.
#[derive(Debug, PartialEq)]
pub struct Contents {
    specification: String,
    jobs: Vec<JobChange>,
    workers: Vec<WorkerChange>,
    mode: Option<Mode>,
    completions: Vec<Completion>,
}

fn holder() -> Holder {
    Holder {
        token: Token::from_bytes([1; 16]),
        worker: WorkerId::from_bytes([2; 16]),
        name: "w".to_owned(),
    }
}

fn failures(count: u32) -> Vec<Failure> {
    let failure = |number| Failure {
        worker: format!("worker {number}"),
        error: "no \"light\"\n".to_owned(),
    };
    (0..count).map(failure).collect()
}

/// The record of a job whose state is one of all there are; `leased` where somebody is at it.
fn record(specification: &Specification, material: u32, leased: bool) -> JobRecord {
    let completed = |redundant| JobState::Completed {
        fingerprint: completion(specification, material).0.fingerprint(),
        worker: "nobody".to_owned(),
        redundant,
    };
    let dispute = Dispute {
        fingerprint: Fingerprint::of_images(Digest::of(b"other")),
        worker: "liar".to_owned(),
        holder: leased.then(holder),
    };
    let pending = JobState::Pending;
    let (state, failed, priority, leases_lost) = match material {
        30 => (completed(RedundantRender::None), 2, -3, 1),
        31 => (completed(RedundantRender::Due), 0, 0, 0),
        32 => (completed(RedundantRender::Agreed), 0, 0, 0),
        33 => (completed(RedundantRender::Disputed(dispute)), 0, 0, 0),
        34 if leased => (completed(RedundantRender::Leased(holder())), 0, 0, 0),
        34 => (completed(RedundantRender::Due), 0, 0, 0),
        35 if leased => (JobState::Leased(holder()), 1, 7, 0),
        35 => (pending, 1, 7, 0),
        36 => (JobState::Quarantined, 3, 0, 0),
        37 => (JobState::Cancelled, 0, 0, 0),
        38 => (pending, 0, 5, 2),
        // Without a history, once nobody is at it.
        39 if leased => (JobState::Leased(holder()), 0, 0, 0),
        39 => (pending, 0, 0, 0),
        _ => (completed(RedundantRender::None), 0, 0, 0),
    };
    JobRecord {
        state,
        priority,
        failures: failures(failed),
        leases_lost,
    }
}

fn workers() -> Vec<WorkerChange> {
    let blocked = |name: &str, cause| WorkerChange {
        name: name.to_owned(),
        record: WorkerRecord {
            failures: 4,
            block: Some(Block {
                cause,
                reason: "why".to_owned(),
            }),
            ..WorkerRecord::default()
        },
    };
    let failing = WorkerChange {
        name: "worker 0".to_owned(),
        record: WorkerRecord {
            failures_in_a_row: vec![WorkerFailure {
                material: 36,
                error: "no light".to_owned(),
            }],
            failures: 9,
            leases_lost: 3,
            block: None,
            probation: 2,
            audit_due: true,
        },
    };
    vec![
        blocked("failing", BlockCause::Failures),
        blocked("liar", BlockCause::Disagreement),
        failing,
    ]
}

/// Makes it, with leases.
pub fn make(path: &Path) -> Contents {
    let specification = small_specification(MATERIALS);
    let mut store = Store::open_or_create(path, &specification).expect("a store");
    for material in 0..COMPLETE {
        let (completion, images) = completion(&specification, material);
        let images: Vec<_> = images
            .into_iter()
            .map(|bytes| (Digest::of(&bytes), bytes))
            .collect();
        store.put(&[completion], &images).expect("put");
    }
    drop(store);
    let (ledger, _) = SledLedger::open(&path.join("ledger")).expect("a ledger");
    let jobs = (30..MATERIALS).map(|material| JobChange {
        material,
        record: record(&specification, material, true),
    });
    let changes = Changes {
        jobs: jobs.collect(),
        workers: workers(),
        mode: Some(Mode::Paused),
        ..Changes::default()
    };
    ledger.apply(&changes, &[]).expect("applied");
    ledger.sync().expect("synced");
    Contents {
        specification: specification.to_json(),
        jobs: (0..MATERIALS - 1)
            .map(|material| JobChange {
                material,
                record: record(&specification, material, false),
            })
            .collect(),
        workers: changes.workers,
        mode: changes.mode,
        completions: (0..COMPLETE)
            .map(|material| completion(&specification, material).0)
            .collect(),
    }
}

/// What a store in a folder holds.
pub fn read(place: &Place, store: &str) -> Contents {
    let path = &place.path().join(store);
    // Wherever they are: as they are recorded, and images of this very set.
    let said = place.refuse(&format!("dataset verify --store {store}"), 1);
    let whole = format!(
        "{} faults; {} of {} images sound",
        MATERIALS - COMPLETE,
        3 * COMPLETE,
        3 * MATERIALS
    );
    assert!(said.contains(&whole), "{said}");
    let (ledger, kept) = SledLedger::open(&path.join("ledger")).expect("a ledger");
    let log = Completions::open(&path.join("completions.log")).expect("a log");
    assert_eq!((log.bad_line_count, log.torn_bytes), (0, 0));
    let store = ReadOnlyStore::open(path).expect("a store");
    let completions = (0..MATERIALS).filter_map(|material| {
        let completion = log.get(material).expect("read")?;
        let in_ledger = ledger.completion(material).expect("read");
        assert_eq!(in_ledger.as_ref(), Some(&completion));
        assert_eq!(store.completion(material).expect("read"), in_ledger);
        check_places(&ledger, material, &completion.views);
        Some(completion)
    });
    Contents {
        specification: store.specification().to_json(),
        completions: completions.collect(),
        jobs: kept.jobs,
        workers: kept.workers,
        mode: kept.mode,
    }
}

fn check_places(ledger: &SledLedger, material: u32, views: &[CompletedView]) {
    for (number, view) in (0..).zip(views) {
        let place = ledger.blob(&view.digest).expect("read");
        let place = place.expect("known by its digest");
        assert_eq!((place.material, place.view), (material, number));
    }
}

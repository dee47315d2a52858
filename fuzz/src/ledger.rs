//! Records of the queue, as a ledger gives them back.

use dataset::Digest;
use jobqueue::{
    Changes, Completion, Fingerprint, JobChange, JobRecord, JobState, Mode, Policy, Queue,
    WorkerChange, WorkerRecord,
    token::{Token, WorkerId},
};
use serde::{Serialize, de::DeserializeOwned};
use std::{collections::BTreeMap, fmt::Debug, time::Duration};

const MATERIALS: u32 = 8;

/// Reads records, one a line after a letter that says of what, restores a queue from them, and
/// lets workers loose on it.
pub fn ledger(bytes: &[u8]) -> bool {
    // As a ledger keeps them: one record a key.
    let mut jobs = BTreeMap::new();
    let mut workers = BTreeMap::new();
    let mut mode = None;
    let mut accepted = false;
    for line in bytes.split(|byte| *byte == b'\n') {
        let Some((what, json)) = line.split_first() else {
            continue;
        };
        match what {
            b'0'..=b'9' => {
                let record = record::<JobRecord>(json);
                jobs.extend(record.map(|record| (u32::from(what - b'0'), record)));
            }
            b'w' => {
                let record = record::<WorkerRecord>(json);
                workers.extend(record.map(|record| ("w".to_owned(), record)));
            }
            b'v' => {
                let record = record::<WorkerRecord>(json);
                workers.extend(record.map(|record| ("v".to_owned(), record)));
            }
            b'm' => mode = record::<Mode>(json),
            b'c' => {
                let completion = record::<Completion>(json);
                accepted |= completion.is_some();
            }
            _ => {}
        }
    }
    accepted |= !jobs.is_empty() || !workers.is_empty() || mode.is_some();
    let jobs = jobs.into_iter();
    let workers = workers.into_iter();
    work(Changes {
        jobs: jobs
            .map(|(material, record)| JobChange { material, record })
            .collect(),
        workers: workers
            .map(|(name, record)| WorkerChange { name, record })
            .collect(),
        mode,
        retracted: Vec::new(),
    });
    accepted
}

fn record<R: DeserializeOwned + Serialize + PartialEq + Debug>(json: &[u8]) -> Option<R> {
    let record: R = serde_json::from_slice(json).ok()?;
    let again = serde_json::to_vec(&record).unwrap();
    assert_eq!(serde_json::from_slice::<R>(&again).unwrap(), record);
    Some(record)
}

fn work(kept: Changes) {
    let holders = kept.jobs.iter().filter_map(|job| job.record.state.holder());
    let held: Vec<(Token, WorkerId)> = holders.map(|held| (held.token, held.worker)).collect();
    let policy = Policy {
        probation: 1,
        audits: 1,
        ..Policy::default()
    };
    let mut queue = Queue::new(MATERIALS, policy);
    queue.restore(kept, Duration::ZERO);
    check(&queue);
    for (material, (token, _)) in (0..).zip(&held) {
        queue.renew(material, *token, 1, Duration::from_secs(1));
    }
    let mut now = Duration::from_secs(2);
    let workers = [("w", 1), ("a/v", 2), ("operator/u", 3)].map(|(name, id)| {
        let worker = WorkerId::from_bytes([id; 16]);
        queue.admit(worker, name);
        worker
    });
    for round in 0..12u8 {
        let worker = workers[usize::from(round) % workers.len()];
        let tokens = [1, 2, 3].map(|number| Token::from_bytes([round * 4 + number; 16]));
        let claimed = queue.claim(worker, &tokens, now);
        check(&queue);
        for (job, token) in claimed.jobs.iter().zip(tokens) {
            // Some are done, some done otherwise, some fail, some are kept.
            let images = Digest::of(&[(job.material as u8 + round) % 2]);
            let images = Fingerprint::of_images(images);
            match (job.material + u32::from(round)) % 4 {
                0 | 1 => drop(queue.complete(job.material, token, images, round % 3 == 0, now)),
                2 => drop(queue.fail(job.material, token, "no light", now)),
                _ => {}
            }
            check(&queue);
        }
        now += Duration::from_secs(30);
        queue.expire(now);
        queue.draw_audits(u64::from(round), now);
        check(&queue);
    }
    for (_, worker) in held {
        queue.release(worker, now);
        check(&queue);
    }
    queue.retry(0..MATERIALS, now);
    queue.release_all(now);
    check(&queue);
    assert_eq!(queue.counts().leased, 0);
}

/// Every job is counted once, and its record reads back.
fn check(queue: &Queue) {
    let counts = queue.counts();
    let states = [
        counts.pending,
        counts.leased,
        counts.completed,
        counts.disputed,
        counts.quarantined,
        counts.cancelled,
    ];
    assert_eq!(states.iter().sum::<u32>(), MATERIALS);
    let jobs = (0..MATERIALS).filter_map(|material| queue.job(material));
    let pending = jobs.filter(|job| job.state == JobState::Pending).count();
    assert_eq!(pending, counts.pending as usize);
    queue.is_finished();
    queue.next_expiry();
}

//! The queue against a model of it: random operations, and after each the same answers, the same
//! states, and a ledger from which a restarted queue continues.

use super::{Change, Counts, JobRecord, JobState, Policy, Queue, Refusal};
use crate::token::{Token, WorkerId};
use dataset::Digest;
use proptest::prelude::*;
use std::{
    collections::{BTreeMap, BTreeSet},
    time::Duration,
};

const MATERIALS: u32 = 12;
const POLICY: Policy = Policy {
    lease: Duration::from_secs(10),
    stall: Duration::from_secs(25),
    failures_max: 3,
    leases_lost_max: 4,
    leases_per_worker_max: 5,
};

/// Tokens are named by the order they were given out in, so that operations can show old ones.
#[derive(Clone, Debug)]
enum Operation {
    Claim { worker: u8, jobs_max: u32 },
    Renew { back: usize, views_done: u32 },
    Complete { back: usize, images: u8 },
    CompleteOther { back: usize, material: u32 },
    Fail { back: usize },
    Release { worker: u8 },
    ReleaseAll,
    Wait { seconds: u64 },
    Restart,
    RetrySetAside,
}

fn operation() -> impl Strategy<Value = Operation> {
    // `back` counts from the newest token: most operations then meet a lease that is alive.
    prop_oneof![
        6 => (0..4u8, 0..4u32).prop_map(|(worker, jobs_max)| Operation::Claim { worker, jobs_max }),
        4 => (0..8usize, 0..4u32)
            .prop_map(|(back, views_done)| Operation::Renew { back, views_done }),
        4 => (0..12usize, prop_oneof![9 => Just(0u8), 1 => Just(1u8)])
            .prop_map(|(back, images)| Operation::Complete { back, images }),
        1 => (0..6usize, 0..MATERIALS + 2)
            .prop_map(|(back, material)| Operation::CompleteOther { back, material }),
        3 => (0..10usize).prop_map(|back| Operation::Fail { back }),
        1 => (0..4u8).prop_map(|worker| Operation::Release { worker }),
        1 => Just(Operation::ReleaseAll),
        4 => (0..8u64).prop_map(|seconds| Operation::Wait { seconds }),
        1 => Just(Operation::Restart),
        1 => Just(Operation::RetrySetAside),
    ]
}

/// What a job is, told in the plainest way: no indices, every question answered by a search.
#[derive(Clone, Debug, Default, PartialEq)]
struct ModelJob {
    lease: Option<ModelLease>,
    completed: Option<Digest>,
    set_aside: bool,
    failures: u32,
    leases_lost: u32,
}

#[derive(Clone, Debug, PartialEq)]
struct ModelLease {
    token: Token,
    worker: WorkerId,
    expires: Duration,
    views_done: u32,
    progressed: Duration,
}

struct Bench {
    queue: Queue,
    model: Vec<ModelJob>,
    ledger: BTreeMap<u32, JobRecord>,
    tokens: Vec<(Token, u32)>,
    now: Duration,
}

fn worker(number: u8) -> WorkerId {
    WorkerId::from_bytes([number; 16])
}

fn fingerprint(material: u32, images: u8) -> Digest {
    Digest::of(&[material as u8, images])
}

impl Bench {
    fn new() -> Self {
        Self {
            queue: Queue::new(MATERIALS, POLICY),
            model: vec![ModelJob::default(); MATERIALS as usize],
            ledger: BTreeMap::new(),
            tokens: Vec::new(),
            now: Duration::ZERO,
        }
    }

    fn keep(&mut self, changes: impl IntoIterator<Item = Change>) -> BTreeSet<u32> {
        changes
            .into_iter()
            .map(|change| {
                self.ledger.insert(change.material, change.record);
                change.material
            })
            .collect()
    }

    fn token(&self, back: usize) -> Option<(Token, u32)> {
        let index = self.tokens.len().checked_sub(back + 1)?;
        Some(self.tokens[index])
    }

    fn back_to_the_queue(&mut self, material: u32) {
        let job = &mut self.model[material as usize];
        job.lease = None;
        job.set_aside =
            job.failures >= POLICY.failures_max || job.leases_lost >= POLICY.leases_lost_max;
    }

    fn current(&self, material: u32, token: Token) -> bool {
        let lease = self.model.get(material as usize).map(|job| &job.lease);
        matches!(lease, Some(Some(lease)) if lease.token == token)
    }

    fn apply(&mut self, operation: Operation) {
        match operation {
            Operation::Claim {
                worker: number,
                jobs_max,
            } => self.claim(worker(number), jobs_max),
            Operation::Renew { back, views_done } => self.renew(back, views_done),
            Operation::Complete { back, images } => {
                if let Some((token, material)) = self.token(back) {
                    self.complete(token, material, images);
                }
            }
            Operation::CompleteOther { back, material } => {
                if let Some((token, _)) = self.token(back) {
                    self.complete(token, material, 0);
                }
            }
            Operation::Fail { back } => self.fail(back),
            Operation::Release { worker: number } => {
                let expected: BTreeSet<u32> = (0..MATERIALS)
                    .filter(|material| {
                        let lease = &self.model[*material as usize].lease;
                        lease
                            .as_ref()
                            .is_some_and(|lease| lease.worker == worker(number))
                    })
                    .collect();
                let changes = self.queue.release(worker(number), self.now);
                assert_eq!(self.keep(changes), expected);
                for material in expected {
                    self.model[material as usize].lease = None;
                }
            }
            Operation::ReleaseAll => {
                let expected: BTreeSet<u32> = (0..MATERIALS)
                    .filter(|material| self.model[*material as usize].lease.is_some())
                    .collect();
                let changes = self.queue.release_all(self.now);
                assert_eq!(self.keep(changes), expected);
                for material in expected {
                    self.model[material as usize].lease = None;
                }
            }
            Operation::Wait { seconds } => self.wait(Duration::from_secs(seconds)),
            Operation::Restart => self.restart(),
            Operation::RetrySetAside => {
                let changes = self.queue.retry_set_aside(self.now);
                let expected: BTreeSet<u32> = (0..MATERIALS)
                    .filter(|material| self.model[*material as usize].set_aside)
                    .collect();
                assert_eq!(self.keep(changes), expected);
                for material in expected {
                    self.model[material as usize] = ModelJob::default();
                }
            }
        }
    }

    fn claim(&mut self, worker: WorkerId, jobs_max: u32) {
        let held = self
            .model
            .iter()
            .filter(|job| {
                job.lease
                    .as_ref()
                    .is_some_and(|lease| lease.worker == worker)
            })
            .count() as u32;
        let room = POLICY.leases_per_worker_max - held;
        let expected: Vec<u32> = (0..MATERIALS)
            .filter(|material| {
                let job = &self.model[*material as usize];
                job.lease.is_none() && job.completed.is_none() && !job.set_aside
            })
            .take(jobs_max.min(room) as usize)
            .collect();
        let next = self.tokens.len() as u128;
        let tokens: Vec<Token> = (0..u128::from(jobs_max))
            .map(|number| Token::from_bytes((next + number).to_be_bytes()))
            .collect();
        let claims = self.queue.claim(worker, &tokens, self.now);
        let claimed: Vec<u32> = claims.iter().map(|change| change.material).collect();
        assert_eq!(claimed, expected);
        for (change, token) in claims.into_iter().zip(tokens) {
            self.tokens.push((token, change.material));
            self.model[change.material as usize].lease = Some(ModelLease {
                token,
                worker,
                expires: self.now + POLICY.lease,
                views_done: 0,
                progressed: self.now,
            });
            self.keep([change]);
        }
    }

    fn renew(&mut self, back: usize, views_done: u32) {
        let Some((token, material)) = self.token(back) else {
            return;
        };
        let renewed = self.queue.renew(material, token, views_done, self.now);
        if !self.current(material, token) {
            assert!(!renewed);
            return;
        }
        let Some(lease) = &mut self.model[material as usize].lease else {
            unreachable!("current");
        };
        if views_done > lease.views_done {
            lease.views_done = views_done;
            lease.progressed = self.now;
        }
        let stalled = lease.progressed + POLICY.stall;
        lease.expires = stalled.min(self.now + POLICY.lease);
        assert_eq!(renewed, self.now < stalled);
    }

    fn complete(&mut self, token: Token, material: u32, images: u8) {
        let fingerprint = fingerprint(material, images);
        let answer = self.queue.complete(material, token, fingerprint, self.now);
        let current = self.current(material, token);
        let Some(job) = self.model.get_mut(material as usize) else {
            assert_eq!(answer, Err(Refusal::UnknownMaterial(material)));
            return;
        };
        match (current, job.completed) {
            (true, _) => {
                job.completed = Some(fingerprint);
                job.lease = None;
                let change = answer.unwrap().unwrap();
                assert_eq!(change.material, material);
                self.keep([change]);
            }
            (false, Some(kept)) if kept == fingerprint => assert_eq!(answer, Ok(None)),
            (false, Some(_)) => assert_eq!(answer, Err(Refusal::Conflict(material))),
            (false, None) => assert_eq!(answer, Err(Refusal::LeaseLost(material))),
        }
    }

    fn fail(&mut self, back: usize) {
        let Some((token, material)) = self.token(back) else {
            return;
        };
        let answer = self
            .queue
            .fail(material, token, "no light".to_owned(), self.now);
        if self.current(material, token) {
            self.model[material as usize].failures += 1;
            self.back_to_the_queue(material);
            self.keep([answer.unwrap()]);
        } else {
            assert_eq!(answer, Err(Refusal::LeaseLost(material)));
        }
    }

    fn wait(&mut self, time: Duration) {
        self.now += time;
        let expected: BTreeSet<u32> = (0..MATERIALS)
            .filter(|material| {
                let lease = &self.model[*material as usize].lease;
                lease
                    .as_ref()
                    .is_some_and(|lease| lease.expires <= self.now)
            })
            .collect();
        let changes = self.queue.expire(self.now);
        assert_eq!(self.keep(changes), expected);
        for material in expected {
            self.model[material as usize].leases_lost += 1;
            self.back_to_the_queue(material);
        }
    }

    /// The process dies; another one continues from what was made durable.
    fn restart(&mut self) {
        self.queue = Queue::new(MATERIALS, POLICY);
        for (material, record) in self.ledger.clone() {
            self.queue.restore(Change { material, record }, self.now);
        }
        for job in &mut self.model {
            if let Some(lease) = &mut job.lease {
                lease.expires = self.now + POLICY.lease;
                lease.views_done = 0;
                lease.progressed = self.now;
            }
        }
    }

    fn check(&self) {
        let count = |of: fn(&ModelJob) -> bool| self.model.iter().filter(|job| of(job)).count();
        let expected = Counts {
            materials: MATERIALS,
            pending: count(|job| job.lease.is_none() && job.completed.is_none() && !job.set_aside)
                as u32,
            leased: count(|job| job.lease.is_some()) as u32,
            completed: count(|job| job.completed.is_some()) as u32,
            set_aside: count(|job| job.set_aside) as u32,
        };
        assert_eq!(self.queue.counts(), expected);
        let left = expected.pending + expected.leased;
        assert_eq!(self.queue.is_finished(), left == 0);
        assert_eq!(
            expected.materials,
            left + expected.completed + expected.set_aside,
            "every job is in exactly one state"
        );
        let expiries = self
            .model
            .iter()
            .filter_map(|job| Some(job.lease.as_ref()?.expires));
        assert_eq!(self.queue.next_expiry(), expiries.min());
        for (material, job) in (0..).zip(&self.model) {
            let kept = self.ledger.get(&material).cloned().unwrap_or_default();
            let state = match (&job.lease, job.completed, job.set_aside) {
                (Some(lease), None, false) => JobState::Leased {
                    token: lease.token,
                    worker: lease.worker,
                },
                (None, Some(fingerprint), false) => JobState::Completed { fingerprint },
                (None, None, true) => JobState::SetAside,
                (None, None, false) => JobState::Pending,
                other => panic!("the model contradicts itself: {other:?}"),
            };
            assert_eq!(kept.state, state, "what is durable is what is");
            assert_eq!(kept.errors.len() as u32, job.failures);
            assert_eq!(kept.leases_lost, job.leases_lost);
            let held = job.lease.as_ref().map(|lease| lease.worker);
            assert!(held.is_none_or(|worker| self.queue.holds(worker)));
        }
    }
}

proptest! {
    // 512 runs of 100 to 300 operations: 100,000 and more.
    #![proptest_config(ProptestConfig { cases: 512, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn the_queue_does_what_the_model_does(
        operations in prop::collection::vec(operation(), 100..300)
    ) {
        let mut bench = Bench::new();
        for operation in operations {
            bench.apply(operation);
            bench.check();
        }
    }
}

//! The queue against a model of it: random operations, and after each the same answers, the same
//! states, and a ledger from which a restarted queue continues. The suite takes the ledger.

use super::{
    BarCause, Changes, Check, Counts, Dispute, Failure, Holder, JobRecord, JobState, Mode, Policy,
    Queue, Refusal, Verdict, WorkerRecord,
};
use crate::{
    ledger::{Ledger, SledLedger, memory::MemoryLedger},
    token::{Token, WorkerId},
};
use dataset::Digest;
use proptest::prelude::*;
use std::{
    collections::{BTreeMap, BTreeSet},
    sync::Arc,
    time::Duration,
};

const MATERIALS: u32 = 12;
const WORKERS: u8 = 5;
const POLICY: Policy = Policy {
    lease: Duration::from_secs(10),
    stall: Duration::from_secs(25),
    deadline: Duration::from_secs(60),
    workers_failed_max: 3,
    failures_max: 5,
    leases_lost_max: 4,
    leases_per_worker_max: 5,
    jobs_failed_max: 3,
    bar: Duration::from_secs(40),
};

/// Tokens are named by the order they were given out in, so that operations can show old ones.
#[derive(Clone, Debug)]
enum Operation {
    Admit {
        worker: u8,
    },
    Dismiss {
        worker: u8,
    },
    Claim {
        worker: u8,
        jobs_max: u32,
    },
    Renew {
        back: usize,
        views_done: u32,
    },
    Complete {
        back: usize,
        images: u8,
        check: bool,
    },
    CompleteOther {
        back: usize,
        material: u32,
    },
    Fail {
        back: usize,
    },
    Release {
        worker: u8,
    },
    ReleaseAll,
    Wait {
        seconds: u64,
    },
    Restart,
    RetrySetAside,
    Retry {
        materials: Vec<u32>,
    },
    Cancel {
        materials: Vec<u32>,
    },
    Prioritize {
        materials: Vec<u32>,
        priority: i32,
    },
    SetMode {
        mode: Mode,
    },
    Bar {
        worker: u8,
    },
    Unbar {
        worker: u8,
    },
}

fn operation() -> impl Strategy<Value = Operation> {
    let materials = || prop::collection::vec(0..MATERIALS + 2, 0..4);
    let mode = prop_oneof![
        6 => Just(Mode::Running), 1 => Just(Mode::Paused), 1 => Just(Mode::Draining)
    ];
    // `back` counts from the newest token: most operations then meet a lease that is alive.
    prop_oneof![
        3 => (0..WORKERS).prop_map(|worker| Operation::Admit { worker }),
        1 => (0..WORKERS).prop_map(|worker| Operation::Dismiss { worker }),
        8 => (0..WORKERS, 0..4u32)
            .prop_map(|(worker, jobs_max)| Operation::Claim { worker, jobs_max }),
        4 => (0..8usize, 0..4u32)
            .prop_map(|(back, views_done)| Operation::Renew { back, views_done }),
        7 => (0..12usize, prop_oneof![6 => Just(0u8), 1 => Just(1u8), 1 => Just(2u8)], any::<bool>())
            .prop_map(|(back, images, check)| Operation::Complete { back, images, check }),
        1 => (0..6usize, 0..MATERIALS + 2)
            .prop_map(|(back, material)| Operation::CompleteOther { back, material }),
        2 => (0..10usize).prop_map(|back| Operation::Fail { back }),
        1 => (0..WORKERS).prop_map(|worker| Operation::Release { worker }),
        1 => Just(Operation::ReleaseAll),
        4 => (0..8u64).prop_map(|seconds| Operation::Wait { seconds }),
        1 => Just(Operation::Restart),
        1 => Just(Operation::RetrySetAside),
        1 => materials().prop_map(|materials| Operation::Retry { materials }),
        1 => materials().prop_map(|materials| Operation::Cancel { materials }),
        1 => (materials(), -2..3i32)
            .prop_map(|(materials, priority)| Operation::Prioritize { materials, priority }),
        1 => mode.prop_map(|mode| Operation::SetMode { mode }),
        1 => (0..WORKERS).prop_map(|worker| Operation::Bar { worker }),
        2 => (0..WORKERS).prop_map(|worker| Operation::Unbar { worker }),
    ]
}

/// What is known of a job, told in the plainest way: no indices, every question answered by a
/// search.
#[derive(Clone, Debug, Default, PartialEq)]
struct ModelJob {
    lease: Option<ModelLease>,
    // Who says what the job's images are, first, second and third.
    opinions: Vec<(Digest, u8)>,
    check_wanted: bool,
    set_aside: bool,
    cancelled: bool,
    priority: i32,
    failed_on: Vec<u8>,
    leases_lost: u32,
}

#[derive(Clone, Debug, PartialEq)]
struct ModelLease {
    token: Token,
    worker: u8,
    claimed: Duration,
    expires: Duration,
    views_done: u32,
    progressed: Duration,
}

#[derive(Clone, Debug, Default, PartialEq)]
struct ModelWorker {
    present: bool,
    failed_in_a_row: Vec<u32>,
    failures: u64,
    leases_lost: u64,
    // When it ends, where it ends.
    bar: Option<(BarCause, Option<Duration>)>,
}

impl ModelJob {
    fn is_pending(&self) -> bool {
        self.lease.is_none() && self.opinions.is_empty() && !self.set_aside && !self.cancelled
    }

    fn is_disputed(&self) -> bool {
        self.opinions.len() == 2 && self.opinions[0].0 != self.opinions[1].0
    }

    fn is_completed(&self) -> bool {
        !self.opinions.is_empty() && !self.is_disputed()
    }

    fn wants_opinion(&self) -> bool {
        self.lease.is_none()
            && (self.is_disputed() || self.opinions.len() == 1 && self.check_wanted)
    }

    fn hopeless(&self) -> bool {
        let workers: BTreeSet<u8> = self.failed_on.iter().copied().collect();
        workers.len() as u32 >= POLICY.workers_failed_max
            || self.failed_on.len() as u32 >= POLICY.failures_max
            || self.leases_lost >= POLICY.leases_lost_max
    }
}

/// Closes a ledger and opens it again, as a restart does.
type Reopen = dyn FnMut(Arc<dyn Ledger>) -> Arc<dyn Ledger>;

struct Bench {
    queue: Queue,
    jobs: Vec<ModelJob>,
    workers: Vec<ModelWorker>,
    mode: Mode,
    ledger: Arc<dyn Ledger>,
    reopen: Box<Reopen>,
    tokens: Vec<(Token, u32)>,
    now: Duration,
}

fn id(number: u8) -> WorkerId {
    WorkerId::from_bytes([number; 16])
}

fn name(number: u8) -> String {
    format!("w{number}")
}

fn fingerprint(material: u32, images: u8) -> Digest {
    Digest::of(&[material as u8, images])
}

impl Bench {
    fn new(
        ledger: Arc<dyn Ledger>,
        reopen: impl FnMut(Arc<dyn Ledger>) -> Arc<dyn Ledger> + 'static,
    ) -> Self {
        Self {
            queue: Queue::new(MATERIALS, POLICY),
            jobs: vec![ModelJob::default(); MATERIALS as usize],
            workers: vec![ModelWorker::default(); WORKERS as usize],
            mode: Mode::Running,
            ledger,
            reopen: Box::new(reopen),
            tokens: Vec::new(),
            now: Duration::ZERO,
        }
    }

    /// Makes changes durable; returns which jobs they touched.
    fn keep(&mut self, changes: &Changes) -> BTreeSet<u32> {
        self.ledger.apply(changes, &[]).unwrap();
        changes.jobs.iter().map(|change| change.material).collect()
    }

    fn token(&self, back: usize) -> Option<(Token, u32)> {
        let index = self.tokens.len().checked_sub(back + 1)?;
        Some(self.tokens[index])
    }

    fn job(&mut self, material: u32) -> &mut ModelJob {
        &mut self.jobs[material as usize]
    }

    fn current(&self, material: u32, token: Token) -> bool {
        let lease = self.jobs.get(material as usize).map(|job| &job.lease);
        matches!(lease, Some(Some(lease)) if lease.token == token)
    }

    fn those(&self, wanted: impl Fn(&ModelJob) -> bool) -> BTreeSet<u32> {
        let jobs = (0..).zip(&self.jobs);
        jobs.filter(|(_, job)| wanted(job))
            .map(|(material, _)| material)
            .collect()
    }

    fn able(&self) -> Vec<u8> {
        let able = |worker: &u8| {
            let worker = &self.workers[*worker as usize];
            worker.present && worker.bar.is_none()
        };
        (0..WORKERS).filter(able).collect()
    }

    fn may_judge(&self, worker: u8, job: &ModelJob) -> bool {
        job.wants_opinion()
            && job.opinions.iter().all(|(_, by)| *by != worker)
            && !job.failed_on.contains(&worker)
    }

    fn apply(&mut self, operation: Operation) {
        match operation {
            Operation::Admit { worker } => {
                self.queue.admit(id(worker), &name(worker));
                self.workers[worker as usize].present = true;
            }
            Operation::Dismiss { worker } => {
                let held = |job: &ModelJob| job.lease.as_ref().is_some_and(|l| l.worker == worker);
                if self.those(held).is_empty() {
                    self.queue.dismiss(id(worker));
                    self.workers[worker as usize].present = false;
                }
            }
            Operation::Claim { worker, jobs_max } => self.claim(worker, jobs_max),
            Operation::Renew { back, views_done } => self.renew(back, views_done),
            Operation::Complete {
                back,
                images,
                check,
            } => {
                if let Some((token, material)) = self.token(back) {
                    self.complete(token, material, images, check);
                }
            }
            Operation::CompleteOther { back, material } => {
                if let Some((token, _)) = self.token(back) {
                    self.complete(token, material, 0, false);
                }
            }
            Operation::Fail { back } => self.fail(back),
            Operation::Release { worker } => {
                let held = |job: &ModelJob| job.lease.as_ref().is_some_and(|l| l.worker == worker);
                let expected = self.those(held);
                let changes = self.queue.release(id(worker), self.now);
                self.handed_back(changes, expected);
            }
            Operation::ReleaseAll => {
                let expected = self.those(|job| job.lease.is_some());
                let changes = self.queue.release_all(self.now);
                self.handed_back(changes, expected);
            }
            Operation::Wait { seconds } => self.wait(Duration::from_secs(seconds)),
            Operation::Restart => self.restart(),
            Operation::RetrySetAside => {
                let expected = self.those(|job| job.set_aside);
                let changes = self.queue.retry_set_aside(self.now);
                self.retried(changes, expected);
            }
            Operation::Retry { materials } => {
                let mut expected = self.those(|job| job.set_aside || job.cancelled);
                expected.retain(|material| materials.contains(material));
                let changes = self.queue.retry(materials, self.now);
                self.retried(changes, expected);
            }
            Operation::Cancel { materials } => {
                let mut expected = self.those(|job| job.opinions.is_empty() && !job.cancelled);
                expected.retain(|material| materials.contains(material));
                let changes = self.queue.cancel(materials, self.now);
                assert_eq!(self.keep(&changes), expected);
                for material in expected {
                    let job = self.job(material);
                    job.lease = None;
                    job.set_aside = false;
                    job.cancelled = true;
                }
            }
            Operation::Prioritize {
                materials,
                priority,
            } => {
                let mut expected = self.those(|job| job.is_pending() && job.priority != priority);
                expected.retain(|material| materials.contains(material));
                let changes = self.queue.prioritize(materials, priority, self.now);
                assert_eq!(self.keep(&changes), expected);
                for material in expected {
                    self.job(material).priority = priority;
                }
            }
            Operation::SetMode { mode } => {
                let changes = self.queue.set_mode(mode);
                assert_eq!(changes.mode.is_some(), mode != self.mode);
                self.keep(&changes);
                self.mode = mode;
            }
            Operation::Bar { worker } => {
                let reason = "dust".to_owned();
                let changes = self
                    .queue
                    .bar(&name(worker), BarCause::Operator, reason, self.now);
                let touched = self.keep(&changes);
                assert_eq!(touched, self.bar(worker, BarCause::Operator));
            }
            Operation::Unbar { worker } => {
                let changes = Changes {
                    workers: self.queue.unbar(&name(worker)).into_iter().collect(),
                    ..Changes::default()
                };
                self.keep(&changes);
                let model = &mut self.workers[worker as usize];
                assert_eq!(changes.workers.len(), usize::from(model.bar.is_some()));
                if model.bar.take().is_some() {
                    model.failed_in_a_row.clear();
                }
            }
        }
    }

    fn handed_back(&mut self, changes: Changes, expected: BTreeSet<u32>) {
        assert_eq!(self.keep(&changes), expected);
        for material in expected {
            self.job(material).lease = None;
        }
    }

    fn retried(&mut self, changes: Changes, expected: BTreeSet<u32>) {
        assert_eq!(self.keep(&changes), expected);
        for material in expected {
            *self.job(material) = ModelJob {
                priority: self.job(material).priority,
                ..ModelJob::default()
            };
        }
    }

    fn claim(&mut self, worker: u8, jobs_max: u32) {
        let held = |job: &ModelJob| job.lease.as_ref().is_some_and(|l| l.worker == worker);
        let room = POLICY.leases_per_worker_max as usize - self.those(held).len();
        let mut expected = Vec::new();
        if self.able().contains(&worker) && self.mode == Mode::Running {
            let judge = |job: &&ModelJob| self.may_judge(worker, job);
            let disputed = |job: &ModelJob| judge(&job) && job.is_disputed();
            let checks = |job: &ModelJob| judge(&job) && !job.is_disputed();
            expected.extend(self.those(disputed));
            expected.extend(self.those(checks));
            let mut fresh: Vec<u32> = self.those(ModelJob::is_pending).into_iter().collect();
            fresh.sort_by_key(|material| -self.jobs[*material as usize].priority);
            let failed = |material: &u32| self.jobs[*material as usize].failed_on.contains(&worker);
            expected.extend(fresh.iter().filter(|material| !failed(material)));
            let others_failed = |material: &u32| {
                let job = &self.jobs[*material as usize];
                self.able()
                    .iter()
                    .all(|other| job.failed_on.contains(other))
            };
            let again = fresh.iter().filter(|m| failed(m) && others_failed(m));
            expected.extend(again);
            expected.truncate(room.min(jobs_max as usize));
        }
        let next = self.tokens.len() as u128;
        let tokens: Vec<Token> = (0..u128::from(jobs_max))
            .map(|number| Token::from_bytes((next + number).to_be_bytes()))
            .collect();
        let claims = self.queue.claim(id(worker), &tokens, self.now);
        let claimed: Vec<u32> = claims.jobs.iter().map(|change| change.material).collect();
        assert_eq!(claimed, expected);
        self.keep(&claims);
        for (material, token) in claimed.into_iter().zip(tokens) {
            self.tokens.push((token, material));
            let now = self.now;
            self.job(material).lease = Some(ModelLease {
                token,
                worker,
                claimed: now,
                expires: now + POLICY.lease,
                views_done: 0,
                progressed: now,
            });
        }
    }

    fn renew(&mut self, back: usize, views_done: u32) {
        let Some((token, material)) = self.token(back) else {
            return;
        };
        let now = self.now;
        let renewed = self.queue.renew(material, token, views_done, now);
        if !self.current(material, token) {
            assert!(!renewed);
            return;
        }
        let Some(lease) = &mut self.job(material).lease else {
            unreachable!("current");
        };
        if views_done > lease.views_done {
            lease.views_done = views_done;
            lease.progressed = now;
        }
        let ends = (lease.progressed + POLICY.stall).min(lease.claimed + POLICY.deadline);
        lease.expires = ends.min(now + POLICY.lease);
        assert_eq!(renewed, now < ends);
    }

    fn complete(&mut self, token: Token, material: u32, images: u8, check: bool) {
        let fingerprint = fingerprint(material, images);
        let answer = self
            .queue
            .complete(material, token, fingerprint, check, self.now);
        let current = self.current(material, token);
        let Some(job) = self.jobs.get_mut(material as usize) else {
            assert_eq!(answer, Err(Refusal::UnknownMaterial(material)));
            return;
        };
        if !current {
            let known = job.opinions.iter().any(|(known, _)| *known == fingerprint);
            let expected = match (job.opinions.is_empty(), known) {
                (true, _) => Err(Refusal::LeaseLost(material)),
                (false, true) => Ok((Verdict::Repeated, Changes::default())),
                (false, false) => Err(Refusal::Conflict(material)),
            };
            assert_eq!(answer, expected);
            return;
        }
        let worker = job.lease.take().unwrap().worker;
        let mut opinions = job.opinions.clone();
        opinions.push((fingerprint, worker));
        let mut touched = BTreeSet::from([material]);
        let expected = match opinions[..] {
            [_] => {
                job.check_wanted = check;
                job.opinions = opinions;
                Verdict::Recorded
            }
            [(first, _), (second, _)] => {
                job.opinions = opinions;
                if first == second {
                    Verdict::Agreed
                } else {
                    Verdict::Disputed
                }
            }
            [(first, a), (second, b), (third, c)] if third == first || third == second => {
                let (honest, liar, verdict) = if third == first {
                    (a, b, Verdict::Upheld(name(b)))
                } else {
                    (c, a, Verdict::Overturned(name(a)))
                };
                job.opinions = vec![(third, honest), (third, WORKERS)];
                touched.extend(self.bar(liar, BarCause::Disagreement));
                verdict
            }
            _ => {
                job.opinions.clear();
                job.set_aside = true;
                job.failed_on.push(worker);
                Verdict::Undecided
            }
        };
        self.workers[worker as usize].failed_in_a_row.clear();
        let (verdict, changes) = answer.unwrap();
        assert_eq!(verdict, expected);
        assert_eq!(self.keep(&changes), touched);
        for material in changes.retracted {
            assert!(!self.jobs[material as usize].is_completed());
        }
    }

    /// Bars a worker in the model; returns which jobs that changes.
    fn bar(&mut self, worker: u8, cause: BarCause) -> BTreeSet<u32> {
        let ends = (cause == BarCause::Failures).then_some(self.now + POLICY.bar);
        self.workers[worker as usize].bar = Some((cause, ends));
        let mut touched = BTreeSet::new();
        for (material, job) in (0..).zip(&mut self.jobs) {
            if job
                .lease
                .as_ref()
                .is_some_and(|lease| lease.worker == worker)
            {
                job.lease = None;
                touched.insert(material);
            }
            if cause != BarCause::Disagreement {
                continue;
            }
            let agreed = job.opinions.len() == 2 && !job.is_disputed();
            let delivered = job.opinions.first().is_some_and(|(_, by)| *by == worker);
            if delivered && !agreed {
                job.opinions.clear();
                job.lease = None;
                touched.insert(material);
            } else if job.is_disputed() && job.opinions[1].1 == worker {
                job.opinions.pop();
                job.check_wanted = true;
                job.lease = None;
                touched.insert(material);
            }
        }
        touched
    }

    fn back_to_the_queue(&mut self, material: u32) {
        let job = self.job(material);
        job.lease = None;
        if job.hopeless() {
            if job.is_disputed() || job.opinions.is_empty() {
                job.opinions.clear();
                job.set_aside = true;
            } else {
                job.check_wanted = false;
            }
        }
    }

    fn fail(&mut self, back: usize) {
        let Some((token, material)) = self.token(back) else {
            return;
        };
        let answer = self.queue.fail(material, token, "no light", self.now);
        if !self.current(material, token) {
            assert_eq!(answer, Err(Refusal::LeaseLost(material)));
            return;
        }
        let Some(lease) = self.job(material).lease.clone() else {
            unreachable!("current");
        };
        self.job(material).failed_on.push(lease.worker);
        self.back_to_the_queue(material);
        let mut touched = BTreeSet::from([material]);
        let worker = &mut self.workers[lease.worker as usize];
        worker.failures += 1;
        worker.failed_in_a_row.retain(|failed| *failed != material);
        worker.failed_in_a_row.push(material);
        let too_many = worker.failed_in_a_row.len() as u32 >= POLICY.jobs_failed_max;
        if too_many && worker.bar.is_none() {
            touched.extend(self.bar(lease.worker, BarCause::Failures));
        }
        assert_eq!(self.keep(&answer.unwrap()), touched);
    }

    fn wait(&mut self, time: Duration) {
        self.now += time;
        let now = self.now;
        let over = |job: &ModelJob| job.lease.as_ref().is_some_and(|lease| lease.expires <= now);
        let expected = self.those(over);
        let (changes, lost) = self.queue.expire(self.now);
        let lost: BTreeSet<u32> = lost.iter().map(|lease| lease.material).collect();
        assert_eq!(lost, expected);
        assert_eq!(self.keep(&changes), expected);
        for material in expected {
            let job = self.job(material);
            job.leases_lost += 1;
            let Some(lease) = job.lease.clone() else {
                unreachable!("over");
            };
            self.workers[lease.worker as usize].leases_lost += 1;
            self.back_to_the_queue(material);
        }
        for worker in &mut self.workers {
            if matches!(worker.bar, Some((_, Some(ends))) if ends <= now) {
                worker.bar = None;
                worker.failed_in_a_row.clear();
            }
        }
    }

    /// The process dies; another one continues from what was made durable.
    fn restart(&mut self) {
        let ledger = std::mem::replace(&mut self.ledger, Arc::new(MemoryLedger::default()));
        self.ledger = (self.reopen)(ledger);
        self.queue = Queue::new(MATERIALS, POLICY);
        let kept = self.ledger.contents().unwrap();
        self.queue.restore(kept, self.now);
        let now = self.now;
        for job in &mut self.jobs {
            if let Some(lease) = &mut job.lease {
                lease.claimed = now;
                lease.expires = now + POLICY.lease;
                lease.views_done = 0;
                lease.progressed = now;
            }
        }
        for worker in &mut self.workers {
            worker.present = false;
            if let Some((_, Some(ends))) = &mut worker.bar {
                *ends = now + POLICY.bar;
            }
        }
    }

    fn check(&self) {
        let count = |of: fn(&ModelJob) -> bool| self.jobs.iter().filter(|job| of(job)).count();
        let expected = Counts {
            materials: MATERIALS,
            pending: count(ModelJob::is_pending) as u32,
            leased: count(|job| job.lease.is_some() && job.opinions.is_empty()) as u32,
            completed: count(ModelJob::is_completed) as u32,
            disputed: count(ModelJob::is_disputed) as u32,
            set_aside: count(|job| job.set_aside) as u32,
            cancelled: count(|job| job.cancelled) as u32,
            checks: count(|job| {
                job.opinions.len() == 1 && (job.check_wanted || job.lease.is_some())
            }) as u32,
        };
        assert_eq!(self.queue.counts(), expected);
        let settled = expected.completed + expected.set_aside + expected.cancelled;
        let left = expected.pending + expected.leased + expected.disputed;
        assert_eq!(
            expected.materials,
            left + settled,
            "every job is in exactly one state"
        );
        let under_way = self.jobs.iter().any(|job| job.lease.is_some());
        let able = self.able();
        let judged = self.jobs.iter();
        let judged = judged.filter(|job| able.iter().any(|worker| self.may_judge(*worker, job)));
        let finished = left == 0 && !under_way && judged.count() == 0;
        assert_eq!(self.queue.is_finished(), finished);
        assert_eq!(self.queue.mode(), self.mode);
        let leases = self
            .jobs
            .iter()
            .filter_map(|job| Some(job.lease.as_ref()?.expires));
        let bars = self.workers.iter().filter_map(|worker| worker.bar?.1);
        assert_eq!(self.queue.next_expiry(), leases.chain(bars).min());
        self.check_ledger();
    }

    /// What is durable is what is.
    fn check_ledger(&self) {
        let kept = self.ledger.contents().unwrap();
        let jobs = kept.jobs.into_iter();
        let jobs: BTreeMap<u32, JobRecord> = jobs.map(|job| (job.material, job.record)).collect();
        let workers = kept.workers.into_iter();
        let workers: BTreeMap<String, WorkerRecord> =
            workers.map(|worker| (worker.name, worker.record)).collect();
        assert_eq!(kept.mode.unwrap_or_default(), self.mode);
        for (material, model) in (0..).zip(&self.jobs) {
            let job = jobs.get(&material).cloned().unwrap_or_default();
            assert_eq!(job.state, state(model), "material {material}");
            assert_eq!(job.priority, model.priority);
            assert_eq!(job.leases_lost, model.leases_lost);
            let failed_on = |Failure { worker, .. }: &Failure| worker.clone();
            let failed_on: Vec<String> = job.failures.iter().map(failed_on).collect();
            let expected: Vec<String> = model.failed_on.iter().map(|by| name(*by)).collect();
            assert_eq!(failed_on, expected);
            assert_eq!(self.queue.job(material), Some(&job));
            let held = model.lease.as_ref().map(|lease| id(lease.worker));
            assert!(held.is_none_or(|worker| self.queue.holds(worker)));
        }
        for (number, model) in (0..).zip(&self.workers) {
            let worker = workers.get(&name(number)).cloned().unwrap_or_default();
            let failed = worker.failures_in_a_row.iter();
            let failed: Vec<u32> = failed.map(|failure| failure.material).collect();
            assert_eq!(failed, model.failed_in_a_row);
            assert_eq!(worker.failures, model.failures);
            assert_eq!(worker.leases_lost, model.leases_lost);
            let cause = worker.bar.as_ref().map(|bar| bar.cause);
            assert_eq!(cause, model.bar.map(|(cause, _)| cause));
            assert_eq!(self.queue.bar_of(&name(number)), worker.bar.as_ref());
        }
    }
}

fn state(model: &ModelJob) -> JobState {
    let holder = model.lease.as_ref().map(|lease| Holder {
        token: lease.token,
        worker: id(lease.worker),
        name: name(lease.worker),
    });
    match (&model.opinions[..], holder) {
        ([], _) if model.set_aside => JobState::SetAside,
        ([], _) if model.cancelled => JobState::Cancelled,
        ([], None) => JobState::Pending,
        ([], Some(holder)) => JobState::Leased(holder),
        ([(fingerprint, by), rest @ ..], holder) => JobState::Completed {
            fingerprint: *fingerprint,
            worker: name(*by),
            check: match (rest, holder) {
                ([], Some(holder)) => Check::Leased(holder),
                ([], None) if model.check_wanted => Check::Due,
                ([], None) => Check::None,
                ([(other, by), ..], holder) if other != fingerprint => Check::Disputed(Dispute {
                    fingerprint: *other,
                    worker: name(*by),
                    holder,
                }),
                _ => Check::Agreed,
            },
        },
    }
}

fn follow(mut bench: Bench, operations: Vec<Operation>) {
    for operation in operations {
        bench.apply(operation);
        bench.check();
    }
}

fn runs(cases: u32) -> ProptestConfig {
    ProptestConfig {
        cases,
        failure_persistence: None,
        ..ProptestConfig::default()
    }
}

proptest! {
    // 512 runs of 200 to 300 operations: 100,000 and more.
    #![proptest_config(runs(512))]

    #[test]
    fn the_queue_does_what_the_model_does(
        operations in prop::collection::vec(operation(), 200..300)
    ) {
        let bench = Bench::new(Arc::new(MemoryLedger::default()), |ledger| ledger);
        follow(bench, operations);
    }
}

proptest! {
    #![proptest_config(runs(24))]

    #[test]
    fn the_queue_does_what_the_model_does_over_sled(
        operations in prop::collection::vec(operation(), 200..300)
    ) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("ledger");
        let ledger = SledLedger::open(&path).unwrap().0;
        let bench = Bench::new(Arc::new(ledger), move |ledger| {
            ledger.sync().unwrap();
            drop(ledger);
            Arc::new(SledLedger::open(&path).unwrap().0)
        });
        follow(bench, operations);
    }
}

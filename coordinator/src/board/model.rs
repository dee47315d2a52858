//! The suite of every board: random operations, and after each the answers, the states and the
//! durable records that a simple model has. A restarted board goes on where the one before ended.

use super::{
    Board, BoardError, Delivery, JobsOrder, Leased, LocalBoard, Overview, Renewal, Surroundings,
};
use crate::{
    blobs::Blobs,
    completion::Completion,
    completion_log::CompletionLog,
    ledger::{BlobPlace, Ledger, LedgerError, SledLedger, memory::MemoryLedger},
    queue::{
        BarCause, Changes, Check, Counts, Dispute, Failure, Holder, JobRecord, JobState, Mode,
        Policy, Queue, Refusal, Selection, Stage, Verdict, WorkerRecord,
    },
    token::{Token, WorkerId},
};
use dataset::{CompletedView, Digest, ErrorStatistics};
use proptest::prelude::*;
use std::{
    collections::{BTreeMap, BTreeSet},
    path::{Path, PathBuf},
    sync::{Arc, Mutex},
    time::Duration,
};
use tempfile::TempDir;
use tokio::runtime;

pub(crate) const MATERIALS: u32 = 12;
const WORKERS: u8 = 5;
pub(crate) const POLICY: Policy = Policy {
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
pub(crate) enum Operation {
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

pub(crate) fn operation() -> impl Strategy<Value = Operation> {
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

/// Where boards are opened, each over what the one before kept.
#[tonic::async_trait]
pub(crate) trait Place: Send {
    /// Opens a board; the one before is gone.
    async fn open(&mut self, overview: Arc<Mutex<Overview>>) -> Arc<dyn Board>;

    /// Tells the board the time.
    async fn set_time(&mut self, now: Duration);

    /// Whether an operation is told when to look for leases that ran out again.
    fn knows_next_expiry(&self) -> bool;
}

struct Bench {
    board: Option<Arc<dyn Board>>,
    place: Box<dyn Place>,
    overview: Arc<Mutex<Overview>>,
    jobs: Vec<ModelJob>,
    workers: Vec<ModelWorker>,
    mode: Mode,
    tokens: Vec<(Token, u32)>,
    now: Duration,
}

fn id(number: u8) -> WorkerId {
    WorkerId::from_bytes([number; 16])
}

fn name(number: u8) -> String {
    format!("w{number}")
}

/// What a worker says of a material; `images` tells different renderings apart.
fn completion(material: u32, images: u8) -> Completion {
    let statistics = ErrorStatistics {
        mean: 0.1,
        p95: 0.2,
        max: 0.3,
        within_target: 0.9,
        samples: 64,
        evaluations: 7,
    };
    Completion {
        material,
        views: vec![CompletedView {
            digest: Digest::of(&[material as u8, images]),
            bytes: 5,
            statistics,
        }],
        seconds: 0.25,
        worker: String::new(),
    }
}

fn materials(changes: &Changes) -> BTreeSet<u32> {
    changes.jobs.iter().map(|change| change.material).collect()
}

/// The answer of an operation that only a refusal can end.
fn refused<T>(answer: Result<T, BoardError>) -> Result<T, Refusal> {
    match answer {
        Ok(answer) => Ok(answer),
        Err(BoardError::Refused(refusal)) => Err(refusal),
        Err(error) => panic!("{error}"),
    }
}

fn chosen(materials: &[u32]) -> Option<Selection> {
    let ranges = materials.iter().map(|material| (*material, *material));
    (!materials.is_empty()).then(|| Selection::new(ranges.collect(), Vec::new()))
}

impl Bench {
    async fn new(mut place: Box<dyn Place>) -> Self {
        let overview = Arc::default();
        place.set_time(Duration::ZERO).await;
        let board = place.open(Arc::clone(&overview)).await;
        Self {
            board: Some(board),
            place,
            overview,
            jobs: vec![ModelJob::default(); MATERIALS as usize],
            workers: vec![ModelWorker::default(); WORKERS as usize],
            mode: Mode::Running,
            tokens: Vec::new(),
            now: Duration::ZERO,
        }
    }

    fn board(&self) -> &dyn Board {
        self.board.as_deref().unwrap()
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

    async fn apply(&mut self, operation: Operation) {
        match operation {
            Operation::Admit { worker } => {
                let (id, name) = (id(worker), name(worker));
                self.board().admit(id, &name).await.unwrap();
                assert_eq!(self.board().name(id).await.unwrap(), Some(name));
                self.workers[worker as usize].present = true;
            }
            Operation::Dismiss { worker } => {
                self.board().dismiss(&[id(worker)]).await.unwrap();
                if self.held(worker).is_empty() {
                    self.workers[worker as usize].present = false;
                    assert_eq!(self.board().name(id(worker)).await.unwrap(), None);
                }
            }
            Operation::Claim { worker, jobs_max } => self.claim(worker, jobs_max).await,
            Operation::Renew { back, views_done } => self.renew(back, views_done).await,
            Operation::Complete {
                back,
                images,
                check,
            } => {
                if let Some((token, material)) = self.token(back) {
                    self.complete(token, material, images, check).await;
                }
            }
            Operation::CompleteOther { back, material } => {
                if let Some((token, _)) = self.token(back) {
                    self.complete(token, material, 0, false).await;
                }
            }
            Operation::Fail { back } => self.fail(back).await,
            Operation::Release { worker } => {
                let expected = self.held(worker);
                let changes = self.board().release(id(worker)).await.unwrap();
                self.handed_back(&changes, expected);
                self.workers[worker as usize].present = false;
            }
            Operation::ReleaseAll => {
                let expected = self.those(|job| job.lease.is_some());
                let changes = self.board().release_all().await.unwrap();
                self.handed_back(&changes, expected);
            }
            Operation::Wait { seconds } => self.wait(Duration::from_secs(seconds)).await,
            Operation::Restart => self.restart().await,
            Operation::RetrySetAside => {
                let expected = self.those(|job| job.set_aside);
                let selection = Selection::new(Vec::new(), vec![Stage::SetAside]);
                let changes = self.board().order(JobsOrder::Retry, &selection).await;
                self.retried(&changes.unwrap(), expected);
            }
            Operation::Retry { materials } => {
                let Some(selection) = chosen(&materials) else {
                    return;
                };
                let mut expected = self.those(|job| job.set_aside || job.cancelled);
                expected.retain(|material| materials.contains(material));
                let changes = self.board().order(JobsOrder::Retry, &selection).await;
                self.retried(&changes.unwrap(), expected);
            }
            Operation::Cancel { materials } => {
                let Some(selection) = chosen(&materials) else {
                    return;
                };
                let mut expected = self.those(|job| job.opinions.is_empty() && !job.cancelled);
                expected.retain(|material| materials.contains(material));
                let changes = self.board().order(JobsOrder::Cancel, &selection).await;
                assert_eq!(self::materials(&changes.unwrap()), expected);
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
                let Some(selection) = chosen(&materials) else {
                    return;
                };
                let mut expected = self.those(|job| job.is_pending() && job.priority != priority);
                expected.retain(|material| materials.contains(material));
                let order = JobsOrder::Prioritize(priority);
                let changes = self.board().order(order, &selection).await;
                assert_eq!(self::materials(&changes.unwrap()), expected);
                for material in expected {
                    self.job(material).priority = priority;
                }
            }
            Operation::SetMode { mode } => {
                let changes = self.board().set_mode(mode).await.unwrap();
                assert_eq!(changes.mode.is_some(), mode != self.mode);
                self.mode = mode;
            }
            Operation::Bar { worker } => {
                let reason = "dust".to_owned();
                let cause = BarCause::Operator;
                let changes = self.board().bar(&name(worker), cause, reason).await;
                assert_eq!(materials(&changes.unwrap()), self.bar(worker, cause));
            }
            Operation::Unbar { worker } => {
                let change = self.board().unbar(&name(worker)).await.unwrap();
                let model = &mut self.workers[worker as usize];
                assert_eq!(change.is_some(), model.bar.is_some());
                if model.bar.take().is_some() {
                    model.failed_in_a_row.clear();
                }
            }
        }
    }

    fn held(&self, worker: u8) -> BTreeSet<u32> {
        self.those(|job| {
            job.lease
                .as_ref()
                .is_some_and(|lease| lease.worker == worker)
        })
    }

    fn handed_back(&mut self, changes: &Changes, expected: BTreeSet<u32>) {
        assert_eq!(materials(changes), expected);
        for material in expected {
            self.job(material).lease = None;
        }
    }

    fn retried(&mut self, changes: &Changes, expected: BTreeSet<u32>) {
        assert_eq!(materials(changes), expected);
        for material in expected {
            *self.job(material) = ModelJob {
                priority: self.job(material).priority,
                ..ModelJob::default()
            };
        }
    }

    async fn claim(&mut self, worker: u8, jobs_max: u32) {
        let room = POLICY.leases_per_worker_max as usize - self.held(worker).len();
        let idle = self.is_finished() || self.mode == Mode::Draining;
        let mut expected = Vec::new();
        if self.able().contains(&worker) && self.mode == Mode::Running && !idle {
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
        let leased = self.board().claim(id(worker), &tokens).await.unwrap();
        let expected: Vec<(Token, u32)> = tokens.into_iter().zip(expected).collect();
        let barred = self.workers[worker as usize].bar.is_some();
        let known = self.workers[worker as usize].present && !idle;
        assert_eq!(leased.barred.is_some(), barred && known);
        assert_eq!(
            leased,
            Leased {
                jobs: expected.clone(),
                finished: self.is_finished(),
                draining: self.mode == Mode::Draining,
                barred: leased.barred.clone(),
            }
        );
        for (token, material) in expected {
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

    async fn renew(&mut self, back: usize, views_done: u32) {
        let Some((token, material)) = self.token(back) else {
            return;
        };
        let now = self.now;
        let renewal = Renewal {
            token,
            material,
            views_done,
        };
        let renewed = self.board().renew(&[renewal]).await.unwrap() == [true];
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

    async fn complete(&mut self, token: Token, material: u32, images: u8, check: bool) {
        let completion = completion(material, images);
        let fingerprint = completion.fingerprint();
        let delivery = Delivery {
            token,
            completion,
            check,
        };
        let answer = refused(self.board().complete(delivery).await);
        let answer = answer.map(|judged| (judged.verdict, judged.changes));
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
        assert_eq!(materials(&changes), touched);
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

    async fn fail(&mut self, back: usize) {
        let Some((token, material)) = self.token(back) else {
            return;
        };
        let answer = refused(self.board().fail(material, token, "no light").await);
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
        let failed = answer.unwrap();
        assert_eq!(failed.worker, name(lease.worker));
        assert_eq!(materials(&failed.changes), touched);
    }

    async fn wait(&mut self, time: Duration) {
        self.now += time;
        self.place.set_time(self.now).await;
        let now = self.now;
        let over = |job: &ModelJob| job.lease.as_ref().is_some_and(|lease| lease.expires <= now);
        let expected = self.those(over);
        let expired = self.board().expire().await.unwrap();
        let lost = expired.lost.iter().map(|lease| lease.material);
        assert_eq!(lost.collect::<BTreeSet<u32>>(), expected);
        assert_eq!(materials(&expired.changes), expected);
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
        if self.place.knows_next_expiry() {
            let leases = self.jobs.iter();
            let leases = leases.filter_map(|job| Some(job.lease.as_ref()?.expires));
            let bars = self.workers.iter().filter_map(|worker| worker.bar?.1);
            let next = leases.chain(bars).min();
            assert_eq!(expired.next, next.map(|next| next - now));
        }
    }

    /// The process dies; another one continues from what was made durable.
    async fn restart(&mut self) {
        self.board().close();
        // A ledger is open once at a time.
        self.board = None;
        self.board = Some(self.place.open(Arc::clone(&self.overview)).await);
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

    fn is_finished(&self) -> bool {
        let left = |job: &ModelJob| job.is_pending() || job.lease.is_some() || job.is_disputed();
        let able = self.able();
        let judged = |job: &ModelJob| able.iter().any(|worker| self.may_judge(*worker, job));
        !self.jobs.iter().any(|job| left(job) || judged(job))
    }

    async fn check(&self) {
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
        let settled = expected.completed + expected.set_aside + expected.cancelled;
        let left = expected.pending + expected.leased + expected.disputed;
        assert_eq!(
            expected.materials,
            left + settled,
            "every job is in exactly one state"
        );
        self.board().look().await.unwrap();
        let barred = self.workers.iter().filter(|worker| worker.bar.is_some());
        let expected = Overview {
            counts: expected,
            mode: self.mode,
            workers_barred: barred.count() as u32,
            finished: self.is_finished(),
        };
        assert_eq!(*self.overview.lock().unwrap(), expected);
        self.check_records().await;
        self.check_crew().await;
    }

    async fn check_crew(&self) {
        let crew = self.board().crew().await.unwrap();
        let sessions = crew.sessions.into_iter();
        let sessions: BTreeMap<WorkerId, (String, u32)> = sessions
            .map(|session| (session.worker, (session.name, session.held)))
            .collect();
        let present = (0..).zip(&self.workers);
        let present = present.filter(|(_, worker)| worker.present);
        let expected = present.map(|(number, _)| {
            let held = self.held(number).len() as u32;
            (id(number), (name(number), held))
        });
        assert_eq!(sessions, expected.collect());
    }

    /// What is durable is what is, and what is told.
    async fn check_records(&self) {
        let all = Selection::default();
        let page = self.board().jobs(0, 2 * MATERIALS as usize, &all).await;
        let page = page.unwrap();
        assert_eq!(page.next, None);
        let told = page.jobs.into_iter();
        let told: BTreeMap<u32, (JobRecord, u32)> = told
            .map(|(material, job, views_done)| (material, (job, views_done)))
            .collect();
        let kept = self.board().contents().await.unwrap();
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
            let views_done = model.lease.as_ref().map_or(0, |lease| lease.views_done);
            assert_eq!(told.get(&material), Some(&(job, views_done)));
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

/// Does operations on a new board, and checks it after each.
pub(crate) fn follow(place: Box<dyn Place>, operations: Vec<Operation>) {
    let runtime = runtime::Builder::new_current_thread().enable_all().build();
    runtime.unwrap().block_on(async {
        let mut bench = Bench::new(place).await;
        for operation in operations {
            bench.apply(operation).await;
            bench.check().await;
        }
        bench.board().close();
    });
}

/// Settings of a test of `cases` runs.
pub(crate) fn runs(cases: u32) -> ProptestConfig {
    ProptestConfig {
        cases,
        failure_persistence: None,
        ..ProptestConfig::default()
    }
}

/// Boards in this process over one ledger.
struct LocalPlace {
    ledger: Kept,
    folder: TempDir,
    now: Arc<Mutex<Duration>>,
}

enum Kept {
    Memory(Arc<MemoryLedger>),
    Sled(PathBuf),
}

/// A sync after every operation takes most of the time and shows nothing: nothing is cut short.
struct SyncedAtTheEnd(SledLedger);

impl Ledger for SyncedAtTheEnd {
    fn contents(&self) -> Result<Changes, LedgerError> {
        self.0.contents()
    }

    fn apply(&self, changes: &Changes, completions: &[Completion]) -> Result<(), LedgerError> {
        self.0.apply(changes, completions)
    }

    fn sync(&self) -> Result<(), LedgerError> {
        Ok(())
    }

    fn completion(&self, material: u32) -> Result<Option<Completion>, LedgerError> {
        self.0.completion(material)
    }

    fn blob(&self, digest: &Digest) -> Result<Option<BlobPlace>, LedgerError> {
        self.0.blob(digest)
    }
}

impl Drop for SyncedAtTheEnd {
    fn drop(&mut self) {
        self.0.sync().unwrap();
    }
}

impl LocalPlace {
    fn new(ledger: impl FnOnce(&Path) -> Kept) -> Box<Self> {
        // The completion log is synced, which takes time on a disk and proves nothing here.
        let memory = Path::new("/dev/shm");
        let folder = if memory.is_dir() {
            tempfile::tempdir_in(memory)
        } else {
            tempfile::tempdir()
        };
        let folder = folder.unwrap();
        Box::new(Self {
            ledger: ledger(folder.path()),
            folder,
            now: Arc::default(),
        })
    }
}

#[tonic::async_trait]
impl Place for LocalPlace {
    async fn open(&mut self, overview: Arc<Mutex<Overview>>) -> Arc<dyn Board> {
        let ledger: Arc<dyn Ledger> = match &self.ledger {
            Kept::Memory(ledger) => Arc::clone(ledger) as Arc<dyn Ledger>,
            Kept::Sled(path) => Arc::new(SyncedAtTheEnd(SledLedger::open(path).unwrap().0)),
        };
        let mut queue = Queue::new(MATERIALS, POLICY);
        queue.restore(ledger.contents().unwrap(), *self.now.lock().unwrap());
        let (log, _) = CompletionLog::open(&self.folder.path().join("completions.log")).unwrap();
        let surroundings = Surroundings::new(Blobs::new(self.folder.path()), move |_, now| {
            *overview.lock().unwrap() = now;
        });
        let clock = Arc::clone(&self.now);
        Arc::new(LocalBoard::without_thread(
            queue,
            log,
            ledger,
            Arc::new(surroundings),
            Box::new(move || *clock.lock().unwrap()),
        ))
    }

    async fn set_time(&mut self, now: Duration) {
        *self.now.lock().unwrap() = now;
    }

    fn knows_next_expiry(&self) -> bool {
        true
    }
}

proptest! {
    // 512 runs of 200 to 300 operations: 100,000 and more.
    #![proptest_config(runs(512))]

    #[test]
    fn the_board_in_memory_does_what_the_model_does(
        operations in prop::collection::vec(operation(), 200..300)
    ) {
        follow(LocalPlace::new(|_| Kept::Memory(Arc::default())), operations);
    }
}

proptest! {
    #![proptest_config(runs(24))]

    #[test]
    fn the_board_over_sled_does_what_the_model_does(
        operations in prop::collection::vec(operation(), 200..300)
    ) {
        follow(LocalPlace::new(|path| Kept::Sled(path.join("ledger"))), operations);
    }
}

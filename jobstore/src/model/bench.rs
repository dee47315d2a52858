//! Every operation, done to the job store and to the model; their answers are equal.

use super::{
    MATERIALS, OPERATOR, POLICY, Place, WORKERS, answers, id,
    job::{ModelJob, ModelLease, ModelWorker},
    name,
    operation::Operation,
};
use crate::{Delivery, JobStore, JobStoreError, JobsOrder, Leased, Overview, Renewal};
use jobqueue::{
    BlockCause, Changes, Completion, Fingerprint, Mode, Refusal, Selection, Stage, Verdict,
    identity::identity, token::Token,
};
use std::{
    collections::BTreeSet,
    sync::{Arc, Mutex},
    time::Duration,
};

pub(super) struct Bench {
    pub job_store: Option<Arc<dyn JobStore>>,
    pub place: Box<dyn Place>,
    pub overview: Arc<Mutex<Overview>>,
    pub jobs: Vec<ModelJob>,
    pub workers: Vec<ModelWorker>,
    pub mode: Mode,
    pub tokens: Vec<(Token, u32)>,
    pub now: Duration,
}

fn materials(changes: &Changes) -> BTreeSet<u32> {
    changes.jobs.iter().map(|change| change.material).collect()
}

/// The answer of an operation that only a refusal can end.
fn refused<T>(answer: Result<T, JobStoreError>) -> Result<T, Refusal> {
    match answer {
        Ok(answer) => Ok(answer),
        Err(JobStoreError::Refused(refusal)) => Err(refusal),
        Err(error) => panic!("{error}"),
    }
}

fn chosen(materials: &[u32]) -> Option<Selection> {
    let ranges = materials.iter().map(|material| (*material, *material));
    (!materials.is_empty()).then(|| Selection::new(ranges.collect(), Vec::new()))
}

impl Bench {
    pub async fn new(mut place: Box<dyn Place>) -> Self {
        let overview = Arc::default();
        place.set_time(Duration::ZERO).await;
        let job_store = place.open(Arc::clone(&overview)).await;
        Self {
            job_store: Some(job_store),
            place,
            overview,
            jobs: vec![ModelJob::default(); MATERIALS as usize],
            workers: vec![ModelWorker::default(); WORKERS as usize],
            mode: Mode::Running,
            tokens: Vec::new(),
            now: Duration::ZERO,
        }
    }

    pub fn job_store(&self) -> &dyn JobStore {
        self.job_store.as_deref().unwrap()
    }

    fn token(&self, back: usize) -> Option<(Token, u32)> {
        let index = self.tokens.len().checked_sub(back + 1)?;
        Some(self.tokens[index])
    }

    pub(super) fn job(&mut self, material: u32) -> &mut ModelJob {
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

    pub fn able(&self) -> Vec<u8> {
        let able =
            |worker: &u8| self.workers[*worker as usize].present && !self.is_blocked(*worker);
        (0..WORKERS).filter(able).collect()
    }

    pub fn is_blocked(&self, worker: u8) -> bool {
        let distrusted = self.workers[answers(worker) as usize].distrusted;
        self.workers[worker as usize].block.is_some() || distrusted
    }

    /// Those who are there to render jobs.
    fn renderers(&self) -> Vec<u8> {
        let mut able = self.able();
        able.retain(|worker| *worker != OPERATOR);
        able
    }

    /// Who answers for work that is to be audited by somebody who is there.
    pub fn audits_due(&self) -> Vec<u8> {
        let due = |number: &u8| {
            let worker = &self.workers[*number as usize];
            let others = self.renderers();
            let blocked = worker.distrusted || *number == 0 && worker.block.is_some();
            worker.audit_due && !blocked && others.iter().any(|other| answers(*other) != *number)
        };
        (0..WORKERS).filter(due).collect()
    }

    fn is_finished_for(&self, worker: u8) -> bool {
        let disputes = self.jobs.iter().any(ModelJob::is_disputed);
        let present = self.workers[worker as usize].present;
        self.is_finished() || worker == OPERATOR && present && !disputes
    }

    pub fn may_rerender(&self, worker: u8, job: &ModelJob) -> bool {
        job.wants_opinion()
            && (worker != OPERATOR || job.is_disputed())
            && job
                .opinions
                .iter()
                .all(|(_, by)| answers(*by) != answers(worker))
            && !job.failed_on.contains(&worker)
    }

    pub async fn apply(&mut self, operation: Operation) {
        match operation {
            Operation::Admit { worker } => self.admit(worker).await,
            Operation::Dismiss { worker } => self.dismiss(worker).await,
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
                let changes = self.job_store().release(id(worker)).await.unwrap();
                self.handed_back(&changes, expected);
                self.workers[worker as usize].present = false;
            }
            Operation::ReleaseAll => {
                let expected = self.those(|job| job.lease.is_some());
                let changes = self.job_store().release_all().await.unwrap();
                self.handed_back(&changes, expected);
            }
            Operation::Wait { seconds } => self.wait(Duration::from_secs(seconds)).await,
            Operation::Restart => self.restart().await,
            Operation::RetryQuarantined => {
                let expected = self.those(|job| job.quarantined);
                let selection = Selection::new(Vec::new(), vec![Stage::Quarantined]);
                let changes = self.job_store().order(JobsOrder::Retry, &selection).await;
                self.retried(&changes.unwrap(), expected);
            }
            Operation::Retry { materials } => self.retry(&materials).await,
            Operation::Cancel { materials } => self.cancel(&materials).await,
            Operation::Prioritize {
                materials,
                priority,
            } => self.prioritize(&materials, priority).await,
            Operation::SetMode { mode } => {
                let changes = self.job_store().set_mode(mode).await.unwrap();
                assert_eq!(changes.mode.is_some(), mode != self.mode);
                self.mode = mode;
            }
            Operation::Block { worker } => {
                let reason = "dust".to_owned();
                let cause = BlockCause::Operator;
                let changes = self.job_store().block(&name(worker), cause, reason).await;
                assert_eq!(materials(&changes.unwrap()), self.block(worker, cause));
            }
            Operation::Unblock { worker } => self.unblock(worker).await,
            Operation::Trust { worker } => self.trust(worker).await,
            Operation::DrawAudits { seed } => self.draw_audits(seed).await,
        }
    }

    async fn admit(&mut self, worker: u8) {
        let (id, name) = (id(worker), name(worker));
        self.job_store().admit(id, &name).await.unwrap();
        assert_eq!(self.job_store().name(id).await.unwrap(), Some(name));
        self.workers[worker as usize].present = true;
    }

    async fn dismiss(&mut self, worker: u8) {
        self.job_store().dismiss(&[id(worker)]).await.unwrap();
        if self.held(worker).is_empty() {
            self.workers[worker as usize].present = false;
            assert_eq!(self.job_store().name(id(worker)).await.unwrap(), None);
        }
    }

    async fn retry(&mut self, materials: &[u32]) {
        let Some(selection) = chosen(materials) else {
            return;
        };
        let mut expected = self.those(|job| job.quarantined || job.cancelled);
        expected.retain(|material| materials.contains(material));
        let changes = self.job_store().order(JobsOrder::Retry, &selection).await;
        self.retried(&changes.unwrap(), expected);
    }

    async fn cancel(&mut self, materials: &[u32]) {
        let Some(selection) = chosen(materials) else {
            return;
        };
        let mut expected = self.those(|job| job.opinions.is_empty() && !job.cancelled);
        expected.retain(|material| materials.contains(material));
        let changes = self.job_store().order(JobsOrder::Cancel, &selection).await;
        assert_eq!(self::materials(&changes.unwrap()), expected);
        for material in expected {
            let job = self.job(material);
            job.lease = None;
            job.quarantined = false;
            job.cancelled = true;
        }
    }

    async fn prioritize(&mut self, materials: &[u32], priority: i32) {
        let Some(selection) = chosen(materials) else {
            return;
        };
        let mut expected = self.those(|job| job.is_pending() && job.priority != priority);
        expected.retain(|material| materials.contains(material));
        let order = JobsOrder::Prioritize(priority);
        let changes = self.job_store().order(order, &selection).await;
        assert_eq!(self::materials(&changes.unwrap()), expected);
        for material in expected {
            self.job(material).priority = priority;
        }
    }

    async fn unblock(&mut self, worker: u8) {
        let change = self.job_store().unblock(&name(worker)).await.unwrap();
        let model = &mut self.workers[worker as usize];
        assert_eq!(change.is_some(), model.block.is_some());
        if let Some((cause, _)) = model.block.take() {
            model.failed_in_a_row.clear();
            if cause == BlockCause::Disagreement {
                model.probation = 0;
            }
        }
    }

    async fn trust(&mut self, worker: u8) {
        let name = name(worker);
        if identity(&name) == name {
            return;
        }
        let change = self.job_store().unblock(identity(&name)).await.unwrap();
        let model = &mut self.workers[answers(worker) as usize];
        assert_eq!(change.is_some(), model.distrusted);
        if std::mem::take(&mut model.distrusted) {
            model.probation = 0;
        }
    }

    pub fn held(&self, worker: u8) -> BTreeSet<u32> {
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
        let idle = self.is_finished_for(worker) || self.mode == Mode::Draining;
        let mut expected = Vec::new();
        if self.able().contains(&worker) && self.mode == Mode::Running && !idle {
            let may = |job: &&ModelJob| self.may_rerender(worker, job);
            let disputed = |job: &ModelJob| may(&job) && job.is_disputed();
            let redundant = |job: &ModelJob| may(&job) && !job.is_disputed();
            expected.extend(self.those(disputed));
            expected.extend(self.those(redundant));
            let mut fresh: Vec<u32> = self.those(ModelJob::is_pending).into_iter().collect();
            fresh.sort_by_key(|material| -self.jobs[*material as usize].priority);
            if worker == OPERATOR {
                fresh.clear();
            }
            let failed = |material: &u32| self.jobs[*material as usize].failed_on.contains(&worker);
            expected.extend(fresh.iter().filter(|material| !failed(material)));
            let others_failed = |material: &u32| {
                let job = &self.jobs[*material as usize];
                self.renderers()
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
        let leased = self.job_store().claim(id(worker), &tokens).await.unwrap();
        let expected: Vec<(Token, u32)> = tokens.into_iter().zip(expected).collect();
        let blocked = self.is_blocked(worker);
        let present = self.workers[worker as usize].present;
        assert_eq!(leased.blocked.is_some(), blocked && present && !idle);
        assert_eq!(
            leased,
            Leased {
                jobs: expected.clone(),
                name: present.then(|| name(worker)),
                finished: self.is_finished_for(worker),
                draining: self.mode == Mode::Draining,
                blocked: leased.blocked.clone(),
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
        let renewed = self.job_store().renew(&[renewal]).await.unwrap() == [true];
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
        let deadline = lease.claimed + POLICY.deadline;
        let ends = match lease.views_done {
            0 => deadline,
            _ => deadline.min(lease.progressed + POLICY.stall),
        };
        lease.expires = ends.min(now + POLICY.lease);
        assert_eq!(renewed, now < ends);
    }

    async fn complete(&mut self, token: Token, material: u32, images: u8, check: bool) {
        // `images` tells different renderings apart.
        let completion = Completion::sample(material, &[material as u8, images]);
        let fingerprint = completion.fingerprint();
        let delivery = Delivery {
            token,
            completion,
            check,
        };
        let answer = refused(self.job_store().complete(delivery).await);
        let answer = answer.map(|decision| (decision.verdict, decision.changes));
        let current = self.current(material, token);
        let Some(job) = self.jobs.get_mut(material as usize) else {
            assert_eq!(answer, Err(Refusal::UnknownMaterial(material)));
            return;
        };
        if !current {
            let mut opinions = job.opinions.iter();
            let known = opinions.any(|(known, _)| known.agrees_with(fingerprint));
            let expected = match (job.opinions.is_empty(), known) {
                (true, _) => Err(Refusal::LeaseLost(material)),
                (false, true) => Ok((Verdict::Repeated, Changes::default())),
                (false, false) => Err(Refusal::Conflict(material)),
            };
            assert_eq!(answer, expected);
            return;
        }
        let worker = job.lease.take().unwrap().worker;
        let (expected, touched) = self.judge(material, worker, fingerprint, check);
        self.workers[worker as usize].failed_in_a_row.clear();
        let (verdict, changes) = answer.unwrap();
        assert_eq!(verdict, expected);
        assert_eq!(materials(&changes), touched);
        for material in changes.retracted {
            assert!(!self.jobs[material as usize].is_completed());
        }
    }

    /// Records a worker's opinion; the verdict on all that there are, and the jobs that it changes.
    fn judge(
        &mut self,
        material: u32,
        worker: u8,
        fingerprint: Fingerprint,
        check: bool,
    ) -> (Verdict, BTreeSet<u32>) {
        let job = &mut self.jobs[material as usize];
        let mut opinions = job.opinions.clone();
        opinions.push((fingerprint, worker));
        let mut touched = BTreeSet::from([material]);
        let verdict = match opinions[..] {
            [_] => {
                let answers = &mut self.workers[answers(worker) as usize];
                let on_probation = answers.probation < POLICY.probation;
                answers.probation += u32::from(on_probation);
                answers.audit_due = true;
                job.redundant_wanted = check || on_probation;
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
                touched.extend(self.distrust(liar));
                verdict
            }
            [(_, a), (_, b), (third, OPERATOR)] => {
                job.opinions = vec![(third, OPERATOR), (third, WORKERS)];
                touched.extend(self.distrust(a));
                touched.extend(self.distrust(b));
                Verdict::Ruled([name(a), name(b)])
            }
            _ => {
                job.opinions.clear();
                job.quarantined = true;
                job.failed_on.push(worker);
                Verdict::Undecided
            }
        };
        (verdict, touched)
    }

    async fn draw_audits(&mut self, seed: u64) {
        let changes = self.job_store().draw_audits(seed).await.unwrap();
        let drawn = materials(&changes);
        let busy = self
            .jobs
            .iter()
            .any(|job| job.is_pending() || job.lease.is_some());
        let due = if busy { Vec::new() } else { self.audits_due() };
        let mut expected = 0;
        for number in due {
            let alone = self.those(|job| {
                let by = job.opinions.first().map(|(_, by)| answers(*by));
                job.opinions.len() == 1 && !job.redundant_wanted && by == Some(number)
            });
            let count = alone.len().min(POLICY.audits as usize);
            assert_eq!(alone.intersection(&drawn).count(), count);
            expected += count;
            self.workers[number as usize].audit_due = false;
        }
        assert_eq!(drawn.len(), expected);
        for material in drawn {
            self.job(material).redundant_wanted = true;
        }
    }

    async fn fail(&mut self, back: usize) {
        let Some((token, material)) = self.token(back) else {
            return;
        };
        let answer = refused(self.job_store().fail(material, token, "no light").await);
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
        if too_many && worker.block.is_none() {
            touched.extend(self.block(lease.worker, BlockCause::Failures));
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
        let expired = self.job_store().expire().await.unwrap();
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
            if matches!(worker.block, Some((_, Some(ends))) if ends <= now) {
                worker.block = None;
                worker.failed_in_a_row.clear();
            }
        }
        if self.place.knows_next_expiry() {
            let leases = self.jobs.iter();
            let leases = leases.filter_map(|job| Some(job.lease.as_ref()?.expires));
            let blocks = self.workers.iter().filter_map(|worker| worker.block?.1);
            let next = leases.chain(blocks).min();
            assert_eq!(expired.next, next.map(|next| next - now));
        }
    }

    /// The process dies; another one continues from what was made durable.
    async fn restart(&mut self) {
        self.job_store().close();
        // A ledger is open once at a time.
        self.job_store = None;
        self.job_store = Some(self.place.open(Arc::clone(&self.overview)).await);
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
            if let Some((_, Some(ends))) = &mut worker.block {
                *ends = now + POLICY.block;
            }
        }
    }
}

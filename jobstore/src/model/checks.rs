//! After each operation: the job store's figures, its records and its workers are the model's.

use super::{
    Bench, MATERIALS, answers, id,
    job::{ModelJob, state},
    name,
};
use crate::Overview;
use jobqueue::{
    BlockCause, Counts, Failure, JobRecord, Selection, WorkerRecord, identity::identity,
    token::WorkerId,
};
use std::collections::BTreeMap;

impl Bench {
    pub fn is_finished(&self) -> bool {
        let left = |job: &ModelJob| job.is_pending() || job.lease.is_some();
        let able = self.able();
        let decision = |job: &ModelJob| able.iter().any(|worker| self.may_rerender(*worker, job));
        !self.jobs.iter().any(|job| left(job) || decision(job)) && self.audits_due().is_empty()
    }

    pub async fn check(&self) {
        let count = |of: fn(&ModelJob) -> bool| self.jobs.iter().filter(|job| of(job)).count();
        let expected = Counts {
            materials: MATERIALS,
            pending: count(ModelJob::is_pending) as u32,
            leased: count(|job| job.lease.is_some() && job.opinions.is_empty()) as u32,
            completed: count(ModelJob::is_completed) as u32,
            disputed: count(ModelJob::is_disputed) as u32,
            quarantined: count(|job| job.quarantined) as u32,
            cancelled: count(|job| job.cancelled) as u32,
            redundant: count(|job| {
                job.opinions.len() == 1 && (job.redundant_wanted || job.lease.is_some())
            }) as u32,
        };
        let settled = expected.completed + expected.quarantined + expected.cancelled;
        let left = expected.pending + expected.leased + expected.disputed;
        assert_eq!(
            expected.materials,
            left + settled,
            "every job is in exactly one state"
        );
        self.job_store().publish_overview().await.unwrap();
        let workers = self.workers.iter();
        let blocks = workers.flat_map(|worker| [worker.block.is_some(), worker.distrusted]);
        let blocked = blocks.filter(|blocked| *blocked);
        let expected = Overview {
            counts: expected,
            mode: self.mode,
            workers_blocked: blocked.count() as u32,
            finished: self.is_finished(),
        };
        assert_eq!(*self.overview.lock().unwrap(), expected);
        self.check_records().await;
        self.check_crew().await;
    }

    async fn check_crew(&self) {
        let workers = self.job_store().workers().await.unwrap();
        let sessions = workers.sessions.into_iter();
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
        let page = self.job_store().jobs(0, 2 * MATERIALS as usize, &all).await;
        let page = page.unwrap();
        assert_eq!(page.next, None);
        let told = page.jobs.into_iter();
        let told: BTreeMap<u32, (JobRecord, u32)> = told
            .map(|(material, job, views_done)| (material, (job, views_done)))
            .collect();
        let kept = self.job_store().contents().await.unwrap();
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
            let cause = worker.block.as_ref().map(|block| block.cause);
            assert_eq!(cause, model.block.map(|(cause, _)| cause));
            if answers(number) != number {
                continue;
            }
            let kept = workers.get(identity(&name(number))).cloned();
            let kept = kept.unwrap_or_default();
            assert_eq!(kept.probation, model.probation);
            assert_eq!(kept.audit_due, model.audit_due);
            let distrusted = kept.block.map(|block| block.cause) == Some(BlockCause::Disagreement);
            let bare = model.block.map(|(cause, _)| cause) == Some(BlockCause::Disagreement);
            assert_eq!(distrusted, model.distrusted || bare);
        }
    }
}

//! The workers as the queue sees them: who is present, who failed how often, who is blocked.
//!
//! A worker is known by its full name. Several processes may share one; then they share its failures
//! and its block. An [identity] has a record of its own, under its own name; its block is that of all
//! whom it answers for.

use super::{
    Policy,
    record::{Block, BlockCause, WorkerChange, WorkerFailure, WorkerRecord},
};
use crate::{
    identity::{credential, identity, is_operator},
    token::WorkerId,
};
use std::{
    collections::{BTreeMap, HashMap},
    time::Duration,
};

/// What is noted when a worker is the first to render a job.
pub(super) struct FirstRendering {
    /// Another has to render it again.
    pub on_probation: bool,
    pub change: Option<WorkerChange>,
}

/// Everything known of workers.
#[derive(Clone, Debug, Default)]
pub(super) struct Workers {
    records: BTreeMap<String, WorkerRecord>,
    // When blocks over failures end.
    block_ends: BTreeMap<String, Duration>,
    sessions: HashMap<WorkerId, String>,
    // How many sessions each name has; no entry is zero.
    present: BTreeMap<String, u32>,
}

impl Workers {
    /// Notes that a worker is there, under this name from now on.
    pub fn admit(&mut self, worker: WorkerId, name: &str) {
        self.dismiss(worker);
        self.sessions.insert(worker, name.to_owned());
        *self.present.entry(name.to_owned()).or_default() += 1;
    }

    /// Notes that a worker is gone.
    pub fn dismiss(&mut self, worker: WorkerId) {
        let Some(name) = self.sessions.remove(&worker) else {
            return;
        };
        if let Some(sessions) = self.present.get_mut(&name) {
            *sessions -= 1;
            if *sessions == 0 {
                self.present.remove(&name);
            }
        }
    }

    pub fn name(&self, worker: WorkerId) -> Option<&str> {
        self.sessions.get(&worker).map(String::as_str)
    }

    pub fn sessions(&self) -> impl Iterator<Item = (WorkerId, &str)> {
        let sessions = self.sessions.iter();
        sessions.map(|(worker, name)| (*worker, name.as_str()))
    }

    /// The block of a worker or of its identity.
    pub fn block(&self, name: &str) -> Option<&Block> {
        let block = |name: &str| self.records.get(name)?.block.as_ref();
        block(name).or_else(|| block(identity(name)))
    }

    /// Names of workers that are there and not blocked.
    pub fn able(&self) -> impl Iterator<Item = &str> {
        let names = self.present.keys().map(String::as_str);
        names.filter(|name| self.block(name).is_none())
    }

    /// Identities whose work is to be audited and that somebody else who is there can say something
    /// about.
    pub fn audits_due(&self) -> impl Iterator<Item = &str> {
        let due = self.records.iter().filter(|(_, record)| record.audit_due);
        let due = due.filter(|(name, _)| self.block(name).is_none());
        due.map(|(name, _)| name.as_str()).filter(|name| {
            let mut others = self.able().filter(|other| !is_operator(other));
            others.any(|other| identity(other) != *name)
        })
    }

    /// Notes that the completions to be audited of an identity are drawn.
    pub fn note_audit(&mut self, identity: &str) -> WorkerChange {
        let mut record = self.record(identity);
        record.audit_due = false;
        self.keep(identity, record)
    }

    /// Notes the first rendering of a job by a worker of this name.
    pub fn note_first_rendering(&mut self, name: &str, policy: &Policy) -> FirstRendering {
        let identity = identity(name);
        let before = self.record(identity);
        let mut record = before.clone();
        let on_probation = record.probation < policy.probation;
        if on_probation {
            record.probation += 1;
        }
        record.audit_due = policy.audits > 0;
        let change = (record != before).then(|| self.keep(identity, record));
        FirstRendering {
            on_probation,
            change,
        }
    }

    pub fn records(&self) -> impl Iterator<Item = (&str, &WorkerRecord)> {
        let records = self.records.iter();
        records.map(|(name, record)| (name.as_str(), record))
    }

    pub fn restore(&mut self, change: WorkerChange, block_ends: Duration) {
        let WorkerChange { name, record } = change;
        self.put(name, record, block_ends);
    }

    /// Notes a failure; true when it was one too many in a row.
    pub fn note_failure(
        &mut self,
        name: &str,
        material: u32,
        error: &str,
        failures_max: u32,
    ) -> (WorkerChange, bool) {
        let mut record = self.record(name);
        record.failures += 1;
        let failures = &mut record.failures_in_a_row;
        failures.retain(|failure| failure.material != material);
        failures.push(WorkerFailure {
            material,
            error: error.to_owned(),
        });
        if failures.len() > limits::WORKER_FAILURES_KEPT_MAX {
            failures.remove(0);
        }
        let too_many = failures.len() as u32 >= failures_max && record.block.is_none();
        (self.keep(name, record), too_many)
    }

    pub fn note_lost_lease(&mut self, name: &str) -> WorkerChange {
        let mut record = self.record(name);
        record.leases_lost += 1;
        self.keep(name, record)
    }

    /// Notes a completion, which ends a row of failures.
    pub fn note_success(&mut self, name: &str) -> Option<WorkerChange> {
        let record = self.records.get(name)?;
        if record.failures_in_a_row.is_empty() {
            return None;
        }
        let mut record = record.clone();
        record.failures_in_a_row.clear();
        Some(self.keep(name, record))
    }

    /// Blocks a worker; a block over failures ends at `end`.
    pub fn set_block(&mut self, name: &str, block: Block, end: Duration) -> WorkerChange {
        let mut record = self.record(name);
        record.block = Some(block);
        self.put(name.to_owned(), record, end)
    }

    /// Lifts a worker's block and ends its row of failures, if it is blocked.
    pub fn lift_block(&mut self, name: &str) -> Option<WorkerChange> {
        let mut record = self.records.get(name)?.clone();
        let block = record.block.take()?;
        record.failures_in_a_row.clear();
        if block.cause == BlockCause::Disagreement {
            // Trust is earned anew.
            record.probation = 0;
        }
        Some(self.keep(name, record))
    }

    /// Lifts the blocks over failures whose time is over.
    pub fn lift_ended_blocks(&mut self, now: Duration) -> Vec<WorkerChange> {
        let ended = self.block_ends.iter().filter(|(_, end)| **end <= now);
        let ended: Vec<String> = ended.map(|(name, _)| name.clone()).collect();
        let lifted = ended.iter().filter_map(|name| self.lift_block(name));
        lifted.collect()
    }

    pub fn block_end(&self, name: &str) -> Option<Duration> {
        self.block_ends.get(name).copied()
    }

    pub fn next_block_end(&self) -> Option<Duration> {
        self.block_ends.values().min().copied()
    }

    fn record(&self, name: &str) -> WorkerRecord {
        self.records.get(name).cloned().unwrap_or_default()
    }

    fn keep(&mut self, name: &str, record: WorkerRecord) -> WorkerChange {
        let end = self.block_ends.get(name).copied().unwrap_or_default();
        self.put(name.to_owned(), record, end)
    }

    fn put(&mut self, name: String, record: WorkerRecord, block_ends: Duration) -> WorkerChange {
        let block = record.block.as_ref();
        if block.is_some_and(|block| block.cause == BlockCause::Failures) {
            self.block_ends.insert(name.clone(), block_ends);
        } else {
            self.block_ends.remove(&name);
        }
        // Names come from outside: beyond the limit only blocks are remembered, and credentials, which
        // do not.
        let known = self.records.contains_key(&name);
        let room = self.records.len() < limits::WORKER_RECORDS_MAX;
        let is_credential = credential(&name).is_some() && identity(&name) == name;
        if !known && !room && record.block.is_none() && !is_credential {
            let record = WorkerRecord::default();
            return WorkerChange { name, record };
        }
        self.records.insert(name.clone(), record.clone());
        WorkerChange { name, record }
    }
}

//! The workers as the queue sees them: who is present, who failed how often, who is blocked.
//!
//! A worker is known by its name. Several processes may share one; then they share its failures
//! and its block.

use super::record::{Block, BlockCause, WorkerChange, WorkerFailure, WorkerRecord};
use crate::token::WorkerId;
use std::{
    collections::{BTreeMap, HashMap},
    time::Duration,
};

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

    pub fn block(&self, name: &str) -> Option<&Block> {
        self.records.get(name)?.block.as_ref()
    }

    /// Names of workers that are there and not blocked.
    pub fn able(&self) -> impl Iterator<Item = &str> {
        let names = self.present.keys().map(String::as_str);
        names.filter(|name| self.block(name).is_none())
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
        record.block.take()?;
        record.failures_in_a_row.clear();
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
        // Names come from outside: beyond the limit only blocks are remembered.
        let known = self.records.contains_key(&name);
        let room = self.records.len() < limits::WORKER_RECORDS_MAX;
        if !known && !room && record.block.is_none() {
            let record = WorkerRecord::default();
            return WorkerChange { name, record };
        }
        self.records.insert(name.clone(), record.clone());
        WorkerChange { name, record }
    }
}

//! The workers that are registered.

use jobqueue::token::WorkerId;
use std::{collections::HashMap, time::Duration};

/// One registration.
pub(crate) struct Member {
    pub seen: Duration,
    /// Materials completed since it registered here.
    pub completed: u64,
}

/// When each worker last called this process. Kept in memory alone.
#[derive(Default)]
pub(crate) struct Presence {
    members: HashMap<WorkerId, Member>,
}

impl Presence {
    /// Adds a worker. False when there are too many.
    pub fn register(&mut self, worker: WorkerId, now: Duration) -> bool {
        if self.members.len() >= limits::WORKERS_MAX && !self.members.contains_key(&worker) {
            return false;
        }
        let before = self.members.get(&worker);
        let completed = before.map_or(0, |member| member.completed);
        let member = Member {
            seen: now,
            completed,
        };
        self.members.insert(worker, member);
        true
    }

    /// Notes that a worker called. False when it is not registered.
    pub fn heard_of(&mut self, worker: WorkerId, now: Duration) -> bool {
        let member = self.members.get_mut(&worker);
        member.map(|member| member.seen = now).is_some()
    }

    /// Counts a completion.
    pub fn note_completion(&mut self, worker: WorkerId) {
        if let Some(member) = self.members.get_mut(&worker) {
            member.completed += 1;
        }
    }

    /// Takes a worker out.
    pub fn remove(&mut self, worker: WorkerId) {
        self.members.remove(&worker);
    }

    /// Workers heard of lately.
    pub fn present(&self, now: Duration) -> u32 {
        let members = self.members.values();
        members.filter(|member| is_present(member, now)).count() as u32
    }

    /// What is known of a worker, if it is in.
    pub fn member(&self, worker: WorkerId) -> Option<&Member> {
        self.members.get(&worker)
    }

    /// Workers that were not heard of lately.
    pub fn absent(&self, now: Duration) -> Vec<WorkerId> {
        let members = self.members.iter();
        let absent = members.filter(|(_, member)| !is_present(member, now));
        absent.map(|(worker, _)| *worker).collect()
    }
}

/// Whether a worker was heard of lately.
pub(crate) fn is_present(member: &Member, now: Duration) -> bool {
    now.saturating_sub(member.seen) < limits::WORKER_ABSENT
}

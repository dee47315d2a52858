//! The workers that are registered.

use crate::{limits, token::WorkerId};
use std::{collections::HashMap, time::Duration};

/// One registration.
pub(crate) struct Member {
    pub name: String,
    pub seen: Duration,
    /// Materials completed since it registered here.
    pub completed: u64,
}

/// When each worker was last heard of. Kept in memory alone: after a restart workers register
/// again, under the ids they have.
#[derive(Default)]
pub(crate) struct Roster {
    members: HashMap<WorkerId, Member>,
}

impl Roster {
    /// Adds a worker, or renames it. False when there are too many.
    pub fn register(&mut self, worker: WorkerId, name: String, now: Duration) -> bool {
        if self.members.len() >= limits::WORKERS_MAX && !self.members.contains_key(&worker) {
            return false;
        }
        let before = self.members.get(&worker);
        let completed = before.map_or(0, |member| member.completed);
        let member = Member {
            name,
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

    /// A worker's name; empty where it is not registered.
    pub fn name(&self, worker: WorkerId) -> String {
        let member = self.members.get(&worker);
        member.map_or_else(String::new, |member| member.name.clone())
    }

    /// Counts a completion.
    pub fn note_completion(&mut self, worker: WorkerId) {
        if let Some(member) = self.members.get_mut(&worker) {
            member.completed += 1;
        }
    }

    /// Takes a worker out; its name, if it was in.
    pub fn remove(&mut self, worker: WorkerId) -> Option<String> {
        Some(self.members.remove(&worker)?.name)
    }

    /// Workers heard of lately.
    pub fn present(&self, now: Duration) -> u32 {
        let members = self.members.values();
        members.filter(|member| is_present(member, now)).count() as u32
    }

    /// Everybody who is in.
    pub fn members(&self) -> impl Iterator<Item = (WorkerId, &Member)> {
        self.members
            .iter()
            .map(|(worker, member)| (*worker, member))
    }

    /// Forgets workers that were not heard of and hold nothing, and says which.
    pub fn forget_absent(
        &mut self,
        now: Duration,
        holds: impl Fn(WorkerId) -> bool,
    ) -> Vec<WorkerId> {
        let absent = self.members.iter();
        let absent = absent
            .filter(|(worker, member)| !is_present(member, now) && !holds(**worker))
            .map(|(worker, _)| *worker);
        let absent: Vec<WorkerId> = absent.collect();
        for worker in &absent {
            self.members.remove(worker);
        }
        absent
    }
}

/// Whether a worker was heard of lately.
pub(crate) fn is_present(member: &Member, now: Duration) -> bool {
    now.saturating_sub(member.seen) < limits::WORKER_ABSENT
}

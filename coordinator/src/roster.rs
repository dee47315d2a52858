//! The workers that are registered.

use crate::{limits, token::WorkerId};
use std::{collections::HashMap, time::Duration};

struct Member {
    name: String,
    seen: Duration,
}

/// Names of workers and when each was last heard of. Kept in memory alone: after a restart workers
/// register again, under the ids they have.
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
        self.members.insert(worker, Member { name, seen: now });
        true
    }

    /// Notes that a worker called. False when it is not registered.
    pub fn heard_of(&mut self, worker: WorkerId, now: Duration) -> bool {
        let member = self.members.get_mut(&worker);
        member.map(|member| member.seen = now).is_some()
    }

    /// A worker's name, for logs; the id where it has not registered since the restart.
    pub fn name(&self, worker: WorkerId) -> String {
        let member = self.members.get(&worker);
        member.map_or_else(|| worker.to_string(), |member| member.name.clone())
    }

    pub fn remove(&mut self, worker: WorkerId) {
        self.members.remove(&worker);
    }

    /// Workers heard of lately.
    pub fn present(&self, now: Duration) -> u32 {
        let lately = |member: &&Member| now.saturating_sub(member.seen) < limits::WORKER_ABSENT;
        self.members.values().filter(lately).count() as u32
    }

    /// Forgets workers that were not heard of and hold nothing.
    pub fn forget_absent(&mut self, now: Duration, holds: impl Fn(WorkerId) -> bool) {
        self.members.retain(|worker, member| {
            now.saturating_sub(member.seen) < limits::WORKER_ABSENT || holds(*worker)
        });
    }
}

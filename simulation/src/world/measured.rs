//! What is counted, and what came of it.

use super::{Coordinator, World, database::RECORDERS};
use crate::{
    farm::{Images, Store},
    figures::{Counted, Figures, Resource, quantile_ms},
};
use std::time::Duration;

/// How long something was busy, of one or of many.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Busy {
    count: u32,
    since: Duration,
    total: Duration,
}

impl Busy {
    fn pass(&mut self, now: Duration) {
        self.total += now.saturating_sub(self.since) * self.count;
        self.since = now;
    }

    pub fn begin(&mut self, now: Duration) {
        self.pass(now);
        self.count += 1;
    }

    pub fn end(&mut self, now: Duration) {
        self.pass(now);
        self.count = self.count.saturating_sub(1);
    }

    /// So far; what is under way counts.
    fn so_far(mut self, now: Duration) -> Duration {
        self.pass(now);
        self.total
    }
}

/// Counts since the beginning; those of the window are what was counted since it began.
#[derive(Clone, Debug, Default)]
pub(super) struct Measured {
    since: Duration,
    pub leases: u64,
    pub recorded: u64,
    pub agreed: u64,
    pub repeated: u64,
    pub contradicted: u64,
    pub refused: u64,
    pub leases_lost: u64,
    pub given_up: u64,
    pub renewals: u64,
    pub workers_died: u64,
    pub transactions: u64,
    pub rendering: Busy,
    leases_took: Vec<Duration>,
    completions_took: Vec<Duration>,
    before: Option<Before>,
}

/// What was counted when measuring began.
#[derive(Clone, Debug)]
struct Before {
    done: u64,
    renewals: u64,
    transactions: u64,
    used: Vec<Duration>,
}

impl Measured {
    pub fn note_lease(&mut self, took: Duration) {
        self.leases_took.push(took);
    }

    pub fn note_completion(&mut self, took: Duration) {
        self.completions_took.push(took);
    }

    fn done(&self) -> u64 {
        self.recorded + self.agreed
    }
}

impl World {
    pub(super) fn begin_measuring(&mut self) {
        self.measured.since = self.events.now();
        self.measured.leases_took.clear();
        self.measured.completions_took.clear();
        self.measured.before = Some(Before {
            done: self.measured.done(),
            renewals: self.measured.renewals,
            transactions: self.measured.transactions,
            used: self.used(),
        });
    }

    /// What every resource was used so far, in the order of `resources`.
    fn used(&self) -> Vec<Duration> {
        let resources = self.resources();
        resources.into_iter().map(|resource| resource.1).collect()
    }

    /// Every resource: its name, what it was used so far, and how many there are of it. What others
    /// wait for comes before who waits.
    fn resources(&self) -> Vec<(&'static str, Duration, usize)> {
        let now = self.events.now();
        let mut resources = Vec::new();
        let count = self.coordinators.len();
        let machines = &self.machines;
        if let Some(database) = machines.get(count) {
            resources.push(("the database's cores", database.used(), database.cores()));
        }
        let used = machines[..count].iter().map(|machine| machine.used()).sum();
        let cores = count * self.farm.coordinator_cores;
        resources.push(("the coordinators' cores", used, cores));
        let sum = |used: fn(&Coordinator) -> Duration| self.coordinators.iter().map(used).sum();
        match self.farm.store {
            Store::Files => {
                resources.push(("group commit", sum(|one| one.commits.used), count));
            }
            Store::Postgres { .. } => {
                let claims = sum(|one| one.turns.claims_used);
                resources.push(("the tasks that claim", claims, count));
                let records = sum(|one| one.turns.records_used);
                resources.push(("the tasks that record", records, count * RECORDERS));
            }
        }
        if self.farm.images == Images::Folder {
            let publishing = sum(|one| one.publications.used);
            resources.push(("publication", publishing, count));
            let slots = self.coordinators.iter();
            let slots = slots.map(|one| one.slots_busy.so_far(now)).sum();
            resources.push(("upload slots", slots, count * self.farm.upload_slots()));
        }
        let rendering = self.measured.rendering.so_far(now);
        resources.push(("the workers", rendering, self.farm.workers.count));
        resources
    }

    pub(super) fn figures(&mut self, complete: bool) -> Figures {
        let now = self.events.now();
        let resources = self.resources();
        let measured = &mut self.measured;
        let window = now.saturating_sub(measured.since).as_secs_f64().max(1e-9);
        let before = measured.before.take().unwrap_or(Before {
            done: 0,
            renewals: 0,
            transactions: 0,
            used: vec![Duration::ZERO; resources.len()],
        });
        let resources = resources.into_iter().zip(before.used);
        let resources = resources.map(|((name, used, count), before)| {
            let used = used.saturating_sub(before).as_secs_f64();
            Resource {
                name,
                count,
                // A batch that is under way in the end counts whole.
                used: (used / (window * count.max(1) as f64)).min(1.0),
            }
        });
        let connected = self.coordinators.iter().map(|one| one.connections);
        let turned_away = if complete {
            0
        } else {
            self.workers
                .iter()
                .filter(|one| one.waits_outside())
                .count()
        };
        let rate = |count: u64, before: u64| (count - before) as f64 / window;
        let latency = |took: &mut Vec<Duration>| {
            took.sort_unstable();
            [50, 99].map(|percent| quantile_ms(took, percent))
        };
        Figures {
            workers: self.farm.workers.count,
            coordinators: self.farm.coordinators,
            complete,
            seconds: now.as_secs_f64(),
            measured_seconds: window,
            events: self.events.count(),
            jobs_per_second: rate(measured.done(), before.done),
            renewals_per_second: rate(measured.renewals, before.renewals),
            transactions_per_second: rate(measured.transactions, before.transactions),
            lease_ms: latency(&mut measured.leases_took),
            complete_ms: latency(&mut measured.completions_took),
            connected: connected.sum(),
            turned_away,
            resources: resources.collect(),
            counted: Counted {
                leases: measured.leases,
                recorded: measured.recorded,
                agreed: measured.agreed,
                repeated: measured.repeated,
                contradicted: measured.contradicted,
                refused: measured.refused,
                leases_lost: measured.leases_lost,
                given_up: measured.given_up,
                workers_died: measured.workers_died,
            },
        }
    }
}

//! What a simulation found, as a person and as a program reads it.

use serde::Serialize;
use std::{fmt, time::Duration};

/// The share of its time from which a resource counts as the bottleneck: what waits for it waits
/// long.
const SATURATED: f64 = 0.85;

/// What came of a farm. Rates and shares are of the time that was measured, counts of all.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Figures {
    /// Workers there were to be.
    pub workers: usize,
    /// Coordinators.
    pub coordinators: usize,
    /// Whether the set is complete.
    pub complete: bool,
    /// How long the farm worked, seconds.
    pub seconds: f64,
    /// Of it measured, seconds.
    pub measured_seconds: f64,
    /// Events that were simulated.
    pub events: u64,
    /// Jobs that workers completed, redundant renders included.
    pub jobs_per_second: f64,
    /// Calls that renewed leases.
    pub renewals_per_second: f64,
    /// Transactions of the database.
    pub transactions_per_second: f64,
    /// What a lease took its worker, p50 and p99, milliseconds.
    pub lease_ms: [f64; 2],
    /// What a completion did.
    pub complete_ms: [f64; 2],
    /// Workers with a connection at the end.
    pub connected: usize,
    /// Workers that no coordinator lets in.
    pub turned_away: usize,
    /// What was used, and how much of it.
    pub resources: Vec<Resource>,
    /// What happened, and how often.
    pub counted: Counted,
}

/// Something that can be the bottleneck.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Resource {
    /// What it is.
    pub name: &'static str,
    /// How many there are.
    pub count: usize,
    /// The share of their time that they were used.
    pub used: f64,
}

/// Counts by the queue's word.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Counted {
    /// Jobs handed out.
    pub leases: u64,
    /// First completions of a material.
    pub recorded: u64,
    /// Redundant renders.
    pub agreed: u64,
    /// Completions that had been recorded before.
    pub repeated: u64,
    /// Completions that contradicted another: there are no liars, so there are none.
    pub contradicted: u64,
    /// Completions whose lease was lost.
    pub refused: u64,
    /// Leases that ran out.
    pub leases_lost: u64,
    /// Calls that took longer than their caller waits.
    pub given_up: u64,
    /// Workers that died.
    pub workers_died: u64,
}

impl Figures {
    /// What keeps the farm from more jobs a second.
    pub fn bottleneck(&self) -> String {
        let saturated = self.resources.iter().find(|one| one.used >= SATURATED);
        let workers = self.resources.last().map_or(0.0, |one| one.used);
        // Those that are let in have all that they can do.
        let share = (self.workers - self.turned_away) as f64 / self.workers as f64;
        if self.turned_away > 0 && workers >= SATURATED * share {
            return "connections: no coordinator lets more workers in".to_owned();
        }
        if let Some(saturated) = saturated {
            return saturated.name.to_owned();
        }
        let most = self
            .resources
            .iter()
            .max_by(|one, other| one.used.total_cmp(&other.used));
        let most = most.map(|one| format!(" ({} at {:.0}%)", one.name, one.used * 100.0));
        format!("nothing is used up{}", most.unwrap_or_default())
    }
}

/// A quantile of sorted times, milliseconds; 0 of none.
pub(crate) fn quantile_ms(sorted: &[Duration], percent: usize) -> f64 {
    let last = sorted.len().saturating_sub(1);
    let time = sorted.get(last * percent / 100).copied();
    time.unwrap_or_default().as_secs_f64() * 1e3
}

impl fmt::Display for Figures {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            workers,
            coordinators,
            seconds,
            measured_seconds,
            ..
        } = self;
        let complete = if self.complete {
            "complete"
        } else {
            "not complete"
        };
        writeln!(
            f,
            "{workers} workers, {coordinators} coordinators, {seconds:.1} s of which \
             {measured_seconds:.1} s are measured; the set is {complete}"
        )?;
        writeln!(f, "  {:.0} jobs/s", self.jobs_per_second)?;
        let [p50, p99] = self.lease_ms;
        writeln!(f, "  lease      p50 {p50:8.1} ms, p99 {p99:8.1} ms")?;
        let [p50, p99] = self.complete_ms;
        writeln!(f, "  completion p50 {p50:8.1} ms, p99 {p99:8.1} ms")?;
        writeln!(
            f,
            "  {} workers are let in, {} are not; {:.0} renewals/s, {:.0} transactions/s",
            self.connected,
            self.turned_away,
            self.renewals_per_second,
            self.transactions_per_second
        )?;
        for Resource { name, count, used } in &self.resources {
            writeln!(f, "  {:5.1}% of {count} {name}", used * 100.0)?;
        }
        let Counted {
            leases,
            recorded,
            agreed,
            leases_lost,
            given_up,
            workers_died,
            ..
        } = self.counted;
        writeln!(
            f,
            "  {leases} leases, {recorded} materials completed, {agreed} of them twice; \
             {leases_lost} leases lost, {given_up} calls given up, {workers_died} workers died"
        )?;
        write!(f, "  bottleneck: {}", self.bottleneck())
    }
}

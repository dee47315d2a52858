//! A store in PostgreSQL: one task of a coordinator claims and three record, each of them in one
//! transaction for all who wait.

use super::{
    After, Event, World,
    calls::{Answer, CallId, Kind},
};
use crate::{
    costs::Postgres,
    machine::{Machine, Team},
};
use std::{
    collections::{BTreeMap, VecDeque},
    time::Duration,
};

/// Tasks of a coordinator that record, as `RECORDERS` of `jobstore-postgres/src/turns.rs`.
pub(super) const RECORDERS: usize = 3;

/// Connections of a coordinator: one for each task, and one for what is looked up by itself.
const CONNECTIONS: usize = RECORDERS + 2;

/// Names a transaction.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct TransactionId(u64);

struct Transaction {
    coordinator: usize,
    claims: bool,
    calls: Vec<CallId>,
}

/// The tasks of one coordinator.
#[derive(Default)]
pub(super) struct Turns {
    claims: VecDeque<CallId>,
    others: VecDeque<CallId>,
    claiming: bool,
    // One at a time takes what waits.
    taking: bool,
    recording: usize,
    /// Until then those who ask for jobs wait for each other.
    claims_from: Duration,
    /// Time used of the task that claims, and of those that record, were all transactions full.
    pub claims_used: Duration,
    pub records_used: Duration,
}

/// The server.
pub(super) struct Database {
    /// Its machine: the coordinator's where that is shared.
    machine: usize,
    connections: Vec<Team>,
    transactions: BTreeMap<TransactionId, Transaction>,
    count: u64,
    unflushed: Vec<TransactionId>,
    flushing: Vec<TransactionId>,
}

impl Database {
    /// On a machine of its own, or on the first coordinator's.
    pub fn new(machines: &mut [Machine<After>], coordinators: usize, own: Option<usize>) -> Self {
        let machine = own.unwrap_or_default();
        let connections = (0..coordinators).map(|_| machines[machine].add_team(CONNECTIONS));
        Self {
            machine,
            connections: connections.collect(),
            transactions: BTreeMap::new(),
            count: 0,
            unflushed: Vec::new(),
            flushing: Vec::new(),
        }
    }
}

impl World {
    /// A call waits for the next transaction.
    pub(super) fn ask_database(&mut self, id: CallId, claims: bool) {
        let Some(coordinator) = self.calls.get(id).map(|call| call.coordinator) else {
            return;
        };
        let turns = &mut self.coordinators[coordinator].turns;
        if claims {
            turns.claims.push_back(id);
        } else {
            turns.others.push_back(id);
        }
        self.plan_turns(coordinator);
    }

    /// Whether an image is known is asked by a statement of its own.
    pub(super) fn look_up(&mut self, id: CallId) {
        let Some(coordinator) = self.calls.get(id).map(|call| call.coordinator) else {
            return;
        };
        let cost = self.farm.costs.postgres.look_up;
        let (machine, team) = (
            self.database.machine,
            self.database.connections[coordinator],
        );
        self.work(machine, team, cost, After::Call(id));
    }

    /// Tasks that are free take what waits, once what is ready has had its turn.
    fn plan_turns(&mut self, number: usize) {
        let now = self.events.now();
        let turns = &mut self.coordinators[number].turns;
        if !turns.claiming && !turns.claims.is_empty() {
            turns.claiming = true;
            let pause = turns.claims_from.saturating_sub(now);
            self.plan_turn(number, true, pause);
        }
        let turns = &mut self.coordinators[number].turns;
        if !turns.taking && turns.recording < RECORDERS && !turns.others.is_empty() {
            turns.taking = true;
            turns.recording += 1;
            self.plan_turn(number, false, Duration::ZERO);
        }
    }

    fn plan_turn(&mut self, coordinator: usize, claims: bool, pause: Duration) {
        let takes = After::Takes {
            coordinator,
            claims,
        };
        if pause.is_zero() {
            let team = self.coordinators[coordinator].tasks;
            self.work(coordinator, team, Duration::ZERO, takes);
        } else {
            self.events.after(pause, Event::Then(takes));
        }
    }

    pub(super) fn take_turn(&mut self, number: usize, claims: bool) {
        let coordinator = &mut self.coordinators[number];
        if !coordinator.alive {
            return;
        }
        let turns = &mut coordinator.turns;
        let waiting = if claims {
            &mut turns.claims
        } else {
            turns.taking = false;
            &mut turns.others
        };
        let count = waiting.len().min(limits::DATABASE_BATCH_MAX);
        let calls: Vec<CallId> = waiting.drain(..count).collect();
        let team = coordinator.tasks;
        let items = self.count(&calls);
        let costs = &self.farm.costs.postgres;
        let takes = costs.coordinator + costs.coordinator_each * items.all();
        let fixed = costs.coordinator
            + self.farm.database_round_trip * costs.round_trips
            + costs.transaction
            + costs.sync;
        let full = fixed * count as u32 / limits::DATABASE_BATCH_MAX as u32;
        let used = full + costs.coordinator_each * items.all() + items.cost(costs);
        let turns = &mut self.coordinators[number].turns;
        if claims {
            turns.claims_used += used;
        } else {
            turns.records_used += used;
        }
        self.database.count += 1;
        let id = TransactionId(self.database.count);
        let transaction = Transaction {
            coordinator: number,
            claims,
            calls,
        };
        self.database.transactions.insert(id, transaction);
        self.work(number, team, takes, After::Prepared(id));
        self.plan_turns(number);
    }

    pub(super) fn send(&mut self, id: TransactionId) {
        let delay = self.farm.database_round_trip * self.farm.costs.postgres.round_trips;
        self.events.after(delay, Event::Then(After::Arrived(id)));
    }

    pub(super) fn arrived(&mut self, id: TransactionId) {
        let Some(transaction) = self.database.transactions.get(&id) else {
            return;
        };
        let team = self.database.connections[transaction.coordinator];
        let calls = transaction.calls.clone();
        let items = self.count(&calls);
        let costs = &self.farm.costs.postgres;
        let takes = costs.transaction + items.cost(costs);
        self.measured.transactions += 1;
        self.work(self.database.machine, team, takes, After::Executed(id));
    }

    /// The queue changes as the transaction commits; one of a dead coordinator does not.
    pub(super) fn executed(&mut self, id: TransactionId) {
        let Some(transaction) = self.database.transactions.get(&id) else {
            return;
        };
        let (coordinator, calls) = (transaction.coordinator, transaction.calls.clone());
        let mut writes = false;
        for call in calls {
            if self
                .calls
                .get(call)
                .is_some_and(|call| Self::asks_standing(call))
            {
                continue;
            }
            let renews = self.calls.get(call).map(|call| call.request.kind) == Some(Kind::Renew);
            let changes = self.apply(call);
            writes |= renews || !changes.is_empty();
        }
        if writes {
            self.after_changes(coordinator);
        }
        if writes {
            self.database.unflushed.push(id);
            self.flush();
        } else {
            self.committed(id);
        }
    }

    /// The database's log is synced for all that wait for it.
    fn flush(&mut self) {
        let database = &mut self.database;
        if database.flushing.is_empty() && !database.unflushed.is_empty() {
            database.flushing = std::mem::take(&mut database.unflushed);
            let sync = self.farm.costs.postgres.sync;
            self.events.after(sync, Event::Then(After::Flushed));
        }
    }

    pub(super) fn flushed(&mut self) {
        for id in std::mem::take(&mut self.database.flushing) {
            self.committed(id);
        }
        self.flush();
    }

    fn committed(&mut self, id: TransactionId) {
        let Some(transaction) = self.database.transactions.remove(&id) else {
            return;
        };
        let now = self.events.now();
        let number = transaction.coordinator;
        let mut found_work = false;
        for id in transaction.calls {
            let Some(call) = self.calls.get(id) else {
                continue;
            };
            if call.request.kind == Kind::Lease && call.answer == Answer::Done {
                self.park(id);
            } else {
                found_work = true;
                self.go_on(id);
            }
        }
        let turns = &mut self.coordinators[number].turns;
        if transaction.claims {
            turns.claiming = false;
            if !found_work {
                turns.claims_from = now + limits::DATABASE_IDLE_PAUSE;
            }
        } else {
            turns.recording -= 1;
        }
        self.plan_turns(number);
    }

    /// Forgets the transactions of a coordinator that died: they are rolled back.
    pub(super) fn roll_back(&mut self, coordinator: usize) {
        let transactions = &mut self.database.transactions;
        // Those that wait for the log are committed all the same; nobody hears of it.
        transactions.retain(|_, transaction| transaction.coordinator != coordinator);
    }

    fn count(&mut self, calls: &[CallId]) -> Items {
        let views = self.farm.views as u32;
        let mut items = Items::default();
        for id in calls {
            let Some(call) = self.calls.get(*id) else {
                continue;
            };
            match call.request.kind {
                Kind::Lease => items.claims += 1,
                Kind::Renew => items.renewals += call.request.jobs.len() as u32,
                _ if Self::asks_standing(call) => items.standings += 1,
                _ => {
                    items.completions += 1;
                    items.images += views;
                }
            }
        }
        items
    }
}

/// What a transaction is asked.
#[derive(Default)]
struct Items {
    claims: u32,
    standings: u32,
    renewals: u32,
    completions: u32,
    images: u32,
}

impl Items {
    /// The database's processor time, besides the transaction's.
    fn cost(&self, costs: &Postgres) -> Duration {
        costs.claim * self.claims
            + costs.standing * self.standings
            + costs.renewal * self.renewals
            + costs.completion * self.completions
            + costs.image * self.images
    }

    fn all(&self) -> u32 {
        self.claims + self.standings + self.renewals + self.completions
    }
}

//! The farm at work: workers, coordinators, machines, and the one real queue that decides.
//!
//! A call goes through the steps of [`calls`]; what it waits for (a core, an upload slot, a batch)
//! takes it one step on when its time has come. Jobs change hands by the queue's own transitions,
//! at the instant at which the real job store would apply them.

mod calls;
mod coordinator;
mod database;
mod failures;
mod files;
mod measured;
mod workers;

use crate::{
    events::Events,
    farm::{Farm, Store},
    figures::Figures,
    machine::{Machine, Slice, Team},
};
use calls::{CallId, Calls, Deadlines};
use coordinator::Coordinator;
use database::{Database, TransactionId};
use jobqueue::{Queue, token::Token};
use measured::Measured;
use std::time::Duration;
use workers::Worker;

/// How often somebody looks for leases that ran out.
const SWEEP: Duration = limits::SWEEP_INTERVAL_MAX;

/// What happens by itself.
enum Event {
    /// A slice of a machine's core is over.
    Slice(usize, Box<Slice<After>>),
    /// What was waited for is there.
    Then(After),
    /// A worker comes.
    Begins { worker: usize },
    /// A worker looks for a coordinator again.
    Connects {
        worker: usize,
        life: u32,
        pause: Duration,
    },
    /// A worker's job is rendered.
    Rendered {
        worker: usize,
        life: u32,
        slot: usize,
        token: Token,
    },
    /// A worker renews its leases.
    Renews { worker: usize, life: u32 },
    /// Callers of leases, or of anything else, wait no longer.
    GiveUp { leases: bool },
    /// A worker has sent its images to the bucket.
    Sent {
        worker: usize,
        life: u32,
        slot: usize,
        token: Token,
    },
    /// A worker dies.
    Dies { worker: usize, life: u32 },
    /// Somebody looks for leases that ran out.
    Sweeps,
    /// The first coordinator dies.
    CoordinatorDies,
    /// Measuring begins.
    Measures,
    /// The simulation is over.
    Ends,
}

/// What follows a task, or a wait.
#[derive(Clone, Copy, Debug)]
enum After {
    /// A call goes on.
    Call(CallId),
    /// An image of a call is checked.
    Checked(CallId),
    /// It is staged.
    TakenIn(CallId),
    /// Its asker has had its turn.
    SlotFree(CallId),
    /// A group may begin a batch.
    MayBegin(files::Group),
    /// A batch has its processor time.
    Written(files::Group),
    /// A batch is on the disk.
    Synced(files::Group),
    /// A task of a coordinator takes what waits.
    Takes { coordinator: usize, claims: bool },
    /// A transaction is ready to be sent.
    Prepared(TransactionId),
    /// It has arrived.
    Arrived(TransactionId),
    /// The database has done its part.
    Executed(TransactionId),
    /// The database's log is on its disk.
    Flushed,
    /// Nobody waits for it.
    Nothing,
}

/// Everything there is.
pub(crate) struct World {
    farm: Farm,
    queue: Queue,
    events: Events<Event>,
    machines: Vec<Machine<After>>,
    workers: Vec<Worker>,
    callers: Option<Team>,
    coordinators: Vec<Coordinator>,
    calls: Calls,
    /// When the callers of leases, and of anything else, wait no longer.
    deadlines: [Deadlines; 2],
    database: Database,
    measured: Measured,
    /// Slots of workers that have not left.
    working: usize,
    names: u128,
}

/// The machine of a coordinator has the coordinator's number; the database's comes after them.
impl World {
    pub fn new(farm: Farm) -> Self {
        let mut machines: Vec<Machine<After>> = (0..farm.coordinators)
            .map(|_| Machine::new(farm.coordinator_cores))
            .collect();
        let coordinators: Vec<Coordinator> = (0..farm.coordinators)
            .map(|number| Coordinator::new(&mut machines[number], &farm))
            .collect();
        let threads = farm.workers.threads_beside_coordinator;
        let callers = threads.map(|threads| machines[0].add_team(threads));
        let own = match farm.store {
            Store::Postgres { cores: Some(cores) } => {
                machines.push(Machine::new(cores));
                Some(farm.coordinators)
            }
            _ => None,
        };
        let database = Database::new(&mut machines, farm.coordinators, own);
        let workers = (0..farm.workers.count).map(|_| Worker::default()).collect();
        Self {
            queue: Queue::new(farm.materials, farm.policy),
            events: Events::default(),
            machines,
            workers,
            callers,
            coordinators,
            calls: Calls::default(),
            deadlines: Default::default(),
            database,
            measured: Measured::default(),
            working: farm.workers.count * farm.workers.jobs_held,
            names: 0,
            farm,
        }
    }

    /// Runs until the set is complete, or time is over.
    pub fn run(mut self) -> (Figures, Queue) {
        self.plan();
        let mut complete = false;
        while let Some(event) = self.events.take_next() {
            if matches!(event, Event::Ends) {
                break;
            }
            self.happen(event);
            if self.working == 0 {
                complete = true;
                break;
            }
        }
        let figures = self.figures(complete);
        (figures, self.queue)
    }

    fn plan(&mut self) {
        let count = self.farm.workers.count as u32;
        for worker in 0..count {
            let late = self.farm.workers.ramp * worker / count;
            let worker = worker as usize;
            self.events.after(late, Event::Begins { worker });
        }
        self.events.after(SWEEP, Event::Sweeps);
        self.events.after(self.farm.warm_up, Event::Measures);
        if let Some(at) = self.farm.coordinator_dies_at {
            self.events.after(at, Event::CoordinatorDies);
        }
        self.events.after(self.farm.ends, Event::Ends);
    }

    fn happen(&mut self, event: Event) {
        match event {
            Event::Slice(machine, slice) => {
                let then = self.machines[machine].end(*slice);
                if let Some(then) = then {
                    self.then(then);
                }
                self.start(machine);
            }
            Event::Then(then) => self.then(then),
            Event::Begins { worker } => self.begin(worker),
            Event::Connects {
                worker,
                life,
                pause,
            } => self.connect(worker, life, pause),
            Event::Rendered {
                worker,
                life,
                slot,
                token,
            } => self.rendered(worker, life, slot, token),
            Event::Renews { worker, life } => self.renew(worker, life),
            Event::Sent {
                worker,
                life,
                slot,
                token,
            } => self.sent_to_bucket(worker, life, slot, token),
            Event::GiveUp { leases } => self.give_up_all(leases),
            Event::Dies { worker, life } => self.die(worker, life),
            Event::Sweeps => self.sweep(),
            Event::CoordinatorDies => self.coordinator_dies(),
            Event::Measures => self.begin_measuring(),
            Event::Ends => {}
        }
    }

    fn then(&mut self, then: After) {
        match then {
            After::Call(call) => self.go_on(call),
            After::Checked(call) => self.checked(call),
            After::TakenIn(call) => self.taken_in(call),
            After::SlotFree(call) => self.slot_free(call),
            After::MayBegin(group) => self.begin_batch(group),
            After::Written(group) => self.written(group),
            After::Synced(group) => self.synced(group),
            After::Takes {
                coordinator,
                claims,
            } => self.take_turn(coordinator, claims),
            After::Prepared(transaction) => self.send(transaction),
            After::Arrived(transaction) => self.arrived(transaction),
            After::Executed(transaction) => self.executed(transaction),
            After::Flushed => self.flushed(),
            After::Nothing => {}
        }
    }

    /// Gives a machine's team a task.
    fn work(&mut self, machine: usize, team: Team, takes: Duration, then: After) {
        self.machines[machine].give(team, takes, then);
        self.start(machine);
    }

    fn start(&mut self, machine: usize) {
        while let Some(slice) = self.machines[machine].start() {
            let takes = slice.takes;
            let event = Event::Slice(machine, Box::new(slice));
            self.events.after(takes, event);
        }
    }

    fn new_token(&mut self) -> Token {
        Token::from_bytes(self.new_name())
    }

    /// Bytes that no lease and no worker had before. Nobody guesses in here.
    fn new_name(&mut self) -> [u8; limits::protocol::TOKEN_BYTES] {
        self.names += 1;
        self.names.to_be_bytes()
    }
}

//! Workers: each slot leases, has its job rendered in its turn, delivers, and leases again.

use super::{
    Event, World,
    calls::{Answer, Call, Job, Kind, Request},
};
use crate::{
    draws::{Draw, exponential, uniform},
    farm::Images,
};
use jobqueue::token::{Token, WorkerId};
use std::{collections::VecDeque, time::Duration};

/// What a slot has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Slot {
    /// It asks for a job.
    Asks,
    Holds(Delivery),
    /// There is nothing left to do.
    Left,
}

/// A job, and how far its delivery is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Delivery {
    job: Job,
    uploads_left: usize,
    uploads_underway: usize,
}

pub(super) struct Worker {
    pub life: u32,
    pub session: WorkerId,
    pub coordinator: Option<usize>,
    pub unsent: Vec<Request>,
    slots: Vec<Slot>,
    rendering: Option<usize>,
    waiting: VecDeque<usize>,
}

impl Default for Worker {
    fn default() -> Self {
        Self {
            life: 0,
            session: WorkerId::from_bytes([0; 16]),
            coordinator: None,
            unsent: Vec::new(),
            slots: Vec::new(),
            rendering: None,
            waiting: VecDeque::new(),
        }
    }
}

impl Worker {
    /// Its jobs, in the order of its slots.
    fn held(&self) -> Vec<Job> {
        let held = self.slots.iter().filter_map(|slot| match slot {
            Slot::Holds(delivery) => Some(delivery.job),
            Slot::Asks | Slot::Left => None,
        });
        held.collect()
    }

    fn delivery(&mut self, slot: usize) -> Option<&mut Delivery> {
        match self.slots.get_mut(slot) {
            Some(Slot::Holds(delivery)) => Some(delivery),
            _ => None,
        }
    }

    /// The slot that holds a job under this token.
    fn slot_of(&self, token: Token) -> Option<usize> {
        let holds =
            |slot: &Slot| matches!(slot, Slot::Holds(delivery) if delivery.job.token == token);
        self.slots.iter().position(holds)
    }

    /// Takes what it was at from a worker that dies.
    pub fn stop(&mut self) {
        self.life += 1;
        self.coordinator = None;
        self.unsent.clear();
        self.slots.clear();
        self.rendering = None;
        self.waiting.clear();
    }

    /// Slots that have left.
    pub fn slots_left(&self) -> usize {
        let left = self.slots.iter().filter(|slot| **slot == Slot::Left);
        left.count()
    }

    /// Whether it looks for a coordinator that lets it in.
    pub fn waits_outside(&self) -> bool {
        !self.slots.is_empty() && self.coordinator.is_none() && !self.has_left()
    }

    /// Whether it has left for good.
    pub fn has_left(&self) -> bool {
        !self.slots.is_empty() && self.slots.iter().all(|slot| *slot == Slot::Left)
    }
}

impl World {
    /// A worker comes, or comes back after it died.
    pub(super) fn begin(&mut self, number: usize) {
        let session = WorkerId::from_bytes(self.new_name());
        let options = &self.farm.workers;
        let worker = &mut self.workers[number];
        let life = worker.life;
        worker.session = session;
        worker.slots = vec![Slot::Asks; options.jobs_held];
        for slot in 0..options.jobs_held {
            self.lease(number, slot);
        }
        let interval = self.farm.policy.lease / limits::worker::RENEWALS_PER_LEASE;
        let worker = number;
        self.events.after(interval, Event::Renews { worker, life });
        if let Some(mean) = self.farm.workers.dies_every {
            let whose = (u64::from(life) << 32) | worker as u64;
            let lives = exponential(self.farm.seed, Draw::Life, whose, mean);
            self.events.after(lives, Event::Dies { worker, life });
        }
        self.connect(worker, life, limits::worker::BACKOFF_FIRST);
    }

    /// A worker without a coordinator looks for one that lets it in, first at any, then at the
    /// next.
    pub(super) fn connect(&mut self, number: usize, life: u32, pause: Duration) {
        let worker = &mut self.workers[number];
        if worker.life != life || worker.coordinator.is_some() {
            return;
        }
        let count = self.coordinators.len();
        let draw = uniform(self.farm.seed, Draw::Coordinator, number as u64);
        let first = (draw * count as f64) as usize;
        let room = (0..count).map(|next| (first + next) % count).find(|next| {
            let coordinator = &self.coordinators[*next];
            coordinator.alive && coordinator.connections < self.farm.connections_max
        });
        let Some(coordinator) = room else {
            let worker = number;
            let again = Event::Connects {
                worker,
                life,
                pause: (2 * pause).min(limits::worker::BACKOFF_MAX),
            };
            return self.events.after(pause, again);
        };
        self.coordinators[coordinator].connections += 1;
        worker.coordinator = Some(coordinator);
        self.queue
            .admit(worker.session, &format!("worker {number}"));
        for request in std::mem::take(&mut worker.unsent) {
            self.ask(number, request);
        }
    }

    fn lease(&mut self, worker: usize, slot: usize) {
        if let Some(state) = self.workers[worker].slots.get_mut(slot) {
            *state = Slot::Asks;
        }
        self.request(worker, slot, Kind::Lease, Vec::new());
    }

    fn request(&mut self, worker: usize, slot: usize, kind: Kind, jobs: Vec<Job>) {
        let began = self.events.now();
        let request = Request {
            kind,
            slot,
            jobs,
            began,
        };
        self.ask(worker, request);
    }

    /// A worker hears the answer of a call.
    pub(super) fn answered(&mut self, call: Call) {
        let Call {
            worker,
            request,
            answer,
            ..
        } = call;
        let Request {
            kind,
            slot,
            jobs,
            began,
        } = request;
        let took = self.events.now().saturating_sub(began);
        match (kind, answer) {
            (Kind::Lease, Answer::Leased(job)) => {
                self.measured.note_lease(took);
                self.leased(worker, slot, job);
            }
            (Kind::Lease, _) => self.leave(worker, slot),
            (Kind::Renew, _) => self.renewed(worker, &jobs),
            (Kind::Complete, _) => {
                // Its lease may be lost since: then the slot has another job by now.
                let of_slot = self.workers[worker].delivery(slot).map(|held| held.job);
                if of_slot == jobs.first().copied() {
                    self.measured.note_completion(took);
                    self.lease(worker, slot);
                }
            }
            (Kind::Find | Kind::Urls | Kind::Upload, _) => {
                self.deliver(worker, slot, &jobs, kind);
            }
        }
    }

    fn leased(&mut self, number: usize, slot: usize, job: Job) {
        let uploads_left = match (self.farm.brings_images, self.farm.images) {
            (false, Images::Folder) => self.farm.views,
            _ => 0,
        };
        let worker = &mut self.workers[number];
        worker.slots[slot] = Slot::Holds(Delivery {
            job,
            uploads_left,
            uploads_underway: 0,
        });
        worker.waiting.push_back(slot);
        self.render(number);
    }

    /// One job renders at a time.
    fn render(&mut self, number: usize) {
        let worker = &mut self.workers[number];
        if worker.rendering.is_some() {
            return;
        }
        let Some(slot) = worker.waiting.pop_front() else {
            return;
        };
        let Some(Delivery { job, .. }) = worker.delivery(slot).copied() else {
            return;
        };
        worker.rendering = Some(slot);
        let life = worker.life;
        let time = self.farm.rendering.of(self.farm.seed, job.material);
        let time = time / self.farm.workers.cores as u32;
        self.measured.rendering.begin(self.events.now());
        let event = Event::Rendered {
            worker: number,
            life,
            slot,
            token: job.token,
        };
        self.events.after(time, event);
    }

    pub(super) fn rendered(&mut self, number: usize, life: u32, slot: usize, token: Token) {
        let worker = &mut self.workers[number];
        // What was given up since ended then.
        if worker.life != life || worker.slot_of(token) != Some(slot) {
            return;
        }
        let Some(Delivery { job, .. }) = worker.delivery(slot).copied() else {
            return;
        };
        worker.rendering = None;
        self.measured.rendering.end(self.events.now());
        self.render(number);
        if self.farm.workers.asks_missing {
            self.request(number, slot, Kind::Find, vec![job]);
        } else {
            self.deliver(number, slot, &[job], Kind::Find);
        }
    }

    /// The next call of a delivery after one of this kind.
    fn deliver(&mut self, number: usize, slot: usize, jobs: &[Job], after: Kind) {
        let at_once = self.farm.workers.uploads_at_once;
        let life = self.workers[number].life;
        let Some(delivery) = self.workers[number].delivery(slot) else {
            return;
        };
        if jobs.first() != Some(&delivery.job) {
            return;
        }
        let job = delivery.job;
        if self.farm.images == Images::Bucket {
            if after == Kind::Find {
                return self.request(number, slot, Kind::Urls, vec![job]);
            }
            let rounds = self.farm.views.div_ceil(at_once) as u32;
            let sent = Event::Sent {
                worker: number,
                life,
                slot,
                token: job.token,
            };
            return self.events.after(self.farm.costs.bucket.put * rounds, sent);
        }
        if after == Kind::Upload {
            delivery.uploads_underway -= 1;
        }
        let room = at_once - delivery.uploads_underway;
        let more = room.min(delivery.uploads_left);
        delivery.uploads_left -= more;
        delivery.uploads_underway += more;
        let all_sent = delivery.uploads_underway == 0;
        for _ in 0..more {
            self.request(number, slot, Kind::Upload, vec![job]);
        }
        if all_sent {
            self.request(number, slot, Kind::Complete, vec![job]);
        }
    }

    pub(super) fn sent_to_bucket(&mut self, number: usize, life: u32, slot: usize, token: Token) {
        let worker = &mut self.workers[number];
        if worker.life == life
            && let Some(Delivery { job, .. }) = worker.delivery(slot).copied()
            && job.token == token
        {
            self.request(number, slot, Kind::Complete, vec![job]);
        }
    }

    pub(super) fn renew(&mut self, number: usize, life: u32) {
        let worker = &self.workers[number];
        if worker.life != life || worker.has_left() {
            return;
        }
        let jobs = worker.held();
        if jobs.is_empty() || worker.coordinator.is_none() {
            return self.plan_renewal(number);
        }
        self.request(number, 0, Kind::Renew, jobs);
    }

    fn plan_renewal(&mut self, worker: usize) {
        let life = self.workers[worker].life;
        let interval = self.farm.policy.lease / limits::worker::RENEWALS_PER_LEASE;
        self.events.after(interval, Event::Renews { worker, life });
    }

    /// A worker gives up the jobs whose leases are lost.
    fn renewed(&mut self, number: usize, lost: &[Job]) {
        self.measured.renewals += 1;
        for job in lost {
            let Some(slot) = self.workers[number].slot_of(job.token) else {
                continue;
            };
            let worker = &mut self.workers[number];
            worker.waiting.retain(|waiting| *waiting != slot);
            if worker.rendering == Some(slot) {
                worker.rendering = None;
                self.measured.rendering.end(self.events.now());
            }
            self.lease(number, slot);
            self.render(number);
        }
        self.plan_renewal(number);
    }

    fn leave(&mut self, number: usize, slot: usize) {
        let worker = &mut self.workers[number];
        worker.slots[slot] = Slot::Left;
        self.working -= 1;
        if worker.has_left()
            && let Some(coordinator) = worker.coordinator.take()
        {
            self.coordinators[coordinator].connections -= 1;
        }
    }

    /// Notes that a worker that renders is gone.
    pub(super) fn stop_rendering(&mut self, number: usize) {
        if self.workers[number].rendering.is_some() {
            self.measured.rendering.end(self.events.now());
        }
    }
}

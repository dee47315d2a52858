//! What fails: workers, coordinators, leases.

use super::{Event, SWEEP, World};
use std::time::Duration;

/// How long a worker that died is away.
const WORKER_AWAY: Duration = Duration::from_secs(60);

impl World {
    /// A worker dies without a word: nobody hears the answers to its calls.
    pub(super) fn die(&mut self, number: usize, life: u32) {
        let worker = &self.workers[number];
        if worker.life != life || worker.has_left() {
            return;
        }
        // Slots that have left are to leave once more.
        self.working += worker.slots_left();
        self.measured.workers_died += 1;
        self.stop_rendering(number);
        let worker = &mut self.workers[number];
        if let Some(coordinator) = worker.coordinator {
            self.coordinators[coordinator].connections -= 1;
        }
        worker.stop();
        let worker = number;
        self.events.after(WORKER_AWAY, Event::Begins { worker });
    }

    /// The first coordinator dies: its calls are lost, and its workers go to the next.
    pub(super) fn coordinator_dies(&mut self) {
        let dead = 0;
        self.coordinators[dead].alive = false;
        self.coordinators[dead].connections = 0;
        self.roll_back(dead);
        // What it has begun runs to its end, and nobody hears of it.
        for team in self.coordinators[dead].teams() {
            self.machines[dead].forget(team);
        }
        let lost = self.calls.which(|call| call.coordinator == dead);
        for id in lost {
            let Some(call) = self.calls.remove(id) else {
                continue;
            };
            let worker = &mut self.workers[call.worker];
            if worker.life == call.life && !call.abandoned {
                worker.unsent.push(call.request);
            }
        }
        for number in 0..self.workers.len() {
            let worker = &mut self.workers[number];
            if worker.coordinator == Some(dead) {
                worker.coordinator = None;
                let life = worker.life;
                self.connect(number, life, limits::worker::BACKOFF_FIRST);
            }
        }
    }

    /// Takes back leases that ran out, and has those who wait for work look again.
    pub(super) fn sweep(&mut self) {
        let (_, lost) = self.queue.expire(self.events.now());
        self.measured.leases_lost += lost.len() as u64;
        if self.may_have_work() || self.queue.is_finished() {
            for coordinator in 0..self.coordinators.len() {
                self.wake(coordinator);
            }
        }
        self.events.after(SWEEP, Event::Sweeps);
    }
}

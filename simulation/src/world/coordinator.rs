//! A coordinator: its threads, its upload slots, and who waits for work.

use super::{
    After, Event, World,
    calls::CallId,
    database::Turns,
    files::{Batches, Kind as GroupKind},
    measured::Busy,
};
use crate::{
    farm::{Farm, Images},
    machine::{Machine, Team},
};
use std::{collections::VecDeque, time::Duration};

pub(super) struct Coordinator {
    pub alive: bool,
    pub connections: usize,
    /// Threads of the runtime, which take what is ready in turns: as many as cores.
    pub tasks: Team,
    /// Threads that are meant to be blocked: one for each upload slot.
    blocking: Team,
    pub committing: Team,
    pub publishing: Team,
    /// The kernel's own threads.
    pub kernel: Team,
    slots_free: usize,
    slots_wanted: VecDeque<CallId>,
    pub slots_busy: Busy,
    pub commits: Batches,
    pub publications: Batches,
    pub turns: Turns,
    /// Calls that wait for work.
    pub parked: Vec<CallId>,
}

impl Coordinator {
    pub fn new(machine: &mut Machine<After>, farm: &Farm) -> Self {
        let slots = farm.upload_slots();
        Self {
            alive: true,
            connections: 0,
            tasks: machine.add_team(farm.coordinator_cores),
            blocking: machine.add_team(slots),
            committing: machine.add_team(1),
            publishing: machine.add_team(1),
            kernel: machine.add_team(farm.coordinator_cores),
            slots_free: slots,
            slots_wanted: VecDeque::new(),
            slots_busy: Busy::default(),
            commits: Batches::default(),
            publications: Batches::default(),
            turns: Turns::default(),
            parked: Vec::new(),
        }
    }

    /// Its threads.
    pub fn teams(&self) -> [Team; 4] {
        [self.tasks, self.blocking, self.committing, self.publishing]
    }

    pub fn batches(&mut self, kind: GroupKind) -> &mut Batches {
        match kind {
            GroupKind::Commit => &mut self.commits,
            GroupKind::Publish => &mut self.publications,
        }
    }
}

impl World {
    /// Images of a call wait for upload slots, in the order in which they came.
    pub(super) fn take_in(&mut self, id: CallId) {
        let Some(call) = self.calls.get(id) else {
            return;
        };
        let (coordinator, images) = (call.coordinator, call.images_left);
        if images == 0 || self.farm.images != Images::Folder {
            return self.go_on(id);
        }
        let wanted = &mut self.coordinators[coordinator].slots_wanted;
        wanted.extend(std::iter::repeat_n(id, images));
        self.fill_slots(coordinator);
    }

    fn fill_slots(&mut self, number: usize) {
        let costs = &self.farm.costs.calls;
        let pixels = f64::from(self.farm.pixels) * costs.take_in_pixel_ns;
        let cost = costs.take_in + Duration::from_nanos(pixels as u64);
        while self.coordinators[number].slots_free > 0 {
            let now = self.events.now();
            let coordinator = &mut self.coordinators[number];
            let Some(id) = coordinator.slots_wanted.pop_front() else {
                return;
            };
            // What nobody waits for is not begun.
            if self.calls.get(id).is_none_or(|call| call.abandoned) {
                continue;
            }
            coordinator.slots_free -= 1;
            coordinator.slots_busy.begin(now);
            let team = coordinator.blocking;
            self.work(number, team, cost, After::Checked(id));
        }
    }

    /// An image is checked; now the disk has it.
    pub(super) fn checked(&mut self, id: CallId) {
        let wait = self.farm.costs.calls.take_in_wait;
        self.events.after(wait, Event::Then(After::TakenIn(id)));
    }

    /// The slot is released only after its caller has been polled among the runtime's tasks.
    pub(super) fn taken_in(&mut self, id: CallId) {
        if let Some(call) = self.calls.get(id) {
            let coordinator = call.coordinator;
            let team = self.coordinators[coordinator].tasks;
            self.work(coordinator, team, Duration::ZERO, After::SlotFree(id));
        }
    }

    pub(super) fn slot_free(&mut self, id: CallId) {
        let Some(call) = self.calls.get(id) else {
            return;
        };
        call.images_left -= 1;
        let (number, all_in) = (call.coordinator, call.images_left == 0);
        let coordinator = &mut self.coordinators[number];
        coordinator.slots_free += 1;
        coordinator.slots_busy.end(self.events.now());
        self.fill_slots(number);
        if all_in {
            self.go_on(id);
        }
    }

    /// A call that found no work waits for some.
    pub(super) fn park(&mut self, id: CallId) {
        if let Some(call) = self.calls.get(id) {
            if call.abandoned {
                self.calls.remove(id);
                return;
            }
            call.parked = true;
            self.coordinators[call.coordinator].parked.push(id);
        }
    }

    /// Those who wait for work at a coordinator look again.
    pub(super) fn wake(&mut self, coordinator: usize) {
        for id in std::mem::take(&mut self.coordinators[coordinator].parked) {
            if let Some(call) = self.calls.get(id) {
                call.parked = false;
                self.take_step(id);
            }
        }
    }
}

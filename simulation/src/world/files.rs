//! A store in a folder: images are published, and transitions committed, in batches.

use super::{
    After, Event, World,
    calls::{Answer, CallId, Job, Kind as CallKind, fingerprint},
};
use crate::{
    draws::{Draw, uniform},
    farm::Images,
};
use jobqueue::{Changes, Verdict};
use std::{collections::VecDeque, time::Duration};

/// Which of a coordinator's batches.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Commit,
    Publish,
}

/// The batches of a coordinator.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Group {
    coordinator: usize,
    kind: Kind,
}

/// What waits, and what is under way.
#[derive(Default)]
pub(super) struct Batches {
    waiting: VecDeque<CallId>,
    underway: Vec<CallId>,
    began: Option<Duration>,
    /// A batch is under way, or will begin when the interval is over.
    engaged: bool,
    /// Time used, were all batches full: what the group cannot do without.
    pub used: Duration,
}

/// What a batch costs.
struct Cost {
    fixed: Duration,
    items: Duration,
    sync_fixed: Duration,
    sync_items: Duration,
    kernel: Duration,
}

impl World {
    fn submit(&mut self, group: Group, id: CallId) {
        let batches = self.coordinators[group.coordinator].batches(group.kind);
        batches.waiting.push_back(id);
        self.engage(group);
    }

    /// Plans the next batch, an interval after the one before at the earliest.
    fn engage(&mut self, group: Group) {
        let now = self.events.now();
        let batches = self.coordinators[group.coordinator].batches(group.kind);
        if batches.engaged || batches.waiting.is_empty() {
            return;
        }
        batches.engaged = true;
        let earliest = batches.began.map(|began| began + limits::COMMIT_INTERVAL);
        let pause = earliest.unwrap_or_default().saturating_sub(now);
        self.events
            .after(pause, Event::Then(After::MayBegin(group)));
    }

    pub(super) fn begin_batch(&mut self, group: Group) {
        let Group { coordinator, kind } = group;
        let now = self.events.now();
        let owner = &mut self.coordinators[coordinator];
        if !owner.alive {
            return;
        }
        let team = match kind {
            Kind::Commit => owner.committing,
            Kind::Publish => owner.publishing,
        };
        let batches = owner.batches(kind);
        let count = batches.waiting.len().min(limits::COMMIT_BATCH_MAX);
        batches.underway = batches.waiting.drain(..count).collect();
        batches.began = Some(now);
        let cost = self.cost(group);
        // Were all batches full, so much of the group's time would go into this one's share.
        let full = (cost.fixed + cost.sync_fixed) * count as u32 / limits::COMMIT_BATCH_MAX as u32;
        let pace = limits::COMMIT_INTERVAL * count as u32 / limits::COMMIT_BATCH_MAX as u32;
        let batches = self.coordinators[coordinator].batches(kind);
        batches.used += (full + cost.items + cost.sync_items).max(pace);
        let takes = cost.fixed + cost.items;
        self.work(coordinator, team, takes, After::Written(group));
    }

    /// What the batch under way costs.
    fn cost(&mut self, group: Group) -> Cost {
        let costs = &self.farm.costs.files;
        let views = self.farm.views as u32;
        let batches = self.coordinators[group.coordinator].batches(group.kind);
        let count = batches.underway.len() as u32;
        if group.kind == Kind::Publish {
            let images = count * views;
            let pixels = f64::from(self.farm.pixels) * costs.publish_sync_pixel_ns;
            let sync = costs.publish_sync_image + Duration::from_nanos(pixels as u64);
            return Cost {
                fixed: costs.publish,
                items: costs.publish_image * images,
                sync_fixed: costs.publish_sync,
                sync_items: sync * images,
                kernel: costs.kernel + costs.kernel_image * images,
            };
        }
        let calls = &mut self.calls;
        let leases = batches.underway.iter().filter(|id| {
            let call = calls.get(**id);
            call.is_some_and(|call| call.request.kind == CallKind::Lease)
        });
        let leases = leases.count() as u32;
        let completion = costs.commit_completion + costs.commit_image * views;
        Cost {
            fixed: costs.commit,
            items: costs.commit_lease * leases + completion * (count - leases),
            sync_fixed: costs.commit_sync,
            sync_items: Duration::ZERO,
            kernel: costs.kernel,
        }
    }

    pub(super) fn written(&mut self, group: Group) {
        let cost = self.cost(group);
        let sync = cost.sync_fixed + cost.sync_items;
        self.events.after(sync, Event::Then(After::Synced(group)));
        let coordinator = group.coordinator;
        let threads = self.coordinators[coordinator].kernel;
        self.work(coordinator, threads, cost.kernel, After::Nothing);
    }

    pub(super) fn synced(&mut self, group: Group) {
        let owner = &mut self.coordinators[group.coordinator];
        if !owner.alive {
            return;
        }
        let batches = owner.batches(group.kind);
        batches.engaged = false;
        let woken = owner.tasks;
        let wake = self.farm.costs.files.wake;
        self.work(group.coordinator, woken, wake, After::Nothing);
        let batches = self.coordinators[group.coordinator].batches(group.kind);
        for id in std::mem::take(&mut batches.underway) {
            self.go_on(id);
        }
        self.engage(group);
    }

    /// Staged images get their names, if the completion would count.
    pub(super) fn publish(&mut self, id: CallId) {
        let Some(coordinator) = self.calls.get(id).map(|call| call.coordinator) else {
            return;
        };
        if self.farm.images != Images::Folder || !self.would_record(id) {
            return self.go_on(id);
        }
        let kind = Kind::Publish;
        self.submit(Group { coordinator, kind }, id);
    }

    /// The queue changes at once, and who asked is told when that is durable.
    pub(super) fn record_in_files(&mut self, id: CallId) {
        let Some(coordinator) = self.calls.get(id).map(|call| call.coordinator) else {
            return;
        };
        let changes = self.apply(id);
        if !changes.is_empty() {
            self.after_changes(coordinator);
        }
        let Some(call) = self.calls.get(id) else {
            return;
        };
        if !changes.is_empty() {
            let kind = Kind::Commit;
            self.submit(Group { coordinator, kind }, id);
        } else if call.request.kind == CallKind::Lease && call.answer == Answer::Done {
            self.park(id);
        } else {
            self.go_on(id);
        }
    }

    /// Has the queue make the transition that a call asks for.
    pub(super) fn apply(&mut self, id: CallId) -> Changes {
        let Some(call) = self.calls.get(id) else {
            return Changes::default();
        };
        match call.request.kind {
            CallKind::Lease => self.claim(id),
            CallKind::Renew => {
                let now = self.events.now();
                // The answer names those that are lost.
                call.request.jobs.retain(|job| {
                    let Job { material, token } = *job;
                    !self.queue.renew(material, token, 0, now)
                });
                Changes::default()
            }
            CallKind::Complete => self.complete(id),
            CallKind::Find | CallKind::Urls | CallKind::Upload => Changes::default(),
        }
    }

    fn claim(&mut self, id: CallId) -> Changes {
        let token = self.new_token();
        let now = self.events.now();
        let Some(call) = self.calls.get(id) else {
            return Changes::default();
        };
        if self.queue.is_finished() {
            call.answer = Answer::Finished;
            return Changes::default();
        }
        // Of the session that asked, should its worker have died since.
        let session = call.session;
        let changes = self.queue.claim(session, &[token], now);
        if let Some(change) = changes.jobs.first() {
            let material = change.material;
            call.answer = Answer::Leased(Job { material, token });
            self.measured.leases += 1;
        }
        changes
    }

    fn complete(&mut self, id: CallId) -> Changes {
        let now = self.events.now();
        let Some(call) = self.calls.get(id) else {
            return Changes::default();
        };
        let Some(Job { material, token }) = call.request.jobs.first().copied() else {
            return Changes::default();
        };
        let draw = uniform(self.farm.seed, Draw::Redundant, material.into());
        let redundant = draw * 1e6 <= f64::from(self.farm.redundant_per_million);
        let digest = fingerprint(material);
        let completed = self.queue.complete(material, token, digest, redundant, now);
        match completed {
            Ok((verdict, changes)) => {
                match verdict {
                    Verdict::Recorded => self.measured.recorded += 1,
                    Verdict::Repeated => self.measured.repeated += 1,
                    Verdict::Agreed => self.measured.agreed += 1,
                    // Every worker tells the truth.
                    Verdict::Disputed
                    | Verdict::Upheld(_)
                    | Verdict::Overturned(_)
                    | Verdict::Ruled(_)
                    | Verdict::Undecided => self.measured.contradicted += 1,
                }
                changes
            }
            Err(_) => {
                call.answer = Answer::Lost;
                self.measured.refused += 1;
                Changes::default()
            }
        }
    }

    /// Wakes those who wait for work when there may be some, or never will be again.
    pub(super) fn after_changes(&mut self, coordinator: usize) {
        let nobody_waits = self.coordinators[coordinator].parked.is_empty();
        if !nobody_waits && (self.may_have_work() || self.queue.is_finished()) {
            self.wake(coordinator);
        }
    }

    /// Whether somebody who waits for work may find some.
    pub(super) fn may_have_work(&self) -> bool {
        let counts = self.queue.counts();
        counts.pending + counts.redundant + counts.disputed > 0
    }
}

//! A call of a worker, step by step.

use super::{After, Event, World};
use crate::farm::{Images, Store};
use dataset::{CompletedView, Digest, ErrorStatistics};
use jobqueue::{
    Fingerprint, Standing,
    token::{Token, WorkerId},
};
use limits::{protocol::CALL_DEADLINE, worker::LEASE_WAIT};
use std::{collections::VecDeque, time::Duration};

/// What is called.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Lease,
    Renew,
    /// Which images are missing?
    Find,
    /// Where are images of a bucket sent to?
    Urls,
    Upload,
    Complete,
}

/// A lease as its worker knows it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Job {
    pub material: u32,
    pub token: Token,
}

/// What a worker asks, whichever coordinator answers.
#[derive(Clone, Debug)]
pub(super) struct Request {
    pub kind: Kind,
    pub slot: usize,
    /// One job, or all that are renewed.
    pub jobs: Vec<Job>,
    pub began: Duration,
}

/// What it is told.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum Answer {
    #[default]
    Done,
    Leased(Job),
    Finished,
    Lost,
}

pub(super) struct Call {
    pub worker: usize,
    pub life: u32,
    pub coordinator: usize,
    pub request: Request,
    pub step: usize,
    /// Images that are not taken in yet.
    pub images_left: usize,
    pub answer: Answer,
    /// It waits for work.
    pub parked: bool,
    /// Its caller no longer waits for it.
    pub abandoned: bool,
    /// The registration of its caller.
    pub session: WorkerId,
}

/// Names a call; that of one that is over names nothing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct CallId {
    index: usize,
    serial: u64,
}

/// All calls under way.
#[derive(Default)]
pub(super) struct Calls {
    calls: Vec<(u64, Option<Call>)>,
    free: Vec<usize>,
    serials: u64,
}

impl Calls {
    pub fn add(&mut self, call: Call) -> CallId {
        self.serials += 1;
        let serial = self.serials;
        let entry = (serial, Some(call));
        let index = match self.free.pop() {
            Some(index) => {
                self.calls[index] = entry;
                index
            }
            None => {
                self.calls.push(entry);
                self.calls.len() - 1
            }
        };
        CallId { index, serial }
    }

    pub fn get(&mut self, id: CallId) -> Option<&mut Call> {
        let (serial, call) = &mut self.calls[id.index];
        call.as_mut().filter(|_| *serial == id.serial)
    }

    pub fn remove(&mut self, id: CallId) -> Option<Call> {
        self.get(id)?;
        self.free.push(id.index);
        self.calls[id.index].1.take()
    }

    /// Those that a test is true of.
    pub fn which(&self, test: impl Fn(&Call) -> bool) -> Vec<CallId> {
        let calls = self.calls.iter().enumerate();
        let found = calls.filter_map(|(index, (serial, call))| {
            let serial = *serial;
            call.as_ref()
                .filter(|call| test(call))
                .map(|_| CallId { index, serial })
        });
        found.collect()
    }
}

/// When the callers of one kind of calls wait no longer, the soonest first.
#[derive(Default)]
pub(super) struct Deadlines {
    waiting: VecDeque<(Duration, CallId)>,
    /// An event will look at the first.
    planned: bool,
}

/// What a call goes through.
#[derive(Clone, Copy, Debug)]
enum Step {
    /// The caller's processor, where it is the coordinator's too.
    Caller,
    /// The network.
    Travel,
    /// The coordinator's processor.
    Serve,
    /// Would the completion count?
    Standing,
    /// Are the images known?
    Look,
    /// Images that came along are checked and staged.
    TakeIn,
    /// Images of a bucket are given their names there.
    Settle,
    /// Staged images are given their names.
    Publish,
    /// The job store records.
    Record,
    /// It is over.
    Hear,
}

impl Kind {
    fn steps(self) -> &'static [Step] {
        use Step::{Caller, Hear, Look, Publish, Record, Serve, Settle, Standing, TakeIn, Travel};
        match self {
            Self::Lease | Self::Renew => {
                &[Caller, Travel, Serve, Record, Serve, Travel, Caller, Hear]
            }
            Self::Find => &[Caller, Travel, Serve, Look, Serve, Travel, Caller, Hear],
            Self::Urls => &[Caller, Travel, Serve, Serve, Travel, Caller, Hear],
            Self::Upload => &[Caller, Travel, Serve, TakeIn, Serve, Travel, Caller, Hear],
            Self::Complete => &[
                Caller, Travel, Serve, Standing, TakeIn, Settle, Publish, Record, Serve, Travel,
                Caller, Hear,
            ],
        }
    }
}

/// What a job's rendering is compared by: every worker tells the truth.
pub(super) fn fingerprint(material: u32) -> Fingerprint {
    Fingerprint::of(&[CompletedView {
        digest: Digest::of(&material.to_le_bytes()),
        bytes: 0,
        statistics: ErrorStatistics {
            mean: 0.0,
            p95: 0.0,
            max: 0.0,
            within_target: 1.0,
            samples: 0,
            evaluations: 0,
        },
        pixels: None,
    }])
}

impl World {
    /// A worker asks, as soon as it has a coordinator.
    pub(super) fn ask(&mut self, worker: usize, request: Request) {
        let Some(coordinator) = self.workers[worker].coordinator else {
            self.workers[worker].unsent.push(request);
            return;
        };
        let deadline = match request.kind {
            Kind::Lease => CALL_DEADLINE + LEASE_WAIT,
            _ => CALL_DEADLINE,
        };
        let kind = request.kind;
        let images_left = match kind {
            Kind::Upload => 1,
            Kind::Complete if self.farm.brings_images => self.farm.views,
            _ => 0,
        };
        let call = self.calls.add(Call {
            worker,
            life: self.workers[worker].life,
            coordinator,
            request,
            step: 0,
            images_left,
            answer: Answer::Done,
            parked: false,
            abandoned: false,
            session: self.workers[worker].session,
        });
        self.plan_deadline(kind == Kind::Lease, deadline, call);
        self.take_step(call);
    }

    /// Calls of one kind give up in the order in which they were made, so the next alone is planned.
    fn plan_deadline(&mut self, leases: bool, after: Duration, id: CallId) {
        let now = self.events.now();
        let deadlines = &mut self.deadlines[usize::from(leases)];
        while let Some((_, first)) = deadlines.waiting.front()
            && self.calls.get(*first).is_none()
        {
            deadlines.waiting.pop_front();
        }
        deadlines.waiting.push_back((now + after, id));
        if !std::mem::replace(&mut deadlines.planned, true) {
            self.events.after(after, Event::GiveUp { leases });
        }
    }

    /// Callers that have waited too long wait no longer.
    pub(super) fn give_up_all(&mut self, leases: bool) {
        let now = self.events.now();
        let number = usize::from(leases);
        self.deadlines[number].planned = false;
        while let Some((at, id)) = self.deadlines[number].waiting.front().copied() {
            if at > now && self.calls.get(id).is_some() {
                if !std::mem::replace(&mut self.deadlines[number].planned, true) {
                    self.events.after(at - now, Event::GiveUp { leases });
                }
                return;
            }
            self.deadlines[number].waiting.pop_front();
            self.give_up(id);
        }
    }

    /// The caller of a call waits no longer, and asks again.
    fn give_up(&mut self, id: CallId) {
        let Some(call) = self.calls.get(id) else {
            return;
        };
        call.abandoned = true;
        let (worker, life, request) = (call.worker, call.life, call.request.clone());
        if call.parked {
            self.calls.remove(id);
        }
        if self.workers[worker].life == life {
            self.measured.given_up += 1;
            self.ask(worker, request);
        }
    }

    /// The step is done.
    pub(super) fn go_on(&mut self, id: CallId) {
        if let Some(call) = self.calls.get(id) {
            call.step += 1;
            self.take_step(id);
        }
    }

    pub(super) fn take_step(&mut self, id: CallId) {
        let Some(call) = self.calls.get(id) else {
            return;
        };
        let (kind, coordinator) = (call.request.kind, call.coordinator);
        match kind.steps()[call.step] {
            Step::Caller => self.spend_caller(id, kind),
            Step::Travel => {
                let delay = self.farm.round_trip / 2;
                self.events.after(delay, Event::Then(After::Call(id)));
            }
            Step::Serve => {
                let half = self.serving(kind) / 2;
                let team = self.coordinators[coordinator].tasks;
                self.work(coordinator, team, half, After::Call(id));
            }
            Step::Standing => match self.farm.store {
                Store::Files => self.go_on(id),
                Store::Postgres { .. } => self.ask_database(id, false),
            },
            Step::Look => match self.farm.store {
                Store::Files => self.go_on(id),
                Store::Postgres { .. } => self.look_up(id),
            },
            Step::TakeIn => self.take_in(id),
            Step::Settle => self.settle(id),
            Step::Publish => self.publish(id),
            Step::Record => match self.farm.store {
                Store::Files => self.record_in_files(id),
                Store::Postgres { .. } => self.ask_database(id, kind == Kind::Lease),
            },
            Step::Hear => self.hear(id),
        }
    }

    /// Whether the call now asks where a completion would stand.
    pub(super) fn asks_standing(call: &Call) -> bool {
        matches!(
            call.request.kind.steps()[call.step],
            Step::Standing | Step::Look
        )
    }

    fn spend_caller(&mut self, id: CallId, kind: Kind) {
        let Some(team) = self.callers else {
            return self.go_on(id);
        };
        let costs = &self.farm.costs.calls;
        let cost = match kind {
            Kind::Lease => costs.caller_lease,
            Kind::Upload => costs.caller_upload,
            _ => costs.caller,
        };
        self.work(0, team, cost / 2, After::Call(id));
    }

    /// The coordinator's processor time of a call, besides what it asks others to do.
    fn serving(&self, kind: Kind) -> Duration {
        let costs = &self.farm.costs;
        let direct = self.farm.images == Images::None;
        match kind {
            // The job store is asked without a network.
            _ if direct => Duration::ZERO,
            Kind::Lease => costs.calls.lease,
            Kind::Renew | Kind::Urls => costs.calls.renew,
            Kind::Find => costs.calls.find,
            Kind::Upload => costs.calls.upload,
            Kind::Complete => {
                let requests = match self.farm.images {
                    Images::Bucket => 2 * self.farm.views as u32 + 1,
                    Images::Folder | Images::None => 0,
                };
                costs.calls.complete + costs.bucket.request * requests
            }
        }
    }

    /// Images of a bucket: sizes and sums are asked for, and they are copied to their names.
    fn settle(&mut self, id: CallId) {
        if self.farm.images != Images::Bucket {
            return self.go_on(id);
        }
        let rounds = self.farm.views.div_ceil(limits::BUCKET_REQUESTS_AT_ONCE);
        let delay = self.farm.costs.bucket.settle * rounds as u32;
        self.events.after(delay, Event::Then(After::Call(id)));
    }

    /// Whether the images of a completion would become its job's.
    pub(super) fn would_record(&mut self, id: CallId) -> bool {
        let Some(call) = self.calls.get(id) else {
            return false;
        };
        let Some(Job { material, token }) = call.request.jobs.first().copied() else {
            return false;
        };
        let standing = self.queue.standing(material, token, fingerprint(material));
        standing == Ok(Standing::Current { records: true })
    }

    fn hear(&mut self, id: CallId) {
        if let Some(call) = self.calls.remove(id)
            && !call.abandoned
            && self.workers[call.worker].life == call.life
        {
            self.answered(call);
        }
    }
}

//! The farm as it happens: what it was told lately, and fragments of its page sent to whoever looks.
//!
//! One task asks the coordinator, once a second while somebody looks, and has each fragment rendered
//! once for readers and once for operators. Every page gets the same bytes. A page that reads slowly gets
//! the newest fragments and misses those between; nothing waits for it.

mod history;
mod stream;

pub use history::History;
pub use stream::{Fragments, stream};

use crate::{access::Visitor, problem::Problem};
use coordinator::ControlService;
use limits::web::{LIVE_PAGES_MAX, LIVE_PAUSE};
use proto::{
    Control, ListWorkersRequest, StatusRequest, StatusResponse, WatchEventsRequest, WorkerDetail,
};
use std::{
    sync::{Arc, Mutex, MutexGuard, PoisonError},
    time::Instant,
};
use tokio::{sync::watch, time::sleep};
use tokio_stream::StreamExt;
use tonic::Request;

/// How a farm is, and what it did lately.
pub struct Seen {
    /// What the coordinator says.
    pub status: StatusResponse,
    /// Its workers.
    pub workers: Vec<WorkerDetail>,
    /// What happened lately.
    pub history: History,
}

/// A coordinator, and what it did lately.
pub struct LiveFarm {
    control: ControlService,
    history: Mutex<History>,
    told: watch::Sender<Arc<[Fragments; 2]>>,
}

impl LiveFarm {
    /// The farm of a coordinator.
    pub fn new(control: ControlService) -> Self {
        Self {
            control,
            history: Mutex::new(History::new(Instant::now())),
            told: watch::channel(Arc::default()).0,
        }
    }

    /// The service to act through.
    pub fn control(&self) -> &ControlService {
        &self.control
    }

    /// How the farm is now.
    pub async fn seen(&self) -> Result<Seen, Problem> {
        let status = self.control.status(Request::new(StatusRequest {}));
        let status = status.await?.into_inner();
        let workers = self.workers().await?;
        let mut history = self.history();
        history.note_images(status.counts.unwrap_or_default().images, Instant::now());
        Ok(Seen {
            status,
            workers,
            history: history.clone(),
        })
    }

    /// All workers, those first that are there.
    pub async fn workers(&self) -> Result<Vec<WorkerDetail>, Problem> {
        let request = Request::new(ListWorkersRequest {});
        let workers = self.control.list_workers(request).await;
        Ok(workers?.into_inner().workers)
    }

    /// The fragments of the farm's page for a visitor, now and whenever they change.
    ///
    /// # Errors
    /// When too many pages are told already.
    pub fn watch(&self) -> Result<watch::Receiver<Arc<[Fragments; 2]>>, Problem> {
        if self.told.receiver_count() >= LIVE_PAGES_MAX {
            return Err(Problem::busy("too many pages are being told what happens"));
        }
        if self.told.receiver_count() == 0 {
            // What was told last is of when somebody looked last.
            self.told.send_replace(Arc::default());
        }
        Ok(self.told.subscribe())
    }

    /// Watches the coordinator until pages are served no longer. `render` makes the fragments for a
    /// visitor.
    pub async fn follow(
        &self,
        render: impl Fn(&Seen, Visitor) -> Fragments,
        mut stopping: watch::Receiver<bool>,
    ) {
        tokio::select! {
            () = self.note_events() => {}
            () = self.tell(render) => {}
            _ = stopping.wait_for(|stopping| *stopping) => {}
        }
    }

    async fn note_events(&self) {
        loop {
            let events = self
                .control
                .watch_events(Request::new(WatchEventsRequest {}));
            match events.await {
                Ok(events) => {
                    let mut events = events.into_inner();
                    while let Some(Ok(event)) = events.next().await {
                        self.history().note_event(event);
                    }
                }
                Err(status) => tracing::warn!(%status, "the pages show no events"),
            }
            sleep(LIVE_PAUSE).await;
        }
    }

    async fn tell(&self, render: impl Fn(&Seen, Visitor) -> Fragments) {
        loop {
            sleep(LIVE_PAUSE).await;
            let is_watched = self.told.receiver_count() > 0;
            if !is_watched && !self.history().wants_images(Instant::now()) {
                continue;
            }
            match self.seen().await {
                Ok(seen) if is_watched => {
                    let fragments =
                        [Visitor::Reader, Visitor::Operator].map(|visitor| render(&seen, visitor));
                    self.told.send_if_modified(|told| {
                        let is_new = **told != fragments;
                        if is_new {
                            *told = Arc::new(fragments);
                        }
                        is_new
                    });
                }
                Ok(_) => {}
                Err(problem) => {
                    tracing::warn!(why = problem.sentence, "the pages do not show what happens");
                }
            }
        }
    }

    // Nothing that runs under the lock panics half way through a change.
    fn history(&self) -> MutexGuard<'_, History> {
        self.history.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Which of the two renderings a visitor gets.
pub fn variant(visitor: Visitor) -> usize {
    match visitor {
        Visitor::Reader => 0,
        Visitor::Operator => 1,
    }
}

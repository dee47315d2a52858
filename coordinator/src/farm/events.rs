//! What happens in the farm, told to the log and to whoever watches.

use limits::protocol::EVENTS_WAITING_MAX;
use std::time::{SystemTime, UNIX_EPOCH};
use tokio::sync::broadcast;

/// What happened.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum EventKind {
    Registered,
    Left,
    Leased,
    LeaseLost,
    Failed,
    Quarantined,
    Completed,
    RedundantAgreed,
    Audited,
    Disputed,
    Settled,
    Blocked,
    Unblocked,
    Retried,
    Cancelled,
    Prioritized,
    Mode,
}

/// One thing that happened, durably where it changed the store.
#[derive(Clone, Debug)]
pub(crate) struct Event {
    pub unix_ms: u64,
    pub kind: EventKind,
    pub material: Option<u32>,
    pub worker: String,
    pub lease: String,
    pub text: String,
}

/// Everybody who watches.
pub(super) struct Events(broadcast::Sender<Event>);

impl EventKind {
    /// The event's name in the protocol and in logs.
    pub fn name(self) -> &'static str {
        match self {
            Self::Registered => "registered",
            Self::Left => "left",
            Self::Leased => "leased",
            Self::LeaseLost => "lease lost",
            Self::Failed => "failed",
            Self::Quarantined => "quarantined",
            Self::Completed => "completed",
            Self::RedundantAgreed => "check agreed",
            Self::Audited => "audited",
            Self::Disputed => "disputed",
            Self::Settled => "settled",
            Self::Blocked => "barred",
            Self::Unblocked => "unbarred",
            Self::Retried => "retried",
            Self::Cancelled => "cancelled",
            Self::Prioritized => "prioritized",
            Self::Mode => "mode",
        }
    }

    /// Whether somebody should look.
    fn is_trouble(self) -> bool {
        matches!(
            self,
            Self::LeaseLost
                | Self::Failed
                | Self::Quarantined
                | Self::Disputed
                | Self::Settled
                | Self::Blocked
        )
    }
}

impl Event {
    pub fn new(kind: EventKind) -> Self {
        let now = SystemTime::now().duration_since(UNIX_EPOCH);
        Self {
            unix_ms: now.map_or(0, |now| now.as_millis() as u64),
            kind,
            material: None,
            worker: String::new(),
            lease: String::new(),
            text: String::new(),
        }
    }

    pub fn material(mut self, material: u32) -> Self {
        self.material = Some(material);
        self
    }

    pub fn worker(mut self, worker: impl Into<String>) -> Self {
        self.worker = worker.into();
        self
    }

    pub fn lease(mut self, token: impl ToString) -> Self {
        self.lease = token.to_string();
        self
    }

    pub fn text(mut self, text: impl Into<String>) -> Self {
        self.text = text.into();
        self
    }
}

impl Events {
    pub fn new() -> Self {
        Self(broadcast::channel(EVENTS_WAITING_MAX).0)
    }

    pub fn watch(&self) -> broadcast::Receiver<Event> {
        self.0.subscribe()
    }

    pub fn readers(&self) -> usize {
        self.0.receiver_count()
    }

    /// Writes an event to the log and sends it to whoever watches.
    pub fn emit(&self, event: Event) {
        let Event {
            kind,
            material,
            worker,
            lease,
            text,
            ..
        } = &event;
        let kind = kind.name();
        if event.kind.is_trouble() {
            tracing::warn!(material, worker, lease, text, "{kind}");
        } else if event.kind == EventKind::Leased {
            tracing::debug!(material, worker, lease, text, "{kind}");
        } else {
            tracing::info!(material, worker, lease, text, "{kind}");
        }
        // An error means that nobody watches.
        drop(self.0.send(event));
    }
}

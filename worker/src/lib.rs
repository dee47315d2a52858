//! The worker: leases materials from a coordinator, renders their views, delivers them, and keeps
//! its leases alive meanwhile.
//!
//! A worker keeps what it has rendered until the coordinator has confirmed it: when the
//! coordinator is away it waits, with growing, jittered pauses, and then delivers under the same
//! token. Work whose lease was lost is dropped at the next view.

mod connection;
mod delivery;
mod fetched_mesh;
mod job;
mod render;
mod upload;
mod worker;

pub use render::{Render, RenderFailure, RenderedView, RendererBackend};
pub use worker::{Options, Summary, Worker, WorkerError};

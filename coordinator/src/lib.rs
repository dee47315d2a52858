//! The coordinator: a farm's server over a store, in gRPC.
//!
//! | module | what |
//! | --- | --- |
//! | `farm` | one operation a call of the protocol, without the network |
//! | `service` | the calls themselves |
//! | [`security`] | who may call, and how much a stranger can cost |
//! | `metrics` | what Prometheus is told |
//! | `running` | starting and stopping |
//! | `supervision` | tasks that have to run for as long as it does |
//! | `health` | what the standard health service says |
//!
//! Never imports the renderer: a coordinator needs neither Embree nor a fast machine.

mod farm;
mod health;
mod metrics;
mod options;
mod presence;
mod rate;
mod report;
mod running;
pub mod security;
mod service;
mod supervision;
mod upload_slots;

pub use options::Options;
pub use report::Progress;
pub use running::{Coordinator, CoordinatorError, RunningCoordinator, Services};
pub use service::ControlService;

//! The farm's protocol: `farm.proto`, the code generated from it, and how a client connects.
//! Its limits are `limits::protocol`.
//!
//! This is the only crate that names generated types; the others use what is re-exported here.
//! Messages carry plain bytes and numbers: what they mean is checked by whoever receives them.

pub mod client;

use limits::protocol;

/// Generated from `farm.proto`, whose comments document it.
#[allow(
    missing_docs,
    unused_qualifications,
    clippy::all,
    reason = "generated code"
)]
mod generated {
    tonic::include_proto!("brdfarm.v1");
}

pub use generated::{
    BarWorkerRequest, BarWorkerResponse, CancelJobsRequest, Check, CompleteRequest,
    CompleteResponse, Counts, DeregisterRequest, DeregisterResponse, Disputed, DrainRequest,
    ErrorStatistics, Event, FailRequest, FailResponse, FindMissingBlobsRequest,
    FindMissingBlobsResponse, GetBlobRequest, GetBlobResponse, GetDatasetRequest,
    GetDatasetResponse, GetMeshRequest, GetMeshResponse, GetUploadUrlsRequest,
    GetUploadUrlsResponse, Header, Job, JobDetail, JobFailure, JobSelection, JobState, JobsChanged,
    LeaseRequest, LeaseResponse, ListJobsRequest, ListJobsResponse, ListWorkersRequest,
    ListWorkersResponse, MaterialRange, Mode, ModeChanged, PauseRequest, PixelStatistics,
    PrioritizeJobsRequest, PutBlobRequest, PutBlobResponse, RegisterRequest, RegisterResponse,
    RenewRequest, RenewResponse, Renewal, ResumeRequest, RetryJobsRequest, SetAside, StatusRequest,
    StatusResponse, UnbarWorkerRequest, UnbarWorkerResponse, Upload, UploadUrl, View,
    WatchEventsRequest, WorkerDetail, WorkerFailure,
};

/// What a coordinator implements for people, one method a call.
pub use generated::control_server::Control;
/// Wraps a [`Control`] as a service; [`control_server`] applies the limits.
pub use generated::control_server::ControlServer;
/// What a coordinator implements for workers, one method a call.
pub use generated::farm_server::Farm;
/// Wraps a [`Farm`] as a service; [`farm_server`] applies the limits.
pub use generated::farm_server::FarmServer;

/// `farm.proto`, compiled: what the reflection service tells of it.
pub const DESCRIPTORS: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/farm.bin"));

/// A worker's client over an HTTP/2 channel; [`client::farm`] makes one.
pub type FarmClient = generated::farm_client::FarmClient<client::Channel>;

/// A person's client over an HTTP/2 channel; [`client::control`] makes one.
pub type ControlClient = generated::control_client::ControlClient<client::Channel>;

/// A client of the standard health service.
pub type HealthClient = tonic_health::pb::health_client::HealthClient<client::Channel>;
pub use tonic_health::pb::{HealthCheckRequest, health_check_response::ServingStatus};

/// The service for workers over `farm`, with the message limits of [`protocol`].
pub fn farm_server<F: Farm>(farm: F) -> FarmServer<F> {
    FarmServer::new(farm)
        .max_decoding_message_size(protocol::MESSAGE_BYTES_MAX)
        .max_encoding_message_size(protocol::MESSAGE_BYTES_MAX)
}

/// The service for people over `control`, with the message limits of [`protocol`].
pub fn control_server<C: Control>(control: C) -> ControlServer<C> {
    ControlServer::new(control)
        .max_decoding_message_size(protocol::CONTROL_MESSAGE_BYTES_MAX)
        .max_encoding_message_size(protocol::MESSAGE_BYTES_MAX)
}

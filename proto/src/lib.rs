//! The farm's protocol: `farm.proto`, the code generated from it, its limits, and how a client
//! connects.
//!
//! This is the only crate that names generated types; the others use what is re-exported here.
//! Messages carry plain bytes and numbers: what they mean is checked by whoever receives them.

pub mod client;
pub mod limits;

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
    CompleteRequest, CompleteResponse, Counts, DeregisterRequest, DeregisterResponse,
    ErrorStatistics, FailRequest, FailResponse, FindMissingBlobsRequest, FindMissingBlobsResponse,
    GetDatasetRequest, GetDatasetResponse, Job, LeaseRequest, LeaseResponse, PutBlobRequest,
    PutBlobResponse, RegisterRequest, RegisterResponse, RenewRequest, RenewResponse, Renewal,
    SetAside, StatusRequest, StatusResponse, View,
};

/// What a coordinator implements, one method a call.
pub use generated::farm_server::Farm;
/// Wraps a [`Farm`] as a service; [`server`] applies the limits.
pub use generated::farm_server::FarmServer;

/// A client over an HTTP/2 channel; [`client::connect_lazily`] makes one.
pub type FarmClient = generated::farm_client::FarmClient<tonic::transport::Channel>;

/// The service over `farm`, with the message limits of [`limits`].
pub fn server<F: Farm>(farm: F) -> FarmServer<F> {
    FarmServer::new(farm)
        .max_decoding_message_size(limits::MESSAGE_BYTES_MAX)
        .max_encoding_message_size(limits::MESSAGE_BYTES_MAX)
}

//! The gRPC services: they check what messages carry, call the farm, and give each error its
//! status.

mod control;
mod farm;
mod refusal;

pub use control::ControlService;
pub(crate) use farm::FarmService;
pub(crate) use refusal::refuse;

use dataset::Digest;
use jobqueue::token::{Token, WorkerId};
use refusal::invalid;
use tonic::{Response, Status};

type Answer<T> = Result<Response<T>, Status>;

fn token(bytes: &[u8]) -> Result<Token, Status> {
    let name = Token::from_message(bytes);
    name.ok_or_else(|| wrong_length("token", limits::protocol::TOKEN_BYTES, bytes))
}

fn worker(bytes: &[u8]) -> Result<WorkerId, Status> {
    let name = WorkerId::from_message(bytes);
    name.ok_or_else(|| wrong_length("worker_id", limits::protocol::TOKEN_BYTES, bytes))
}

fn digest(field: &str, bytes: &[u8]) -> Result<Digest, Status> {
    let digest = bytes.try_into().map(Digest::from_bytes);
    digest.map_err(|_| wrong_length(field, limits::protocol::DIGEST_BYTES, bytes))
}

fn wrong_length(field: &str, expected: usize, bytes: &[u8]) -> Status {
    let found = bytes.len();
    invalid(
        field,
        &format!("{field} has {expected} bytes, and this has {found}"),
    )
}

fn message_digest(digest: &Digest) -> Vec<u8> {
    digest.as_bytes().to_vec()
}

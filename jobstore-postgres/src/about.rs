//! What is said of a database, whoever asks it.

use jobqueue::Completion;
use thiserror::Error;

/// Whether a store's name is a database's.
pub fn is_database(store: &str) -> bool {
    ["postgres://", "postgresql://"]
        .iter()
        .any(|scheme| store.starts_with(scheme))
}

/// Why a database cannot be used.
#[derive(Debug, Error)]
pub enum DatabaseError {
    /// Its URL makes no sense, and is not repeated: it may have a password.
    #[error(
        "a database is named as postgres://USER@HOST:PORT/DATABASE, with %40 for an @ in a password \
         and the like: {0}"
    )]
    Name(String),
    /// This program has no client for it.
    #[error(
        "this program was built without PostgreSQL: build it with `--features cluster`, or take the \
         Python package or the container, which have it"
    )]
    NoClient,
    /// What its URL or the environment says of TLS makes no sense.
    #[error("{name}: {reason}")]
    Encryption {
        /// Its name, without a password.
        name: String,
        /// What is wrong.
        reason: String,
    },
    /// The server has no such database.
    #[error("there is no database {0}: make it with `createdb`, or name another")]
    Missing(String),
    /// Nobody answers, or we are not let in.
    #[error(
        "the database {name} cannot be reached: {reason}; see that it runs, and that host, port, \
         user and password are right"
    )]
    Unreachable {
        /// Its name, without a password.
        name: String,
        /// What it or the system said.
        reason: String,
    },
    /// Its schema is of an older program.
    #[error(
        "the database {0} has the tables of an older brdfarm: start a coordinator on it, which \
         brings them up to date"
    )]
    Older(String),
    /// A store is being copied from it, or into it.
    #[error("`brdfarm store migrate` is at work on {0}: wait until it ends")]
    Moving(String),
    /// It does not do what it is asked.
    #[error("the database {name} cannot be used: {reason}")]
    Away {
        /// Its name, without a password.
        name: String,
        /// What it or the system said.
        reason: String,
    },
}

/// The mesh of a dataset's sample, to be kept beside its identity.
#[derive(Clone, Copy, Debug)]
pub struct MeshBytes<'a> {
    /// The digest by which the specification names it.
    pub digest: [u8; 32],
    /// The bytes of its file.
    pub bytes: &'a [u8],
}

/// What a database is about.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Identity {
    /// The version of the renderer of its images.
    pub renderer_version: String,
    /// The digest of its specification, 32 bytes.
    pub specification_hash: Vec<u8>,
    /// As JSON; its number of materials is the largest ever asked for.
    pub specification: String,
    /// Where the images are.
    pub blobs: String,
    /// The store that it is being made a copy of, while not all of it is there.
    pub migrating_from: Option<String>,
}

/// A completion that is to be recorded.
#[derive(Clone, Copy, Debug)]
pub struct Amendment<'a> {
    /// What is to be recorded.
    pub completion: &'a Completion,
    /// What counts now, as far as whoever amends it knows: where that is no longer so, nothing is
    /// done.
    pub before: Option<&'a Completion>,
}

/// Who is at work on a database.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Live {
    /// Workers heard of lately.
    pub workers: u32,
    /// Leases that have not run out.
    pub leases: u32,
}

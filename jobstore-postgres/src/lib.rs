//! The job store on PostgreSQL, for any number of coordinators.
//!
//! Every operation is one short transaction: it locks the rows that it touches, builds a queue of
//! those jobs alone, runs the transition of [`jobqueue`] on it, writes what changed and
//! commits. The time is the database's.
//!
//! Architecture invariant: transactions run in two ways. Claims, renewals and completions run
//! beside each other, under a shared advisory lock, and write nothing but jobs that they locked,
//! and what belongs to those: leases, completions, images. All else, where many jobs or a worker's
//! history may change, runs alone, under the same lock taken exclusively. So the outcome is that of
//! some order of the operations, one after the other, and nobody waits in a circle. Commands that
//! write do so alone as well, one command at a time.
//!
//! | advisory lock, beside the schema's name | whose |
//! | --- | --- |
//! | 1651663974 | every transaction's, shared or not |
//! | 1651663975 | whoever looks for leases that ran out |
//! | 1651663976 | a command that writes, for as long as it runs |
//! | 1651663977 | a copy being made from or to here: coordinators do not start |
//!
//! | table | what |
//! | --- | --- |
//! | `jobs` | the record of each job, and columns for the indices |
//! | `leases` | the times of leases, in narrow rows that renewals change in place |
//! | `workers`, `sessions` | histories by name; who is there |
//! | `completions`, `images` | what was delivered |
//! | `tallies` | how many jobs are in which stage, counted in the same transactions |

//!
//! Without the feature `postgres` the crate compiles without a client for PostgreSQL, and a database
//! is refused when it is named.

mod about;
#[cfg(feature = "postgres")]
mod connecting;
#[cfg(feature = "postgres")]
mod encryption;
#[cfg(feature = "postgres")]
mod fault;
#[cfg(feature = "postgres")]
mod job_store;
#[cfg(feature = "postgres")]
mod listing;
#[cfg(feature = "postgres")]
mod locked_jobs;
#[cfg(feature = "postgres")]
mod maintenance;
#[cfg(feature = "postgres")]
mod meshes;
#[cfg(feature = "postgres")]
mod moving;
#[cfg(any(test, not(feature = "postgres")))]
#[cfg_attr(
    feature = "postgres",
    allow(dead_code, reason = "its test is all that runs of it")
)]
mod no_client;
#[cfg(feature = "postgres")]
mod operating;
#[cfg(feature = "postgres")]
mod registering;
#[cfg(feature = "postgres")]
mod rows;
#[cfg(feature = "postgres")]
mod schema;
#[cfg(feature = "postgres")]
mod snapshot;
#[cfg(feature = "postgres")]
mod sweeping;
#[cfg(feature = "testing")]
#[allow(clippy::unwrap_used, reason = "for tests alone")]
pub mod testing;
#[cfg(test)]
#[cfg(feature = "postgres")]
mod tests;
#[cfg(feature = "postgres")]
mod turns;
#[cfg(feature = "postgres")]
mod window;
#[cfg(feature = "postgres")]
mod writing;

pub use about::{Amendment, DatabaseError, Identity, Live, MeshBytes, is_database};
#[cfg(not(feature = "postgres"))]
pub use no_client::{Database, MaintenanceSession, job_store, without_secrets};
#[cfg(feature = "postgres")]
pub use {
    connecting::{Database, without_secrets},
    job_store::{PostgresJobStore, PresenceLimits, job_store},
    maintenance::MaintenanceSession,
};

#[cfg(feature = "postgres")]
use job_store::Shared;

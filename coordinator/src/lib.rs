//! The coordinator: ledger, blob store, leases, gRPC service, verification, repair.
//!
//! | module | what |
//! | --- | --- |
//! | [`queue`] | the jobs' state machine: no sockets, no clock, no input or output |
//! | `board` | every transition of the queue, made durable |
//! | [`ledger`] | jobs, completions and the index of images, in sled |
//! | [`completion_log`] | one checksummed line a completed material, from which a ledger is rebuilt |
//! | [`blobs`] | images by digest, in files or in a bucket |
//! | [`bucket`] | objects of S3, Google Cloud Storage or Azure |
//! | [`store`] | one folder with all three, for one writer and any number of readers; or a database |
//! | `postgres` | the board on PostgreSQL, for any number of coordinators |
//! | [`shared_store`] | a database, and a place for images, that they share |
//! | [`acceptance`] | what counts as an image of the dataset |
//! | [`verify`] | every image present, intact and what it says it is |
//! | [`repair`] | what `verify` finds is rendered again |
//! | [`migration`] | a store copied into another |
//! | [`garbage`] | files among the images that nothing names |
//! | [`security`] | who may call, and how much a stranger can cost |
//! | [`limits`] | every limit, with its unit |
//!
//! Never imports the renderer: a coordinator needs neither Embree nor a fast machine.

pub mod acceptance;
pub mod blobs;
mod board;
pub mod bucket;
mod commit;
mod completion;
pub mod completion_log;
mod farm;
mod file_error;
pub mod garbage;
mod group;
mod hands;
pub mod ledger;
pub mod limits;
mod metrics;
pub mod migration;
mod postgres;
pub mod queue;
mod rate;
mod recovery;
pub mod repair;
mod roster;
mod running;
pub mod security;
mod service;
pub mod shared_store;
mod staging;
pub mod store;
pub mod token;
pub mod verify;

pub use bucket::{Bucket, BucketUrl};
pub use completion::Completion;
pub use farm::Progress;
pub use file_error::FileError;
pub use queue::Policy;
pub use recovery::Recovery;
pub use running::{AnyStore, Coordinator, CoordinatorError, Options, RunningCoordinator, Services};
pub use shared_store::{BlobsPlace, SharedStore, SharedStoreError};
pub use store::{ImageFault, ReadOnlyStore, Store, StoreError, StoreName, WritableStore};

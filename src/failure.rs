//! What a failure tells the shell.

use crate::shutdown::{self, Stopped};
use crate::standard_error::report;
use coordinator::CoordinatorError;
use dataset::{IndexListError, SpecificationError};
use datastore::shared::DatabaseError;
use datastore::{SharedStoreError, StoreError};
use export::ExportError;
use export::diff::DiffError;
use export::import::ImportError;
use migrate::MigrationError;
use std::error::Error;
use std::io;
use std::process::ExitCode;
use worker::WorkerError;

/// The exit code of input that is wrong; 1 is everything else that went wrong.
const BAD_INPUT: u8 = 2;

/// Input that is wrong: its message is one sentence with the place.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct BadInput(pub String);

/// Reports an outcome on standard error and turns it into an exit code. A reader that has gone
/// away, as `head` does, is no failure.
pub fn exit_code(outcome: anyhow::Result<()>) -> ExitCode {
    let Err(error) = outcome else {
        return ExitCode::SUCCESS;
    };
    let reader_left = error.chain().any(|cause| {
        cause
            .downcast_ref::<io::Error>()
            .is_some_and(|cause| cause.kind() == io::ErrorKind::BrokenPipe)
    });
    if reader_left {
        return ExitCode::SUCCESS;
    }
    report(&message(&error));
    if error.chain().any(|cause| cause.is::<Stopped>()) {
        return ExitCode::from(shutdown::exit_code());
    }
    if error.chain().any(is_bad_input) {
        ExitCode::from(BAD_INPUT)
    } else {
        ExitCode::FAILURE
    }
}

/// The error with its causes, less those that the errors above them have told already.
fn message(error: &anyhow::Error) -> String {
    let mut message = error.to_string();
    for cause in error.chain().skip(1).map(ToString::to_string) {
        if !message.ends_with(&cause) {
            message.push_str(": ");
            message.push_str(&cause);
        }
    }
    message
}

/// Whether another command line or another file would help.
fn is_bad_input(cause: &(dyn Error + 'static)) -> bool {
    #[cfg(feature = "training")]
    if let Some(error) = cause.downcast_ref() {
        use training::TrainingError::{Input, Manifest};
        return matches!(error, Input(_) | Manifest(_));
    }
    cause.is::<BadInput>()
        || cause.is::<SpecificationError>()
        || cause.is::<IndexListError>()
        || store_error(cause).is_some_and(is_bad_name)
        || cause.downcast_ref().is_some_and(is_bad_database)
        || matches!(
            cause.downcast_ref(),
            Some(MigrationError::Same(_) | MigrationError::SamePlace { .. })
        )
        || matches!(
            cause.downcast_ref(),
            Some(
                CoordinatorError::Exposed(_)
                    | CoordinatorError::ImageTooLarge { .. }
                    | CoordinatorError::Certificate(_)
            )
        )
        || matches!(cause.downcast_ref(), Some(WorkerError::Url(_)))
        || matches!(cause.downcast_ref(), Some(ImportError::Mesh { .. }))
        || matches!(
            cause.downcast_ref(),
            Some(
                ExportError::NoSuchView { .. }
                    | ExportError::NoMaterial(_)
                    | ExportError::Occupied { .. }
                    | ExportError::OtherExport { .. }
                    | ExportError::OtherExportInBucket { .. }
                    | ExportError::OtherTable { .. }
                    | ExportError::Rectify(_)
            )
        )
}

/// What is wrong with a store. Errors that speak for it are transparent: it is none of their
/// causes.
fn store_error<'a>(cause: &'a (dyn Error + 'static)) -> Option<&'a StoreError> {
    let of_import = || match cause.downcast_ref()? {
        ImportError::Store(error) => Some(error),
        _ => None,
    };
    let of_diff = || match cause.downcast_ref()? {
        DiffError::Store(error) => Some(error),
        _ => None,
    };
    let of_migration = || match cause.downcast_ref()? {
        MigrationError::Store(error) => Some(error),
        _ => None,
    };
    let store = cause.downcast_ref().or_else(of_import).or_else(of_diff);
    store.or_else(of_migration)
}

fn is_bad_name(error: &StoreError) -> bool {
    match error {
        StoreError::Absent(_)
        | StoreError::Occupied { .. }
        | StoreError::Specification { .. }
        | StoreError::OtherBlobs { .. }
        | StoreError::BlobsApart(_)
        | StoreError::Copy(_)
        | StoreError::ForeignBucket(_) => true,
        StoreError::Shared(error) => is_bad_database(error),
        _ => false,
    }
}

fn is_bad_database(error: &SharedStoreError) -> bool {
    matches!(
        error,
        SharedStoreError::Absent(_)
            | SharedStoreError::Copy(_)
            | SharedStoreError::Specification { .. }
            | SharedStoreError::BlobsUnknown(_)
            | SharedStoreError::Blobs { .. }
            | SharedStoreError::Database(
                DatabaseError::Name(_)
                    | DatabaseError::Missing(_)
                    | DatabaseError::Encryption { .. }
            )
    )
}

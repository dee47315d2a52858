//! Errors as gRPC statuses with details that programs can read: what kind (ErrorInfo), which field
//! (BadRequest), when to try again (RetryInfo).

use crate::farm::FarmError;
use imagestore::FileError;
use jobqueue::Refusal;
use jobstore::JobStoreError;
use limits::protocol::{ERROR_DOMAIN, RETRY_AFTER};
use std::{collections::HashMap, io};
use tonic::{Code, Status};
use tonic_types::{ErrorDetails, StatusExt};

/// A status whose details say what kind of error it is, and whether trying again can help.
pub(crate) fn refuse(code: Code, reason: &str, message: impl Into<String>) -> Status {
    let mut details = ErrorDetails::new();
    details.set_error_info(reason, ERROR_DOMAIN, HashMap::new());
    if is_momentary(code) {
        details.set_retry_info(Some(RETRY_AFTER));
    }
    Status::with_error_details(code, message, details)
}

/// Whether the same call may be answered later.
pub(super) fn is_momentary(code: Code) -> bool {
    matches!(code, Code::Unavailable | Code::ResourceExhausted)
}

/// The status of a message whose field is wrong.
pub(super) fn invalid(field: &str, reason: &str) -> Status {
    let mut details = ErrorDetails::new();
    details.set_error_info("INVALID_FIELD", ERROR_DOMAIN, HashMap::new());
    details.add_bad_request_violation(field, reason);
    Status::with_error_details(Code::InvalidArgument, reason, details)
}

/// The status of a message with more entries in a field than a call may have.
pub(super) fn too_many(field: &str, found: usize, max: usize) -> Status {
    invalid(
        field,
        &format!("a call has at most {max} {field}, and this one has {found}"),
    )
}

impl From<FarmError> for Status {
    fn from(error: FarmError) -> Self {
        let (code, reason) = kind(&error);
        let message = error.to_string();
        if code == Code::Internal {
            tracing::error!(message, "a call failed");
        }
        refuse(code, reason, message)
    }
}

fn kind(error: &FarmError) -> (Code, &'static str) {
    match error {
        FarmError::JobStore(error) => job_store_kind(error),
        FarmError::Image { .. } | FarmError::Rejected(_) => {
            (Code::InvalidArgument, "IMAGE_REJECTED")
        }
        FarmError::Invalid(_) => (Code::InvalidArgument, "INVALID_MESSAGE"),
        FarmError::Incompatible(_) => (Code::FailedPrecondition, "INCOMPATIBLE"),
        FarmError::ByUrl => (Code::FailedPrecondition, "UPLOAD_BY_URL"),
        FarmError::NotByUrl => (Code::FailedPrecondition, "UPLOAD_BY_CALL"),
        FarmError::Bucket(_) => (Code::Unavailable, "BUCKET_AWAY"),
        FarmError::UnknownWorker(_) => (Code::NotFound, "UNKNOWN_WORKER"),
        FarmError::NotItsId(_) => (Code::PermissionDenied, "NOT_ITS_ID"),
        FarmError::NotBlocked(_) => (Code::NotFound, "NOT_BARRED"),
        FarmError::UnknownBlob(_) => (Code::NotFound, "UNKNOWN_IMAGE"),
        FarmError::DamagedBlob(_) => (Code::DataLoss, "DAMAGED_IMAGE"),
        FarmError::TooManyWorkers(_) => (Code::ResourceExhausted, "TOO_MANY_WORKERS"),
        FarmError::TooManyReaders(_) => (Code::ResourceExhausted, "TOO_MANY_READERS"),
        FarmError::StagingFull(_) => (Code::ResourceExhausted, "STAGING_FULL"),
        FarmError::File(error) if is_full(error) => (Code::ResourceExhausted, "DISK_FULL"),
        FarmError::Interrupted => (Code::Unavailable, "INTERRUPTED"),
        FarmError::File(_) | FarmError::Random(_) => (Code::Internal, "SYSTEM"),
    }
}

fn job_store_kind(error: &JobStoreError) -> (Code, &'static str) {
    match error {
        JobStoreError::Refused(Refusal::UnknownMaterial(_)) => {
            (Code::InvalidArgument, "UNKNOWN_MATERIAL")
        }
        JobStoreError::Refused(Refusal::LeaseLost(_)) => (Code::FailedPrecondition, "LEASE_LOST"),
        JobStoreError::Refused(Refusal::Conflict(_)) => (Code::AlreadyExists, "OTHER_IMAGES"),
        JobStoreError::NotDurable(_) => (Code::Unavailable, "STORE_CLOSED"),
        JobStoreError::Unavailable(_) => (Code::Unavailable, "DATABASE_AWAY"),
        JobStoreError::File(error) if is_full(error) => (Code::ResourceExhausted, "DISK_FULL"),
        JobStoreError::File(_) => (Code::Internal, "SYSTEM"),
        // The farm publishes and tries again.
        JobStoreError::Unpublished(_) | JobStoreError::Interrupted => {
            (Code::Unavailable, "INTERRUPTED")
        }
        JobStoreError::Ledger(_) => (Code::Internal, "SYSTEM"),
    }
}

fn is_full(error: &FileError) -> bool {
    matches!(
        error.source.kind(),
        io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded | io::ErrorKind::FileTooLarge
    )
}

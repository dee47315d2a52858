//! Errors as Python knows them, with the sentences that the command has.

use datastore::StoreError as RustStoreError;
use pyo3::{
    PyErr, create_exception,
    exceptions::{PyException, PyFileNotFoundError, PyOSError, PyRuntimeError, PyValueError},
};
use std::{fmt::Display, io};

create_exception!(
    brdfarm,
    StoreError,
    PyException,
    "A store, a manifest or an image in it cannot be used; the message says why."
);

/// Input that is wrong.
pub fn invalid(error: impl Display) -> PyErr {
    PyValueError::new_err(error.to_string())
}

/// Something of ours that failed.
pub fn failed(error: impl Display) -> PyErr {
    PyRuntimeError::new_err(error.to_string())
}

/// A store that cannot be used.
pub fn of_store(error: impl Display) -> PyErr {
    StoreError::new_err(error.to_string())
}

/// A store that cannot be opened.
pub fn of_opening(error: &RustStoreError) -> PyErr {
    match error {
        RustStoreError::Absent(_) => PyFileNotFoundError::new_err(error.to_string()),
        _ => of_store(error),
    }
}

/// A file that the system would not give.
pub fn of_file(error: &io::Error, sentence: impl Display) -> PyErr {
    let sentence = sentence.to_string();
    match error.kind() {
        io::ErrorKind::NotFound => PyFileNotFoundError::new_err(sentence),
        _ => PyOSError::new_err(sentence),
    }
}

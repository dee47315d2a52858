//! Why bytes are no image of a dataset.

use dataset::{Digest, IMAGE_HEADER_ATTRIBUTE};
use thiserror::Error;

/// Why bytes are no image of the dataset.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum Rejection {
    /// The bytes have another digest.
    #[error("the bytes have the digest {found}, not {named}")]
    Digest {
        /// What they were called.
        named: Digest,
        /// What they are.
        found: Digest,
    },
    /// The file cannot be read.
    #[error("the file is no EXR image that can be read: {0}")]
    Unreadable(String),
    /// The file's layout is not what the renderer writes.
    #[error("the image's {what} is {found}, but this dataset's is {expected}")]
    Layout {
        /// Which property.
        what: &'static str,
        /// As the file has it.
        found: String,
        /// As the dataset has it.
        expected: String,
    },
    /// The attribute that says which image it is is absent or malformed.
    #[error("the image's attribute {IMAGE_HEADER_ATTRIBUTE:?} {0}")]
    Attribute(String),
    /// The file's header is not, byte for byte, what the renderer writes.
    #[error("the image's file header {0}")]
    FileHeader(String),
    /// A pixel's value is no radiance.
    #[error("line {line} of the image has a value that is {what}")]
    Pixel {
        /// Counted from 0 at the top.
        line: usize,
        /// Not finite, or negative.
        what: &'static str,
    },
    /// It is an image, but of something else.
    #[error("the image's {what} is {found}, but it was sent as {expected}")]
    Identity {
        /// Which property.
        what: &'static str,
        /// As the file has it.
        found: String,
        /// As the job has it.
        expected: String,
    },
}

/// Refuses a property that is not what it has to be.
pub(crate) fn same<T: PartialEq + std::fmt::Debug>(
    what: &'static str,
    found: T,
    expected: T,
) -> Result<(), Rejection> {
    if found == expected {
        Ok(())
    } else {
        Err(layout(what, found, expected))
    }
}

/// That a property of the file's layout is not what it has to be.
pub(crate) fn layout(
    what: &'static str,
    found: impl std::fmt::Debug,
    expected: impl std::fmt::Debug,
) -> Rejection {
    Rejection::Layout {
        what,
        found: format!("{found:?}"),
        expected: format!("{expected:?}"),
    }
}

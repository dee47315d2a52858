//! Why something cannot be shown or done. `pages` shows it.

use http::StatusCode;
use tonic::{Code, Status};

/// Why something cannot be shown or done: an HTTP status and a sentence.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Problem {
    /// The status.
    pub status: StatusCode,
    /// What is wrong and what to do, for people.
    pub sentence: String,
}

impl Problem {
    /// The request makes no sense.
    pub fn bad(sentence: impl Into<String>) -> Self {
        Self::new(StatusCode::BAD_REQUEST, sentence)
    }

    /// There is no such thing.
    pub fn absent(sentence: impl Into<String>) -> Self {
        Self::new(StatusCode::NOT_FOUND, sentence)
    }

    /// The caller may not.
    pub fn forbidden(sentence: impl Into<String>) -> Self {
        Self::new(StatusCode::FORBIDDEN, sentence)
    }

    /// It was there, or should be, and is not as it was.
    pub fn gone(sentence: impl Into<String>) -> Self {
        Self::new(StatusCode::GONE, sentence)
    }

    /// Too many ask at one time.
    pub fn busy(what: &str) -> Self {
        let sentence = format!("{what}: try again in a moment");
        Self::new(StatusCode::SERVICE_UNAVAILABLE, sentence)
    }

    /// Something here does not work.
    pub fn broken(sentence: impl Into<String>) -> Self {
        Self::new(StatusCode::INTERNAL_SERVER_ERROR, sentence)
    }

    fn new(status: StatusCode, sentence: impl Into<String>) -> Self {
        Self {
            status,
            sentence: sentence.into(),
        }
    }
}

/// What the coordinator refused.
impl From<Status> for Problem {
    fn from(status: Status) -> Self {
        let sentence = status.message().to_owned();
        match status.code() {
            Code::InvalidArgument | Code::OutOfRange => Self::bad(sentence),
            Code::NotFound | Code::FailedPrecondition => Self::absent(sentence),
            Code::ResourceExhausted | Code::Unavailable => Self::busy(&sentence),
            _ => Self::broken(sentence),
        }
    }
}

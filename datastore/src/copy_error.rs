//! Why a store cannot be the target of a copy.

use dataset::Digest;
use thiserror::Error;

/// Why a store cannot be the target of a copy, or only of one particular copy.
#[derive(Debug, Error)]
pub enum CopyError {
    /// It is an unfinished copy.
    #[error("{name} is an unfinished copy: `brdfarm store migrate {from} {name}` completes it")]
    Half {
        /// The store.
        name: String,
        /// What it is a copy of.
        from: String,
    },
    /// It is an unfinished copy of something else.
    #[error(
        "{name} is an unfinished copy of {found}, not of {given}: complete that copy, or choose \
         another target"
    )]
    Other {
        /// The store.
        name: String,
        /// What it is a copy of: a store, and its specification.
        found: String,
        /// What was to be copied.
        given: String,
    },
    /// It is a store.
    #[error("{0} is already a store: choose an empty place for the copy, or a new one")]
    Taken(String),
}

impl CopyError {
    /// For an unfinished copy of `found` that was to become a copy of `given`; each is a store with
    /// its specification.
    pub fn other(name: String, found: (&str, Digest), given: (&str, Digest)) -> Self {
        let told = |(store, hash)| format!("{store} with specification {hash}");
        Self::Other {
            name,
            found: told(found),
            given: told(given),
        }
    }
}

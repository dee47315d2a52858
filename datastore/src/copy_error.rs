//! Why a store is no target of a copy.

use dataset::Digest;
use thiserror::Error;

/// Why a store is no target of a copy, or only of one.
#[derive(Debug, Error)]
pub enum CopyError {
    /// It is half of a copy.
    #[error("{name} is half of a copy: `brdfarm store migrate {from} {name}` goes on with it")]
    Half {
        /// The store.
        name: String,
        /// What it is a copy of.
        from: String,
    },
    /// It is half of a copy of something else.
    #[error(
        "{name} is half of a copy of {found}, not of {given}: go on with that, or choose another \
         target"
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
    #[error("{0} is a store already: choose an empty place for the copy, or a new one")]
    Taken(String),
}

impl CopyError {
    /// Of a store that is half of a copy of one of these two, each a store with its specification,
    /// and was to become one of the other.
    pub fn other(name: String, found: (&str, Digest), given: (&str, Digest)) -> Self {
        let told = |(store, hash)| format!("{store} with specification {hash}");
        Self::Other {
            name,
            found: told(found),
            given: told(given),
        }
    }
}

//! A store of either kind, open for a coordinator.

use crate::{SharedStore, Store};
use dataset::Specification;

/// What a coordinator serves.
pub enum AnyStore {
    /// A folder, which is its alone.
    Own(Box<Store>),
    /// A database, beside other coordinators. What was quarantined stays so until an operator says
    /// otherwise: coordinators come and go.
    Shared(Box<SharedStore>),
}

impl AnyStore {
    /// The specification; its number of materials is the largest ever asked for.
    pub fn specification(&self) -> &Specification {
        match self {
            Self::Own(store) => store.specification(),
            Self::Shared(store) => store.specification(),
        }
    }
}

impl From<Store> for AnyStore {
    fn from(store: Store) -> Self {
        Self::Own(Box::new(store))
    }
}

impl From<SharedStore> for AnyStore {
    fn from(store: SharedStore) -> Self {
        Self::Shared(Box::new(store))
    }
}

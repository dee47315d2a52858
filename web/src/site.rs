//! What is shown: a store, and the farm that fills it, if there is one.

use crate::{catalogue::Catalogue, images::Images, live::LiveFarm, threads::Threads};
use coordinator::ControlService;
use dataset::{Digest, Specification};
use datastore::{ReadOnlyStore, StoreError, StoreName};
use limits::web::{PAGES_AT_ONCE, PAGES_WAITING_MAX};
use std::sync::Arc;

/// A store, ready to be looked at, and the farm at work on it, if there is one.
pub struct Site {
    pub(crate) specification: Arc<Specification>,
    pub(crate) specification_hash: Digest,
    pub(crate) store: StoreName,
    pub(crate) catalogue: Catalogue,
    pub(crate) images: Images,
    pub(crate) farm: Option<LiveFarm>,
    pub(crate) threads: Threads,
}

impl Site {
    /// Reads what is complete in a store. Blocks.
    ///
    /// # Errors
    /// When the store cannot be read.
    pub fn new(store: ReadOnlyStore) -> Result<Self, StoreError> {
        let specification = Arc::new(store.specification().clone());
        Ok(Self {
            specification_hash: store.specification_hash(),
            store: store.name().clone(),
            images: Images::new(Arc::clone(&specification), store.blobs().clone()),
            catalogue: Catalogue::new(store)?,
            specification,
            farm: None,
            threads: Threads::new(PAGES_AT_ONCE, PAGES_WAITING_MAX),
        })
    }

    /// The same with the farm that fills the store.
    pub fn with_farm(mut self, control: ControlService) -> Self {
        self.farm = Some(LiveFarm::new(control));
        self
    }
}

//! The completed materials of a store, in memory: labels and what was measured of each, to be
//! filtered and sorted without reading the store.

mod entry;
mod filter;

pub use entry::{Entry, FIELDS, Field};
pub use filter::{Filter, FilterError};

use datastore::{ReadOnlyStore, StoreError};
use jobqueue::Completion;
use limits::web::CATALOGUE_MATERIALS_MAX;
use std::{
    collections::BTreeMap,
    sync::{Arc, Mutex, PoisonError, RwLock},
};

/// The catalogue of one store. Everything that reads the store blocks.
pub struct Catalogue {
    // Also keeps two threads from looking for new materials at one time.
    store: Mutex<ReadOnlyStore>,
    listing: RwLock<Arc<Listing>>,
}

/// The completed materials at one time.
#[derive(Debug, Default)]
pub struct Listing {
    /// In the order of their indices.
    pub entries: Vec<Entry>,
    /// Whether there are more than the catalogue holds.
    pub is_cut: bool,
}

impl Catalogue {
    /// Reads what is complete.
    ///
    /// # Errors
    /// When the store cannot be read.
    pub fn new(store: ReadOnlyStore) -> Result<Self, StoreError> {
        let materials: Vec<u32> = store.materials_complete().collect();
        let listing = listing(&store, &Listing::default(), &materials)?;
        Ok(Self {
            store: Mutex::new(store),
            listing: RwLock::new(Arc::new(listing)),
        })
    }

    /// The materials as they were when the store was last looked at.
    pub fn listing(&self) -> Arc<Listing> {
        Arc::clone(&self.listing.read().unwrap_or_else(PoisonError::into_inner))
    }

    /// A material's completion, if it is complete.
    ///
    /// # Errors
    /// When the store cannot be read.
    pub fn completion(&self, material: u32) -> Result<Option<Completion>, StoreError> {
        Ok(self.store().completion(material)?)
    }

    /// Looks for materials that were completed since. Returns which changed.
    ///
    /// # Errors
    /// When the store cannot be read.
    pub fn refresh(&self) -> Result<Vec<u32>, StoreError> {
        let mut store = self.store();
        let changed = store.refresh()?;
        if changed.is_empty() {
            return Ok(changed);
        }
        let listing = listing(&store, &self.listing(), &changed)?;
        *self.listing.write().unwrap_or_else(PoisonError::into_inner) = Arc::new(listing);
        Ok(changed)
    }

    // Nothing that runs under the lock panics half way through a change.
    fn store(&self) -> std::sync::MutexGuard<'_, ReadOnlyStore> {
        self.store.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The listing that `before` becomes when these materials changed.
fn listing(
    store: &ReadOnlyStore,
    before: &Listing,
    changed: &[u32],
) -> Result<Listing, StoreError> {
    let kept = before.entries.iter().cloned();
    let mut entries: BTreeMap<u32, Entry> = kept.map(|entry| (entry.material, entry)).collect();
    let mut is_cut = before.is_cut;
    for material in changed.iter().copied() {
        let Some(completion) = store.completion(material)? else {
            entries.remove(&material);
            continue;
        };
        if entries.len() >= CATALOGUE_MATERIALS_MAX && !entries.contains_key(&material) {
            is_cut = true;
            continue;
        }
        entries.insert(material, Entry::new(store.specification(), &completion));
    }
    Ok(Listing {
        entries: entries.into_values().collect(),
        is_cut,
    })
}

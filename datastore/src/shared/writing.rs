//! A shared store open for a command that writes, beside coordinators at work.
//!
//! One command at a time has a database's lock of commands that write. What it records it records
//! alone, as operators' orders are, and only where what it knew still holds; so nobody waits for a
//! command longer than for a transaction, but where it says so.

use super::{BlobsPlace, SharedStore, SharedStoreError, waiting_runtime};
use crate::StoreName;
use dataset::{Digest, Specification};
use imagestore::blobs::Blobs;
use jobstore_postgres::{Amendment, MaintenanceSession};
use tokio::runtime::Runtime;

/// A store in a database, open for writing; no other command has it so. Every call waits, and none
/// can be made inside a runtime.
pub struct SharedWriter {
    url: String,
    store: SharedStore,
    maintenance: MaintenanceSession,
    // The last to go: connections end on it.
    runtime: Runtime,
}

impl SharedWriter {
    /// Opens the store that is there.
    pub fn open(url: &str) -> Result<Self, SharedStoreError> {
        let runtime = waiting_runtime()?;
        let store = runtime.block_on(SharedStore::open(url))?;
        Self::of(url, store, runtime)
    }

    /// Opens the store, or makes one.
    pub fn open_or_create(
        url: &str,
        specification: &Specification,
        blobs: Option<&BlobsPlace>,
    ) -> Result<Self, SharedStoreError> {
        let runtime = waiting_runtime()?;
        let store = runtime.block_on(SharedStore::open_or_create(url, specification, blobs))?;
        Self::of(url, store, runtime)
    }

    fn of(url: &str, store: SharedStore, runtime: Runtime) -> Result<Self, SharedStoreError> {
        let maintenance = runtime.block_on(MaintenanceSession::begin(&store.database))?;
        let maintenance =
            maintenance.ok_or_else(|| SharedStoreError::Locked(store.name().to_owned()))?;
        Ok(Self {
            url: url.to_owned(),
            store,
            maintenance,
            runtime,
        })
    }

    /// What it was opened by.
    pub fn name(&self) -> StoreName {
        StoreName::Database(self.url.clone())
    }

    /// Puts images under their names, durably. Nobody removes them before they are recorded: that
    /// takes the lock that this command has.
    pub fn put_images(&self, images: &[(Digest, Vec<u8>)]) -> Result<(), SharedStoreError> {
        Ok(self.store.blobs.put(images)?)
    }

    /// Records completions whose images are there; of each says whether it was recorded.
    pub fn amend(&mut self, amendments: &[Amendment<'_>]) -> Result<Vec<bool>, SharedStoreError> {
        Ok(self.runtime.block_on(self.maintenance.amend(amendments))?)
    }

    /// Does something while nobody can name an image that is not named now.
    ///
    /// Images are named by completions, which count under a lease only: its row is there until the
    /// transaction that names the images, under the shared lock, removes it; and by commands that
    /// write, of which this is the only one. So while this holds that lock exclusively, and there
    /// is no lease, an image that no completion names stays so, wherever its worker and its
    /// coordinator are with it: they find the lease lost, and whoever gets the next one is told
    /// what is missing. That a lease is lost or ended before it is taken back is not enough:
    /// until then it counts. Coordinators wait meanwhile.
    pub fn undisturbed<T, E: From<SharedStoreError>>(
        &mut self,
        work: impl FnOnce(&Blobs) -> Result<T, E>,
    ) -> Result<T, E> {
        let excluded = self.runtime.block_on(self.maintenance.exclude());
        let done = match excluded.map_err(SharedStoreError::from)? {
            0 => work(&self.store.blobs),
            leases => {
                let name = self.store.name().to_owned();
                Err(SharedStoreError::Leased { name, leases }.into())
            }
        };
        let admitted = self.runtime.block_on(self.maintenance.admit());
        admitted.map_err(SharedStoreError::from)?;
        done
    }
}

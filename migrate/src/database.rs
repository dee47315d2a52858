//! A store in a database that holds still.

use super::{Entry, FrozenStore, KeptFarm, MigrationError, PAGE_JOBS, Page};
use dataset::Specification;
use datastore::{BlobsPlace, SharedStore, SharedStoreError, StoreName, shared};
use imagestore::blobs::Blobs;
use jobstore_postgres::{Live, MaintenanceSession};
use std::fs::File;
use tokio::runtime::Runtime;

pub struct Database {
    name: StoreName,
    blobs: Blobs,
    maintenance: MaintenanceSession,
    // Held for as long as images may be staged.
    _staging_lock: Option<File>,
    // The last to go: the connection ends on it.
    runtime: Runtime,
}

impl Database {
    /// One to copy from. Its coordinators, if there are any, wait until this ends.
    pub fn source(url: &str) -> Result<(Self, Specification, BlobsPlace), MigrationError> {
        let name = StoreName::Database(url.to_owned());
        let runtime = shared::waiting_runtime()?;
        let (specification, place, maintenance, live) = runtime.block_on(async {
            let (database, specification, place) = shared::snapshot(url).await?;
            let maintenance = MaintenanceSession::begin(&database).await?;
            let locked = || SharedStoreError::Locked(database.name().to_owned());
            let mut maintenance = maintenance.ok_or_else(locked)?;
            let live = maintenance.freeze().await?;
            Ok::<_, SharedStoreError>((specification, place, maintenance, live))
        })?;
        if live
            != (Live {
                workers: 0,
                leases: 0,
            })
        {
            let Live { workers, leases } = live;
            return Err(MigrationError::AtWork {
                name,
                workers,
                leases,
            });
        }
        let database = Self {
            name,
            blobs: place.for_readers()?,
            maintenance,
            _staging_lock: None,
            runtime,
        };
        Ok((database, specification, place))
    }

    /// One to copy into.
    pub fn target(
        url: &str,
        specification: &Specification,
        blobs: Option<&BlobsPlace>,
        from: &str,
    ) -> Result<Self, MigrationError> {
        let runtime = shared::waiting_runtime()?;
        let begun = SharedStore::begin_copy(url, specification, blobs, from);
        let (store, maintenance) = runtime.block_on(begun)?;
        Ok(Self {
            name: StoreName::Database(url.to_owned()),
            blobs: store.blobs,
            maintenance,
            _staging_lock: store.staging_lock,
            runtime,
        })
    }
}

impl FrozenStore for Database {
    fn name(&self) -> &StoreName {
        &self.name
    }

    fn blobs(&self) -> &Blobs {
        &self.blobs
    }

    fn completed(&mut self) -> Result<u32, MigrationError> {
        Ok(self.runtime.block_on(self.maintenance.completed())?)
    }

    fn page(&mut self, from: u32) -> Result<Page, MigrationError> {
        Ok(self
            .runtime
            .block_on(self.maintenance.entries(from, PAGE_JOBS))?)
    }

    fn farm(&mut self) -> Result<KeptFarm, MigrationError> {
        Ok(self.runtime.block_on(self.maintenance.kept_farm())?)
    }

    fn write(&mut self, entries: &[Entry]) -> Result<(), MigrationError> {
        Ok(self
            .runtime
            .block_on(self.maintenance.write_entries(entries))?)
    }

    fn write_farm(&mut self, farm: &KeptFarm) -> Result<(), MigrationError> {
        Ok(self.runtime.block_on(self.maintenance.write_farm(farm))?)
    }

    // Every page is asked of the server.
    fn reopen(self: Box<Self>) -> Result<Box<dyn FrozenStore>, MigrationError> {
        Ok(self)
    }

    fn finish(mut self: Box<Self>) -> Result<(), MigrationError> {
        Ok(self.runtime.block_on(self.maintenance.note_migrated())?)
    }
}

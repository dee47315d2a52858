//! The database of a program that was built without a client: there is none.

use super::{Amendment, DatabaseError, Identity, Live, MeshBytes};
use jobqueue::Policy;
use jobstore::{
    JobStore, JobStoreContext, JobStoreError, Meter,
    kept::{Entry, KeptFarm, Page},
};
use std::{convert::Infallible, sync::Arc};

/// A database that cannot exist.
#[derive(Clone)]
pub struct Database(Infallible);

/// A session that cannot exist.
pub struct MaintenanceSession(Infallible);

/// What of a database's URL may be shown: without a client to take it apart, nothing.
pub fn without_secrets(_: &str) -> String {
    "postgres://...".to_owned()
}

/// A job store over a database that cannot exist.
pub async fn job_store(
    database: Database,
    _: Policy,
    _: Arc<dyn Meter>,
    _: Arc<JobStoreContext>,
) -> Result<Arc<dyn JobStore>, JobStoreError> {
    match database.0 {}
}

impl Database {
    /// Says how to get a program that has a client.
    pub fn new(_: &str) -> Result<Self, DatabaseError> {
        Err(DatabaseError::NoClient)
    }

    /// The URL, without a password.
    pub fn name(&self) -> &str {
        match self.0 {}
    }

    /// What the database is about, its schema brought up to date.
    pub async fn open(&self) -> Result<Option<Identity>, DatabaseError> {
        match self.0 {}
    }

    /// Makes the database about a dataset.
    pub async fn make(
        &self,
        _: &Identity,
        _: Option<MeshBytes<'_>>,
        _: u32,
    ) -> Result<(), DatabaseError> {
        match self.0 {}
    }

    /// Keeps a mesh again.
    pub async fn restore_mesh(&self, _: MeshBytes<'_>, _: &[u8]) -> Result<(), DatabaseError> {
        match self.0 {}
    }

    /// The bytes of a mesh.
    pub async fn mesh(&self, _: &[u8], _: u64) -> Result<Option<Vec<u8>>, DatabaseError> {
        match self.0 {}
    }

    /// What the database is about.
    pub async fn snapshot(&self) -> Result<Option<Identity>, DatabaseError> {
        match self.0 {}
    }

    /// Tells every completion that counts.
    pub async fn completions<T, E: From<DatabaseError>>(
        &self,
        _: &[u32],
        _: impl FnOnce(Option<Identity>) -> Result<T, E>,
        _: &mut dyn FnMut(&str) -> Result<(), E>,
    ) -> Result<T, E> {
        match self.0 {}
    }
}

impl MaintenanceSession {
    /// Takes the lock of commands that write.
    pub async fn begin(database: &Database) -> Result<Option<Self>, DatabaseError> {
        match database.0 {}
    }

    /// Records completions.
    pub async fn amend(&mut self, _: &[Amendment<'_>]) -> Result<Vec<bool>, DatabaseError> {
        match self.0 {}
    }

    /// Keeps every transaction of every coordinator waiting.
    pub async fn exclude(&mut self) -> Result<u32, DatabaseError> {
        match self.0 {}
    }

    /// Lets the others go on.
    pub async fn admit(&mut self) -> Result<(), DatabaseError> {
        match self.0 {}
    }

    /// Keeps coordinators from starting.
    pub async fn freeze(&mut self) -> Result<Live, DatabaseError> {
        match self.0 {}
    }

    /// Makes the database about a dataset.
    pub async fn make(
        &mut self,
        _: &Identity,
        _: Option<MeshBytes<'_>>,
        _: u32,
    ) -> Result<(), DatabaseError> {
        match self.0 {}
    }

    /// How many jobs are complete.
    pub async fn completed(&mut self) -> Result<u32, DatabaseError> {
        match self.0 {}
    }

    /// Jobs, page after page.
    pub async fn entries(&mut self, _: u32, _: usize) -> Result<Page, DatabaseError> {
        match self.0 {}
    }

    /// Records jobs.
    pub async fn write_entries(&mut self, _: &[Entry]) -> Result<(), DatabaseError> {
        match self.0 {}
    }

    /// What is kept of the farm.
    pub async fn kept_farm(&mut self) -> Result<KeptFarm, DatabaseError> {
        match self.0 {}
    }

    /// Records what is kept of the farm.
    pub async fn write_farm(&mut self, _: &KeptFarm) -> Result<(), DatabaseError> {
        match self.0 {}
    }

    /// Notes that the copy is whole.
    pub async fn note_migrated(&mut self) -> Result<(), DatabaseError> {
        match self.0 {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_database_without_a_client_is_refused_and_its_url_is_not_repeated() {
        let url = "postgres://user:secret@host/database";
        let refusal = Database::new(url).err().unwrap().to_string();
        assert!(refusal.contains("--features cluster"), "{refusal}");
        assert!(!refusal.contains("secret"));
        assert_eq!(without_secrets(url), "postgres://...");
    }
}

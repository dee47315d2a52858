//! A shared store for those who only read.

use super::{BlobsPlace, SharedStoreError, identity, kept_mesh, waiting_runtime};
use dataset::Specification;
use imagestore::{FileError, blobs::Blobs};
use jobstore_postgres::Database;

/// What a store in a database is about, its images for readers, and every completion that counts,
/// told as JSON, but for the materials in `known`, all as it is at one instant. The mesh that the
/// specification names is not loaded ([`load_mesh`]). Waits; cannot be called inside a runtime.
pub fn read(
    url: &str,
    known: &[u32],
    tell: &mut dyn FnMut(&str) -> Result<(), FileError>,
) -> Result<(Specification, Blobs), SharedStoreError> {
    let database = Database::new(url)?;
    let runtime = waiting_runtime()?;
    let name = database.name();
    let mut tell = |line: &str| Ok(tell(line)?);
    let told = database.completions(known, |kept| identity::known(name, kept), &mut tell);
    let (specification, place) = runtime.block_on(told)?;
    Ok((specification, place.for_readers()?))
}

/// Loads the mesh that the specification of a store in a database names, where it names one. Waits;
/// cannot be called inside a runtime.
pub fn load_mesh(
    url: &str,
    specification: Specification,
) -> Result<Specification, SharedStoreError> {
    if specification.sample.mesh.is_none() {
        return Ok(specification);
    }
    let database = Database::new(url)?;
    let runtime = waiting_runtime()?;
    runtime.block_on(kept_mesh::load(&database, specification))
}

/// What a store in a database is about, and where its images are.
pub async fn snapshot(
    url: &str,
) -> Result<(Database, Specification, BlobsPlace), SharedStoreError> {
    let database = Database::new(url)?;
    let (specification, place) = identity::known(database.name(), database.snapshot().await?)?;
    let specification = kept_mesh::load(&database, specification).await?;
    Ok((database, specification, place))
}

//! The mesh of the sample of a dataset in a database: written in the transaction that names it.

use super::SharedStoreError;
use dataset::{Digest, Specification};
use jobstore_postgres::{Database, MeshBytes};
use mesh::limits::FILE_BYTES_MAX;

/// What a database is to keep of a specification's mesh, where it names one.
pub(super) fn bytes(
    specification: &Specification,
) -> Result<Option<MeshBytes<'_>>, SharedStoreError> {
    let Some(mesh) = &specification.sample.mesh else {
        return Ok(None);
    };
    let loaded = mesh.loaded();
    let loaded = loaded.ok_or_else(|| SharedStoreError::MeshNotLoaded(mesh.digest()))?;
    Ok(Some(MeshBytes {
        digest: *mesh.digest().as_bytes(),
        bytes: loaded.bytes(),
    }))
}

/// Loads the mesh that the specification in a database names, where it names one.
pub(super) async fn load(
    database: &Database,
    specification: Specification,
) -> Result<Specification, SharedStoreError> {
    let Some(digest) = specification.sample.mesh.as_ref().map(|mesh| mesh.digest()) else {
        return Ok(specification);
    };
    let refused = |reason: String| SharedStoreError::Mesh {
        name: database.name().to_owned(),
        digest,
        reason,
    };
    let bytes = database.mesh(digest.as_bytes(), FILE_BYTES_MAX).await?;
    let bytes = bytes.ok_or_else(|| refused("is missing".to_owned()))?;
    let found = Digest::of(&bytes);
    if found != digest {
        return Err(refused(format!(
            "is damaged: its bytes have the digest {found}"
        )));
    }
    let loaded = specification.with_mesh(bytes);
    loaded.map_err(|error| refused(format!("cannot be used ({error})")))
}

/// Loads the mesh as [`load`] does. Where the database has lost it, it gets that of the specification that
/// was given, which is of the same hash and so names the same one.
pub(super) async fn load_or_restore(
    database: &Database,
    specification: Specification,
    given: &Specification,
) -> Result<Specification, SharedStoreError> {
    match load(database, specification.clone()).await {
        Err(SharedStoreError::Mesh { .. }) if given.sample.loaded_mesh().is_some() => {
            if let Some(mesh) = bytes(given)? {
                let hash = specification.hash();
                database.restore_mesh(mesh, hash.as_bytes()).await?;
            }
            load(database, specification).await
        }
        loaded => loaded,
    }
}

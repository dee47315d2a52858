//! What a database is about, compared with what is wanted of it.

use super::{BlobsPlace, SharedStoreError};
use crate::CopyError;
use dataset::{Digest, RENDERER_VERSION, Specification, specification::Differences};
use jobstore_postgres::Identity;

/// What a database is about, if it is one of this program's stores.
pub(super) fn known(
    name: &str,
    kept: Option<Identity>,
) -> Result<(Specification, BlobsPlace), SharedStoreError> {
    let kept = kept.ok_or_else(|| SharedStoreError::Absent(name.to_owned()))?;
    if let Some(from) = kept.migrating_from {
        let name = name.to_owned();
        return Err(CopyError::Half { name, from }.into());
    }
    if kept.renderer_version != RENDERER_VERSION {
        return Err(SharedStoreError::Renderer {
            name: name.to_owned(),
            found: kept.renderer_version,
        });
    }
    let damaged = |reason: String| SharedStoreError::Damaged {
        name: name.to_owned(),
        reason,
    };
    let specification = Specification::from_json(&kept.specification)
        .map_err(|error| damaged(error.to_string()))?;
    let hash = specification.hash();
    if kept.specification_hash != hash.as_bytes() {
        return Err(damaged(format!(
            "its specification has the hash {hash}, and it names another"
        )));
    }
    let place = kept.blobs.parse().map_err(damaged)?;
    Ok((specification, place))
}

/// Compares what a database is about with what is wanted of it; the specification that is then to
/// be there, and the place of the images.
pub(super) fn check(
    name: &str,
    kept: &Identity,
    wanted: &Specification,
    given: Option<BlobsPlace>,
) -> Result<(Specification, BlobsPlace), SharedStoreError> {
    let (mut specification, found) = known(name, Some(kept.clone()))?;
    if specification.hash() != wanted.hash() {
        return Err(SharedStoreError::Specification {
            name: name.to_owned(),
            differences: Differences::between(&specification, wanted),
        });
    }
    if let Some(given) = given
        && given != found
    {
        return Err(SharedStoreError::Blobs {
            name: name.to_owned(),
            found: Box::new(found),
            given: Box::new(given),
        });
    }
    specification.materials = specification.materials.max(wanted.materials);
    Ok((specification, found))
}

/// Refuses a database that is neither empty nor half of this copy.
pub(super) fn check_target(
    name: &str,
    kept: Option<&Identity>,
    specification: &Specification,
    from: &str,
) -> Result<(), SharedStoreError> {
    let Some(kept) = kept else {
        return Ok(());
    };
    let name = name.to_owned();
    let Some(found) = &kept.migrating_from else {
        return Err(CopyError::Taken(name).into());
    };
    let given_hash = specification.hash();
    let found_hash = <[u8; 32]>::try_from(kept.specification_hash.as_slice());
    let Ok(found_hash) = found_hash.map(Digest::from_bytes) else {
        let reason = "its specification has no hash".to_owned();
        return Err(SharedStoreError::Damaged { name, reason });
    };
    if found == from && found_hash == given_hash {
        return Ok(());
    }
    Err(CopyError::other(name, (found, found_hash), (from, given_hash)).into())
}

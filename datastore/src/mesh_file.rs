//! The mesh of a store in a folder: a file beside its identity, named by its digest.

use super::{StoreError, durable::write_durably};
use dataset::{Specification, specification::SampleMesh};
use std::{ffi::OsStr, path::Path};

/// Writes the mesh that a specification names, durably, where it names one. The identity follows:
/// whatever names the mesh finds it.
pub(super) fn write(store: &Path, specification: &Specification) -> Result<(), StoreError> {
    let Some(mesh) = &specification.sample.mesh else {
        return Ok(());
    };
    let loaded = mesh.loaded();
    let loaded = loaded.ok_or_else(|| StoreError::MeshNotLoaded(mesh.digest()))?;
    write_durably(&store.join(mesh.file_name()), loaded.bytes())?;
    Ok(())
}

/// Loads the mesh that the specification of a store names, where it names one.
pub(super) fn load(
    store: &Path,
    specification: Specification,
) -> Result<Specification, StoreError> {
    let Some(mesh) = &specification.sample.mesh else {
        return Ok(specification);
    };
    let file_name = mesh.file_name();
    let loaded = specification.with_mesh_in(store);
    loaded.map_err(|reason| StoreError::Mesh {
        file_name,
        reason: Box::new(reason),
    })
}

/// Loads the mesh as [`load`] does. Where the store has lost it, it gets that of the specification that was
/// given, which is of the same hash and so names the same one.
pub(super) fn load_or_restore(
    store: &Path,
    specification: Specification,
    given: &Specification,
) -> Result<Specification, StoreError> {
    match load(store, specification.clone()) {
        Err(StoreError::Mesh { .. }) if given.sample.loaded_mesh().is_some() => {
            write(store, given)?;
            load(store, specification)
        }
        loaded => loaded,
    }
}

/// Whether a file of this name is what writing a mesh leaves behind that was cut short.
pub(super) fn is_left_behind(name: &OsStr) -> bool {
    let Some(name) = name.to_str() else {
        return false;
    };
    SampleMesh::of_file_name(name.strip_suffix(".new").unwrap_or(name)).is_some()
}

#[cfg(test)]
mod tests {
    use super::*;
    use dataset::Digest;

    #[test]
    fn only_what_a_digest_names_was_left_behind() {
        let digest = Digest::of(b"mesh").to_string();
        for name in [format!("{digest}.mesh"), format!("{digest}.mesh.new")] {
            assert!(is_left_behind(name.as_ref()), "{name}");
        }
        let others = [
            digest.clone(),
            format!("{digest}.obj"),
            format!("{digest}.new"),
            format!("{digest}.mesh.new.new"),
            "cloth.mesh".to_owned(),
            ".mesh".to_owned(),
            "new".to_owned(),
        ];
        for name in others {
            assert!(!is_left_behind(name.as_ref()), "{name}");
        }
    }
}

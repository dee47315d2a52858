//! The mesh of the sample: a file beside the manifest that is named by its digest, in an export as in a
//! store.

use super::{ImportError, Source};
use dataset::{Specification, SpecificationError};
use mesh::limits::FILE_BYTES_MAX;
use std::path::Path;

/// The specification with the mesh that it names, where it names one: as it is if the mesh is loaded, else
/// with that of the folder or the place in a bucket that is imported. Its bytes are checked against the
/// digest.
pub(super) fn load(
    specification: &Specification,
    source: &Source,
) -> Result<Specification, ImportError> {
    let specification = specification.clone();
    let Some(mesh) = &specification.sample.mesh else {
        return Ok(specification);
    };
    if mesh.loaded().is_some() {
        return Ok(specification);
    }
    let file_name = mesh.file_name();
    let refused = |reason: String| ImportError::Mesh {
        path: source.path(Path::new(&file_name)),
        reason,
    };
    match source {
        Source::Folder(folder) => specification.with_mesh_in(folder),
        Source::Bucket(bucket) => {
            let read = bucket.block_on(bucket.read(&file_name, FILE_BYTES_MAX));
            let bytes = read.map_err(|error| refused(error.source.to_string()))?;
            if bytes.len() as u64 > FILE_BYTES_MAX {
                return Err(refused(format!("it has more than {FILE_BYTES_MAX} bytes")));
            }
            specification.with_mesh(bytes)
        }
    }
    .map_err(|error: SpecificationError| refused(error.to_string()))
}

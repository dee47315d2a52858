//! The mesh of a dataset, fetched from its coordinator in parts and checked.

use crate::{
    WorkerError,
    connection::{CallError, Connection},
};
use dataset::Specification;
use limits::protocol::MESH_BYTES_PER_CALL;
use mesh::limits::FILE_BYTES_MAX;
use proto::{GetMeshRequest, GetMeshResponse};
use tokio::task::spawn_blocking;

/// Loads the mesh that a coordinator's specification names, where it names one. `failed` tells why a call
/// has no answer.
///
/// # Errors
/// When a call has no answer, and when what comes is not the mesh that the specification names.
pub(crate) async fn with_mesh(
    connection: &Connection,
    specification: Specification,
    failed: impl Fn(CallError) -> WorkerError,
) -> Result<Specification, WorkerError> {
    if specification.sample.mesh.is_none() {
        return Ok(specification);
    }
    let mut bytes = Vec::new();
    let mut total = None;
    loop {
        let message = GetMeshRequest {
            offset: bytes.len() as u64,
        };
        let part = connection
            .call(message, async |mut client, request| {
                client.get_mesh(request).await
            })
            .await
            .map_err(&failed)?;
        check(&part, bytes.len() as u64, total).map_err(WorkerError::Mesh)?;
        total = Some(part.total_bytes);
        bytes.extend_from_slice(&part.bytes);
        if bytes.len() as u64 == part.total_bytes {
            break;
        }
    }
    // Millions of triangles take seconds.
    let loaded = spawn_blocking(move || specification.with_mesh(bytes)).await;
    let loaded = loaded.map_err(|error| WorkerError::Mesh(error.to_string()))?;
    loaded.map_err(|error| WorkerError::Mesh(error.to_string()))
}

/// That an answer goes on where the ones before it ended, and is as long as it has to be: so there are no
/// more calls than parts of the largest mesh.
fn check(part: &GetMeshResponse, begin: u64, total_before: Option<u64>) -> Result<(), String> {
    let total = part.total_bytes;
    if total > FILE_BYTES_MAX {
        return Err(format!(
            "it has {total} bytes, and a mesh has at most {FILE_BYTES_MAX}"
        ));
    }
    if let Some(before) = total_before
        && before != total
    {
        return Err(format!("it had {before} bytes, and now has {total}"));
    }
    let expected = total.saturating_sub(begin).min(MESH_BYTES_PER_CALL as u64);
    let found = part.bytes.len() as u64;
    if expected == 0 || found != expected {
        return Err(format!(
            "the answer for offset {begin} of {total} bytes has {found} bytes, not {expected}"
        ));
    }
    Ok(())
}

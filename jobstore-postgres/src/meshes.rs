//! The mesh of a dataset's sample: the bytes of its file, in parts that fit a statement.

use super::{
    Database, DatabaseError, MeshBytes,
    connecting::{execute, query},
    fault::Fault,
};
use deadpool_postgres::Transaction;
use tokio_postgres::{IsolationLevel, types::ToSql};

/// Keeps a mesh beside the identity of this specification, which is there: a database that is about
/// another one by now stays as it is.
pub(super) async fn keep(
    transaction: &Transaction<'_>,
    mesh: MeshBytes<'_>,
    specification_hash: &[u8],
) -> Result<(), Fault> {
    let statement = include_str!("sql/keep_mesh.sql");
    let parts = mesh.bytes.chunks(limits::DATABASE_MESH_PART_BYTES);
    for (part, bytes) in (0_i32..).zip(parts) {
        let parameters: [&(dyn ToSql + Sync); 4] =
            [&mesh.digest.as_slice(), &part, &bytes, &specification_hash];
        execute(transaction, statement, &parameters).await?;
    }
    Ok(())
}

impl Database {
    /// Keeps a mesh in place of what there is of it, in a database that is about this specification.
    /// Whoever calls knows that what there is is missing or damaged.
    pub async fn restore_mesh(
        &self,
        mesh: MeshBytes<'_>,
        specification_hash: &[u8],
    ) -> Result<(), DatabaseError> {
        let restored = async {
            let mut connection = self.connection().await?;
            let transaction = connection.transaction().await?;
            execute(&transaction, include_str!("sql/lock_exclusive.sql"), &[]).await?;
            let digest = mesh.digest.as_slice();
            execute(
                &transaction,
                include_str!("sql/forget_mesh.sql"),
                &[&digest],
            )
            .await?;
            keep(&transaction, mesh, specification_hash).await?;
            transaction.commit().await?;
            Ok(())
        };
        restored.await.map_err(|fault| self.away(fault))
    }

    /// The bytes of the mesh of this digest, none where nothing is kept of it. Whoever asks compares
    /// them with the digest.
    ///
    /// # Errors
    /// Also where it has more than `bytes_max` bytes.
    pub async fn mesh(
        &self,
        digest: &[u8],
        bytes_max: u64,
    ) -> Result<Option<Vec<u8>>, DatabaseError> {
        let read = async {
            let mut connection = self.connection().await?;
            let transaction = connection
                .build_transaction()
                .isolation_level(IsolationLevel::RepeatableRead)
                .read_only(true)
                .start()
                .await?;
            read(&transaction, digest, bytes_max).await
        };
        read.await.map_err(|fault| self.away(fault))
    }
}

async fn read(
    transaction: &Transaction<'_>,
    digest: &[u8],
    bytes_max: u64,
) -> Result<Option<Vec<u8>>, Fault> {
    let rows = query(transaction, include_str!("sql/mesh_size.sql"), &[&digest]).await?;
    let (parts, total) = rows
        .first()
        .map_or((0_i64, 0_i64), |row| (row.get(0), row.get(1)));
    if parts == 0 {
        return Ok(None);
    }
    let total = u64::try_from(total).map_err(Fault::damaged)?;
    if total > bytes_max {
        return Err(Fault::damaged(format!(
            "its table meshes has {total} bytes of one mesh, and no mesh has more than {bytes_max}"
        )));
    }
    let mut bytes = Vec::new();
    for part in 0..i32::try_from(parts).map_err(Fault::damaged)? {
        let statement = include_str!("sql/mesh_part.sql");
        let rows = query(transaction, statement, &[&digest, &part]).await?;
        // A part that is missing shows in the digest.
        if let Some(row) = rows.first() {
            bytes.extend_from_slice(row.get(0));
        }
    }
    Ok(Some(bytes))
}

//! The schema, and which dataset it holds.

use super::{
    Database, DatabaseError, Identity, MeshBytes, connecting::execute, fault::Fault, meshes,
};
use deadpool_postgres::Transaction;

/// The steps that made the schema what it is, in order. One that was released never changes.
const MIGRATIONS: [&str; 5] = [
    include_str!("migrations/0001_jobs.sql"),
    include_str!("migrations/0002_migrating.sql"),
    include_str!("migrations/0003_compression.sql"),
    include_str!("migrations/0004_identity.sql"),
    include_str!("migrations/0005_meshes.sql"),
];

impl Database {
    /// Brings the schema up to date, one process at a time, and reads what the database is about;
    /// none where it is about nothing yet.
    pub async fn open(&self) -> Result<Option<Identity>, DatabaseError> {
        let opened = async {
            let mut connection = self.connection().await?;
            let transaction = connection.transaction().await?;
            let statement = include_str!("sql/not_moving.sql");
            let row = transaction.query_one(statement, &[]).await?;
            if !row.get::<_, bool>(0) {
                return Err(Fault::Moving);
            }
            migrate(&transaction).await?;
            let identity = identity(&transaction).await?;
            transaction.commit().await?;
            Ok(identity)
        };
        opened.await.map_err(|fault| self.away(fault))
    }

    /// Makes the database about a dataset of this many materials, or lets the one it is about grow to
    /// that many. Whoever calls has compared the two. A new one gets the mesh of its sample, if that is
    /// one.
    pub async fn make(
        &self,
        identity: &Identity,
        mesh: Option<MeshBytes<'_>>,
        materials: u32,
    ) -> Result<(), DatabaseError> {
        let made = async {
            let mut connection = self.connection().await?;
            let transaction = connection.transaction().await?;
            execute(&transaction, include_str!("sql/lock_exclusive.sql"), &[]).await?;
            make(&transaction, identity, mesh, materials).await?;
            transaction.commit().await?;
            Ok(())
        };
        made.await.map_err(|fault| self.away(fault))
    }
}

pub(super) async fn make(
    transaction: &Transaction<'_>,
    identity: &Identity,
    mesh: Option<MeshBytes<'_>>,
    materials: u32,
) -> Result<(), Fault> {
    // Millions of rows take their time.
    transaction
        .batch_execute("SET LOCAL statement_timeout = 0")
        .await?;
    execute(
        transaction,
        include_str!("sql/make.sql"),
        &[
            &identity.renderer_version,
            &identity.specification_hash,
            &identity.specification,
            &identity.blobs,
            &identity.migrating_from,
        ],
    )
    .await?;
    if let Some(mesh) = mesh {
        meshes::keep(transaction, mesh, &identity.specification_hash).await?;
    }
    let materials = i64::from(materials);
    execute(transaction, include_str!("sql/grow.sql"), &[&materials]).await?;
    Ok(())
}

async fn migrate(transaction: &Transaction<'_>) -> Result<(), Fault> {
    // The same lock as every transaction's: a schema never changes under one.
    transaction
        .query(include_str!("sql/lock_exclusive.sql"), &[])
        .await?;
    transaction
        .batch_execute(include_str!("sql/migrations.sql"))
        .await?;
    let applied = version(transaction).await?;
    for (number, migration) in (1..).zip(MIGRATIONS) {
        if number > applied {
            transaction.batch_execute(migration).await?;
            transaction
                .execute("INSERT INTO migrations (number) VALUES ($1)", &[&number])
                .await?;
        }
    }
    Ok(())
}

/// Whether there is a schema, without making one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Standing {
    Absent,
    /// Steps are missing, which whoever opens the database for writing makes.
    Older,
    Current,
}

pub(super) async fn standing(transaction: &Transaction<'_>) -> Result<Standing, Fault> {
    let rows = transaction
        .query(include_str!("sql/schema.sql"), &[])
        .await?;
    if !rows.first().is_some_and(|row| row.get(0)) {
        return Ok(Standing::Absent);
    }
    let current = version(transaction).await? == MIGRATIONS.len() as i32;
    Ok(if current {
        Standing::Current
    } else {
        Standing::Older
    })
}

/// How many of the steps were made.
async fn version(transaction: &Transaction<'_>) -> Result<i32, Fault> {
    let rows = transaction
        .query(include_str!("sql/version.sql"), &[])
        .await?;
    let applied: i32 = rows.first().map_or(0, |row| row.get(0));
    let known = MIGRATIONS.len() as i32;
    if applied > known {
        return Err(Fault::damaged(format!(
            "its schema has version {applied}, and this program knows versions to {known}: install \
             the brdfarm that made it"
        )));
    }
    Ok(applied)
}

pub(super) async fn identity(transaction: &Transaction<'_>) -> Result<Option<Identity>, Fault> {
    let rows = transaction
        .query(include_str!("sql/identity.sql"), &[])
        .await?;
    Ok(rows.first().map(|row| Identity {
        renderer_version: row.get(0),
        specification_hash: row.get(1),
        specification: row.get(2),
        blobs: row.get(3),
        migrating_from: row.get(4),
    }))
}

//! What a database holds at one instant, for readers: nothing is written, no schema is made.

use super::{
    Database, DatabaseError, Identity,
    fault::Fault,
    schema::{self, Standing},
};
use deadpool_postgres::Transaction;
use futures_util::TryStreamExt;
use std::pin::pin;
use tokio_postgres::{IsolationLevel, types::ToSql};

impl Database {
    /// What the database is about; none where it is about nothing, or has no schema.
    pub async fn snapshot(&self) -> Result<Option<Identity>, DatabaseError> {
        let looked = async {
            let mut connection = self.connection().await?;
            let transaction = connection.transaction().await?;
            identity(&transaction).await
        };
        looked.await.map_err(|fault| self.away(fault))
    }

    /// Tells every completion that counts, as JSON, in the order of materials, all as they were at
    /// one instant, but for those of the materials in `known`. `check` is asked first, whether the
    /// database is one to read.
    pub async fn completions<T, E: From<DatabaseError>>(
        &self,
        known: &[u32],
        check: impl FnOnce(Option<Identity>) -> Result<T, E>,
        tell: &mut dyn FnMut(&str) -> Result<(), E>,
    ) -> Result<T, E> {
        let away = |fault: Fault| E::from(self.away(fault));
        let mut connection = self
            .connection()
            .await
            .map_err(|error| away(error.into()))?;
        let transaction = connection
            .build_transaction()
            .isolation_level(IsolationLevel::RepeatableRead)
            .read_only(true)
            .start()
            .await
            .map_err(|error| away(error.into()))?;
        let checked = check(identity(&transaction).await.map_err(away)?)?;
        let mut rows = pin!(stream(&transaction, known).await.map_err(away)?);
        while let Some(row) = rows.try_next().await.map_err(|error| away(error.into()))? {
            tell(row.get(0))?;
        }
        Ok(checked)
    }
}

async fn identity(transaction: &Transaction<'_>) -> Result<Option<Identity>, Fault> {
    match schema::standing(transaction).await? {
        Standing::Absent => Ok(None),
        Standing::Older => Err(Fault::Older),
        Standing::Current => schema::identity(transaction).await,
    }
}

/// The rows come as they are asked for: those that nobody has read yet wait at the server.
async fn stream(
    transaction: &Transaction<'_>,
    known: &[u32],
) -> Result<tokio_postgres::RowStream, Fault> {
    // As many as there are: how long that takes depends on who reads.
    transaction
        .batch_execute("SET LOCAL statement_timeout = 0")
        .await?;
    let known: Vec<i64> = known.iter().copied().map(i64::from).collect();
    let parameters: [&(dyn ToSql + Sync); 1] = [&known];
    let statement = include_str!("sql/completions.sql");
    Ok(transaction.query_raw(statement, parameters).await?)
}

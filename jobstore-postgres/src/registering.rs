//! Workers come and go.

use super::{
    Shared,
    connecting::{execute, query},
    fault::attempt,
    rows::ms,
};
use jobqueue::token::WorkerId;
use jobstore::JobStoreError;

impl Shared {
    pub async fn admit(&self, worker: WorkerId, name: &str) -> Result<(), JobStoreError> {
        attempt!({
            let mut connection = self.database.connection().await?;
            let transaction = connection.transaction().await?;
            let worker = worker.to_message();
            execute(
                &transaction,
                include_str!("sql/admit.sql"),
                &[&worker, &name],
            )
            .await?;
            transaction.commit().await?;
            Ok(())
        })?;
        // A worker of another name may be what a second rendering waits for.
        self.wake(1);
        Ok(())
    }

    /// The name of a worker.
    pub async fn name(&self, worker: WorkerId) -> Result<Option<String>, JobStoreError> {
        attempt!({
            let mut connection = self.database.connection().await?;
            let transaction = connection.transaction().await?;
            let worker = worker.to_message();
            let rows = query(&transaction, include_str!("sql/name.sql"), &[&worker]).await?;
            Ok(rows.first().map(|row| row.get(0)))
        })
    }

    pub async fn dismiss(&self, workers: &[WorkerId]) -> Result<(), JobStoreError> {
        let workers: Vec<Vec<u8>> = workers.iter().map(|worker| worker.to_message()).collect();
        let after = ms(self.presence.dismissed_after);
        attempt!({
            let mut connection = self.database.connection().await?;
            let transaction = connection.transaction().await?;
            let statement = include_str!("sql/dismiss.sql");
            execute(&transaction, statement, &[&workers, &after]).await?;
            transaction.commit().await?;
            Ok(())
        })
    }
}

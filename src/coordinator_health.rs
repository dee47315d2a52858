//! `brdfarm coordinator health`: whether a coordinator serves.

use crate::connection::CoordinatorOptions;
use clap::Args;
use proto::{ServingStatus, client::with_deadline};
use tonic::Response;

/// Ask a coordinator whether it serves
///
/// Asks the standard health service, which wants no token; for probes that cannot speak TLS
/// themselves. Prints nothing and exits with 0 where it serves, with 1 where it does not or does not
/// answer. It does not serve while what keeps its jobs, such as a database, does not answer; its log
/// says why.
#[derive(Debug, Args)]
pub struct Options {
    #[command(flatten)]
    coordinator: CoordinatorOptions,
    /// Ask only whether it answers: to start one anew because its database is away helps nobody
    #[arg(long)]
    alive: bool,
}

/// Asks.
pub fn execute(options: &Options) -> anyhow::Result<()> {
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()?;
    runtime.block_on(async {
        let mut client = options.coordinator.connect_health()?;
        let question = with_deadline(proto::HealthCheckRequest::default());
        let answer = client.check(question).await.map(Response::into_inner);
        let answer = answer.map_err(|status| options.coordinator.error(&status))?;
        anyhow::ensure!(
            options.alive || answer.status() == ServingStatus::Serving,
            "the coordinator answers, and does not serve: its log says why"
        );
        Ok(())
    })
}

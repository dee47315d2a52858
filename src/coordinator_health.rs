//! `brdfarm coordinator health`: whether a coordinator serves.

use crate::connection::CoordinatorOptions;
use clap::Args;
use proto::{ServingStatus, client::with_deadline};
use tonic::Response;

/// Ask a coordinator whether it serves
///
/// Asks the standard health service, which needs no token; for probes that cannot speak TLS
/// themselves. Prints nothing. Exits with 0 if the coordinator serves, and with 1 if it does not serve
/// or does not answer. A coordinator does not serve while its job store, such as a database, does not
/// answer; its log says why.
#[derive(Debug, Args)]
pub struct Options {
    #[command(flatten)]
    coordinator: CoordinatorOptions,
    /// Ask only whether it answers, because restarting it would not bring its database back
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
            "the coordinator answers but does not serve: its log says why"
        );
        Ok(())
    })
}

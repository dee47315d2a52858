//! What the standard health service says: what the next call would find.

use crate::{
    farm::Farm,
    service::{ControlService, FarmService},
};
use std::sync::Arc;
use tokio::{
    sync::watch,
    time::{sleep, timeout},
};
use tonic_health::server::HealthReporter;

/// Asks the job store again and again, and has the health service say whether it answers, until
/// `stopping` is true.
pub(crate) async fn watch(
    health: HealthReporter,
    farm: Arc<Farm>,
    mut stopping: watch::Receiver<bool>,
) -> Result<(), String> {
    let mut served: Option<bool> = None;
    loop {
        let why = match timeout(limits::HEALTH_WAIT, farm.probe()).await {
            Ok(Ok(())) => None,
            Ok(Err(error)) => Some(error.to_string()),
            Err(_) => Some("what keeps the jobs does not answer".to_owned()),
        };
        let serves = why.is_none();
        if served != Some(serves) {
            match why {
                Some(reason) => tracing::error!(reason, "not serving"),
                None if served.is_some() => tracing::info!("serving again"),
                None => {}
            }
            say(&health, serves).await;
            served = Some(serves);
        }
        tokio::select! {
            () = sleep(limits::HEALTH_INTERVAL) => {}
            _ = stopping.wait_for(|stopping| *stopping) => break,
        }
    }
    say(&health, false).await;
    Ok(())
}

/// Says whether it serves, as a whole and each service.
pub(crate) async fn say(health: &HealthReporter, serves: bool) {
    type Farms = proto::FarmServer<FarmService>;
    type Controls = proto::ControlServer<ControlService>;
    if serves {
        health.set_serving::<Farms>().await;
        health.set_serving::<Controls>().await;
    } else {
        health.set_not_serving::<Farms>().await;
        health.set_not_serving::<Controls>().await;
    }
    let whole = match serves {
        true => tonic_health::ServingStatus::Serving,
        false => tonic_health::ServingStatus::NotServing,
    };
    health.set_service_status("", whole).await;
}

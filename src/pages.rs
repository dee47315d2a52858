//! Pages for a browser beside a coordinator: `--web`.

use anyhow::Context;
use coordinator::RunningCoordinator;
use datastore::{ReadOnlyStore, StoreName};
use tokio::task::spawn_blocking;
use web::{RunningServer, Site};

/// Serves the pages of a coordinator and its store, if they are wanted.
pub async fn serve(
    store: &StoreName,
    coordinator: &RunningCoordinator,
    wanted: Option<web::Options>,
) -> anyhow::Result<Option<RunningServer>> {
    let Some(options) = wanted else {
        return Ok(None);
    };
    let store = store.clone();
    // Reading a store blocks, and one in a database has a runtime of its own.
    let site = spawn_blocking(move || Site::new(ReadOnlyStore::open(store)?)).await;
    let site = site.context("reading the store was interrupted")??;
    let site = site.with_farm(coordinator.control());
    Ok(Some(web::serve(site, options).await?))
}

/// Waits until pages stop working, if there are any.
pub async fn failed(pages: Option<&RunningServer>) -> String {
    match pages {
        Some(pages) => pages.failed().await,
        None => std::future::pending().await,
    }
}

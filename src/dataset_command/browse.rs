//! `brdfarm dataset browse`.

use super::StoreOptions;
use crate::connection::security;
use crate::runtime::Runtime;
use crate::{open_files, shutdown};
use clap::Args;
use datastore::ReadOnlyStore;
use std::io::{self, Write};
use std::net::SocketAddr;
use std::path::PathBuf;
use web::Site;

/// Look at a store in a browser: materials, their images and labels, and how they cover the parameters
///
/// Prints the address of the first page and serves until it is asked to stop. Changes nothing; a
/// coordinator may be at work on the store, and what it completes is shown soon after.
#[derive(Debug, Args)]
pub struct Options {
    #[command(flatten)]
    store: StoreOptions,
    /// The address to listen on; port 0 takes a free one
    #[arg(long, default_value = "127.0.0.1:7118", value_name = "IP:PORT")]
    listen: SocketAddr,
    /// A folder with certificate.pem, key.pem and tokens, as `brdfarm credentials` makes it: pages are
    /// encrypted, and ask for the token of a reader or an operator
    #[arg(long, value_name = "DIR")]
    credentials: Option<PathBuf>,
    /// Allow an address that other machines can reach, without encryption and without tokens
    #[arg(long)]
    insecure: bool,
}

/// Serves.
pub fn execute(options: &Options) -> anyhow::Result<()> {
    let serving = web::Options {
        listen: options.listen,
        security: match &options.credentials {
            Some(folder) => security(folder)?,
            None => Default::default(),
        },
        insecure: options.insecure,
    };
    serving.check()?;
    open_files::raise();
    let site = Site::new(ReadOnlyStore::open(&options.store.store)?)?;
    let runtime = Runtime::new()?;
    runtime.block_on(async {
        let mut asked = shutdown::flag("finishing the answers under way")?;
        let server = web::serve(site, serving).await?;
        writeln!(io::stdout(), "browse at {}", server.url())?;
        let ended = tokio::select! {
            () = shutdown::raised(&mut asked) => Ok(()),
            why = server.failed() => Err(anyhow::anyhow!(why)),
        };
        server.shutdown().await;
        ended
    })
}

//! Being asked to stop: SIGINT (Ctrl-C) or SIGTERM.

use crate::failure;
use std::{io, process};
use tokio::signal::unix::{SignalKind, signal};
use tokio::sync::watch;

/// A flag that rises when somebody asks the process to stop. Has to be called inside a runtime,
/// which listens for as long as it lives.
///
/// A second request ends the process at once, for those who do not want to wait for work to be
/// handed back; so does the first when nobody holds the flag any more.
pub fn flag() -> io::Result<watch::Receiver<bool>> {
    let mut interrupt = signal(SignalKind::interrupt())?;
    let mut terminate = signal(SignalKind::terminate())?;
    let (asked, flag) = watch::channel(false);
    tokio::spawn(async move {
        loop {
            tokio::select! {
                _ = interrupt.recv() => {}
                _ = terminate.recv() => {}
            }
            if *asked.borrow() || asked.is_closed() {
                failure::report("stopped at once");
                process::exit(1);
            }
            asked.send_replace(true);
        }
    });
    Ok(flag)
}

/// Waits until a flag is up.
pub async fn raised(flag: &mut watch::Receiver<bool>) {
    // An error means that the runtime is going, and this future with it.
    drop(flag.wait_for(|raised| *raised).await);
}

//! Being asked to stop: SIGINT (Ctrl-C) or SIGTERM.

use crate::standard_error;
use std::{
    io::{self, Write},
    process,
    sync::atomic::{AtomicU8, Ordering},
    time::{Duration, Instant},
};
use tokio::signal::unix::{SignalKind, signal};
use tokio::sync::watch;

/// Signals closer together than this count as one request: `timeout` and a terminal signal each
/// process of a group, and a program that passes a signal on sends it again.
const ANOTHER: Duration = Duration::from_secs(1);

/// The signal that asked first; 0 before.
static ASKED_BY: AtomicU8 = AtomicU8::new(0);

/// A command that ended because somebody asked it to, before its work was done.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct Stopped(pub String);

/// The exit code of a command that was asked to stop: as of one that the signal ended.
pub fn exit_code() -> u8 {
    128 + ASKED_BY.load(Ordering::Relaxed)
}

/// Notes that whoever reads the progress is gone, which counts as being asked to stop: a program that
/// started this one and died does not leave it at work.
pub fn note_reader_gone() {
    let by = SignalKind::pipe().as_raw_value();
    let by = u8::try_from(by).unwrap_or_default();
    let _ = ASKED_BY.compare_exchange(0, by, Ordering::Relaxed, Ordering::Relaxed);
}

/// A flag that rises when somebody asks the process to stop. Has to be called inside a runtime,
/// which listens for as long as it lives. The first request is answered at once on standard error;
/// `first` completes that sentence with what is still being done.
///
/// A second request ends the process, for those who do not want to wait; so does the first when
/// nobody holds the flag any more.
pub fn flag(first: &'static str) -> io::Result<watch::Receiver<bool>> {
    let mut interrupt = signal(SignalKind::interrupt())?;
    let mut terminate = signal(SignalKind::terminate())?;
    let (asked, flag) = watch::channel(false);
    tokio::spawn(async move {
        let mut asked_at: Option<Instant> = None;
        loop {
            let by = tokio::select! {
                _ = interrupt.recv() => SignalKind::interrupt(),
                _ = terminate.recv() => SignalKind::terminate(),
            };
            if asked_at.is_some_and(|at| at.elapsed() < ANOTHER) {
                continue;
            }
            // Signals have small numbers.
            let by = u8::try_from(by.as_raw_value()).unwrap_or_default();
            let unasked = ASKED_BY.compare_exchange(0, by, Ordering::Relaxed, Ordering::Relaxed);
            if unasked.is_err() || asked.is_closed() {
                standard_error::report("stopped at once");
                process::exit(exit_code().into());
            }
            // Standard error may be gone; there is nobody left to tell.
            let _ = writeln!(
                io::stderr(),
                "stopping: {first}; a second signal stops at once"
            );
            asked_at = Some(Instant::now());
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

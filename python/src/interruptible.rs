//! Work that Ctrl-C stops.

use crate::error::failed;
use pyo3::prelude::*;
use std::{
    sync::mpsc::{self, RecvTimeoutError},
    thread,
    time::Duration,
};

/// How often Python is asked whether somebody pressed Ctrl-C.
const SIGNAL_INTERVAL: Duration = Duration::from_millis(50);

/// Does `work` on a thread of its own, without the interpreter's lock, and looks for signals
/// meanwhile. After one whose handler raises, the exception is returned at once; the thread ends
/// when its work does, and what it made is dropped.
pub fn run<T: Send + 'static>(
    py: Python<'_>,
    work: impl FnOnce() -> T + Send + 'static,
) -> PyResult<T> {
    let (sender, receiver) = mpsc::sync_channel(1);
    let thread = thread::Builder::new().name("brdfarm".to_owned());
    thread
        // Nobody receives after an interruption.
        .spawn(move || drop(sender.send(work())))
        .map_err(|error| failed(format_args!("a thread cannot be started: {error}")))?;
    // The receiver is owned by this thread alone, and goes in and out of each wait.
    let mut receiver = receiver;
    loop {
        let (received, back) =
            py.detach(move || (receiver.recv_timeout(SIGNAL_INTERVAL), receiver));
        receiver = back;
        match received {
            Ok(done) => return Ok(done),
            Err(RecvTimeoutError::Timeout) => py.check_signals()?,
            Err(RecvTimeoutError::Disconnected) => {
                return Err(failed(
                    "the renderer panicked, which is a fault of the program: please report it",
                ));
            }
        }
    }
}

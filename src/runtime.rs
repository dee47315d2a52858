//! The runtime of commands that render.

use std::io;

/// A runtime that waits for nobody when it goes. A thread of it may be in a view that does not end:
/// waiting for it would keep the error from being told, and the process from ending when it is asked
/// to. What has to be durable is so before.
pub struct Runtime(Option<tokio::runtime::Runtime>);

impl Runtime {
    pub fn new() -> io::Result<Self> {
        Ok(Self(Some(tokio::runtime::Runtime::new()?)))
    }
}

impl std::ops::Deref for Runtime {
    type Target = tokio::runtime::Runtime;

    fn deref(&self) -> &Self::Target {
        match &self.0 {
            Some(runtime) => runtime,
            None => unreachable!("it is there until it is dropped"),
        }
    }
}

impl Drop for Runtime {
    fn drop(&mut self) {
        if let Some(runtime) = self.0.take() {
            runtime.shutdown_background();
        }
    }
}

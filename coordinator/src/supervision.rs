//! Tasks that have to run for as long as the coordinator does.
//!
//! One that ends unasked, or panics, would be missed by nobody: leases would not run out, or images
//! not be published. So it is a failure of the coordinator, which says so and ends.

use futures_util::FutureExt;
use std::{any::Any, panic::AssertUnwindSafe, time::Duration};
use tokio::{sync::watch, task::JoinSet, time::timeout};

/// The tasks of one coordinator.
pub(crate) struct Supervisor {
    tasks: JoinSet<()>,
    // What the others need to their end.
    helpers: JoinSet<()>,
    failure: watch::Sender<Option<String>>,
    stopping: watch::Receiver<bool>,
    /// The name of a task that a test has panic.
    #[cfg(test)]
    panics: Option<&'static str>,
}

impl Supervisor {
    /// No task yet. None of them is missed any more once `stopping` is true, or its sender is gone.
    pub fn new(stopping: watch::Receiver<bool>) -> Self {
        Self {
            tasks: JoinSet::new(),
            helpers: JoinSet::new(),
            failure: watch::channel(None).0,
            stopping,
            #[cfg(test)]
            panics: None,
        }
    }

    #[cfg(test)]
    pub fn with_panic_in(stopping: watch::Receiver<bool>, name: Option<&'static str>) -> Self {
        Self {
            panics: name,
            ..Self::new(stopping)
        }
    }

    /// What failed first, once something did.
    pub fn failure(&self) -> watch::Receiver<Option<String>> {
        self.failure.subscribe()
    }

    /// Runs a task that has to last until the coordinator stops, and ends then.
    pub fn spawn(
        &mut self,
        name: &'static str,
        task: impl Future<Output = Result<(), String>> + Send + 'static,
    ) {
        let watched = self.watched(name, task);
        self.tasks.spawn(watched);
    }

    /// Runs a task that the others need to their end, and that is cut off after them.
    pub fn spawn_helper(
        &mut self,
        name: &'static str,
        task: impl Future<Output = Result<(), String>> + Send + 'static,
    ) {
        let watched = self.watched(name, task);
        self.helpers.spawn(watched);
    }

    fn watched(
        &self,
        name: &'static str,
        task: impl Future<Output = Result<(), String>> + Send + 'static,
    ) -> impl Future<Output = ()> + Send + 'static {
        let failure = self.failure.clone();
        let stopping = self.stopping.clone();
        #[cfg(test)]
        let panics = self.panics == Some(name);
        #[cfg(test)]
        let task = async move {
            assert!(!panics, "a panic that a test asked for");
            task.await
        };
        async move {
            let ended = AssertUnwindSafe(task).catch_unwind().await;
            if *stopping.borrow() || stopping.has_changed().is_err() {
                return;
            }
            let why = match ended {
                Ok(Ok(())) => "it ended".to_owned(),
                Ok(Err(why)) => why,
                Err(panic) => format!("it panicked: {}", message(&*panic)),
            };
            tracing::error!(task = name, why, "the coordinator cannot go on");
            failure.send_if_modified(|failure| {
                let first = failure.is_none();
                failure.get_or_insert_with(|| format!("{name}: {why}"));
                first
            });
        }
    }

    /// Waits until all tasks have ended, and cuts those off that have not after so long. False where
    /// some were.
    pub async fn end(mut self, grace: Duration) -> bool {
        let ended = async { while self.tasks.join_next().await.is_some() {} };
        let ended = timeout(grace, ended).await.is_ok();
        self.tasks.shutdown().await;
        self.helpers.shutdown().await;
        ended
    }
}

fn message(panic: &(dyn Any + Send)) -> &str {
    let text = panic.downcast_ref::<String>().map(String::as_str);
    text.or_else(|| panic.downcast_ref::<&str>().copied())
        .unwrap_or("it does not say why")
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::future::pending;

    #[tokio::test]
    async fn an_end_is_a_failure_unless_it_was_asked_for() {
        let (stop, stopping) = watch::channel(false);
        let mut supervisor = Supervisor::new(stopping.clone());
        let mut failure = supervisor.failure();
        supervisor.spawn("lasting", pending());
        let mut asked = stopping.clone();
        supervisor.spawn("stopped", async move {
            drop(asked.wait_for(|stopping| *stopping).await);
            Ok(())
        });
        supervisor.spawn("short", async { Ok(()) });
        let said = failure.wait_for(Option::is_some).await.unwrap().clone();
        assert_eq!(said.as_deref(), Some("short: it ended"));
        supervisor.spawn("later", async { panic!("number {}", 2) });
        stop.send_replace(true);
        supervisor.spawn_helper("helper", pending());
        assert!(!supervisor.end(Duration::from_millis(200)).await);
        assert_eq!(failure.borrow().as_deref(), Some("short: it ended"));

        let (_stop, stopping) = watch::channel(false);
        let mut supervisor = Supervisor::new(stopping);
        let mut failure = supervisor.failure();
        supervisor.spawn("one", async { panic!("number {}", 3) });
        let said = failure.wait_for(Option::is_some).await.unwrap().clone();
        assert_eq!(said.as_deref(), Some("one: it panicked: number 3"));
        supervisor.spawn_helper("helper", pending());
        assert!(
            supervisor.end(Duration::from_secs(60)).await,
            "nobody waits for a helper"
        );
    }
}

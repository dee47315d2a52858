//! Calls that outlast the coordinator's absence: repeated with growing, jittered pauses.

use proto::{
    FarmClient,
    client::{self, Credentials, with_deadline_after},
};
use std::{
    error::Error,
    sync::{
        Arc,
        atomic::{AtomicUsize, Ordering},
    },
    time::Duration,
};
use thiserror::Error;
use tokio::time::{Instant, sleep};
use tonic::{Code, Request, Response, Status};
use tonic_types::StatusExt;

/// Attempts of a call that fail without a word: a coordinator that is just starting is no news.
const ATTEMPTS_QUIET: u32 = 3;

/// Why a call has no answer.
#[derive(Clone, Debug, Error)]
pub(crate) enum CallError {
    /// The coordinator said no; asking again changes nothing.
    #[error("{}", .0.message())]
    Refused(Status),
    /// The coordinator cannot be reached, or cannot answer.
    #[error("the coordinator did not answer for {} s: {}", .0.as_secs(), reason(.1))]
    Away(Duration, Status),
    /// The bucket that images go to takes none.
    #[error("no image could be uploaded for {} s: {}", .0.as_secs(), .1)]
    BucketAway(Duration, String),
}

/// What a status says, and the innermost of its causes: the network's own words.
fn reason(status: &Status) -> String {
    let mut innermost = None;
    let mut cause = status.source();
    while let Some(error) = cause {
        innermost = Some(error.to_string());
        cause = error.source();
    }
    match innermost {
        Some(cause) if cause != status.message() => format!("{}: {cause}", status.message()),
        _ => status.message().to_owned(),
    }
}

/// The line to the coordinators of one farm, any of which answers any call. Cheap to clone.
#[derive(Clone)]
pub(crate) struct Connection {
    clients: Arc<[FarmClient]>,
    // Whom calls go to: the one that answered last. The same for all clones.
    current: Arc<AtomicUsize>,
    away_max: Duration,
}

impl Connection {
    /// A line to the coordinators at `urls` that gives up after all have been away for `away_max`.
    /// It begins with any of them, so that workers spread over them.
    pub fn new(
        urls: &[String],
        credentials: &Credentials,
        away_max: Duration,
    ) -> Result<Self, String> {
        let clients = urls.iter().map(|url| client::farm(url, credentials));
        let clients = clients.collect::<Result<Arc<[_]>, _>>()?;
        if clients.is_empty() {
            return Err("no coordinator is named".to_owned());
        }
        let first = (random_fraction().unwrap_or_default() * clients.len() as f64) as usize;
        Ok(Self {
            current: Arc::new(AtomicUsize::new(first.min(clients.len() - 1))),
            clients,
            away_max,
        })
    }

    /// The same line with another patience.
    pub fn patient_for(&self, away_max: Duration) -> Self {
        Self {
            away_max,
            ..self.clone()
        }
    }

    /// For how long whoever delivers should bear with an absence.
    pub fn patience(&self) -> Duration {
        self.away_max
    }

    /// Turns to the coordinator after `failed`, unless another call has done so meanwhile.
    fn turn_from(&self, failed: usize) {
        let next = (failed + 1) % self.clients.len();
        let order = Ordering::Relaxed;
        // An error means that somebody turned away before.
        let _ = self.current.compare_exchange(failed, next, order, order);
    }

    /// Makes a call, and again while no coordinator answers.
    pub async fn call<M: Clone, R, F>(
        &self,
        message: M,
        method: impl Fn(FarmClient, Request<M>) -> F,
    ) -> Result<R, CallError>
    where
        F: Future<Output = Result<Response<R>, Status>>,
    {
        self.call_and_wait(message, Duration::ZERO, method).await
    }

    /// The same for a call that asks to wait `wait`.
    pub async fn call_and_wait<M: Clone, R, F>(
        &self,
        message: M,
        wait: Duration,
        method: impl Fn(FarmClient, Request<M>) -> F,
    ) -> Result<R, CallError>
    where
        F: Future<Output = Result<Response<R>, Status>>,
    {
        let mut away_since = None;
        for attempt in 0.. {
            let started = Instant::now();
            let asked = self.current.load(Ordering::Relaxed);
            let request = with_deadline_after(message.clone(), wait);
            let status = match method(self.clients[asked].clone(), request).await {
                Ok(response) => return Ok(response.into_inner()),
                Err(status) if is_final(status.code()) => return Err(CallError::Refused(status)),
                Err(status) => status,
            };
            let away = away_since.get_or_insert(started).elapsed();
            if away >= self.away_max {
                return Err(CallError::Away(away, status));
            }
            if attempt == ATTEMPTS_QUIET {
                let reason = reason(&status);
                tracing::warn!(
                    reason,
                    "a call to the coordinator keeps failing, trying again"
                );
            }
            if status.code() != Code::ResourceExhausted {
                self.turn_from(asked);
            }
            // Pauses begin when all have been asked.
            let round = attempt / self.clients.len() as u32;
            let pause = pause(round).max(asked_pause(&status));
            sleep(pause.min(self.away_max - away)).await;
        }
        unreachable!("attempts do not run out")
    }
}

/// Answers that repeating does not change. All others come of a coordinator that is away, busy or
/// stopping, or of the network.
fn is_final(code: Code) -> bool {
    matches!(
        code,
        Code::InvalidArgument
            | Code::NotFound
            | Code::AlreadyExists
            | Code::FailedPrecondition
            | Code::PermissionDenied
            | Code::Unauthenticated
            | Code::Unimplemented
            | Code::OutOfRange
    )
}

/// How long the coordinator asks to wait, if it does.
fn asked_pause(status: &Status) -> Duration {
    let details = status.get_error_details();
    let asked = details.retry_info().and_then(|retry| retry.retry_delay);
    asked.unwrap_or_default().min(limits::worker::BACKOFF_MAX)
}

/// The pause after a failed attempt, counted from 0: none, then doubling up to a limit, each half
/// fixed and half random, so that workers do not come back all at once.
pub(crate) fn pause(attempt: u32) -> Duration {
    let Some(doublings) = attempt.checked_sub(1) else {
        return Duration::ZERO;
    };
    let full = limits::worker::BACKOFF_FIRST
        .saturating_mul(1 << doublings.min(20))
        .min(limits::worker::BACKOFF_MAX);
    // Without random numbers pauses are merely not spread.
    full.mul_f64(0.5 + 0.5 * random_fraction().unwrap_or(1.0))
}

/// A number from 0 to 1; `None` where the system has no random numbers.
fn random_fraction() -> Option<f64> {
    let mut random = [0; 2];
    getrandom::fill(&mut random).ok()?;
    Some(f64::from(u16::from_ne_bytes(random)) / f64::from(u16::MAX))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pauses_grow_from_nothing_to_the_limit_and_differ() {
        assert_eq!(pause(0), Duration::ZERO);
        for attempt in 1..40 {
            let full = limits::worker::BACKOFF_FIRST * (1 << (attempt - 1).min(20));
            let full = full.min(limits::worker::BACKOFF_MAX);
            let pause = pause(attempt);
            assert!(pause <= full && pause >= full / 2, "{attempt}: {pause:?}");
        }
        let pauses: std::collections::BTreeSet<Duration> = (0..20).map(|_| pause(30)).collect();
        assert!(pauses.len() > 1);
    }

    #[tokio::test]
    async fn a_call_is_repeated_until_it_is_answered_refused_or_given_up() {
        let nobody = ["http://127.0.0.1:9".to_owned()];
        let patience = Duration::from_millis(400);
        let line = Connection::new(&nobody, &Credentials::default(), patience).unwrap();
        let calls = std::cell::Cell::new(0);
        let scripted = |answers: &'static [Result<u8, Code>]| {
            calls.set(0);
            let calls = &calls;
            move |_: FarmClient, _: Request<()>| {
                let answer = answers[calls.get().min(answers.len() - 1)];
                calls.set(calls.get() + 1);
                async move {
                    answer
                        .map(Response::new)
                        .map_err(|code| Status::new(code, "x"))
                }
            }
        };
        let answer = line.call(
            (),
            scripted(&[Err(Code::Unavailable), Err(Code::Unknown), Ok(7)]),
        );
        assert_eq!(answer.await.unwrap(), 7);
        assert_eq!(calls.get(), 3);

        let answer = line.call((), scripted(&[Err(Code::InvalidArgument), Ok(7)]));
        assert!(matches!(answer.await, Err(CallError::Refused(_))));
        assert_eq!(calls.get(), 1);

        let started = Instant::now();
        let answer = line.call((), scripted(&[Err(Code::Unavailable)]));
        assert!(matches!(answer.await, Err(CallError::Away(..))));
        assert!(started.elapsed() >= Duration::from_millis(400));
    }

    #[tokio::test]
    async fn another_coordinator_is_asked_where_one_fails_and_is_asked_from_then_on() {
        let urls = [1, 2, 3].map(|port| format!("http://127.0.0.1:{port}"));
        let line = Connection::new(&urls, &Credentials::default(), Duration::MAX).unwrap();
        line.current.store(1, Ordering::Relaxed);
        let current = Arc::clone(&line.current);
        let asked = std::cell::RefCell::new(Vec::new());
        // Coordinator 0 alone is there, and busy at first.
        let answer = async |_: FarmClient, _: Request<()>| {
            let coordinator = current.load(Ordering::Relaxed);
            asked.borrow_mut().push(coordinator);
            match (coordinator, asked.borrow().len()) {
                (0, 3) => Err(Status::resource_exhausted("no room")),
                (0, _) => Ok(Response::new(7)),
                _ => Err(Status::unavailable("gone")),
            }
        };
        let began = Instant::now();
        assert_eq!(line.call((), &answer).await.unwrap(), 7);
        assert!(
            began.elapsed() < limits::worker::BACKOFF_FIRST,
            "it paused before it had asked all"
        );
        assert_eq!(line.clone().call((), &answer).await.unwrap(), 7);
        assert_eq!(asked.into_inner(), [1, 2, 0, 0, 0]);
        // Of two calls that failed at the same one, one turns.
        line.turn_from(0);
        line.turn_from(0);
        assert_eq!(current.load(Ordering::Relaxed), 1);
    }
}

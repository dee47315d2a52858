//! What goes wrong between here and the database.

use super::encryption;
use deadpool_postgres::PoolError;
use jobqueue::Refusal;
use jobstore::{JobStoreError, ledger::LedgerError};
use std::error::Error as _;
use tokio_postgres::error::SqlState;

/// Why a transaction did not happen, or may not have.
#[derive(Debug)]
pub(super) enum Fault {
    Refused(Refusal),
    Database(tokio_postgres::Error),
    Pool(PoolError),
    Damaged(String),
    /// The schema lacks steps.
    Older,
    /// A store is being copied from it, or into it.
    Moving,
}

impl Fault {
    /// Whether the same again may work at once: the transaction was the victim of another, or its
    /// connection had ended before.
    pub fn is_passing(&self) -> bool {
        match self {
            Self::Database(error) => {
                error.is_closed()
                    || matches!(
                        error.code(),
                        Some(
                            &SqlState::T_R_DEADLOCK_DETECTED | &SqlState::T_R_SERIALIZATION_FAILURE
                        )
                    )
            }
            _ => false,
        }
    }

    pub fn damaged(what: impl ToString) -> Self {
        Self::Damaged(what.to_string())
    }

    /// What it is to whoever asked about this material.
    pub fn of_material(&self, material: u32) -> JobStoreError {
        let what = match self {
            Self::Damaged(what) => what.clone(),
            other => format!("{other:?}"),
        };
        let what = format!("the record of material {material}: {what}");
        JobStoreError::Ledger(LedgerError::Damaged(what))
    }
}

impl From<tokio_postgres::Error> for Fault {
    fn from(error: tokio_postgres::Error) -> Self {
        Self::Database(error)
    }
}

impl From<PoolError> for Fault {
    fn from(error: PoolError) -> Self {
        Self::Pool(error)
    }
}

impl From<Refusal> for Fault {
    fn from(refusal: Refusal) -> Self {
        Self::Refused(refusal)
    }
}

impl From<Fault> for JobStoreError {
    fn from(fault: Fault) -> Self {
        match fault {
            Fault::Refused(refusal) => refusal.into(),
            Fault::Database(error) if is_away(&error) => Self::Unavailable(told(&error)),
            Fault::Database(error) => Self::Ledger(LedgerError::Damaged(told(&error))),
            Fault::Pool(PoolError::Backend(error)) => Self::Unavailable(told(&error)),
            Fault::Pool(error) => Self::Unavailable(error.to_string()),
            Fault::Damaged(what) => Self::Ledger(LedgerError::Damaged(what)),
            Fault::Older => Self::Ledger(LedgerError::Damaged("its schema is older".to_owned())),
            Fault::Moving => Self::Unavailable("a store is being copied".to_owned()),
        }
    }
}

/// An error with its cause: what the server said is in the cause.
pub(super) fn told(error: &tokio_postgres::Error) -> String {
    if let Some(disbelief) = encryption::disbelief(error) {
        return disbelief;
    }
    match error.source() {
        Some(cause) => format!("{error}: {cause}"),
        None => error.to_string(),
    }
}

/// Whether the database is away, is going, or is too busy; else it is not what it should be.
fn is_away(error: &tokio_postgres::Error) -> bool {
    let Some(code) = error.code() else {
        return true;
    };
    // Connection, rollback, resources, object state, operator, system.
    let classes = ["08", "40", "53", "55", "57", "58", "25"];
    classes.iter().any(|class| code.code().starts_with(class))
}

/// Runs a transaction, and again where another one stood in its way.
macro_rules! attempt {
    ($body:expr) => {{
        let mut attempts = 1;
        loop {
            let outcome: Result<_, $crate::fault::Fault> = async { $body }.await;
            match outcome {
                Ok(outcome) => break Ok(outcome),
                Err(fault) if fault.is_passing() && attempts < limits::DATABASE_ATTEMPTS_MAX => {
                    attempts += 1;
                }
                Err(fault) => break Err(jobstore::JobStoreError::from(fault)),
            }
        }
    }};
}
pub(super) use attempt;

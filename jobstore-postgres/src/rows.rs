//! Values as the database has them, and back.

use super::fault::Fault;
use jobqueue::{JobRecord, Mode, Stage};
use serde::de::DeserializeOwned;
use std::time::Duration;
use tokio_postgres::Row;

/// A row's material and record.
pub(super) fn job(row: &Row) -> Result<(u32, JobRecord), Fault> {
    Ok((number(row.get(0))?, record(row.get(1))?))
}

/// The record of a job; none is one without a history.
pub(super) fn record(text: Option<&str>) -> Result<JobRecord, Fault> {
    text.map_or_else(|| Ok(JobRecord::default()), |text| json(text, "job"))
}

pub(super) fn mode(text: &str) -> Result<Mode, Fault> {
    json(text, "mode")
}

pub(super) fn json<T: DeserializeOwned>(text: &str, what: &str) -> Result<T, Fault> {
    let read = serde_json::from_str(text);
    read.map_err(|error| Fault::damaged(format!("a {what} cannot be read: {error}")))
}

pub(super) fn text<T: serde::Serialize>(value: &T) -> Result<String, Fault> {
    serde_json::to_string(value).map_err(Fault::damaged)
}

pub(super) fn number(number: i64) -> Result<u32, Fault> {
    u32::try_from(number).map_err(|_| Fault::damaged(format!("{number} is out of range")))
}

pub(super) fn time(milliseconds: i64) -> Duration {
    Duration::from_millis(u64::try_from(milliseconds).unwrap_or_default())
}

pub(super) fn ms(time: Duration) -> i64 {
    i64::try_from(time.as_millis()).unwrap_or(i64::MAX)
}

pub(super) fn no_farm() -> Fault {
    Fault::damaged("the database has no dataset any more")
}

/// A stage as the database calls it.
pub(super) fn stage_name(stage: Stage) -> &'static str {
    match stage {
        Stage::Pending => "pending",
        Stage::Leased => "leased",
        Stage::Completed => "completed",
        Stage::Disputed => "disputed",
        Stage::Quarantined => "set_aside",
        Stage::Cancelled => "cancelled",
    }
}

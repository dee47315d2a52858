//! What a transaction writes, many rows a statement.

use super::{
    connecting::execute,
    fault::Fault,
    rows::{ms, stage_name, text},
};
use deadpool_postgres::Transaction;
use jobqueue::{
    Completion, Holder, JobRecord, JobState, Lease, Mode, RedundantRender, identity::identity,
};
use std::collections::BTreeMap;

pub(super) async fn end_leases(transaction: &Transaction<'_>, ended: &[i64]) -> Result<(), Fault> {
    if !ended.is_empty() {
        execute(transaction, include_str!("sql/end_leases.sql"), &[&ended]).await?;
    }
    Ok(())
}

pub(super) async fn write_leases(
    transaction: &Transaction<'_>,
    held: &[(i64, &Holder, &Lease)],
) -> Result<(), Fault> {
    if held.is_empty() {
        return Ok(());
    }
    let materials: Vec<i64> = held.iter().map(|held| held.0).collect();
    let tokens: Vec<Vec<u8>> = held.iter().map(|held| held.1.token.to_message()).collect();
    let workers: Vec<Vec<u8>> = held.iter().map(|held| held.1.worker.to_message()).collect();
    let names: Vec<&str> = held.iter().map(|held| held.1.name.as_str()).collect();
    let claimed: Vec<i64> = held.iter().map(|held| ms(held.2.claimed)).collect();
    let expires: Vec<i64> = held.iter().map(|held| ms(held.2.expires)).collect();
    let views: Vec<i64> = held
        .iter()
        .map(|held| i64::from(held.2.views_done))
        .collect();
    let progressed: Vec<i64> = held.iter().map(|held| ms(held.2.progressed)).collect();
    execute(
        transaction,
        include_str!("sql/write_leases.sql"),
        &[
            &materials,
            &tokens,
            &workers,
            &names,
            &claimed,
            &expires,
            &views,
            &progressed,
        ],
    )
    .await?;
    Ok(())
}

pub(super) async fn write_mode(
    transaction: &Transaction<'_>,
    mode: Option<Mode>,
) -> Result<(), Fault> {
    if let Some(mode) = mode {
        let mode = text(&mode)?;
        execute(transaction, include_str!("sql/write_mode.sql"), &[&mode]).await?;
    }
    Ok(())
}

pub(super) async fn write_jobs(
    transaction: &Transaction<'_>,
    jobs: &BTreeMap<u32, &JobRecord>,
) -> Result<(), Fault> {
    if jobs.is_empty() {
        return Ok(());
    }
    let materials: Vec<i64> = jobs.keys().map(|material| i64::from(*material)).collect();
    let stages: Vec<&str> = jobs
        .values()
        .map(|job| stage_name(job.state.stage()))
        .collect();
    let priorities: Vec<i32> = jobs.values().map(|job| job.priority).collect();
    let mut wanted = Vec::new();
    let mut renderers: Vec<Option<&str>> = Vec::new();
    let mut contradictors: Vec<Option<&str>> = Vec::new();
    for job in jobs.values() {
        let (redundant, renderer, contradictor) = match &job.state {
            JobState::Completed {
                worker, redundant, ..
            } => match redundant {
                RedundantRender::Agreed => (false, None, None),
                RedundantRender::Disputed(dispute) => (
                    dispute.holder.is_none(),
                    Some(identity(worker)),
                    Some(identity(&dispute.worker)),
                ),
                redundant => (
                    *redundant == RedundantRender::Due,
                    Some(identity(worker)),
                    None,
                ),
            },
            _ => (false, None, None),
        };
        wanted.push(redundant);
        renderers.push(renderer);
        contradictors.push(contradictor);
    }
    let failed = jobs.values().map(|job| {
        let failures = job.failures.iter();
        let mut names: Vec<&str> = failures.map(|failure| failure.worker.as_str()).collect();
        names.sort_unstable();
        names.dedup();
        names.join("\u{1f}")
    });
    let failed: Vec<String> = failed.collect();
    let records = jobs.values().map(|job| {
        let kept = **job != JobRecord::default();
        kept.then(|| text(job)).transpose()
    });
    let records = records.collect::<Result<Vec<Option<String>>, Fault>>()?;
    execute(
        transaction,
        include_str!("sql/write_jobs.sql"),
        &[
            &materials,
            &stages,
            &priorities,
            &wanted,
            &renderers,
            &contradictors,
            &failed,
            &records,
        ],
    )
    .await?;
    Ok(())
}

pub(super) async fn write_completions(
    transaction: &Transaction<'_>,
    completions: &[&Completion],
) -> Result<(), Fault> {
    // A statement touches a row once: of one material the last counts.
    let last = completions
        .iter()
        .map(|completion| (completion.material, *completion));
    let last: BTreeMap<u32, &Completion> = last.collect();
    if last.is_empty() {
        return Ok(());
    }
    let materials: Vec<i64> = last.keys().map(|material| i64::from(*material)).collect();
    let texts = last.values().copied().map(text);
    let texts = texts.collect::<Result<Vec<String>, Fault>>()?;
    let statement = include_str!("sql/write_completions.sql");
    execute(transaction, statement, &[&materials, &texts]).await?;
    Ok(())
}

pub(super) async fn write_images(
    transaction: &Transaction<'_>,
    completions: &[&Completion],
) -> Result<(), Fault> {
    let images = completions.iter().flat_map(|completion| {
        let views = (0..).zip(&completion.views);
        views.map(|(view, image): (i32, _)| {
            let place = (i64::from(completion.material), view, image.bytes as i64);
            (image.digest.as_bytes().as_slice(), place)
        })
    });
    let images: BTreeMap<&[u8], (i64, i32, i64)> = images.collect();
    if images.is_empty() {
        return Ok(());
    }
    let digests: Vec<&[u8]> = images.keys().copied().collect();
    let materials: Vec<i64> = images.values().map(|place| place.0).collect();
    let views: Vec<i32> = images.values().map(|place| place.1).collect();
    let bytes: Vec<i64> = images.values().map(|place| place.2).collect();
    let statement = include_str!("sql/write_images.sql");
    execute(
        transaction,
        statement,
        &[&digests, &materials, &views, &bytes],
    )
    .await?;
    Ok(())
}

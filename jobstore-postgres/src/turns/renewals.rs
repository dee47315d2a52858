//! Leases are prolonged.

use crate::{
    connecting::execute,
    fault::Fault,
    locked_jobs::{HeldLease, LockedJobs},
    rows::ms,
};
use deadpool_postgres::Transaction;
use jobqueue::{Holder, JobRecord, JobState, Queue};
use jobstore::Renewal;
use std::collections::{BTreeMap, HashMap};

/// Prolongs leases, which are locked; of each says whether its holder may go on.
pub(super) async fn renew(
    transaction: &Transaction<'_>,
    locked: &LockedJobs,
    leases: BTreeMap<u32, HeldLease>,
    asked: &[&[Renewal]],
) -> Result<Vec<Vec<bool>>, Fault> {
    if asked.is_empty() {
        return Ok(Vec::new());
    }
    let mut queue = Queue::of_some(locked.policy(), jobqueue::Mode::Running);
    for (material, held) in leases {
        // Whatever else the job is, for its holder it is leased.
        let holder = Holder {
            token: held.token,
            worker: held.worker,
            name: held.name,
        };
        let record = JobRecord {
            state: JobState::Leased(holder),
            ..JobRecord::default()
        };
        queue.add_job(material, record, Some(held.lease));
    }
    let mut renew = |renewal: &Renewal| {
        let Renewal {
            token,
            material,
            views_done,
        } = *renewal;
        queue.renew(material, token, views_done, locked.now)
    };
    let renewed = asked
        .iter()
        .map(|renewals| renewals.iter().map(&mut renew).collect())
        .collect();
    write(transaction, &queue, asked).await?;
    Ok(renewed)
}

async fn write(
    transaction: &Transaction<'_>,
    queue: &Queue,
    asked: &[&[Renewal]],
) -> Result<(), Fault> {
    let renewals = asked.iter().copied().flatten();
    let leases = renewals.filter_map(|renewal| {
        let lease = queue.lease(renewal.material)?;
        let token = queue.holder(renewal.material)?.token;
        Some((renewal.material, (token, lease)))
    });
    // By material: no row is written twice.
    let leases: HashMap<u32, _> = leases.collect();
    let leases: Vec<_> = leases.into_iter().collect();
    let materials: Vec<i64> = leases.iter().map(|lease| i64::from(lease.0)).collect();
    let tokens: Vec<Vec<u8>> = leases.iter().map(|lease| lease.1.0.to_message()).collect();
    let expires: Vec<i64> = leases.iter().map(|lease| ms(lease.1.1.expires)).collect();
    let views = leases.iter().map(|lease| i64::from(lease.1.1.views_done));
    let views: Vec<i64> = views.collect();
    let progressed: Vec<i64> = leases
        .iter()
        .map(|lease| ms(lease.1.1.progressed))
        .collect();
    execute(
        transaction,
        include_str!("../sql/renew_leases.sql"),
        &[&materials, &tokens, &expires, &views, &progressed],
    )
    .await?;
    Ok(())
}

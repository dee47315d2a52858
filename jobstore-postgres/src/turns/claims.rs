//! Claims: jobs are found for all who ask, and the queue decides who gets which.

use super::Counts;
use crate::{
    Shared,
    connecting::{execute, query},
    fault::Fault,
    locked_jobs::LockedJobs,
    rows::{json, number, time},
};
use deadpool_postgres::Transaction;
use jobqueue::{
    Changes, Mode, WorkerChange, WorkerRecord, identity,
    token::{Token, WorkerId},
};
use jobstore::{JobStoreError, Leased};
use std::{
    collections::{BTreeSet, HashMap, HashSet},
    time::Duration,
};
use tokio_postgres::Row;

/// A worker asks for jobs, one for each token.
pub(super) struct Claim {
    pub worker: WorkerId,
    pub tokens: Vec<Token>,
}

/// The claims of one transaction.
pub(super) struct Claims<'a> {
    pub shared: &'a Shared,
    pub transaction: &'a Transaction<'a>,
    pub counts: Counts,
    /// The transaction before may have committed.
    pub asked_again: bool,
}

/// A worker that asks and is registered.
pub(super) struct Asker {
    name: String,
    record: Option<WorkerRecord>,
    /// Of whoever answers for it, where that is not its own.
    answers: Option<WorkerRecord>,
    /// How many more leases it may hold.
    room: usize,
    /// When it was last noted that it is there.
    seen_before: Duration,
}

impl Asker {
    fn block(&self) -> Option<String> {
        let mut records = [&self.record, &self.answers].into_iter().flatten();
        let block = records.find_map(|record| record.block.as_ref())?;
        Some(block.reason.clone())
    }
}

/// Why somebody's history cannot be read is theirs alone to hear.
pub(super) type Askers = HashMap<WorkerId, Result<Asker, String>>;

impl Claims<'_> {
    /// Claims jobs for everybody; adds to `changes`.
    pub async fn claim(
        &self,
        locked: &mut LockedJobs,
        claims: &[&Claim],
        mut askers: Askers,
        changes: &mut Changes,
    ) -> Result<Vec<Result<Leased, JobStoreError>>, Fault> {
        if claims.is_empty() {
            return Ok(Vec::new());
        }
        let before = self.claimed_before(claims).await?;
        self.note_seen(&askers).await?;
        let (wanted, more) = self.find_jobs(locked, claims, &before, &askers).await?;
        let mut leased = Vec::new();
        for (claim, mut tokens) in claims.iter().zip(wanted) {
            let asker = match askers.get_mut(&claim.worker) {
                Some(Ok(asker)) => asker,
                Some(Err(why)) => {
                    leased.push(Err(Fault::damaged(why).into()));
                    continue;
                }
                None => {
                    leased.push(Ok(Leased {
                        draining: self.counts.mode == Mode::Draining,
                        ..Leased::default()
                    }));
                    continue;
                }
            };
            let mut jobs = claimed_by(claim, &before);
            tokens.truncate(asker.room);
            if !tokens.is_empty() {
                let mut claimed = locked.queue.claim(claim.worker, &tokens, locked.now);
                if more && claimed.jobs.len() < tokens.len() {
                    let left = &tokens[claimed.jobs.len()..];
                    let others = self.claim_others(locked, claim.worker, &asker.name, left);
                    claimed.extend(others.await?);
                }
                asker.room -= claimed.jobs.len();
                let materials = claimed.jobs.iter().map(|change| change.material);
                jobs.extend(tokens.into_iter().zip(materials));
                changes.extend(claimed);
            }
            leased.push(Ok(Leased {
                jobs,
                name: Some(asker.name.clone()),
                draining: self.counts.mode == Mode::Draining,
                blocked: asker.block(),
                ..Leased::default()
            }));
        }
        Ok(leased)
    }

    /// Tells those who got nothing whether there never will be anything again. Has to be called
    /// when all is written.
    pub async fn note_finished(
        &self,
        leased: &mut [Result<Leased, JobStoreError>],
    ) -> Result<(), Fault> {
        let mut all = leased.iter().flatten();
        let unserved = all.clone().any(|leased| leased.jobs.is_empty());
        let served = all.any(|leased| !leased.jobs.is_empty());
        // Pending jobs that nobody got are pending still.
        let may_be = unserved && !served && self.counts.pending == 0;
        let finished = may_be && is_finished(self.transaction).await?;
        let operators = leased
            .iter()
            .flatten()
            .filter_map(|leased| leased.name.as_ref());
        let operators = operators.filter(|name| identity::is_operator(name)).count();
        let undisputed = operators > 0 && !is_disputed(self.transaction).await?;
        for leased in leased.iter_mut().flatten() {
            let name = leased.name.as_ref();
            let operator = name.is_some_and(|name| identity::is_operator(name));
            leased.finished = finished || operator && undisputed && leased.jobs.is_empty();
            if leased.finished || leased.draining {
                leased.blocked = None;
            }
        }
        Ok(())
    }

    /// What claims got whose answers were lost.
    async fn claimed_before(&self, claims: &[&Claim]) -> Result<HashMap<Token, u32>, Fault> {
        let mut before = HashMap::new();
        if !self.asked_again {
            return Ok(before);
        }
        let tokens = claims.iter().flat_map(|claim| &claim.tokens);
        let tokens: Vec<Vec<u8>> = tokens.map(|token| token.to_message()).collect();
        let workers = claims.iter().map(|claim| claim.worker.to_message());
        let workers: Vec<Vec<u8>> = workers.collect();
        let statement = include_str!("../sql/claimed_before.sql");
        for row in query(self.transaction, statement, &[&workers, &tokens]).await? {
            if let Some(token) = Token::from_message(row.get(1)) {
                before.insert(token, number(row.get(0))?);
            }
        }
        Ok(before)
    }

    /// Who asks.
    pub fn read(&self, rows: &[Row]) -> Askers {
        let asker = |row: &Row| {
            let name: String = row.get(1);
            let record = |column: usize| {
                let text: Option<&str> = row.get(column);
                text.map(|text| json(text, "worker")).transpose()
            };
            let held: i64 = row.get(4);
            let room = i64::from(self.shared.policy.leases_per_worker_max) - held;
            record(2)
                .and_then(|own| Ok((own, record(5)?)))
                .map(|(record, answers)| Asker {
                    name: name.clone(),
                    record,
                    answers,
                    room: usize::try_from(room).unwrap_or_default(),
                    seen_before: time(row.get(3)),
                })
                .map_err(|fault| format!("the history of worker {name}: {fault:?}"))
        };
        let worker = |row: &Row| WorkerId::from_message(row.get(0));
        let askers = rows.iter();
        askers
            .filter_map(|row| Some((worker(row)?, asker(row))))
            .collect()
    }

    /// Notes that workers are there, where that was not done lately.
    async fn note_seen(&self, askers: &Askers) -> Result<(), Fault> {
        let after = limits::WORKER_ABSENT / 3;
        let seen = askers.iter().filter(|(_, asker)| {
            let asker = asker.as_ref();
            asker.is_ok_and(|asker| asker.seen_before >= after)
        });
        let mut seen: Vec<Vec<u8>> = seen.map(|(worker, _)| worker.to_message()).collect();
        if !seen.is_empty() {
            // In one order, so that no two coordinators wait for each other.
            seen.sort_unstable();
            execute(self.transaction, include_str!("../sql/seen.sql"), &[&seen]).await?;
        }
        Ok(())
    }

    /// Locks jobs for all who may have some; returns the tokens that each claim wants jobs for, and
    /// whether there may be more jobs.
    async fn find_jobs(
        &self,
        locked: &mut LockedJobs,
        claims: &[&Claim],
        before: &HashMap<Token, u32>,
        askers: &Askers,
    ) -> Result<(Vec<Vec<Token>>, bool), Fault> {
        let mut names: BTreeSet<&str> = BTreeSet::new();
        let mut wanted = Vec::new();
        let mut count = 0;
        for claim in claims {
            let asker = match askers.get(&claim.worker) {
                Some(Ok(asker)) if asker.block().is_none() => asker,
                _ => {
                    wanted.push(Vec::new());
                    continue;
                }
            };
            // Whoever got some before has its answer.
            let answered = claim.tokens.iter().any(|token| before.contains_key(token));
            let tokens = match self.counts.mode {
                Mode::Running if !answered => claim.tokens.clone(),
                _ => Vec::new(),
            };
            if !tokens.is_empty() {
                names.insert(&asker.name);
                locked.queue.admit(claim.worker, &asker.name);
                count += tokens.len().min(asker.room);
                let own = asker.record.as_ref().map(|record| (&*asker.name, record));
                let answers = asker.answers.as_ref();
                let answers = answers.map(|record| (identity::identity(&asker.name), record));
                for (name, record) in own.into_iter().chain(answers) {
                    let (name, record) = (name.to_owned(), record.clone());
                    let worker = WorkerChange { name, record };
                    locked.queue.add_worker(worker, locked.now);
                }
            }
            wanted.push(tokens);
        }
        let names: Vec<&str> = names.into_iter().collect();
        let more = self.lock_claimable(locked, &names, count).await?;
        Ok((wanted, more))
    }

    /// Claims jobs for one that those found for all are not for.
    async fn claim_others(
        &self,
        locked: &mut LockedJobs,
        worker: WorkerId,
        name: &str,
        tokens: &[Token],
    ) -> Result<Changes, Fault> {
        self.lock_claimable(locked, &[name], tokens.len()).await?;
        Ok(locked.queue.claim(worker, tokens, locked.now))
    }

    /// Locks up to `count` jobs that one or another of these may have, besides those that are
    /// locked already. False when there are no more.
    async fn lock_claimable(
        &self,
        locked: &mut LockedJobs,
        names: &[&str],
        count: usize,
    ) -> Result<bool, Fault> {
        let mut lacking = count as i64;
        // The operator renders what is disputed and nothing else.
        let renderers = names.iter().copied();
        let renderers: Vec<&str> = renderers
            .filter(|name| !identity::is_operator(name))
            .collect();
        let fresh = self.counts.pending > 0 && !renderers.is_empty();
        for (statement, names, some) in [
            (
                include_str!("../sql/redundant.sql"),
                names,
                self.counts.redundant > 0,
            ),
            (include_str!("../sql/fresh.sql"), &renderers, fresh),
            (include_str!("../sql/again.sql"), &renderers, fresh),
        ] {
            while lacking > 0 && some {
                let mut known = locked.known();
                known.extend(self.shared.unreadable());
                let rows = query(self.transaction, statement, &[&names, &lacking, &known]).await?;
                let unreadable = locked.add(&rows)?;
                lacking -= (rows.len() - unreadable.len()) as i64;
                if unreadable.is_empty() {
                    break;
                }
                self.shared.pass_over(unreadable);
            }
        }
        Ok(count > 0 && lacking == 0)
    }
}

/// The rows of those who ask and are registered.
pub(super) async fn askers(
    transaction: &Transaction<'_>,
    claims: &[&Claim],
) -> Result<Vec<Row>, Fault> {
    if claims.is_empty() {
        return Ok(Vec::new());
    }
    let workers: HashSet<WorkerId> = claims.iter().map(|claim| claim.worker).collect();
    let workers: Vec<Vec<u8>> = workers.iter().map(|worker| worker.to_message()).collect();
    let statement = include_str!("../sql/askers.sql");
    query(transaction, statement, &[&workers]).await
}

fn claimed_by(claim: &Claim, before: &HashMap<Token, u32>) -> Vec<(Token, u32)> {
    let tokens = claim.tokens.iter();
    tokens
        .filter_map(|token| Some((*token, *before.get(token)?)))
        .collect()
}

/// Whether two contradict each other about a job.
async fn is_disputed(transaction: &Transaction<'_>) -> Result<bool, Fault> {
    let statement = include_str!("../sql/disputed.sql");
    let rows = query(transaction, statement, &[]).await?;
    Ok(!rows.is_empty())
}

/// Whether nothing is left to do, now or later.
pub(crate) async fn is_finished(transaction: &Transaction<'_>) -> Result<bool, Fault> {
    let rows = query(transaction, include_str!("../sql/finished.sql"), &[]).await?;
    Ok(rows.first().is_some_and(|row| row.get(0)))
}

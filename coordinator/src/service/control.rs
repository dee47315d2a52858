//! The service for people.

use super::{
    Answer, digest, message_digest,
    refusal::{invalid, too_many},
};
use crate::farm::{Event, Farm, WorkerReport};
use jobqueue::{Block, JobRecord, JobState, Mode, RedundantRender, Selection, Stage};
use jobstore::JobsOrder;
use std::{pin::Pin, sync::Arc};
use tokio_stream::{
    Stream, StreamExt,
    wrappers::{BroadcastStream, errors::BroadcastStreamRecvError},
};
use tonic::{Request, Response, Status};

/// The service for people over a farm. Checks no role: its caller does.
pub struct ControlService {
    pub(crate) farm: Arc<Farm>,
}

#[tonic::async_trait]
impl proto::Control for ControlService {
    type WatchEventsStream = Pin<Box<dyn Stream<Item = Result<proto::Event, Status>> + Send>>;

    async fn status(&self, _: Request<proto::StatusRequest>) -> Answer<proto::StatusResponse> {
        let report = self.farm.fresh_report().await?;
        let progress = report.progress;
        let counts = progress.counts;
        let quarantined = self.farm.quarantined().await?.into_iter();
        let disputed = self.farm.disputed().await?.into_iter();
        Ok(Response::new(proto::StatusResponse {
            name: self.farm.specification.name.clone(),
            specification_hash: message_digest(&self.farm.specification_hash),
            views: self.farm.specification.views.len() as u32,
            counts: Some(proto::Counts {
                materials: counts.materials,
                completed: counts.completed,
                leased: counts.leased,
                pending: counts.pending,
                set_aside: counts.quarantined,
                images: progress.images,
                bytes_received: progress.bytes_received,
                workers: progress.workers,
                failures: progress.failures,
                leases_lost: progress.leases_lost,
                cancelled: counts.cancelled,
                disputed: counts.disputed,
                checks: counts.redundant,
                workers_barred: report.workers_blocked,
            }),
            set_aside: quarantined
                .map(|(material, errors)| proto::SetAside { material, errors })
                .collect(),
            mode: message_mode(report.mode).into(),
            finished: progress.finished,
            up_ms: report.up.as_millis() as u64,
            images_per_second: report.images_per_second,
            disputed: disputed
                .map(|dispute| proto::Disputed {
                    material: dispute.material,
                    worker: dispute.worker,
                    contradicted_by: dispute.contradicted_by,
                })
                .collect(),
        }))
    }

    async fn list_jobs(
        &self,
        request: Request<proto::ListJobsRequest>,
    ) -> Answer<proto::ListJobsResponse> {
        let message = request.into_inner();
        let wanted = selection(message.selection)?;
        let jobs_max = message.jobs_max.clamp(1, limits::protocol::JOBS_LISTED_MAX) as usize;
        let page = self.farm.jobs(message.from, jobs_max, &wanted).await?;
        let jobs = page.jobs.into_iter();
        Ok(Response::new(proto::ListJobsResponse {
            jobs: jobs
                .map(|(material, job, views_done)| job_detail(material, job, views_done))
                .collect(),
            next: page.next,
        }))
    }

    async fn list_workers(
        &self,
        _: Request<proto::ListWorkersRequest>,
    ) -> Answer<proto::ListWorkersResponse> {
        let workers = self.farm.workers().await?.into_iter();
        Ok(Response::new(proto::ListWorkersResponse {
            workers: workers
                .map(|(name, report)| worker_detail(name, report))
                .collect(),
        }))
    }

    async fn watch_events(
        &self,
        _: Request<proto::WatchEventsRequest>,
    ) -> Answer<Self::WatchEventsStream> {
        let events = BroadcastStream::new(self.farm.watch()?);
        let events = events.map(|event| {
            Ok(match event {
                Ok(event) => event_message(event),
                Err(BroadcastStreamRecvError::Lagged(missed)) => proto::Event {
                    kind: "missed".to_owned(),
                    text: format!("{missed} events were missed"),
                    ..proto::Event::default()
                },
            })
        });
        Ok(Response::new(Box::pin(events)))
    }

    async fn get_blob(
        &self,
        request: Request<proto::GetBlobRequest>,
    ) -> Answer<proto::GetBlobResponse> {
        let digest = digest("digest", &request.into_inner().digest)?;
        let data = self.farm.blob(digest).await?.into();
        Ok(Response::new(proto::GetBlobResponse { data }))
    }

    async fn retry_jobs(
        &self,
        request: Request<proto::RetryJobsRequest>,
    ) -> Answer<proto::JobsChanged> {
        self.change(request.into_inner().selection, JobsOrder::Retry)
            .await
    }

    async fn cancel_jobs(
        &self,
        request: Request<proto::CancelJobsRequest>,
    ) -> Answer<proto::JobsChanged> {
        self.change(request.into_inner().selection, JobsOrder::Cancel)
            .await
    }

    async fn prioritize_jobs(
        &self,
        request: Request<proto::PrioritizeJobsRequest>,
    ) -> Answer<proto::JobsChanged> {
        let message = request.into_inner();
        let max = limits::protocol::PRIORITY_MAX;
        if !(-max..=max).contains(&message.priority) {
            let reason = format!(
                "a priority is between -{max} and {max}, and this is {}",
                message.priority
            );
            return Err(invalid("priority", &reason));
        }
        self.change(message.selection, JobsOrder::Prioritize(message.priority))
            .await
    }

    async fn pause(&self, _: Request<proto::PauseRequest>) -> Answer<proto::ModeChanged> {
        self.set_mode(Mode::Paused).await
    }

    async fn resume(&self, _: Request<proto::ResumeRequest>) -> Answer<proto::ModeChanged> {
        self.set_mode(Mode::Running).await
    }

    async fn drain(&self, _: Request<proto::DrainRequest>) -> Answer<proto::ModeChanged> {
        self.set_mode(Mode::Draining).await
    }

    async fn bar_worker(
        &self,
        request: Request<proto::BarWorkerRequest>,
    ) -> Answer<proto::BarWorkerResponse> {
        let message = request.into_inner();
        let long = [
            ("name", message.name.len(), limits::protocol::NAME_BYTES_MAX),
            (
                "reason",
                message.reason.len(),
                limits::protocol::REASON_BYTES_MAX,
            ),
        ];
        for (field, found, max) in long {
            if found == 0 || found > max {
                let reason = format!("{field} has 1 to {max} bytes, and this has {found}");
                return Err(invalid(field, &reason));
            }
        }
        let leases_taken_back = self.farm.block(&message.name, message.reason).await?;
        Ok(Response::new(proto::BarWorkerResponse {
            leases_taken_back,
        }))
    }

    async fn unbar_worker(
        &self,
        request: Request<proto::UnbarWorkerRequest>,
    ) -> Answer<proto::UnbarWorkerResponse> {
        self.farm.unblock(&request.into_inner().name).await?;
        Ok(Response::new(proto::UnbarWorkerResponse {}))
    }
}

impl ControlService {
    async fn change(
        &self,
        selected: Option<proto::JobSelection>,
        order: JobsOrder,
    ) -> Answer<proto::JobsChanged> {
        let wanted = selection(selected)?;
        let changed = ranges(&self.farm.order(order, &wanted).await?);
        Ok(Response::new(proto::JobsChanged { changed }))
    }

    async fn set_mode(&self, mode: Mode) -> Answer<proto::ModeChanged> {
        let repeated = self.farm.set_mode(mode).await?;
        Ok(Response::new(proto::ModeChanged {
            mode: message_mode(mode).into(),
            repeated,
        }))
    }
}

/// Which jobs a selection selects.
fn selection(selection: Option<proto::JobSelection>) -> Result<Selection, Status> {
    let proto::JobSelection { ranges, states } = selection.unwrap_or_default();
    if ranges.len() > limits::protocol::RANGES_PER_CALL_MAX {
        let max = limits::protocol::RANGES_PER_CALL_MAX;
        return Err(too_many("ranges", ranges.len(), max));
    }
    if let Some(range) = ranges.iter().find(|range| range.first > range.last) {
        let reason = format!("{} to {} is no range", range.first, range.last);
        return Err(invalid("selection.ranges", &reason));
    }
    let stages = states.into_iter().map(|state| {
        let known = proto::JobState::try_from(state).ok();
        let stage = known.and_then(stage);
        stage.ok_or_else(|| invalid("selection.states", &format!("{state} is no state of a job")))
    });
    let ranges = ranges.iter().map(|range| (range.first, range.last));
    Ok(Selection::new(
        ranges.collect(),
        stages.collect::<Result<_, Status>>()?,
    ))
}

/// Ascending materials as ranges.
fn ranges(materials: &[u32]) -> Vec<proto::MaterialRange> {
    let mut ranges: Vec<proto::MaterialRange> = Vec::new();
    for material in materials.iter().copied() {
        match ranges.last_mut() {
            Some(range) if range.last + 1 == material => range.last = material,
            _ => ranges.push(proto::MaterialRange {
                first: material,
                last: material,
            }),
        }
    }
    ranges
}

fn message_mode(mode: Mode) -> proto::Mode {
    match mode {
        Mode::Running => proto::Mode::Running,
        Mode::Paused => proto::Mode::Paused,
        Mode::Draining => proto::Mode::Draining,
    }
}

fn message_state(stage: Stage) -> proto::JobState {
    match stage {
        Stage::Pending => proto::JobState::Pending,
        Stage::Leased => proto::JobState::Leased,
        Stage::Completed => proto::JobState::Completed,
        Stage::Disputed => proto::JobState::Disputed,
        Stage::Quarantined => proto::JobState::SetAside,
        Stage::Cancelled => proto::JobState::Cancelled,
    }
}

fn stage(state: proto::JobState) -> Option<Stage> {
    Some(match state {
        proto::JobState::Unspecified => return None,
        proto::JobState::Pending => Stage::Pending,
        proto::JobState::Leased => Stage::Leased,
        proto::JobState::Completed => Stage::Completed,
        proto::JobState::Disputed => Stage::Disputed,
        proto::JobState::SetAside => Stage::Quarantined,
        proto::JobState::Cancelled => Stage::Cancelled,
    })
}

fn job_detail(material: u32, job: JobRecord, views_done: u32) -> proto::JobDetail {
    let state = message_state(job.state.stage());
    let holder = job.state.holder();
    let lease = holder.map_or_else(String::new, |holder| holder.token.to_string());
    let mut worker = holder.map_or_else(String::new, |holder| holder.name.clone());
    let mut contradicted_by = String::new();
    let mut verdict = proto::Check::None;
    if let JobState::Completed {
        worker: by,
        redundant,
        ..
    } = &job.state
    {
        worker.clone_from(by);
        verdict = match redundant {
            RedundantRender::None => proto::Check::None,
            RedundantRender::Due => proto::Check::Due,
            RedundantRender::Leased(_) => proto::Check::UnderWay,
            RedundantRender::Agreed => proto::Check::Agreed,
            RedundantRender::Disputed(dispute) => {
                contradicted_by.clone_from(&dispute.worker);
                proto::Check::None
            }
        };
    }
    let failures = job.failures.into_iter();
    let failures = failures.map(|failure| proto::JobFailure {
        worker: failure.worker,
        error: shortened(failure.error),
    });
    proto::JobDetail {
        material,
        state: state.into(),
        priority: job.priority,
        failures: failures.collect(),
        leases_lost: job.leases_lost,
        worker,
        lease,
        views_done,
        check: verdict.into(),
        contradicted_by,
    }
}

fn worker_detail(name: String, report: WorkerReport) -> proto::WorkerDetail {
    let failures = report.record.failures_in_a_row.into_iter();
    let failures = failures.map(|failure| proto::WorkerFailure {
        material: failure.material,
        error: shortened(failure.error),
    });
    let silent = report.silent.unwrap_or_default();
    proto::WorkerDetail {
        name,
        sessions: report.sessions,
        leases: report.leases,
        materials_completed: report.completed,
        failures: report.record.failures,
        leases_lost: report.record.leases_lost,
        failures_in_a_row: failures.collect(),
        barred: report
            .record
            .block
            .map_or_else(String::new, |Block { reason, .. }| reason),
        silent_ms: silent.as_millis() as u64,
    }
}

fn event_message(event: Event) -> proto::Event {
    proto::Event {
        unix_ms: event.unix_ms,
        kind: event.kind.name().to_owned(),
        material: event.material,
        worker: event.worker,
        lease: event.lease,
        text: event.text,
    }
}

fn shortened(mut error: String) -> String {
    error.truncate(error.floor_char_boundary(limits::protocol::ERROR_LISTED_BYTES_MAX));
    error
}

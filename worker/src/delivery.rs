//! Delivering a rendered job: images first, then the completion.

use crate::{
    connection::{CallError, Connection},
    job::{Job, RenderedJob},
    limits,
};
use proto::{
    CompleteRequest, ErrorStatistics, FailRequest, FindMissingBlobsRequest, PutBlobRequest, View,
};
use std::{collections::VecDeque, sync::atomic::Ordering};
use tokio::task::JoinSet;
use tonic::Code;

/// What became of a delivery.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum Delivered {
    /// Recorded, durably; now, or before by somebody with the same images.
    Recorded,
    /// The lease was lost before: the work is somebody else's now.
    Lost,
    /// The coordinator does not take the images; it knows why.
    Refused,
}

/// Sends what the coordinator lacks and reports the material complete, as often as it takes: a
/// coordinator that restarts in between has forgotten the images, not the lease.
pub(crate) async fn deliver(
    connection: &Connection,
    job: &Job,
    rendered: &RenderedJob,
) -> Result<Delivered, CallError> {
    let completion = completion(job, rendered);
    for _ in 0..limits::DELIVERIES_MAX {
        if job.lost.load(Ordering::Relaxed) {
            return Ok(Delivered::Lost);
        }
        let sent = send_missing(connection, rendered).await;
        let completed = match sent {
            Err(error) => Err(error),
            Ok(()) => {
                let message = completion.clone();
                let complete = connection.call(message, async |mut client, request| {
                    client.complete(request).await
                });
                complete.await
            }
        };
        match completed {
            Ok(answer) if answer.missing.is_empty() => return Ok(Delivered::Recorded),
            Ok(answer) => tracing::info!(missing = answer.missing.len(), "images are sent again"),
            Err(CallError::Refused(status)) => {
                return refused(connection, job, &status).await;
            }
            Err(error) => return Err(error),
        }
    }
    let reason = "the coordinator lost the images again and again".to_owned();
    report_failure(connection, job, reason).await?;
    Ok(Delivered::Refused)
}

/// Tells the coordinator that a job could not be done. A lease lost in the meantime is no error.
pub(crate) async fn report_failure(
    connection: &Connection,
    job: &Job,
    error: String,
) -> Result<(), CallError> {
    tracing::warn!(error, "the material could not be rendered");
    let message = FailRequest {
        token: job.token.clone(),
        material: job.material,
        error,
    };
    let answer = connection
        .call(message, async |mut client, request| {
            client.fail(request).await
        })
        .await;
    match answer {
        Ok(_) | Err(CallError::Refused(_)) => Ok(()),
        Err(error) => Err(error),
    }
}

async fn refused(
    connection: &Connection,
    job: &Job,
    status: &tonic::Status,
) -> Result<Delivered, CallError> {
    if status.code() == Code::FailedPrecondition {
        tracing::warn!(reason = status.message(), "the work came too late");
        return Ok(Delivered::Lost);
    }
    report_failure(connection, job, status.message().to_owned()).await?;
    Ok(Delivered::Refused)
}

async fn send_missing(connection: &Connection, rendered: &RenderedJob) -> Result<(), CallError> {
    let message = FindMissingBlobsRequest {
        digests: rendered
            .views
            .iter()
            .map(|(digest, _)| digest.as_bytes().to_vec())
            .collect(),
    };
    let answer = connection
        .call(message, async |mut client, request| {
            client.find_missing_blobs(request).await
        })
        .await?;
    let mut waiting: VecDeque<PutBlobRequest> = rendered
        .views
        .iter()
        .filter(|(digest, _)| {
            answer
                .missing
                .iter()
                .any(|bytes| bytes == digest.as_bytes())
        })
        .map(|(digest, image)| PutBlobRequest {
            digest: digest.as_bytes().to_vec(),
            size: image.exr.len() as u64,
            data: image.exr.clone().into(),
        })
        .collect();
    let mut uploads = JoinSet::new();
    loop {
        while uploads.len() < limits::UPLOADS_AT_ONCE {
            let Some(message) = waiting.pop_front() else {
                break;
            };
            let connection = connection.clone();
            uploads.spawn(async move {
                connection
                    .call(message, async |mut client, request| {
                        client.put_blob(request).await
                    })
                    .await
            });
        }
        match uploads.join_next().await {
            None => return Ok(()),
            Some(Ok(uploaded)) => {
                uploaded?;
            }
            Some(Err(error)) => unreachable!("an upload neither panics nor is cancelled: {error}"),
        }
    }
}

fn completion(job: &Job, rendered: &RenderedJob) -> CompleteRequest {
    let views = rendered.views.iter().map(|(digest, image)| {
        let statistics = image.statistics;
        View {
            digest: digest.as_bytes().to_vec(),
            size: image.exr.len() as u64,
            statistics: Some(ErrorStatistics {
                mean: statistics.mean,
                p95: statistics.p95,
                max: statistics.max,
                within_target: statistics.within_target,
                samples: statistics.samples,
                evaluations: statistics.evaluations,
            }),
        }
    });
    CompleteRequest {
        token: job.token.clone(),
        material: job.material,
        views: views.collect(),
        seconds: rendered.time.as_secs_f64(),
    }
}

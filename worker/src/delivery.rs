//! Delivering a rendered job: images first, then the completion; small images come along with it.

use crate::{
    connection::{CallError, Connection, pause},
    job::{Job, RenderedJob},
    render::RenderedView,
    upload::Uploader,
};
use bytes::Bytes;
use dataset::Digest;
use futures_util::{StreamExt, stream};
use limits::protocol::IMAGES_BROUGHT_BYTES_MAX;
use md5::{Digest as _, Md5};
use proto::{
    CompleteRequest, ErrorStatistics, FailRequest, FindMissingBlobsRequest,
    FindMissingBlobsResponse, GetUploadUrlsRequest, PixelStatistics, PutBlobRequest, Upload, View,
};
use std::{collections::VecDeque, sync::atomic::Ordering};
use tokio::{
    task::JoinSet,
    time::{Instant, sleep},
};
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
    uploader: &Uploader,
    job: &Job,
    rendered: &RenderedJob,
) -> Result<Delivered, CallError> {
    let asked = find_missing(connection, job, rendered).await;
    let FindMissingBlobsResponse {
        mut missing,
        upload_by_url,
    } = match asked {
        Ok(answer) => answer,
        Err(CallError::Refused(status)) => return refused(connection, job, &status).await,
        Err(error) => return Err(error),
    };
    for _ in 0..limits::worker::DELIVERIES_MAX {
        if job.lost.load(Ordering::Relaxed) {
            return Ok(Delivered::Lost);
        }
        let mut completion = completion(job, rendered, upload_by_url);
        let sent = if upload_by_url {
            upload_missing(connection, uploader, job, rendered, &missing).await
        } else if bytes_of(rendered, &missing) <= IMAGES_BROUGHT_BYTES_MAX {
            bring_along(&mut completion, rendered, &missing);
            Ok(())
        } else {
            send_missing(connection, job, rendered, &missing).await
        };
        let completed = match sent {
            Err(error) => Err(error),
            Ok(()) => {
                let complete = connection.call(completion, async |mut client, request| {
                    client.complete(request).await
                });
                complete.await
            }
        };
        match completed {
            Ok(answer) if answer.missing.is_empty() => return Ok(Delivered::Recorded),
            Ok(answer) => {
                tracing::info!(missing = answer.missing.len(), "images are sent again");
                missing = answer.missing;
            }
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

async fn find_missing(
    connection: &Connection,
    job: &Job,
    rendered: &RenderedJob,
) -> Result<FindMissingBlobsResponse, CallError> {
    let views = rendered.views.iter();
    let bytes: u64 = views.clone().map(|(_, image)| image.exr.len() as u64).sum();
    // Images that come along with the completion need no room of their own.
    let token = if bytes > IMAGES_BROUGHT_BYTES_MAX {
        job.token.clone()
    } else {
        Vec::new()
    };
    let message = FindMissingBlobsRequest {
        digests: views
            .map(|(digest, _)| digest.as_bytes().to_vec())
            .collect(),
        token,
        material: job.material,
    };
    let ask = connection.call(message, async |mut client, request| {
        client.find_missing_blobs(request).await
    });
    ask.await
}

/// Sends images to the bucket, with new URLs as often as those before are of no use.
async fn upload_missing(
    connection: &Connection,
    uploader: &Uploader,
    job: &Job,
    rendered: &RenderedJob,
    missing: &[Vec<u8>],
) -> Result<(), CallError> {
    let mut waiting: Vec<(Upload, Bytes)> = missing_of(rendered, missing)
        .map(|(digest, image)| {
            let upload = Upload {
                digest: digest.as_bytes().to_vec(),
                md5: md5(image),
            };
            (upload, Bytes::from(image.exr.clone()))
        })
        .collect();
    let began = Instant::now();
    for attempt in 0.. {
        if waiting.is_empty() || job.lost.load(Ordering::Relaxed) {
            return Ok(());
        }
        let message = GetUploadUrlsRequest {
            token: job.token.clone(),
            material: job.material,
            uploads: waiting.iter().map(|(upload, _)| upload.clone()).collect(),
        };
        let signed = connection.call(message, async |mut client, request| {
            client.get_upload_urls(request).await
        });
        let urls = signed.await?.urls;
        let images = waiting.into_iter().zip(urls);
        let uploads = images.map(|((upload, bytes), url)| async move {
            let sent = uploader.put(&url, bytes.clone()).await;
            sent.err().map(|error| ((upload, bytes), error))
        });
        let failed: Vec<_> = stream::iter(uploads)
            .buffer_unordered(limits::worker::UPLOADS_AT_ONCE)
            .filter_map(async |failed| failed)
            .collect()
            .await;
        let (again, errors): (Vec<_>, Vec<_>) = failed.into_iter().unzip();
        waiting = again;
        if let Some(error) = errors.first() {
            let away = began.elapsed();
            if away >= connection.patience() {
                return Err(CallError::BucketAway(away, error.to_string()));
            }
            tracing::warn!(%error, images = errors.len(), "uploads failed, trying again");
            sleep(pause(attempt)).await;
        }
    }
    unreachable!("attempts do not run out")
}

fn is_among(digest: &Digest, missing: &[Vec<u8>]) -> bool {
    missing.iter().any(|bytes| bytes == digest.as_bytes())
}

/// Of a job's images those that are missing.
fn missing_of<'a>(
    rendered: &'a RenderedJob,
    missing: &'a [Vec<u8>],
) -> impl Iterator<Item = &'a (Digest, RenderedView)> {
    let views = rendered.views.iter();
    views.filter(|(digest, _)| is_among(digest, missing))
}

fn bytes_of(rendered: &RenderedJob, missing: &[Vec<u8>]) -> u64 {
    let images = missing_of(rendered, missing);
    images.map(|(_, image)| image.exr.len() as u64).sum()
}

/// Puts images into the completion: a call less for each.
fn bring_along(completion: &mut CompleteRequest, rendered: &RenderedJob, missing: &[Vec<u8>]) {
    for (view, (digest, image)) in completion.views.iter_mut().zip(&rendered.views) {
        if is_among(digest, missing) {
            view.image = image.exr.clone().into();
        }
    }
}

/// Sends images to the coordinator.
async fn send_missing(
    connection: &Connection,
    job: &Job,
    rendered: &RenderedJob,
    missing: &[Vec<u8>],
) -> Result<(), CallError> {
    let mut waiting: VecDeque<PutBlobRequest> = missing_of(rendered, missing)
        .map(|(digest, image)| PutBlobRequest {
            digest: digest.as_bytes().to_vec(),
            size: image.exr.len() as u64,
            data: image.exr.clone().into(),
            token: job.token.clone(),
            material: job.material,
        })
        .collect();
    let mut uploads = JoinSet::new();
    loop {
        while uploads.len() < limits::worker::UPLOADS_AT_ONCE {
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

fn md5(image: &RenderedView) -> Vec<u8> {
    Md5::digest(&image.exr).to_vec()
}

fn completion(job: &Job, rendered: &RenderedJob, with_md5s: bool) -> CompleteRequest {
    let views = rendered.views.iter().map(|(digest, image)| {
        let (statistics, pixels) = (image.statistics, image.pixels);
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
            md5: if with_md5s { md5(image) } else { Vec::new() },
            image: Bytes::new(),
            pixels: Some(PixelStatistics {
                sample_share: pixels.sample_share,
                brightness_mean: pixels.brightness_mean,
                brightness_p99: pixels.brightness_p99,
                dark_share: pixels.dark_share,
                above_white_share: pixels.above_white_share,
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

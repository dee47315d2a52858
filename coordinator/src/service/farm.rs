//! The service for workers.

use super::{
    Answer, digest, message_digest,
    refusal::{invalid, is_momentary, refuse, too_many},
    token, worker,
};
use crate::{
    farm::{Farm, Md5, Outcome, RenderedImage, RenderedMaterial},
    security::{Caller, Role},
};
use bytes::Bytes;
use dataset::{CompletedView, Digest, ErrorStatistics, PixelStatistics, RENDERER_VERSION};
use imagestore::staging::{Credential, LeaseOf};
use jobqueue::identity::{OPERATOR, full_name};
use jobstore::Renewal;
use limits::protocol::MESH_BYTES_PER_CALL;
use std::{sync::Arc, time::Duration};
use tonic::{Code, Request, Response, Status};
use tracing::{Instrument, info_span};

/// The service for workers over a farm.
pub(crate) struct FarmService {
    pub farm: Arc<Farm>,
}

#[tonic::async_trait]
impl proto::Farm for FarmService {
    async fn get_dataset(
        &self,
        _: Request<proto::GetDatasetRequest>,
    ) -> Answer<proto::GetDatasetResponse> {
        Ok(Response::new(proto::GetDatasetResponse {
            specification_json: self.farm.specification.to_json(),
            specification_hash: message_digest(&self.farm.specification_hash),
            renderer_version: RENDERER_VERSION.to_owned(),
            materials: self.farm.progress().borrow().counts.materials,
        }))
    }

    async fn get_mesh(
        &self,
        request: Request<proto::GetMeshRequest>,
    ) -> Answer<proto::GetMeshResponse> {
        let offset = request.into_inner().offset;
        let mesh = self.farm.specification.sample.loaded_mesh();
        let mesh = mesh.ok_or_else(|| {
            let message = "the sample of this dataset is not a mesh: there is none to fetch";
            refuse(Code::NotFound, "NO_MESH", message)
        })?;
        let (bytes, total_bytes) = part(Bytes::from_owner(Arc::clone(mesh.bytes())), offset)?;
        Ok(Response::new(proto::GetMeshResponse { bytes, total_bytes }))
    }

    async fn register(
        &self,
        request: Request<proto::RegisterRequest>,
    ) -> Answer<proto::RegisterResponse> {
        let caller = request.extensions().get::<Caller>().cloned();
        let message = request.into_inner();
        if message.name.is_empty() || message.name.len() > limits::protocol::NAME_BYTES_MAX {
            let reason = format!(
                "a worker's name has 1 to {} bytes, and this one has {}",
                limits::protocol::NAME_BYTES_MAX,
                message.name.len()
            );
            return Err(invalid("name", &reason));
        }
        let known = match message.worker_id.as_slice() {
            [] => None,
            bytes => Some(worker(bytes)?),
        };
        if message.name.chars().any(char::is_control) {
            return Err(invalid("name", "a worker's name has no control characters"));
        }
        let hash = digest("specification_hash", &message.specification_hash)?;
        let credential = credential(caller.as_ref(), message.resolves_disputes)?;
        let name = full_name(credential, &message.name);
        let worker = self
            .farm
            .register(known, name, &message.renderer_version, hash)
            .await?;
        Ok(Response::new(proto::RegisterResponse {
            worker_id: worker.to_message(),
            lease_ms: self.farm.policy.lease.as_millis() as u64,
            deadline_ms: self.farm.policy.deadline.as_millis() as u64,
        }))
    }

    async fn lease(&self, request: Request<proto::LeaseRequest>) -> Answer<proto::LeaseResponse> {
        let message = request.into_inner();
        let worker = worker(&message.worker_id)?;
        let wait = Duration::from_millis(message.wait_ms);
        let leased = self.farm.lease(worker, message.jobs_max, wait).await?;
        let jobs = leased.jobs.into_iter();
        let jobs = jobs.map(|(token, material)| proto::Job {
            token: token.to_message(),
            material,
        });
        Ok(Response::new(proto::LeaseResponse {
            jobs: jobs.collect(),
            finished: leased.finished,
            draining: leased.draining,
            barred: leased.blocked.unwrap_or_default(),
        }))
    }

    async fn renew(&self, request: Request<proto::RenewRequest>) -> Answer<proto::RenewResponse> {
        let message = request.into_inner();
        let worker = worker(&message.worker_id)?;
        if message.renewals.len() > limits::protocol::LEASES_PER_WORKER_MAX as usize {
            let max = limits::protocol::LEASES_PER_WORKER_MAX as usize;
            return Err(too_many("renewals", message.renewals.len(), max));
        }
        let renewals = message
            .renewals
            .iter()
            .map(|renewal| {
                let token = token(&renewal.token)?;
                Ok(Renewal {
                    token,
                    material: renewal.material,
                    views_done: renewal.views_done,
                })
            })
            .collect::<Result<Vec<_>, Status>>()?;
        let lost = self.farm.renew(worker, &renewals).await?;
        Ok(Response::new(proto::RenewResponse { lost }))
    }

    async fn find_missing_blobs(
        &self,
        request: Request<proto::FindMissingBlobsRequest>,
    ) -> Answer<proto::FindMissingBlobsResponse> {
        let by = caller(&request);
        let message = request.into_inner();
        if message.digests.len() > limits::protocol::DIGESTS_PER_CALL_MAX {
            let max = limits::protocol::DIGESTS_PER_CALL_MAX;
            return Err(too_many("digests", message.digests.len(), max));
        }
        let digests = message.digests.iter().map(|bytes| digest("digests", bytes));
        let digests = digests.collect::<Result<Vec<Digest>, Status>>()?;
        // Whoever sends images one by one says for which job, and finds room for them.
        let sender = match message.token.as_slice() {
            [] => None,
            bytes => {
                let token = token(bytes)?;
                let lease = LeaseOf {
                    material: message.material,
                    token,
                };
                Some((lease, by))
            }
        };
        let missing = self.farm.find_missing(sender, digests).await?;
        Ok(Response::new(proto::FindMissingBlobsResponse {
            missing: missing.iter().map(message_digest).collect(),
            upload_by_url: self.farm.takes_uploads_by_url(),
        }))
    }

    async fn get_upload_urls(
        &self,
        request: Request<proto::GetUploadUrlsRequest>,
    ) -> Answer<proto::GetUploadUrlsResponse> {
        let message = request.into_inner();
        let token = token(&message.token)?;
        if message.uploads.len() > limits::protocol::VIEWS_MAX {
            let found = message.uploads.len();
            return Err(too_many("uploads", found, limits::protocol::VIEWS_MAX));
        }
        let uploads = message.uploads.iter().map(|upload| {
            let digest = digest("uploads.digest", &upload.digest)?;
            Ok((digest, md5("uploads.md5", &upload.md5)?))
        });
        let uploads = uploads.collect::<Result<Vec<_>, Status>>()?;
        let urls = self.farm.upload_urls(token, message.material, &uploads);
        let urls = urls.await?.into_iter().map(|upload| proto::UploadUrl {
            url: upload.url,
            headers: upload
                .headers
                .into_iter()
                .map(|(name, value)| proto::Header { name, value })
                .collect(),
        });
        Ok(Response::new(proto::GetUploadUrlsResponse {
            urls: urls.collect(),
        }))
    }

    async fn put_blob(
        &self,
        request: Request<proto::PutBlobRequest>,
    ) -> Answer<proto::PutBlobResponse> {
        let by = caller(&request);
        let message = request.into_inner();
        let digest = digest("digest", &message.digest)?;
        if message.token.is_empty() {
            let reason = "an image is sent under the lease of its material, and this call names \
                          none: install the brdfarm that the coordinator runs";
            return Err(invalid("token", reason));
        }
        let lease = LeaseOf {
            material: message.material,
            token: token(&message.token)?,
        };
        self.farm
            .put_blob(lease, by, digest, message.size, message.data)
            .await?;
        Ok(Response::new(proto::PutBlobResponse {}))
    }

    async fn complete(
        &self,
        request: Request<proto::CompleteRequest>,
    ) -> Answer<proto::CompleteResponse> {
        let by = caller(&request);
        let message = request.into_inner();
        let token = token(&message.token)?;
        if message.views.len() > limits::protocol::VIEWS_MAX {
            return Err(too_many(
                "views",
                message.views.len(),
                limits::protocol::VIEWS_MAX,
            ));
        }
        let images = message.views.into_iter().map(rendered_image);
        let rendered = RenderedMaterial {
            material: message.material,
            images: images.collect::<Result<_, Status>>()?,
            seconds: message.seconds,
            by,
        };
        check_brought(&rendered)?;
        let span = info_span!("job", material = message.material, lease = %token);
        let outcome = async {
            let outcome = self.farm.complete(token, rendered).await;
            let outcome = outcome.map_err(Status::from);
            match &outcome {
                Ok(Outcome::Recorded) => {}
                Ok(Outcome::Repeated) => tracing::info!("completed before"),
                Ok(Outcome::Missing(missing)) => {
                    tracing::info!(missing = missing.len(), "images are missing");
                }
                // Its worker says so, and it is repeated.
                Err(status) if is_momentary(status.code()) => {
                    tracing::debug!(error = status.message(), "a completion has to wait");
                }
                Err(status) => {
                    tracing::warn!(error = status.message(), "a completion does not count");
                }
            }
            outcome
        };
        let (missing, repeated) = match outcome.instrument(span).await? {
            Outcome::Recorded => (Vec::new(), false),
            Outcome::Repeated => (Vec::new(), true),
            Outcome::Missing(missing) => (missing.iter().map(message_digest).collect(), false),
        };
        Ok(Response::new(proto::CompleteResponse { missing, repeated }))
    }

    async fn fail(&self, request: Request<proto::FailRequest>) -> Answer<proto::FailResponse> {
        let message = request.into_inner();
        let token = token(&message.token)?;
        let mut error = message.error;
        error.truncate(error.floor_char_boundary(limits::protocol::ERROR_BYTES_MAX));
        let span = info_span!("job", material = message.material, lease = %token);
        let failed = self.farm.fail(token, message.material, error);
        let quarantined = failed.instrument(span).await?;
        Ok(Response::new(proto::FailResponse {
            set_aside: quarantined,
        }))
    }

    async fn deregister(
        &self,
        request: Request<proto::DeregisterRequest>,
    ) -> Answer<proto::DeregisterResponse> {
        let worker = worker(&request.into_inner().worker_id)?;
        let released = self.farm.deregister(worker).await?;
        Ok(Response::new(proto::DeregisterResponse { released }))
    }
}

/// The bytes of a mesh that one answer has, and how many there are in all. They are copied once, when the
/// answer is encoded; `security::unread` bounds what waits to be read.
fn part(mesh: Bytes, offset: u64) -> Result<(Bytes, u64), Status> {
    let offset_in_memory = usize::try_from(offset).unwrap_or(usize::MAX);
    if offset_in_memory >= mesh.len() {
        let total = mesh.len();
        let message = format!("the mesh has {total} bytes, none of them at offset {offset}");
        return Err(refuse(Code::OutOfRange, "NO_SUCH_OFFSET", message));
    }
    let end = mesh
        .len()
        .min(offset_in_memory.saturating_add(MESH_BYTES_PER_CALL));
    Ok((mesh.slice(offset_in_memory..end), mesh.len() as u64))
}

/// Which credential answers for a worker that registers.
fn credential(caller: Option<&Caller>, resolves_disputes: bool) -> Result<Option<&str>, Status> {
    match caller {
        // Without tokens nobody is defended against anybody.
        None => Ok(resolves_disputes.then_some(OPERATOR)),
        Some(caller) if (caller.role == Role::Operator) == resolves_disputes => {
            Ok(Some(&caller.credential))
        }
        Some(caller) => {
            let what = match caller.role {
                Role::Operator => {
                    "an operator's token is for `jobs resolve`: render with a worker's"
                }
                _ => "disputes are decided with an operator's token",
            };
            Err(refuse(Code::PermissionDenied, "WRONG_ROLE", what))
        }
    }
}

/// Which credential answers for what a call stages.
fn caller<M>(request: &Request<M>) -> Credential {
    let caller = request.extensions().get::<Caller>();
    caller.map(|caller| Digest::of(caller.credential.as_bytes()))
}

fn md5(field: &str, bytes: &[u8]) -> Result<Md5, Status> {
    let reason = format!("an MD5 has {} bytes", limits::protocol::MD5_BYTES);
    bytes.try_into().map_err(|_| invalid(field, &reason))
}

/// Images come along only where they are small.
fn check_brought(rendered: &RenderedMaterial) -> Result<(), Status> {
    let images = rendered.images.iter();
    let bytes: u64 = images.map(|image| image.data.len() as u64).sum();
    if bytes > limits::protocol::IMAGES_BROUGHT_BYTES_MAX {
        let reason = format!(
            "a completion brings images of {bytes} bytes along, more than {}: send them with PutBlob",
            limits::protocol::IMAGES_BROUGHT_BYTES_MAX
        );
        return Err(invalid("views.image", &reason));
    }
    Ok(())
}

fn rendered_image(view: proto::View) -> Result<RenderedImage, Status> {
    Ok(RenderedImage {
        view: completed_view(&view)?,
        md5: match view.md5.as_slice() {
            [] => None,
            bytes => Some(md5("views.md5", bytes)?),
        },
        data: view.image,
    })
}

fn completed_view(view: &proto::View) -> Result<CompletedView, Status> {
    let Some(statistics) = &view.statistics else {
        return Err(invalid("views", "a view has no error statistics"));
    };
    Ok(CompletedView {
        digest: digest("views.digest", &view.digest)?,
        bytes: view.size,
        statistics: ErrorStatistics {
            mean: statistics.mean,
            p95: statistics.p95,
            max: statistics.max,
            within_target: statistics.within_target,
            samples: statistics.samples,
            evaluations: statistics.evaluations,
        },
        pixels: view.pixels.as_ref().map(|pixels| PixelStatistics {
            sample_share: pixels.sample_share,
            brightness_mean: pixels.brightness_mean,
            brightness_p99: pixels.brightness_p99,
            dark_share: pixels.dark_share,
            above_white_share: pixels.above_white_share,
        }),
    })
}

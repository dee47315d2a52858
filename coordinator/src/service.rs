//! The gRPC service: checks what messages carry, calls the [`Farm`], and gives each error its
//! status.

use crate::{
    completion::Completion,
    farm::{Farm, FarmError, Outcome},
    queue::Refusal,
    token::{Token, WorkerId},
};
use dataset::{CompletedView, Digest, ErrorStatistics, RENDERER_VERSION};
use proto::limits;
use std::{io, sync::Arc, time::Duration};
use tonic::{Request, Response, Status};
use tracing::{Instrument, info_span};

/// The service over a farm.
pub(crate) struct Service {
    pub farm: Arc<Farm>,
}

type Answer<T> = Result<Response<T>, Status>;

#[tonic::async_trait]
impl proto::Farm for Service {
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

    async fn register(
        &self,
        request: Request<proto::RegisterRequest>,
    ) -> Answer<proto::RegisterResponse> {
        let message = request.into_inner();
        if message.name.is_empty() || message.name.len() > limits::NAME_BYTES_MAX {
            return Err(Status::invalid_argument(format!(
                "a worker's name has 1 to {} bytes, and this one has {}",
                limits::NAME_BYTES_MAX,
                message.name.len()
            )));
        }
        let known = match message.worker_id.as_slice() {
            [] => None,
            bytes => Some(worker(bytes)?),
        };
        let hash = digest(&message.specification_hash)?;
        let worker = self
            .farm
            .register(known, message.name, &message.renderer_version, hash)?;
        Ok(Response::new(proto::RegisterResponse {
            worker_id: worker.to_message(),
            lease_ms: self.farm.policy.lease.as_millis() as u64,
        }))
    }

    async fn lease(&self, request: Request<proto::LeaseRequest>) -> Answer<proto::LeaseResponse> {
        let message = request.into_inner();
        let worker = worker(&message.worker_id)?;
        let wait = Duration::from_millis(message.wait_ms);
        let (leases, finished) = self.farm.lease(worker, message.jobs_max, wait).await?;
        for (token, material) in &leases {
            tracing::debug!(material, lease = %token, %worker, "leased");
        }
        let jobs = leases
            .into_iter()
            .map(|(token, material)| proto::Job {
                token: token.to_message(),
                material,
            })
            .collect();
        Ok(Response::new(proto::LeaseResponse { jobs, finished }))
    }

    async fn renew(&self, request: Request<proto::RenewRequest>) -> Answer<proto::RenewResponse> {
        let message = request.into_inner();
        let worker = worker(&message.worker_id)?;
        if message.renewals.len() > limits::LEASES_PER_WORKER_MAX as usize {
            return Err(Status::invalid_argument(format!(
                "a worker holds at most {} leases",
                limits::LEASES_PER_WORKER_MAX
            )));
        }
        let renewals = message
            .renewals
            .iter()
            .map(|renewal| {
                let token = token(&renewal.token)?;
                Ok((token, renewal.material, renewal.views_done))
            })
            .collect::<Result<Vec<_>, Status>>()?;
        let lost = self.farm.renew(worker, &renewals);
        Ok(Response::new(proto::RenewResponse { lost }))
    }

    async fn find_missing_blobs(
        &self,
        request: Request<proto::FindMissingBlobsRequest>,
    ) -> Answer<proto::FindMissingBlobsResponse> {
        let message = request.into_inner();
        if message.digests.len() > limits::DIGESTS_PER_CALL_MAX {
            return Err(Status::invalid_argument(format!(
                "a call asks for at most {} digests",
                limits::DIGESTS_PER_CALL_MAX
            )));
        }
        let digests = message.digests.iter().map(|bytes| digest(bytes));
        let digests = digests.collect::<Result<Vec<Digest>, Status>>()?;
        let missing = self.farm.find_missing(digests).await?;
        Ok(Response::new(proto::FindMissingBlobsResponse {
            missing: missing.iter().map(message_digest).collect(),
        }))
    }

    async fn put_blob(
        &self,
        request: Request<proto::PutBlobRequest>,
    ) -> Answer<proto::PutBlobResponse> {
        let message = request.into_inner();
        let digest = digest(&message.digest)?;
        self.farm
            .put_blob(digest, message.size, message.data)
            .await?;
        Ok(Response::new(proto::PutBlobResponse {}))
    }

    async fn complete(
        &self,
        request: Request<proto::CompleteRequest>,
    ) -> Answer<proto::CompleteResponse> {
        let message = request.into_inner();
        let token = token(&message.token)?;
        let completion = Completion {
            material: message.material,
            views: message
                .views
                .iter()
                .map(completed_view)
                .collect::<Result<Vec<CompletedView>, Status>>()?,
            seconds: message.seconds,
            worker: String::new(),
        };
        let span = info_span!("job", material = message.material, lease = %token);
        let outcome = async {
            let outcome = self.farm.complete(token, completion).await;
            match &outcome {
                Ok(Outcome::Recorded) => tracing::info!(seconds = message.seconds, "completed"),
                Ok(Outcome::Repeated) => tracing::info!("completed before"),
                Ok(Outcome::Missing(missing)) => {
                    tracing::info!(missing = missing.len(), "images are missing");
                }
                Err(error) => tracing::warn!(%error, "a completion does not count"),
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
        error.truncate(error.floor_char_boundary(limits::ERROR_BYTES_MAX));
        let span = info_span!("job", material = message.material, lease = %token);
        span.in_scope(|| tracing::warn!(error, "a worker could not render"));
        let failed = self.farm.fail(token, message.material, error);
        let set_aside = failed.instrument(span).await?;
        Ok(Response::new(proto::FailResponse { set_aside }))
    }

    async fn deregister(
        &self,
        request: Request<proto::DeregisterRequest>,
    ) -> Answer<proto::DeregisterResponse> {
        let worker = worker(&request.into_inner().worker_id)?;
        let released = self.farm.deregister(worker).await?;
        tracing::info!(%worker, released, "a worker left");
        Ok(Response::new(proto::DeregisterResponse { released }))
    }

    async fn status(&self, _: Request<proto::StatusRequest>) -> Answer<proto::StatusResponse> {
        let (progress, set_aside) = self.farm.status();
        let counts = progress.counts;
        Ok(Response::new(proto::StatusResponse {
            name: self.farm.specification.name.clone(),
            specification_hash: message_digest(&self.farm.specification_hash),
            views: self.farm.specification.views.len() as u32,
            counts: Some(proto::Counts {
                materials: counts.materials,
                completed: counts.completed,
                leased: counts.leased,
                pending: counts.pending,
                set_aside: counts.set_aside,
                images: progress.images,
                bytes_received: progress.bytes_received,
                workers: progress.workers,
                failures: progress.failures,
                leases_lost: progress.leases_lost,
            }),
            set_aside: set_aside
                .into_iter()
                .map(|(material, errors)| proto::SetAside { material, errors })
                .collect(),
        }))
    }
}

impl From<FarmError> for Status {
    fn from(error: FarmError) -> Self {
        let message = error.to_string();
        match error {
            FarmError::Refused(Refusal::UnknownMaterial(_))
            | FarmError::Image { .. }
            | FarmError::Rejected(_)
            | FarmError::Invalid(_) => Self::invalid_argument(message),
            FarmError::Refused(Refusal::LeaseLost(_)) | FarmError::Incompatible(_) => {
                Self::failed_precondition(message)
            }
            FarmError::Refused(Refusal::Conflict(_)) => Self::already_exists(message),
            FarmError::UnknownWorker(_) => Self::not_found(message),
            FarmError::TooManyWorkers(_) | FarmError::StagingFull(_) => {
                Self::resource_exhausted(message)
            }
            FarmError::File(error)
                if matches!(
                    error.source.kind(),
                    io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded
                ) =>
            {
                Self::resource_exhausted(message)
            }
            FarmError::NotDurable(_) | FarmError::Interrupted => Self::unavailable(message),
            FarmError::File(_) | FarmError::Ledger(_) | FarmError::Random(_) => {
                tracing::error!(message, "a call failed");
                Self::internal(message)
            }
        }
    }
}

fn token(bytes: &[u8]) -> Result<Token, Status> {
    let name = Token::from_message(bytes);
    name.ok_or_else(|| wrong_length("a lease's token", limits::TOKEN_BYTES, bytes))
}

fn worker(bytes: &[u8]) -> Result<WorkerId, Status> {
    let name = WorkerId::from_message(bytes);
    name.ok_or_else(|| wrong_length("a worker's id", limits::TOKEN_BYTES, bytes))
}

fn digest(bytes: &[u8]) -> Result<Digest, Status> {
    let digest = bytes.try_into().map(Digest::from_bytes);
    digest.map_err(|_| wrong_length("a digest", limits::DIGEST_BYTES, bytes))
}

fn wrong_length(what: &str, expected: usize, bytes: &[u8]) -> Status {
    let found = bytes.len();
    Status::invalid_argument(format!("{what} has {expected} bytes, and this has {found}"))
}

fn message_digest(digest: &Digest) -> Vec<u8> {
    digest.as_bytes().to_vec()
}

fn completed_view(view: &proto::View) -> Result<CompletedView, Status> {
    let Some(statistics) = &view.statistics else {
        return Err(Status::invalid_argument("a view has no error statistics"));
    };
    Ok(CompletedView {
        digest: digest(&view.digest)?,
        bytes: view.size,
        statistics: ErrorStatistics {
            mean: statistics.mean,
            p95: statistics.p95,
            max: statistics.max,
            within_target: statistics.within_target,
            samples: statistics.samples,
            evaluations: statistics.evaluations,
        },
    })
}

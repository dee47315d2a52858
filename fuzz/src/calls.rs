//! Messages of any call, to a live coordinator.

use crate::fixtures::{LEASED, LIVE_SPECIFICATION, WORKER};
use coordinator::{Coordinator, Options};
use dataset::RENDERER_VERSION;
use datastore::Store;
use prost::Message;
use proto::{Control, Farm, JobSelection, JobState};
use std::sync::{LazyLock, Mutex, PoisonError};
use tokio::runtime::Runtime;
use tonic::{Code, Request, Response, Status};

/// Calls of one input.
const CALLS_MAX: usize = 16;

/// Makes the calls of an input.
type Live = Box<dyn Fn(&[u8]) -> bool + Send + Sync>;

/// One coordinator for all inputs: to make one takes long. What can be undone of an input is
/// before the next.
static LIVE: LazyLock<Live> = LazyLock::new(|| {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::open_or_create(folder.path(), &LIVE_SPECIFICATION).unwrap();
    let hash = LIVE_SPECIFICATION.hash().as_bytes().to_vec();
    let runtime = Runtime::new().unwrap();
    let options = Options::default();
    let services = runtime.block_on(Coordinator::services(store, &options));
    let services = services.unwrap();
    let token = Mutex::new(Vec::new());
    Box::new(move |bytes| {
        // One input after another, whatever threads tests have.
        let mut token = token.lock().unwrap_or_else(PoisonError::into_inner);
        // All of them are kept, and not only what is named below.
        let (_folder, services) = (&folder, &services);
        runtime.block_on(async {
            begin(&services.farm, &services.control, &hash).await;
            all(&services.farm, &services.control, bytes, &mut token).await
        })
    })
});

/// Answers messages, each after a byte that says to which call and two that say how long it is.
pub fn calls(bytes: &[u8]) -> bool {
    LIVE(bytes)
}

async fn begin(farm: &impl Farm, control: &impl Control, hash: &[u8]) {
    let worker_id = WORKER.0.to_vec();
    let leave = proto::DeregisterRequest {
        worker_id: worker_id.clone(),
    };
    farm.deregister(Request::new(leave)).await.unwrap();
    let unblock = proto::UnbarWorkerRequest {
        name: WORKER.1.to_owned(),
    };
    drop(control.unbar_worker(Request::new(unblock)).await);
    let resume = Request::new(proto::ResumeRequest {});
    control.resume(resume).await.unwrap();
    let given_up = [JobState::SetAside, JobState::Cancelled];
    let retry = proto::RetryJobsRequest {
        selection: Some(JobSelection {
            ranges: Vec::new(),
            states: given_up.map(Into::into).to_vec(),
        }),
    };
    control.retry_jobs(Request::new(retry)).await.unwrap();
    let register = proto::RegisterRequest {
        name: WORKER.1.to_owned(),
        renderer_version: RENDERER_VERSION.to_owned(),
        specification_hash: hash.to_vec(),
        worker_id,
        resolves_disputes: false,
    };
    farm.register(Request::new(register)).await.unwrap();
}

async fn all(
    farm: &impl Farm,
    control: &impl Control,
    mut bytes: &[u8],
    token: &mut Vec<u8>,
) -> bool {
    let mut accepted = false;
    for _ in 0..CALLS_MAX {
        let Some((&[call, high, low], rest)) = bytes.split_first_chunk() else {
            break;
        };
        let length = usize::from(u16::from_be_bytes([high, low])).min(rest.len());
        let (message, rest) = rest.split_at(length);
        bytes = rest;
        accepted |= one(farm, control, call, message, token)
            .await
            .unwrap_or(false);
    }
    accepted
}

/// Makes one call; `None` where the message is none of its type.
async fn one(
    farm: &impl Farm,
    control: &impl Control,
    call: u8,
    message: &[u8],
    token: &mut Vec<u8>,
) -> Option<bool> {
    let current = |field: &mut Vec<u8>| {
        if field == LEASED {
            field.clone_from(token);
        }
    };
    Some(match call {
        b'R' => answered(farm.register(request(message)?).await).is_some(),
        b'L' => {
            let mut lease: Request<proto::LeaseRequest> = request(message)?;
            lease.get_mut().wait_ms %= 2;
            let leased = answered(farm.lease(lease).await)?;
            if let Some(job) = leased.jobs.first() {
                token.clone_from(&job.token);
            }
            true
        }
        b'N' => {
            let mut renew: Request<proto::RenewRequest> = request(message)?;
            let renewals = renew.get_mut().renewals.iter_mut();
            renewals.for_each(|renewal| current(&mut renewal.token));
            answered(farm.renew(renew).await).is_some()
        }
        b'M' => {
            let mut find: Request<proto::FindMissingBlobsRequest> = request(message)?;
            current(&mut find.get_mut().token);
            answered(farm.find_missing_blobs(find).await).is_some()
        }
        b'P' => {
            let mut put: Request<proto::PutBlobRequest> = request(message)?;
            current(&mut put.get_mut().token);
            answered(farm.put_blob(put).await).is_some()
        }
        b'C' => {
            let mut complete: Request<proto::CompleteRequest> = request(message)?;
            current(&mut complete.get_mut().token);
            answered(farm.complete(complete).await).is_some()
        }
        b'F' => {
            let mut fail: Request<proto::FailRequest> = request(message)?;
            current(&mut fail.get_mut().token);
            answered(farm.fail(fail).await).is_some()
        }
        b'D' => answered(farm.deregister(request(message)?).await).is_some(),
        b's' => answered(control.status(request(message)?).await).is_some(),
        b'l' => answered(control.list_jobs(request(message)?).await).is_some(),
        b'w' => answered(control.list_workers(request(message)?).await).is_some(),
        b'g' => answered(control.get_blob(request(message)?).await).is_some(),
        b'r' => answered(control.retry_jobs(request(message)?).await).is_some(),
        b'c' => answered(control.cancel_jobs(request(message)?).await).is_some(),
        b'p' => answered(control.prioritize_jobs(request(message)?).await).is_some(),
        b'b' => answered(control.bar_worker(request(message)?).await).is_some(),
        b'u' => answered(control.unbar_worker(request(message)?).await).is_some(),
        b'h' => answered(control.pause(request(message)?).await).is_some(),
        b'd' => answered(control.drain(request(message)?).await).is_some(),
        _ => return None,
    })
}

fn request<M: Message + Default>(bytes: &[u8]) -> Option<Request<M>> {
    M::decode(bytes).ok().map(Request::new)
}

/// The answer, unless the coordinator refuses: which is well, unless the fault is its own.
fn answered<R>(answer: Result<Response<R>, Status>) -> Option<R> {
    match answer {
        Ok(answer) => Some(answer.into_inner()),
        Err(status) => {
            let own_fault = [
                Code::Internal,
                Code::Unknown,
                Code::Unavailable,
                Code::DataLoss,
            ];
            assert!(!own_fault.contains(&status.code()), "{status}");
            None
        }
    }
}

//! A worker that speaks the protocol.

use crate::{images::Images, liars::Liar};
use dataset::RENDERER_VERSION;
use proto::{
    CompleteRequest, DeregisterRequest, FailRequest, FarmClient, FindMissingBlobsRequest, Job,
    LeaseRequest, RegisterRequest, View,
    client::{Credentials, farm, with_deadline, with_deadline_after},
};
use std::{
    sync::{
        Arc,
        atomic::{AtomicU64, Ordering},
    },
    time::Duration,
};
use tonic::{Code, Status};

/// How long a worker asks to wait for a job.
const WAIT: Duration = Duration::from_secs(1);

/// What rendering a material would take.
const RENDERING: Duration = Duration::from_millis(3);

/// A worker, and whether it lies.
pub struct Puppet {
    pub images: Arc<Images>,
    pub url: String,
    pub credentials: Credentials,
    pub name: String,
    pub liar: Option<Liar>,
    /// Completions that were acknowledged.
    pub delivered: Arc<AtomicU64>,
}

/// How a worker ended.
#[derive(Debug, PartialEq, Eq)]
pub enum End {
    Finished,
    Blocked,
}

impl Puppet {
    /// Works until the set is finished or it is blocked for good.
    pub async fn work(self) -> End {
        let mut delivered = 0;
        let mut names = 0;
        loop {
            let name = format!("{}-{names}", self.name);
            let end = self.work_as(&name, &mut delivered).await;
            if end == End::Blocked && self.liar == Some(Liar::Renamed) && names < 5 {
                names += 1;
                continue;
            }
            return end;
        }
    }

    async fn work_as(&self, name: &str, delivered: &mut u32) -> End {
        let mut client = farm(&self.url, &self.credentials).unwrap();
        let specification = &self.images.specification;
        let register = RegisterRequest {
            name: name.to_owned(),
            renderer_version: RENDERER_VERSION.to_owned(),
            specification_hash: specification.hash().as_bytes().to_vec(),
            worker_id: Vec::new(),
            resolves_disputes: false,
        };
        let registered = client.register(with_deadline(register)).await.unwrap();
        let worker_id = registered.into_inner().worker_id;
        loop {
            let message = LeaseRequest {
                worker_id: worker_id.clone(),
                jobs_max: 1,
                wait_ms: WAIT.as_millis() as u64,
            };
            let leased = match client.lease(with_deadline_after(message, WAIT)).await {
                Ok(leased) => leased.into_inner(),
                // The set is complete, and nobody serves it any more.
                Err(status) if status.code() == Code::Unavailable => return End::Finished,
                Err(status) => panic!("{name}: {status}"),
            };
            let is_blocked = !leased.barred.is_empty();
            if leased.finished || is_blocked {
                let message = DeregisterRequest { worker_id };
                // The coordinator may end before it hears of it.
                drop(client.deregister(with_deadline(message)).await);
                return if is_blocked {
                    End::Blocked
                } else {
                    End::Finished
                };
            }
            for job in leased.jobs {
                tokio::time::sleep(RENDERING).await;
                let views = self.views(&mut client, job.material, *delivered).await;
                *delivered += 1;
                self.complete(&mut client, job, views).await;
            }
        }
    }

    async fn views(&self, client: &mut FarmClient, material: u32, number: u32) -> Vec<View> {
        let truth = self.images.truth(material);
        let Some(liar) = self.liar else {
            return truth;
        };
        let asked = FindMissingBlobsRequest {
            digests: truth.iter().map(|view| view.digest.clone()).collect(),
            token: Vec::new(),
            material: 0,
        };
        let missing = client.find_missing_blobs(with_deadline(asked)).await;
        let known = missing.unwrap().into_inner().missing.is_empty();
        match liar.lies(number, material, known) {
            true if liar == Liar::StatisticsOnly => self.images.praise(material),
            true if liar == Liar::BrightnessOnly => self.images.brighten(material),
            true if liar == Liar::Headers => self.images.smuggle(material),
            true => self.images.lie(material),
            false => truth,
        }
    }

    async fn complete(&self, client: &mut FarmClient, job: Job, views: Vec<View>) {
        let message = CompleteRequest {
            token: job.token,
            material: job.material,
            views,
            seconds: 0.01,
        };
        let mut answer = client.complete(with_deadline(message.clone())).await;
        // Room for images that a lease has lost, or not yet: a worker asks again.
        while matches!(&answer, Err(status) if status.code() == Code::ResourceExhausted) {
            tokio::time::sleep(RENDERING).await;
            answer = client.complete(with_deadline(message.clone())).await;
        }
        match answer {
            Ok(answer) => {
                assert!(answer.into_inner().missing.is_empty());
                self.delivered.fetch_add(1, Ordering::Relaxed);
            }
            Err(status) if self.liar == Some(Liar::Headers) => {
                assert_eq!(status.code(), Code::InvalidArgument, "{status}");
                let message = FailRequest {
                    token: message.token,
                    material: message.material,
                    error: status.message().to_owned(),
                };
                client.fail(with_deadline(message)).await.unwrap();
            }
            // A liar's leases are taken back when it is found out, and so is a second rendering of what
            // it alone vouched for.
            Err(status) => assert!(lost(&status), "{status}"),
        }
    }
}

fn lost(status: &Status) -> bool {
    matches!(
        status.code(),
        Code::FailedPrecondition | Code::AlreadyExists
    )
}

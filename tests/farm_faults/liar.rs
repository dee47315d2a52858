//! A worker that speaks the protocol and sends to a bucket what it likes.

use crate::harness::Harness;
use md5::{Digest as _, Md5};
use proto::client::{self, Credentials, with_deadline_after};
use proto::{
    CompleteRequest, CompleteResponse, ErrorStatistics, FarmClient, GetDatasetRequest,
    GetUploadUrlsRequest, LeaseRequest, RegisterRequest, Upload, UploadUrl, View,
};
use serde_json::Value;
use std::fs;
use std::io::{Read, Write};
use std::net::TcpStream;
use std::time::Duration;
use tokio::runtime::Runtime;
use tonic::Status;

/// An image by the names that somebody gives it, and what is sent as it.
#[derive(Clone)]
pub struct Claim {
    pub digest: Vec<u8>,
    pub bytes: Vec<u8>,
}

/// The digests and sizes of a material in a store, by view.
pub fn recorded(harness: &Harness, store: &str, material: u32) -> Vec<(Vec<u8>, usize)> {
    let log = harness.path().join(store).join("completions.log");
    let log = fs::read_to_string(log).expect("a log");
    let entries = log.lines().map(|line| -> Value {
        let (_, json) = line.split_once(' ').expect("a checksum");
        serde_json::from_str(json).expect("JSON")
    });
    let entry = entries
        .into_iter()
        .find(|entry| entry["material"] == material);
    let views = entry.expect("a completion")["views"].clone();
    let views = views.as_array().expect("views").iter().map(|view| {
        let digest: dataset::Digest = view["digest"]
            .as_str()
            .expect("hex")
            .parse()
            .expect("a digest");
        let bytes = view["bytes"].as_u64().expect("a size");
        (digest.as_bytes().to_vec(), bytes as usize)
    });
    views.collect()
}

pub struct Liar {
    runtime: Runtime,
    client: FarmClient,
    token: Vec<u8>,
    pub material: u32,
}

impl Liar {
    /// Leases a material.
    pub fn lease(harness: &Harness) -> Self {
        let runtime = Runtime::new().expect("a runtime");
        let (client, token, material) = runtime.block_on(async {
            let url = format!("http://{}", harness.address);
            let mut client = client::farm(&url, &Credentials::default()).expect("a client");
            let ask = || with_deadline_after(GetDatasetRequest {}, Duration::ZERO);
            let dataset = client
                .get_dataset(ask())
                .await
                .expect("a dataset")
                .into_inner();
            let register = RegisterRequest {
                name: "liar".to_owned(),
                renderer_version: dataset.renderer_version,
                specification_hash: dataset.specification_hash,
                worker_id: Vec::new(),
                resolves_disputes: false,
            };
            let registered = client
                .register(register)
                .await
                .expect("admitted")
                .into_inner();
            let lease = LeaseRequest {
                worker_id: registered.worker_id,
                jobs_max: 1,
                wait_ms: 0,
            };
            let leased = client.lease(lease).await.expect("a lease").into_inner();
            let job = leased.jobs[0].clone();
            (client, job.token, job.material)
        });
        Self {
            runtime,
            client,
            token,
            material,
        }
    }

    /// Where to send images.
    pub fn urls(&mut self, claims: &[Claim]) -> Result<Vec<UploadUrl>, Status> {
        let uploads = claims.iter().map(|claim| Upload {
            digest: claim.digest.clone(),
            md5: Md5::digest(&claim.bytes).to_vec(),
        });
        let message = GetUploadUrlsRequest {
            token: self.token.clone(),
            material: self.material,
            uploads: uploads.collect(),
        };
        let asked = self.client.get_upload_urls(message);
        Ok(self.runtime.block_on(asked)?.into_inner().urls)
    }

    /// Says that the material is complete.
    pub fn complete(&mut self, claims: &[Claim]) -> Result<CompleteResponse, Status> {
        let views = claims.iter().map(|claim| View {
            digest: claim.digest.clone(),
            size: claim.bytes.len() as u64,
            statistics: Some(ErrorStatistics::default()),
            md5: Md5::digest(&claim.bytes).to_vec(),
            ..View::default()
        });
        let message = CompleteRequest {
            token: self.token.clone(),
            material: self.material,
            views: views.collect(),
            seconds: 1.0,
        };
        let told = self.client.complete(message);
        Ok(self.runtime.block_on(told)?.into_inner())
    }

    /// Sends images where they are to go, and says that the material is complete.
    pub fn deliver(&mut self, claims: &[Claim]) -> Result<CompleteResponse, Status> {
        for (url, claim) in self.urls(claims)?.iter().zip(claims) {
            assert_eq!(put(url, &claim.bytes), 200);
        }
        self.complete(claims)
    }
}

/// Sends bytes to a URL and returns the status.
pub fn put(url: &UploadUrl, bytes: &[u8]) -> u16 {
    let (host, path) = url
        .url
        .strip_prefix("http://")
        .and_then(|rest| rest.split_once('/'))
        .expect("a URL of this machine");
    let mut stream = TcpStream::connect(host).expect("a server");
    let mut head = format!("PUT /{path} HTTP/1.1\r\nhost: {host}\r\nconnection: close\r\n");
    for header in &url.headers {
        head += &format!("{}: {}\r\n", header.name, header.value);
    }
    head += &format!("content-length: {}\r\n\r\n", bytes.len());
    stream.write_all(head.as_bytes()).expect("sent");
    // A server that refuses may not read on.
    let _ = stream.write_all(bytes);
    let mut answer = String::new();
    stream.read_to_string(&mut answer).expect("an answer");
    let status = answer
        .split(' ')
        .nth(1)
        .and_then(|status| status.parse().ok());
    status.expect("a status")
}

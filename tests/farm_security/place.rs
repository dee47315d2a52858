//! A coordinator of its own process, and what is asked of it.

use crate::process::Process;
use dataset::{Digest, RENDERER_VERSION, Specification};
use proto::{
    FarmClient,
    client::{self, Credentials, with_deadline},
};
use std::fs;
use std::path::Path;
use std::process::{Command, Output};
use tonic::Status;

pub const SPECIFICATION: &str = r#"
name = "guarded"
materials = 2
[image]
width = 16
height = 16
[integrator]
kind = "path"
samples_per_pixel = 16
"#;

/// What a coordinator may take of memory while strangers stand at its door, bytes.
pub const MEMORY_MAX: u64 = 400 << 20;

pub fn brdfarm(directory: &Path, arguments: &str) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_brdfarm"));
    command.current_dir(directory);
    command.args(arguments.split_whitespace());
    command
}

pub fn run(directory: &Path, arguments: &str) -> Output {
    brdfarm(directory, arguments)
        .output()
        .expect("brdfarm runs")
}

pub fn said(output: &Output) -> String {
    let both = [&output.stdout[..], &output.stderr[..]].concat();
    String::from_utf8(both).expect("UTF-8")
}

pub fn succeed(directory: &Path, arguments: &str) -> String {
    let output = run(directory, arguments);
    assert!(
        output.status.success(),
        "brdfarm {arguments}: {}",
        said(&output)
    );
    said(&output)
}

pub fn coordinator(directory: &Path, store: &str, credentials: &str) -> (Process, String) {
    fs::write(directory.join("spec.toml"), SPECIFICATION).expect("written");
    let arguments = format!(
        "coordinator serve --spec spec.toml --store {store} --listen 127.0.0.1:0 {credentials}"
    );
    let mut command = brdfarm(directory, &arguments);
    Process::serving(&mut command).expect("a coordinator")
}

/// Memory that a process has, bytes.
pub fn memory_bytes(process: &Process) -> u64 {
    process.memory_bytes("VmRSS").expect("it runs")
}

pub fn credentials(directory: &Path, folder: &str) -> Credentials {
    let read = |name: &str| fs::read(directory.join(folder).join(name)).expect("readable");
    Credentials {
        token: Some(String::from_utf8(read("token")).expect("text")),
        authority: Some(read("authority.pem")),
        identity: Some((read("certificate.pem"), read("key.pem"))),
    }
}

/// A stranger with a lease, in single steps.
pub struct Guest {
    pub farm: FarmClient,
    pub worker_id: Vec<u8>,
    pub job: proto::Job,
}

impl Guest {
    pub async fn leasing(url: &str, credentials: &Credentials) -> Self {
        let specification = Specification::from_toml(SPECIFICATION, "spec.toml").expect("valid");
        let mut farm = client::farm(url, credentials).expect("a client");
        let register = proto::RegisterRequest {
            name: "guest".to_owned(),
            renderer_version: RENDERER_VERSION.to_owned(),
            specification_hash: specification.hash().as_bytes().to_vec(),
            worker_id: Vec::new(),
            resolves_disputes: false,
        };
        let registered = farm.register(with_deadline(register)).await;
        let worker_id = registered.expect("a name").into_inner().worker_id;
        let lease = proto::LeaseRequest {
            worker_id: worker_id.clone(),
            jobs_max: 1,
            wait_ms: 0,
        };
        let leased = farm.lease(with_deadline(lease)).await.expect("an answer");
        let job = leased.into_inner().jobs.swap_remove(0);
        Self {
            farm,
            worker_id,
            job,
        }
    }

    /// Sends an image of its material.
    pub async fn put(&mut self, digest: Digest, data: Vec<u8>) -> Result<(), Status> {
        let message = proto::PutBlobRequest {
            digest: digest.as_bytes().to_vec(),
            size: data.len() as u64,
            data: data.into(),
            token: self.job.token.clone(),
            material: self.job.material,
        };
        self.farm.put_blob(with_deadline(message)).await.map(drop)
    }

    pub async fn leave(mut self) {
        let message = proto::DeregisterRequest {
            worker_id: self.worker_id,
        };
        let left = self.farm.deregister(with_deadline(message)).await;
        left.expect("an answer");
    }
}

pub async fn status(url: &str, credentials: &Credentials) -> Result<u32, Status> {
    let mut client = client::control(url, credentials).expect("a client");
    let answer = client
        .status(with_deadline(proto::StatusRequest {}))
        .await?;
    Ok(answer.into_inner().counts.expect("counts").materials)
}

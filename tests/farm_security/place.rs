//! A coordinator of its own process, and what is asked of it.

use crate::process::Process;
use proto::client::{self, Credentials, with_deadline};
use std::fs;
use std::path::Path;
use std::process::{Command, Output};

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

pub async fn status(url: &str, credentials: &Credentials) -> Result<u32, tonic::Status> {
    let mut client = client::control(url, credentials).expect("a client");
    let answer = client
        .status(with_deadline(proto::StatusRequest {}))
        .await?;
    Ok(answer.into_inner().counts.expect("counts").materials)
}

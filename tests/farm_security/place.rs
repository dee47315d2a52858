//! A coordinator of its own process, and what is asked of it.

use proto::client::{self, Credentials, with_deadline};
use std::fs;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};

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

pub struct Process(Child);

impl Drop for Process {
    fn drop(&mut self) {
        // An error means that it has ended already.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

impl Process {
    /// Bytes of memory that it has, as the system counts them.
    pub fn memory(&self) -> u64 {
        let status = fs::read_to_string(format!("/proc/{}/status", self.0.id()));
        let status = status.expect("its status");
        let line = status.lines().find(|line| line.starts_with("VmRSS:"));
        let kilobytes = line.expect("a line").split_whitespace().nth(1);
        kilobytes
            .expect("a number")
            .parse::<u64>()
            .expect("a number")
            << 10
    }
}

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
    let child = brdfarm(directory, &arguments)
        .stdout(Stdio::piped())
        .spawn();
    let mut child = child.expect("a coordinator");
    let mut line = String::new();
    let stdout = child.stdout.take().expect("a pipe");
    BufReader::new(stdout).read_line(&mut line).expect("a line");
    let url = line.trim().rsplit(' ').next().expect("a URL").to_owned();
    (Process(child), url)
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

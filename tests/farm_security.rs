//! Strangers at the door of a real coordinator: each is refused, and the farm goes on.

use proto::client::{self, Credentials, with_deadline};
use rcgen::{CertificateParams, CertifiedIssuer, KeyPair};
use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
use std::fs;
use std::io::{BufRead, BufReader};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, SystemTime};
use tonic::Code;

const SPECIFICATION: &str = r#"
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
const MEMORY_MAX: u64 = 400 << 20;

struct Process(Child);

impl Drop for Process {
    fn drop(&mut self) {
        // An error means that it has ended already.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

impl Process {
    /// Bytes of memory that it has, as the system counts them.
    fn memory(&self) -> u64 {
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

fn brdfarm(directory: &Path, arguments: &str) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_brdfarm"));
    command.current_dir(directory);
    command.args(arguments.split_whitespace());
    command
}

fn run(directory: &Path, arguments: &str) -> Output {
    brdfarm(directory, arguments)
        .output()
        .expect("brdfarm runs")
}

fn said(output: &Output) -> String {
    let both = [&output.stdout[..], &output.stderr[..]].concat();
    String::from_utf8(both).expect("UTF-8")
}

fn succeed(directory: &Path, arguments: &str) -> String {
    let output = run(directory, arguments);
    assert!(
        output.status.success(),
        "brdfarm {arguments}: {}",
        said(&output)
    );
    said(&output)
}

fn coordinator(directory: &Path, store: &str, credentials: &str) -> (Process, String) {
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

fn credentials(directory: &Path, folder: &str) -> Credentials {
    let read = |name: &str| fs::read(directory.join(folder).join(name)).expect("readable");
    Credentials {
        token: Some(String::from_utf8(read("token")).expect("text")),
        authority: Some(read("authority.pem")),
        identity: Some((read("certificate.pem"), read("key.pem"))),
    }
}

async fn status(url: &str, credentials: &Credentials) -> Result<u32, tonic::Status> {
    let mut client = client::control(url, credentials).expect("a client");
    let answer = client
        .status(with_deadline(proto::StatusRequest {}))
        .await?;
    Ok(answer.into_inner().counts.expect("counts").materials)
}

/// A client certificate that ended a minute ago, signed by an authority that is believed.
fn expired() -> (String, Vec<u8>, Vec<u8>) {
    let mut parameters = CertificateParams::new(Vec::new()).expect("parameters");
    parameters.is_ca = rcgen::IsCa::Ca(rcgen::BasicConstraints::Unconstrained);
    let key = KeyPair::generate().expect("a key");
    let authority = CertifiedIssuer::self_signed(parameters, key).expect("an authority");
    let mut parameters = CertificateParams::new(Vec::new()).expect("parameters");
    let now = SystemTime::now();
    parameters.not_before = (now - Duration::from_secs(3600)).into();
    parameters.not_after = (now - Duration::from_secs(60)).into();
    let key = KeyPair::generate().expect("a key");
    let certificate = parameters.signed_by(&key, &authority).expect("signed");
    let [certificate, key] = [certificate.pem(), key.serialize_pem()].map(String::into_bytes);
    (authority.pem(), certificate, key)
}

#[tokio::test]
async fn only_those_who_may_come_in_come_in() {
    let directory = tempfile::tempdir().expect("a directory");
    let directory = directory.path();
    let shown = succeed(
        directory,
        "credentials keys --host farm.example --mutual-tls",
    );
    assert!(shown.contains("worker connect https://farm.example:7117 --credentials keys/worker"));
    succeed(directory, "credentials others --mutual-tls");
    assert_eq!(
        run(directory, "credentials keys").status.code(),
        Some(2),
        "nothing is lost"
    );
    let key = fs::metadata(directory.join("keys/worker/token")).expect("a token");
    assert_eq!(
        std::os::unix::fs::PermissionsExt::mode(&key.permissions()) & 0o777,
        0o600
    );
    // One more authority for client certificates, whose certificate has expired.
    let (authority, certificate, key) = expired();
    let believed = directory.join("keys/coordinator/client-authority.pem");
    let both = fs::read_to_string(&believed).expect("an authority") + &authority;
    fs::write(&believed, both).expect("written");
    let (_coordinator, url) = coordinator(directory, "store", "--credentials keys/coordinator");
    assert!(url.starts_with("https://"), "{url}");

    let reader = credentials(directory, "keys/reader");
    let worker = credentials(directory, "keys/worker");
    let operator = credentials(directory, "keys/operator");
    assert_eq!(status(&url, &reader).await.expect("an answer"), 2);
    assert_eq!(status(&url, &operator).await.expect("an answer"), 2);

    // Roles and tokens.
    let refused = status(&url, &worker).await.unwrap_err();
    assert_eq!(refused.code(), Code::PermissionDenied, "{refused}");
    let with_token = |token: Option<&str>| Credentials {
        token: token.map(str::to_owned),
        ..reader.clone()
    };
    let wrong = "0".repeat(64);
    for token in [None, Some("short"), Some(&*wrong)] {
        let refused = status(&url, &with_token(token)).await.unwrap_err();
        assert_eq!(refused.code(), Code::Unauthenticated, "{refused}");
        assert!(!refused.message().contains("0000"), "{refused}");
    }
    let mut client = client::control(&url, &reader).expect("a client");
    let refused = client
        .pause(with_deadline(proto::PauseRequest {}))
        .await
        .unwrap_err();
    assert_eq!(refused.code(), Code::PermissionDenied);
    let mut client = client::farm(&url, &operator).expect("a client");
    let message = with_deadline(proto::GetDatasetRequest {});
    let refused = client.get_dataset(message).await.unwrap_err();
    assert_eq!(refused.code(), Code::PermissionDenied);

    // Certificates.
    let others = credentials(directory, "others/reader");
    let strangers = [
        Credentials {
            identity: None,
            ..reader.clone()
        },
        Credentials {
            identity: others.identity.clone(),
            ..reader.clone()
        },
        Credentials {
            identity: Some((certificate, key)),
            ..reader.clone()
        },
        // And a coordinator whom the client has no reason to believe.
        Credentials {
            authority: others.authority.clone(),
            ..reader.clone()
        },
    ];
    for stranger in strangers {
        let refused = status(&url, &stranger).await.unwrap_err();
        assert!(
            matches!(
                refused.code(),
                Code::Unavailable | Code::Unknown | Code::Cancelled
            ),
            "{refused}"
        );
    }
    let plain = url.replace("https", "http");
    assert!(status(&plain, &Credentials::default()).await.is_err());

    // A worker with everything renders the set, even one with a name like a path.
    let work = format!(
        "worker connect {url} --credentials keys/worker --backend native --name ../../../tmp/x"
    );
    assert!(succeed(directory, &work).contains("28 images"));
    let look = format!("status --coordinator {url} --credentials keys/reader");
    assert!(succeed(directory, &look).contains("2 of 2 complete"));
    succeed(directory, "dataset verify --store store");
}

#[test]
fn secrets_and_open_doors_are_refused_on_the_command_line() {
    let directory = tempfile::tempdir().expect("a directory");
    let directory = directory.path();
    fs::write(directory.join("spec.toml"), SPECIFICATION).expect("written");
    fs::create_dir(directory.join("empty")).expect("a folder");
    for (arguments, what) in [
        ("worker connect http://127.0.0.1:1 --token 0123", "--token"),
        ("status --token 0123", "--token"),
        (
            "coordinator serve --listen 0.0.0.0:0",
            "nothing protects it",
        ),
        ("coordinator serve --credentials empty", "tokens"),
        ("worker connect https://127.0.0.1:1", "authority.pem"),
    ] {
        let output = run(directory, arguments);
        assert_eq!(
            output.status.code(),
            Some(2),
            "{arguments}: {}",
            said(&output)
        );
        assert!(
            said(&output).contains(what),
            "{arguments}: {}",
            said(&output)
        );
    }
}

#[tokio::test]
async fn messages_that_are_too_large_are_refused_unread() {
    let directory = tempfile::tempdir().expect("a directory");
    let (coordinator, url) = coordinator(directory.path(), "store", "");
    let nobody = Credentials::default();
    let farm = client::farm(&url, &nobody).expect("a client");
    let mut farm = farm.max_encoding_message_size(64 << 20);
    for _ in 0..3 {
        let data = vec![0; 16 << 20];
        let message = proto::PutBlobRequest {
            digest: vec![0; 32],
            size: data.len() as u64,
            data: data.into(),
        };
        let refused = farm.put_blob(with_deadline(message)).await.unwrap_err();
        assert_eq!(refused.code(), Code::OutOfRange, "{refused}");
    }
    let message = proto::FindMissingBlobsRequest {
        digests: vec![vec![0; 32]; 5000],
    };
    let refused = farm
        .find_missing_blobs(with_deadline(message))
        .await
        .unwrap_err();
    assert_eq!(refused.code(), Code::InvalidArgument, "{refused}");
    let control = client::control(&url, &nobody).expect("a client");
    let mut control = control.max_encoding_message_size(64 << 20);
    let message = proto::BarWorkerRequest {
        name: "x".repeat(1 << 20),
        reason: "y".to_owned(),
    };
    let refused = control
        .bar_worker(with_deadline(message))
        .await
        .unwrap_err();
    assert_eq!(refused.code(), Code::OutOfRange, "{refused}");
    assert!(
        coordinator.memory() < MEMORY_MAX,
        "{}",
        coordinator.memory()
    );
    assert_eq!(status(&url, &nobody).await.expect("an answer"), 2);
}

#[tokio::test]
async fn ten_thousand_silent_connections_keep_nobody_out() {
    let directory = tempfile::tempdir().expect("a directory");
    let directory = directory.path();
    let limit = getrlimit(Resource::Nofile);
    let raised = Rlimit {
        current: limit.maximum,
        ..limit
    };
    setrlimit(Resource::Nofile, raised).expect("open files");
    let (coordinator, url) = coordinator(directory, "store", "");
    let address = url.trim_start_matches("http://").to_owned();
    let mut silent = Vec::new();
    while silent.len() < 10_000 {
        let Ok(stream) = TcpStream::connect(&address) else {
            panic!("{} connections are all that this system has", silent.len());
        };
        silent.push(stream);
        if silent.len().is_multiple_of(2500) {
            let answer = status(&url, &Credentials::default()).await;
            assert_eq!(
                answer.expect("an answer"),
                2,
                "with {} of them",
                silent.len()
            );
        }
    }
    let work = format!("worker connect {url} --backend native");
    assert!(succeed(directory, &work).contains("28 images"));
    assert!(
        coordinator.memory() < MEMORY_MAX,
        "{}",
        coordinator.memory()
    );
}

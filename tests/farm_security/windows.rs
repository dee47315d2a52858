//! What may be looked at from outside: metrics, health, and what the services are.

use crate::place::{coordinator, run, status, succeed};
use proto::client::{self, Credentials, with_deadline};
use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use tonic::metadata::MetadataValue;
use tonic::transport::{Certificate, Channel, ClientTlsConfig, Endpoint};
use tonic::{Code, Request};
use tonic_health::pb::{
    HealthCheckRequest, health_check_response::ServingStatus, health_client::HealthClient,
};
use tonic_reflection::pb::v1::{
    ServerReflectionRequest, server_reflection_client::ServerReflectionClient,
    server_reflection_request::MessageRequest, server_reflection_response::MessageResponse,
};

/// An address that was free a moment ago.
fn free_address() -> String {
    let listener = TcpListener::bind("127.0.0.1:0").expect("an address");
    listener.local_addr().expect("an address").to_string()
}

fn get(address: &str, path: &str) -> String {
    let mut stream = TcpStream::connect(address).expect("a connection");
    let request = format!("GET {path} HTTP/1.1\r\nHost: {address}\r\nConnection: close\r\n\r\n");
    stream.write_all(request.as_bytes()).expect("written");
    let mut answer = String::new();
    stream.read_to_string(&mut answer).expect("text");
    answer
}

/// The value of a line of metrics.
fn value(metrics: &str, name: &str) -> f64 {
    let mut values = metrics.lines().filter_map(|line| {
        let value = line.strip_prefix(name)?.strip_prefix(' ')?;
        value.parse().ok()
    });
    values
        .next()
        .unwrap_or_else(|| panic!("no {name} in {metrics}"))
}

#[tokio::test]
async fn metrics_tell_what_happened_and_nothing_secret() {
    let directory = tempfile::tempdir().expect("a directory");
    let directory = directory.path();
    let address = free_address();
    let (_coordinator, url) = coordinator(directory, "store", &format!("--metrics {address}"));
    let before = get(&address, "/metrics");
    assert!(before.starts_with("HTTP/1.1 200"), "{before}");
    assert_eq!(value(&before, "brdfarm_jobs{state=\"pending\"}"), 2.0);
    assert_eq!(value(&before, "brdfarm_store_bytes"), 0.0);
    let work = format!("worker connect {url} --backend native --name secretive");
    assert!(succeed(directory, &work).contains("28 images"));
    let mut control = client::control(&url, &Credentials::default()).expect("a client");
    let unknown = proto::GetBlobRequest {
        digest: vec![7; 32],
    };
    control
        .get_blob(with_deadline(unknown))
        .await
        .expect_err("no such image");

    let after = get(&address, "/metrics");
    assert_eq!(value(&after, "brdfarm_jobs{state=\"completed\"}"), 2.0);
    assert_eq!(value(&after, "brdfarm_images"), 28.0);
    succeed(
        directory,
        "dataset manifest export --format csv --out out.csv",
    );
    assert_eq!(
        value(&after, "brdfarm_store_bytes"),
        image_bytes(directory) as f64
    );
    assert!(value(&after, "brdfarm_store_free_bytes") > 0.0);
    assert!(value(&after, "brdfarm_upload_seconds_count") >= 28.0);
    assert_eq!(value(&after, "brdfarm_render_seconds_count"), 2.0);
    assert!(value(&after, "brdfarm_ledger_commit_seconds_count") >= 2.0);
    assert_eq!(
        value(&after, "brdfarm_errors_total{code=\"not_found\"}"),
        1.0
    );
    assert!(after.trim_end().ends_with("# EOF"), "cut short");
    assert!(!after.contains("secretive"), "names are not for everybody");

    assert!(get(&address, "/").starts_with("HTTP/1.1 404"));
    assert!(get(&address, "/../../etc/passwd").starts_with("HTTP/1.1 404"));
    let taken = run(
        directory,
        &format!(
            "coordinator serve --spec spec.toml --store other --listen 127.0.0.1:0 --metrics {address}"
        ),
    );
    assert_eq!(taken.status.code(), Some(1), "the address is taken");
    assert_eq!(
        status(&url, &Credentials::default())
            .await
            .expect("an answer"),
        2
    );
}

/// Bytes of the images in a store, from its manifest.
fn image_bytes(directory: &std::path::Path) -> u64 {
    let manifest = std::fs::read_to_string(directory.join("out.csv")).expect("a manifest");
    let mut lines = manifest.lines();
    let names = lines.next().expect("names").split(',');
    let column = names.clone().position(|name| name == "bytes");
    let column = column.expect("a column of bytes");
    let bytes = lines.map(|line| line.split(',').nth(column).expect("a field"));
    bytes
        .map(|bytes| bytes.parse::<u64>().expect("a number"))
        .sum()
}

async fn channel(url: &str, credentials: &Credentials) -> Channel {
    let authority = credentials.authority.clone().expect("an authority");
    let tls = ClientTlsConfig::new().ca_certificate(Certificate::from_pem(authority));
    let endpoint = Endpoint::from_shared(url.to_owned()).expect("a URL");
    let endpoint = endpoint.tls_config(tls).expect("a configuration");
    endpoint.connect().await.expect("a connection")
}

/// As a probe asks: without a token, believing the farm's authority.
#[test]
fn the_health_command_tells_by_its_exit_code() {
    let directory = tempfile::tempdir().expect("a directory");
    let directory = directory.path();
    succeed(directory, "credentials keys");
    std::fs::create_dir(directory.join("probe")).expect("made");
    let authority = directory.join("keys/worker/authority.pem");
    std::fs::copy(authority, directory.join("probe/authority.pem")).expect("copied");
    let (coordinator, url) = coordinator(directory, "store", "--credentials keys/coordinator");
    let health = format!("coordinator health --coordinator {url} --credentials probe");
    assert_eq!(succeed(directory, &health), "");
    drop(coordinator);
    assert_eq!(run(directory, &health).status.code(), Some(1));
}

#[tokio::test]
async fn health_is_for_everybody_and_reflection_for_those_with_a_token() {
    let directory = tempfile::tempdir().expect("a directory");
    let directory = directory.path();
    succeed(directory, "credentials keys");
    let (_coordinator, url) = coordinator(directory, "store", "--credentials keys/coordinator");
    let reader = reader(directory);
    let channel = channel(&url, &reader).await;

    let mut health = HealthClient::new(channel.clone());
    for service in ["", "brdfarm.v1.Farm", "brdfarm.v1.Control"] {
        let message = HealthCheckRequest {
            service: service.to_owned(),
        };
        let answer = health.check(message).await.expect("an answer").into_inner();
        assert_eq!(answer.status(), ServingStatus::Serving, "{service:?}");
    }
    let message = HealthCheckRequest {
        service: "no.such.Service".to_owned(),
    };
    let unknown = health.check(message).await.expect_err("no such service");
    assert_eq!(unknown.code(), Code::NotFound);

    let mut reflection = ServerReflectionClient::new(channel);
    let list = || {
        tokio_stream::once(ServerReflectionRequest {
            host: String::new(),
            message_request: Some(MessageRequest::ListServices(String::new())),
        })
    };
    let refused = reflection.server_reflection_info(list()).await;
    let refused = refused.expect_err("no token");
    assert_eq!(refused.code(), Code::Unauthenticated);
    let mut request = Request::new(list());
    let token = format!("Bearer {}", reader.token.expect("a token").trim());
    let token: MetadataValue<_> = token.parse().expect("a header");
    request.metadata_mut().insert("authorization", token);
    let answers = reflection.server_reflection_info(request).await;
    let answer = answers.expect("an answer").into_inner().message().await;
    let answer = answer.expect("a message").expect("one message");
    let Some(MessageResponse::ListServicesResponse(services)) = answer.message_response else {
        panic!("{answer:?}");
    };
    let mut names: Vec<String> = services
        .service
        .into_iter()
        .map(|found| found.name)
        .collect();
    names.sort();
    for name in [
        "brdfarm.v1.Control",
        "brdfarm.v1.Farm",
        "grpc.health.v1.Health",
    ] {
        assert!(names.iter().any(|found| found == name), "{name}: {names:?}");
    }
}

/// A reader's credentials, without a certificate of its own.
fn reader(directory: &std::path::Path) -> Credentials {
    let folder = directory.join("keys/reader");
    let read = |name: &str| std::fs::read(folder.join(name)).expect("readable");
    Credentials {
        token: Some(String::from_utf8(read("token")).expect("text")),
        authority: Some(read("authority.pem")),
        identity: None,
    }
}

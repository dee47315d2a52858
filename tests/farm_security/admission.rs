//! Tokens, roles and certificates.

use crate::place::{SPECIFICATION, coordinator, credentials, run, said, status, succeed};
use proto::client::{self, Credentials, with_deadline};
use rcgen::{CertificateParams, CertifiedIssuer, KeyPair};
use std::time::{Duration, SystemTime};
use std::{fs, path::Path};
use tonic::Code;

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

/// Makes credentials for a farm in `keys` and for another one in `others`.
fn make_credentials(directory: &Path) {
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
}

#[tokio::test]
async fn only_those_who_may_come_in_come_in() {
    let directory = tempfile::tempdir().expect("a directory");
    let directory = directory.path();
    make_credentials(directory);
    // One more authority for client certificates, whose certificate has expired.
    let (authority, certificate, key) = expired();
    let believed = directory.join("keys/coordinator/client-authority.pem");
    let both = fs::read_to_string(&believed).expect("an authority") + &authority;
    fs::write(&believed, both).expect("written");
    let (_coordinator, url) = coordinator(directory, "store", "--credentials keys/coordinator");
    assert!(url.starts_with("https://"), "{url}");

    roles_and_tokens_are_checked(directory, &url).await;
    strangers_are_kept_out(directory, &url, (certificate, key)).await;

    // A worker with everything renders the set, even one with a name like a path.
    let work = format!(
        "worker connect {url} --credentials keys/worker --backend native --name ../../../tmp/x"
    );
    assert!(succeed(directory, &work).contains("28 images"));
    let look = format!("status --coordinator {url} --credentials keys/reader");
    assert!(succeed(directory, &look).contains("2 of 2 complete"));
    succeed(directory, "dataset verify --store store");
}

async fn roles_and_tokens_are_checked(directory: &Path, url: &str) {
    let reader = credentials(directory, "keys/reader");
    let worker = credentials(directory, "keys/worker");
    let operator = credentials(directory, "keys/operator");
    assert_eq!(status(url, &reader).await.expect("an answer"), 2);
    assert_eq!(status(url, &operator).await.expect("an answer"), 2);

    let refused = status(url, &worker).await.expect_err("a refusal");
    assert_eq!(refused.code(), Code::PermissionDenied, "{refused}");
    let with_token = |token: Option<&str>| Credentials {
        token: token.map(str::to_owned),
        ..reader.clone()
    };
    let wrong = "0".repeat(64);
    for token in [None, Some("short"), Some(&*wrong)] {
        let refused = status(url, &with_token(token))
            .await
            .expect_err("a refusal");
        assert_eq!(refused.code(), Code::Unauthenticated, "{refused}");
        assert!(!refused.message().contains("0000"), "{refused}");
    }
    let mut client = client::control(url, &reader).expect("a client");
    let refused = client
        .pause(with_deadline(proto::PauseRequest {}))
        .await
        .expect_err("a refusal");
    assert_eq!(refused.code(), Code::PermissionDenied);
    let mut client = client::farm(url, &reader).expect("a client");
    let message = with_deadline(proto::GetDatasetRequest {});
    let refused = client.get_dataset(message).await.expect_err("a refusal");
    assert_eq!(refused.code(), Code::PermissionDenied);
    // An operator decides disputes, and renders nothing else.
    let mut client = client::farm(url, &operator).expect("a client");
    let register = proto::RegisterRequest {
        name: "me".to_owned(),
        renderer_version: dataset::RENDERER_VERSION.to_owned(),
        specification_hash: vec![0; 32],
        ..proto::RegisterRequest::default()
    };
    let refused = client
        .register(with_deadline(register))
        .await
        .expect_err("a refusal");
    assert_eq!(refused.code(), Code::PermissionDenied);
}

/// Without a certificate, with one of another farm or an expired one, and without TLS. Nor does a
/// client talk to a coordinator whom it has no reason to believe.
async fn strangers_are_kept_out(directory: &Path, url: &str, expired: (Vec<u8>, Vec<u8>)) {
    let reader = credentials(directory, "keys/reader");
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
            identity: Some(expired),
            ..reader.clone()
        },
        Credentials {
            authority: others.authority.clone(),
            ..reader.clone()
        },
    ];
    for stranger in strangers {
        let refused = status(url, &stranger).await.expect_err("a refusal");
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

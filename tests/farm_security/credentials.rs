//! Folders of credentials that grow: more hosts, certificates that are valid for longer, more workers.

use crate::place::{SPECIFICATION, brdfarm, run, said, succeed};
use crate::process::Process;
use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;

/// A coordinator under an address that no certificate has unless it is asked for.
fn serve(directory: &Path) -> (Process, String) {
    fs::write(directory.join("spec.toml"), SPECIFICATION).expect("written");
    let arguments = "coordinator serve --spec spec.toml --store store --listen 127.0.0.2:0 \
                     --credentials keys/coordinator";
    Process::serving(&mut brdfarm(directory, arguments)).expect("a coordinator")
}

fn read(directory: &Path, file: &str) -> String {
    fs::read_to_string(directory.join(file)).expect("readable")
}

fn refused(directory: &Path, arguments: &str, why: &str) {
    let output = run(directory, arguments);
    let text = said(&output);
    assert_eq!(output.status.code(), Some(2), "{arguments}: {text}");
    assert!(text.contains(why), "{arguments}: {text}");
}

fn copy(from: &Path, to: &Path) {
    fs::create_dir(to).expect("a folder");
    for file in fs::read_dir(from).expect("a folder") {
        let file = file.expect("an entry");
        fs::copy(file.path(), to.join(file.file_name())).expect("copied");
    }
}

#[test]
fn a_host_is_added_later_and_clients_keep_what_they_have() {
    let directory = tempfile::tempdir().expect("a directory");
    let directory = directory.path();
    succeed(
        directory,
        "credentials keys --host farm.example --mutual-tls",
    );
    let key = fs::metadata(directory.join("keys/authority/key.pem")).expect("a key");
    assert_eq!(key.permissions().mode() & 0o777, 0o600);
    let folder = fs::metadata(directory.join("keys/authority")).expect("a folder");
    assert_eq!(folder.permissions().mode() & 0o777, 0o700);
    // What a reader's machine was given at first.
    copy(&directory.join("keys/reader"), &directory.join("given"));

    let (coordinator, url) = serve(directory);
    let look = format!("status --coordinator {url} --credentials given");
    let output = run(directory, &look);
    assert!(!output.status.success(), "the certificate lacks 127.0.0.2");
    drop(coordinator);

    let before = read(directory, "keys/coordinator/key.pem");
    let shown = succeed(
        directory,
        "credentials keys --host 127.0.0.2 --host farm.example",
    );
    assert!(shown.contains("1 host added"), "{shown}");
    assert_eq!(read(directory, "keys/coordinator/key.pem"), before);
    let shown = succeed(directory, "credentials keys --host farm.example");
    assert!(shown.contains("has these hosts already"), "{shown}");
    let (coordinator, url) = serve(directory);
    let look = format!("status --coordinator {url} --credentials given");
    succeed(directory, &look);
    drop(coordinator);

    // Once more, with what was added; old and new folders of clients both open the door.
    let tokens = read(directory, "keys/coordinator/tokens");
    let certificate = read(directory, "keys/reader/certificate.pem");
    succeed(directory, "credentials keys --worker alice");
    let shown = succeed(directory, "credentials keys --renew --days 30");
    assert!(
        shown.contains("5 certificates in keys valid for 30 days")
            && shown.contains("copy each folder"),
        "{shown}"
    );
    assert_ne!(read(directory, "keys/reader/certificate.pem"), certificate);
    assert!(read(directory, "keys/coordinator/tokens").starts_with(&tokens));
    let (_coordinator, url) = serve(directory);
    for reader in ["given", "keys/reader"] {
        let look = format!("status --coordinator {url} --credentials {reader}");
        succeed(directory, &look);
    }
    let work = format!("worker connect {url} --credentials keys/workers/alice --backend native");
    assert!(succeed(directory, &work).contains("28 images"));
}

#[test]
fn what_a_folder_cannot_give_is_refused_with_a_way_out() {
    let directory = tempfile::tempdir().expect("a directory");
    let directory = directory.path();
    refused(
        directory,
        "credentials keys --renew",
        "there are no credentials in keys",
    );
    assert!(!directory.join("keys").exists());
    succeed(directory, "credentials keys");
    refused(directory, "credentials keys", "--renew");
    refused(
        directory,
        "credentials keys --mutual-tls",
        "for a new folder",
    );
    // As an earlier version made it, or as somebody keeps it who took the key away.
    fs::rename(directory.join("keys/authority"), directory.join("away")).expect("moved");
    let before = read(directory, "keys/coordinator/certificate.pem");
    for arguments in ["--host farm.example", "--renew"] {
        let arguments = format!("credentials keys {arguments}");
        refused(directory, &arguments, "has no authority/key.pem");
    }
    assert_eq!(read(directory, "keys/coordinator/certificate.pem"), before);
    succeed(directory, "credentials keys --worker alice");
    refused(
        directory,
        "credentials keys --worker alice",
        "already exists",
    );
    fs::rename(directory.join("away"), directory.join("keys/authority")).expect("moved");
    fs::write(directory.join("keys/authority/key.pem"), "no key").expect("written");
    let output = run(directory, "credentials keys --renew");
    assert_eq!(output.status.code(), Some(1), "{}", said(&output));
    assert!(said(&output).contains("key.pem"), "{}", said(&output));
    assert_eq!(read(directory, "keys/coordinator/certificate.pem"), before);
}

//! TLS to a server with a certificate of an authority of the test's own.

use crate::Database;
use crate::testing::{Server, run};
use rcgen::{BasicConstraints, CertificateParams, CertifiedIssuer, DnType, IsCa, KeyPair};
use std::{fs, path::Path, time::Duration};
use tempfile::TempDir;

fn authority(name: &str) -> CertifiedIssuer<'static, KeyPair> {
    let mut parameters = CertificateParams::default();
    parameters.distinguished_name.push(DnType::CommonName, name);
    parameters.is_ca = IsCa::Ca(BasicConstraints::Unconstrained);
    CertifiedIssuer::self_signed(parameters, KeyPair::generate().unwrap()).unwrap()
}

/// Whether a connection is encrypted, or why there is none.
async fn encrypted(url: &str) -> Result<bool, String> {
    let database = Database::new(url).map_err(|error| error.to_string())?;
    let asked = async {
        let connection = database.connection().await?;
        let query = "SELECT ssl FROM pg_stat_ssl WHERE pid = pg_backend_pid()";
        Ok(connection.query_one(query, &[]).await?.get(0))
    };
    asked
        .await
        .map_err(|fault| database.away(fault).to_string())
}

fn write(folder: &TempDir, name: &str, pem: &str) -> String {
    let path = folder.path().join(name);
    fs::write(&path, pem).unwrap();
    Path::to_str(&path).unwrap().to_owned()
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_server_is_believed_as_far_as_the_mode_says() {
    let [ours, foreign, namesake] = ["ours", "foreign", "ours"].map(authority);
    let key = KeyPair::generate().unwrap();
    let names = CertificateParams::new(vec!["localhost".to_owned()]).unwrap();
    let certificate = names.signed_by(&key, &ours).unwrap().pem();
    let folder = tempfile::tempdir().unwrap();
    let foreign = write(&folder, "foreign.pem", &foreign.pem());
    let namesake = write(&folder, "namesake.pem", &namesake.pem());
    let ours = write(&folder, "ours.pem", &ours.pem());
    let starting = move || Server::start_with_certificate(&certificate, &key.serialize_pem());
    let server = tokio::task::spawn_blocking(starting).await.unwrap();

    let at = |host: &str, parameters: &str| {
        let url = server.url_at(host).replace("brdfarm@", "brdfarm:hush@");
        format!("{url}?{parameters}")
    };
    let refused = async |url: String, why: &str| {
        let said = encrypted(&url).await.unwrap_err();
        let name = url.split('?').next().unwrap().replace(":hush", "");
        assert_eq!(said, format!("the database {name} cannot be used: {why}"));
    };
    let full = |authority| format!("sslmode=verify-full&sslrootcert={authority}");
    let by_authority = |authority| format!("sslmode=verify-ca&sslrootcert={authority}");
    let unknown = "its certificate is signed by none of the authorities in sslrootcert";
    let misnamed = "its certificate is not for 127.0.0.1, but for DnsName(\"localhost\")";

    let plain = at("127.0.0.1", "sslmode=prefer");
    assert_eq!(encrypted(&plain).await, Ok(false));
    let speechless = "error performing TLS handshake: server does not support TLS";
    refused(at("127.0.0.1", "sslmode=require"), speechless).await;
    run(&server.url(), "ALTER SYSTEM SET ssl = on").await;
    run(&server.url(), "SELECT pg_reload_conf()").await;
    let heard = async {
        while encrypted(&plain).await != Ok(true) {
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
    };
    tokio::time::timeout(Duration::from_secs(60), heard)
        .await
        .unwrap();

    assert_eq!(encrypted(&at("localhost", &full(&ours))).await, Ok(true));
    refused(at("127.0.0.1", &full(&ours)), misnamed).await;
    refused(at("localhost", &full(&foreign)), unknown).await;
    refused(at("localhost", &full(&namesake)), unknown).await;
    assert_eq!(
        encrypted(&at("127.0.0.1", &by_authority(&ours))).await,
        Ok(true)
    );
    refused(at("localhost", &by_authority(&foreign)), unknown).await;
    // Whose authority is named is checked, even where nothing has to be.
    let named = format!("sslmode=require&sslrootcert={foreign}");
    refused(at("localhost", &named), unknown).await;
    for (mode, expected) in [("require", true), ("prefer", true), ("disable", false)] {
        let url = at("127.0.0.1", &format!("sslmode={mode}"));
        assert_eq!(encrypted(&url).await, Ok(expected), "{mode}");
    }
    // Through a socket nobody but the system listens.
    let socket = format!("{}&{}", server.url(), full(&foreign));
    assert_eq!(encrypted(&socket).await, Ok(false));
}

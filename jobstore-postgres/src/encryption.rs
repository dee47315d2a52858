//! TLS to a database: libpq's parameters, with their names and meanings.
//!
//! | `sslmode` | encrypted | the server's certificate |
//! | --- | --- | --- |
//! | `disable` | never | |
//! | `prefer`, the default | where the server can | is not looked at |
//! | `require` | always | as `verify-ca` where there are authorities, else not looked at |
//! | `verify-ca` | always | is signed by one of the authorities |
//! | `verify-full` | always | and is for the host that the URL names |
//!
//! The authorities are the certificates in the file that `sslrootcert` names, or in
//! `~/.postgresql/root.crt`; `sslrootcert=system` takes the system's, and `verify-full` alone goes
//! with it. Parameters that the URL does not have come from `PGSSLMODE` and `PGSSLROOTCERT`. What
//! goes through a Unix socket is never encrypted.

use rustls::{
    CertificateError, ClientConfig, DigitallySignedStruct, Error, RootCertStore, SignatureScheme,
    client::{
        WebPkiServerVerifier,
        danger::{HandshakeSignatureValid, ServerCertVerified, ServerCertVerifier},
    },
    crypto::{CryptoProvider, ring, verify_tls12_signature, verify_tls13_signature},
    pki_types::{CertificateDer, ServerName, UnixTime, pem::PemObject},
};
use std::{error::Error as _, ffi::OsString, io, path::PathBuf, sync::Arc};
use tokio_postgres::config::SslMode;
use tokio_postgres_rustls::MakeRustlsConnect;

/// What the server has to support when TLS begins with the first byte, `sslnegotiation=direct`.
const PROTOCOL: &[u8] = b"postgresql";

/// How connections are encrypted.
pub(super) struct Encryption {
    pub mode: SslMode,
    pub connector: MakeRustlsConnect,
}

/// Whose word about a server counts.
enum Trust {
    Anybody,
    Authorities { roots: RootCertStore, names: bool },
}

/// What a URL says of encryption, as it says it.
#[derive(Debug, Default, PartialEq, Eq)]
pub(super) struct Parameters {
    mode: Option<String>,
    authorities: Option<String>,
}

/// A URL without `sslmode` and `sslrootcert`, and these.
pub(super) fn take(url: &str) -> (String, Parameters) {
    // A password may have a question mark; what comes after it may not.
    let place = url.find('@').map_or(0, |at| at + 1);
    let mut taken = Parameters::default();
    let Some(query) = url[place..].find('?').map(|at| place + at) else {
        return (url.to_owned(), taken);
    };
    let mut others = Vec::new();
    for parameter in url[query + 1..].split('&') {
        let (name, value) = match parameter.split_once('=') {
            Some(("sslmode", value)) => (&mut taken.mode, value),
            Some(("sslrootcert", value)) => (&mut taken.authorities, value),
            _ => {
                others.push(parameter);
                continue;
            }
        };
        let value = percent_encoding::percent_decode_str(value).decode_utf8_lossy();
        *name = Some(value.into_owned());
    }
    let rest = match &others[..] {
        [] => url[..query].to_owned(),
        others => format!("{}?{}", &url[..query], others.join("&")),
    };
    (rest, taken)
}

impl Parameters {
    /// What they mean. `variable` reads the environment.
    ///
    /// # Errors
    /// The sentence that says what is wrong with them.
    pub fn encryption(
        self,
        variable: impl Fn(&str) -> Option<OsString>,
    ) -> Result<Encryption, String> {
        let given = |name| variable(name).filter(|value| !value.is_empty());
        let of_environment = || given("PGSSLMODE").map(|mode| mode.to_string_lossy().into_owned());
        let mode = self.mode.or_else(of_environment);
        let authorities = self.authorities.map(OsString::from);
        let authorities = authorities.or_else(|| given("PGSSLROOTCERT"));
        let (mode, trust) = match &authorities {
            Some(system) if system == "system" => match mode.as_deref() {
                None | Some("verify-full") => (SslMode::Require, system_authorities()?),
                Some(other) => {
                    return Err(format!(
                        "sslmode={other} does not go with sslrootcert=system, where anybody can \
                         have a certificate: write sslmode=verify-full"
                    ));
                }
            },
            _ => {
                let home = given("HOME").map(PathBuf::from);
                let usual = home.map(|home| home.join(".postgresql/root.crt"));
                let usual = usual.filter(|file| file.exists());
                let mode = mode.as_deref().unwrap_or("prefer");
                chosen(mode, authorities.map(PathBuf::from).or(usual))?
            }
        };
        let connector = MakeRustlsConnect::new(configuration(trust)?);
        Ok(Encryption { mode, connector })
    }
}

fn chosen(mode: &str, authorities: Option<PathBuf>) -> Result<(SslMode, Trust), String> {
    let verified = |names| {
        let file = authorities.as_ref().ok_or_else(|| {
            format!(
                "sslmode={mode} wants to know whose word about the server counts: add \
                 sslrootcert=FILE with the authority's certificate, or sslrootcert=system"
            )
        })?;
        let roots = authorities_of(file)?;
        Ok::<_, String>(Trust::Authorities { roots, names })
    };
    Ok(match mode {
        "disable" => (SslMode::Disable, Trust::Anybody),
        "prefer" => (SslMode::Prefer, Trust::Anybody),
        "require" if authorities.is_none() => (SslMode::Require, Trust::Anybody),
        "require" | "verify-ca" => (SslMode::Require, verified(false)?),
        "verify-full" => (SslMode::Require, verified(true)?),
        other => {
            return Err(format!(
                "sslmode={other} is none of disable, prefer, require, verify-ca and verify-full"
            ));
        }
    })
}

fn authorities_of(file: &PathBuf) -> Result<RootCertStore, String> {
    let place = file.display();
    let certificates = CertificateDer::pem_file_iter(file)
        .and_then(|found| found.collect::<Result<Vec<_>, _>>())
        .map_err(|error| format!("sslrootcert {place} cannot be read: {error}"))?;
    let mut roots = RootCertStore::empty();
    for certificate in certificates {
        roots
            .add(certificate)
            .map_err(|error| format!("sslrootcert {place} cannot be used: {error}"))?;
    }
    if roots.is_empty() {
        return Err(format!("sslrootcert {place} has no certificate in it"));
    }
    Ok(roots)
}

fn system_authorities() -> Result<Trust, String> {
    let found = rustls_native_certs::load_native_certs();
    let mut roots = RootCertStore::empty();
    // Among a system's many there may be some that are of no use.
    roots.add_parsable_certificates(found.certs);
    if roots.is_empty() {
        return Err("sslrootcert=system: this system has no certificates".to_owned());
    }
    Ok(Trust::Authorities { roots, names: true })
}

fn configuration(trust: Trust) -> Result<ClientConfig, String> {
    let provider = Arc::new(ring::default_provider());
    let unusable = |error: &dyn std::error::Error| format!("TLS cannot be used: {error}");
    let (authorities, names) = match trust {
        Trust::Anybody => (None, false),
        Trust::Authorities { roots, names } => {
            let roots = Arc::new(roots);
            let built = WebPkiServerVerifier::builder_with_provider(roots, Arc::clone(&provider));
            (
                Some(built.build().map_err(|error| unusable(&error))?),
                names,
            )
        }
    };
    let verifier = Verifier {
        authorities,
        names,
        provider: Arc::clone(&provider),
    };
    let mut configuration = ClientConfig::builder_with_provider(provider)
        .with_safe_default_protocol_versions()
        .map_err(|error| unusable(&error))?
        .dangerous()
        .with_custom_certificate_verifier(Arc::new(verifier))
        .with_no_client_auth();
    configuration.alpn_protocols = vec![PROTOCOL.to_vec()];
    Ok(configuration)
}

/// Believes as much as the mode says. That a server has the key of the certificate that it shows is
/// always checked.
#[derive(Debug)]
struct Verifier {
    authorities: Option<Arc<WebPkiServerVerifier>>,
    names: bool,
    provider: Arc<CryptoProvider>,
}

impl ServerCertVerifier for Verifier {
    fn verify_server_cert(
        &self,
        certificate: &CertificateDer<'_>,
        intermediates: &[CertificateDer<'_>],
        name: &ServerName<'_>,
        ocsp_response: &[u8],
        now: UnixTime,
    ) -> Result<ServerCertVerified, Error> {
        let Some(authorities) = &self.authorities else {
            return Ok(ServerCertVerified::assertion());
        };
        let verdict =
            authorities.verify_server_cert(certificate, intermediates, name, ocsp_response, now);
        match verdict {
            // The name is what is looked at last.
            Err(Error::InvalidCertificate(
                CertificateError::NotValidForName | CertificateError::NotValidForNameContext { .. },
            )) if !self.names => Ok(ServerCertVerified::assertion()),
            verdict => verdict,
        }
    }

    fn verify_tls12_signature(
        &self,
        message: &[u8],
        certificate: &CertificateDer<'_>,
        signature: &DigitallySignedStruct,
    ) -> Result<HandshakeSignatureValid, Error> {
        let known = &self.provider.signature_verification_algorithms;
        verify_tls12_signature(message, certificate, signature, known)
    }

    fn verify_tls13_signature(
        &self,
        message: &[u8],
        certificate: &CertificateDer<'_>,
        signature: &DigitallySignedStruct,
    ) -> Result<HandshakeSignatureValid, Error> {
        let known = &self.provider.signature_verification_algorithms;
        verify_tls13_signature(message, certificate, signature, known)
    }

    fn supported_verify_schemes(&self) -> Vec<SignatureScheme> {
        let known = &self.provider.signature_verification_algorithms;
        known.supported_schemes()
    }
}

/// Why a server's certificate was not believed, where that is what went wrong.
pub(super) fn disbelief(error: &tokio_postgres::Error) -> Option<String> {
    let error: &io::Error = error.source()?.downcast_ref()?;
    let Error::InvalidCertificate(reason) = error.get_ref()?.downcast_ref()? else {
        return None;
    };
    Some(match reason {
        // The other is an authority that is called the same.
        CertificateError::UnknownIssuer | CertificateError::BadSignature => {
            "its certificate is signed by none of the authorities in sslrootcert".to_owned()
        }
        CertificateError::NotValidForNameContext {
            expected,
            presented,
        } => format!(
            "its certificate is not for {}, but for {}",
            expected.to_str(),
            match &presented[..] {
                [] => "no name".to_owned(),
                names => names.join(", "),
            }
        ),
        other => format!("its certificate cannot be believed: {other}"),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const NOWHERE: fn(&str) -> Option<OsString> = |_| None;

    fn mode(url: &str) -> Result<SslMode, String> {
        let (_, parameters) = take(url);
        parameters.encryption(NOWHERE).map(|found| found.mode)
    }

    #[test]
    fn parameters_about_tls_are_taken_and_all_others_stay() {
        for (url, rest, mode, authorities) in [
            (
                "postgres://me@h/d?sslmode=require&options=-cx%3Dy&sslrootcert=%2Fa%20b",
                "postgres://me@h/d?options=-cx%3Dy",
                Some("require"),
                Some("/a b"),
            ),
            (
                "postgres://me:a?sslmode=b@h/d?sslmode=disable",
                "postgres://me:a?sslmode=b@h/d",
                Some("disable"),
                None,
            ),
            ("postgres:///d", "postgres:///d", None, None),
        ] {
            let taken = Parameters {
                mode: mode.map(str::to_owned),
                authorities: authorities.map(str::to_owned),
            };
            assert_eq!(take(url), (rest.to_owned(), taken));
        }
    }

    #[test]
    fn modes_mean_what_libpq_says() {
        assert_eq!(mode("postgres://h"), Ok(SslMode::Prefer));
        assert_eq!(mode("postgres://h?sslmode=disable"), Ok(SslMode::Disable));
        assert_eq!(mode("postgres://h?sslmode=require"), Ok(SslMode::Require));
        let says = |url, what: &str| {
            let said = mode(url).unwrap_err();
            assert!(said.contains(what), "{url}: {said}");
        };
        says("postgres://h?sslmode=verify-ca", "add sslrootcert=FILE");
        says("postgres://h?sslmode=verify-full", "add sslrootcert=FILE");
        says("postgres://h?sslmode=allow", "is none of disable, prefer");
        says(
            "postgres://h?sslmode=require&sslrootcert=/nowhere",
            "/nowhere cannot be read",
        );
        says(
            "postgres://h?sslmode=require&sslrootcert=/dev/null",
            "has no certificate in it",
        );
        says(
            "postgres://h?sslmode=verify-ca&sslrootcert=system",
            "write sslmode=verify-full",
        );
        // What the URL does not say the environment may.
        let strict = |name: &str| (name == "PGSSLMODE").then(|| "verify-full".into());
        assert!(take("postgres://h").1.encryption(strict).is_err());
        let (_, said) = take("postgres://h?sslmode=prefer");
        assert!(said.encryption(strict).is_ok());
    }
}

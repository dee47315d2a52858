//! `brdfarm credentials`: certificates and tokens, so that the secure set-up is as short as the
//! insecure one.

use crate::failure::BadInput;
use anyhow::Context;
use clap::Args;
use rcgen::{
    BasicConstraints, CertificateParams, CertifiedIssuer, DnType, ExtendedKeyUsagePurpose, IsCa,
    KeyPair, KeyUsagePurpose,
};
use std::fs::{DirBuilder, OpenOptions};
use std::io::{self, Write};
use std::os::unix::fs::{DirBuilderExt, OpenOptionsExt};
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

/// Random bytes of a token.
const TOKEN_BYTES: usize = 32;

/// How far back certificates are valid, for machines whose clocks differ.
const CLOCK_SKEW: Duration = Duration::from_secs(3600);

/// Those who get a folder, beside the coordinator; also the names of the roles.
const ROLES: [&str; 3] = ["worker", "operator", "reader"];

/// Make certificates and tokens for a farm
///
/// Makes an authority that signs what is made here and nothing after, and writes a folder for each
/// side: coordinator, worker, operator, reader. Serve with --credentials DIR/coordinator, and copy
/// to each machine the one folder of what runs there.
#[derive(Debug, Args)]
pub struct Options {
    /// The folder to make
    #[arg(value_name = "DIR")]
    folder: PathBuf,
    /// A name or address under which the coordinator is reached, as in its URL; can be repeated.
    /// localhost and 127.0.0.1 are always among them
    #[arg(long = "host", value_name = "NAME")]
    hosts: Vec<String>,
    /// How long the certificates are valid
    #[arg(long, default_value_t = 365, value_name = "DAYS",
          value_parser = clap::value_parser!(u64).range(1..=3650))]
    days: u64,
    /// Let nobody in without a certificate of this authority, whatever token they have
    #[arg(long)]
    mutual_tls: bool,
}

/// Makes them.
pub fn execute(options: &Options) -> anyhow::Result<()> {
    let folder = &options.folder;
    if folder.exists() {
        let what = format!("{} is there already: choose a new folder", folder.display());
        return Err(BadInput(what).into());
    }
    make_folder(folder)?;
    let authority = authority(options.days)?;
    let tokens = ROLES.map(|role| Ok((role, token()?)));
    let tokens = tokens.into_iter().collect::<anyhow::Result<Vec<_>>>()?;

    let coordinator = folder.join("coordinator");
    make_folder(&coordinator)?;
    let mut hosts = vec![
        "localhost".to_owned(),
        "127.0.0.1".to_owned(),
        "::1".to_owned(),
    ];
    hosts.extend(options.hosts.iter().cloned());
    let usage = ExtendedKeyUsagePurpose::ServerAuth;
    sign(
        &authority,
        "brdfarm coordinator",
        hosts,
        usage,
        options.days,
        &coordinator,
    )?;
    let lines: Vec<String> = tokens
        .iter()
        .map(|(role, token)| format!("{role} {token}\n"))
        .collect();
    write(&coordinator.join("tokens"), &lines.concat())?;
    if options.mutual_tls {
        write(&coordinator.join("client-authority.pem"), &authority.pem())?;
    }
    for (role, token) in tokens {
        let folder = folder.join(role);
        make_folder(&folder)?;
        let usage = ExtendedKeyUsagePurpose::ClientAuth;
        let name = format!("brdfarm {role}");
        sign(&authority, &name, Vec::new(), usage, options.days, &folder)?;
        write(&folder.join("token"), &token)?;
        write(&folder.join("authority.pem"), &authority.pem())?;
    }
    let folder = folder.display();
    let host = options.hosts.first().map_or("localhost", String::as_str);
    writeln!(
        io::stdout(),
        "brdfarm coordinator serve --listen 0.0.0.0:7117 --credentials {folder}/coordinator\n\
         brdfarm worker connect https://{host}:7117 --credentials {folder}/worker\n\
         brdfarm status --coordinator https://{host}:7117 --credentials {folder}/reader"
    )?;
    Ok(())
}

/// An authority whose key lives as long as this process.
fn authority(days: u64) -> anyhow::Result<CertifiedIssuer<'static, KeyPair>> {
    let mut parameters = valid_for(CertificateParams::new(Vec::new())?, days);
    let name = &mut parameters.distinguished_name;
    name.push(DnType::CommonName, "brdfarm development authority");
    parameters.is_ca = IsCa::Ca(BasicConstraints::Constrained(0));
    parameters.key_usages = vec![KeyUsagePurpose::KeyCertSign, KeyUsagePurpose::CrlSign];
    Ok(CertifiedIssuer::self_signed(
        parameters,
        KeyPair::generate()?,
    )?)
}

fn sign(
    authority: &CertifiedIssuer<'static, KeyPair>,
    name: &str,
    hosts: Vec<String>,
    usage: ExtendedKeyUsagePurpose,
    days: u64,
    folder: &Path,
) -> anyhow::Result<()> {
    let wrong = |_| {
        BadInput(format!(
            "--host {}: these are no names of hosts",
            hosts.join(" ")
        ))
    };
    let parameters = CertificateParams::new(hosts.clone()).map_err(wrong)?;
    let mut parameters = valid_for(parameters, days);
    parameters.distinguished_name.push(DnType::CommonName, name);
    parameters.key_usages = vec![KeyUsagePurpose::DigitalSignature];
    parameters.extended_key_usages = vec![usage];
    parameters.use_authority_key_identifier_extension = true;
    let key = KeyPair::generate()?;
    let certificate = parameters.signed_by(&key, authority)?;
    write(&folder.join("certificate.pem"), &certificate.pem())?;
    write(&folder.join("key.pem"), &key.serialize_pem())
}

fn valid_for(mut parameters: CertificateParams, days: u64) -> CertificateParams {
    let now = SystemTime::now();
    parameters.not_before = (now - CLOCK_SKEW).into();
    parameters.not_after = (now + Duration::from_secs(days * 86_400)).into();
    parameters
}

fn token() -> anyhow::Result<String> {
    let mut bytes = [0; TOKEN_BYTES];
    getrandom::fill(&mut bytes)
        .map_err(|error| anyhow::anyhow!("the system gives no random numbers: {error}"))?;
    Ok(bytes.iter().map(|byte| format!("{byte:02x}")).collect())
}

/// A folder that only its owner can look into.
fn make_folder(path: &Path) -> anyhow::Result<()> {
    let unable = || format!("cannot make {}", path.display());
    DirBuilder::new()
        .mode(0o700)
        .create(path)
        .with_context(unable)
}

/// A new file that only its owner can read.
fn write(path: &Path, text: &str) -> anyhow::Result<()> {
    let mut options = OpenOptions::new();
    let file = options.write(true).create_new(true).mode(0o600).open(path);
    let written = file.and_then(|mut file| file.write_all(text.as_bytes()));
    written.with_context(|| format!("cannot write {}", path.display()))
}

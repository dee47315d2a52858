//! `brdfarm credentials`: certificates and tokens, so that the secure set-up is as short as the
//! insecure one.

use crate::failure::BadInput;
use crate::plural::count;
use anyhow::Context;
use clap::Args;
use jobqueue::identity::{OPERATOR, is_credential_name};
use rcgen::{
    BasicConstraints, CertificateParams, CertifiedIssuer, DnType, ExtendedKeyUsagePurpose, IsCa,
    KeyPair, KeyUsagePurpose,
};
use rustls::pki_types::ServerName;
use std::fs::{self, DirBuilder, OpenOptions};
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
/// Makes an authority whose key is not kept, and writes a folder for each role: coordinator, worker,
/// operator, reader. Serve with --credentials DIR/coordinator. Copy to each machine only the folder of
/// the role that runs there.
#[derive(Debug, Args)]
pub struct Options {
    /// The folder to make
    #[arg(value_name = "DIR")]
    folder: PathBuf,
    /// A name or address of the coordinator, as in its URL; can be repeated. localhost and 127.0.0.1
    /// are always included
    #[arg(long = "host", value_name = "NAME", value_parser = host)]
    hosts: Vec<String>,
    /// How long the certificates are valid
    #[arg(long, default_value_t = 365, value_name = "DAYS",
          value_parser = clap::value_parser!(u64).range(1..=3650))]
    days: u64,
    /// Refuse every client without a certificate of this authority, even with a valid token
    #[arg(long)]
    mutual_tls: bool,
    /// Make a separate credential for a worker, in DIR/workers/NAME; can be repeated, and adds to an
    /// existing folder. The farm holds a credential responsible for everything that is delivered with
    /// it, so give each machine, or each person, its own
    #[arg(long = "worker", value_name = "NAME")]
    workers: Vec<String>,
}

/// A name or an address of a host, as certificates have them: `*.` stands for one label.
fn host(text: &str) -> Result<String, String> {
    let name = text.strip_prefix("*.").unwrap_or(text);
    match ServerName::try_from(name) {
        Ok(_) => Ok(text.to_owned()),
        Err(_) => Err(
            "this is not the name or address of a host, such as farm.lab.org or 10.0.0.7"
                .to_owned(),
        ),
    }
}

/// Makes them.
pub fn execute(options: &Options) -> anyhow::Result<()> {
    let folder = &options.folder;
    check_names(&options.workers)?;
    if folder.exists() {
        if options.workers.is_empty() {
            let what = format!(
                "{} already exists: choose a new folder, or add workers to it with --worker",
                folder.display()
            );
            return Err(BadInput(what).into());
        }
        return add_workers(options);
    }
    make_folder(folder)?;
    let authority = authority(options.days)?;
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
    if options.mutual_tls {
        write(&coordinator.join("client-authority.pem"), &authority.pem())?;
    }
    let mut lines = String::new();
    for role in ROLES {
        let token = make_client(
            options,
            &authority,
            &folder.join(role),
            role,
            &authority.pem(),
        )?;
        let name = if role == "worker" { " worker" } else { "" };
        lines += &format!("{role} {token}{name}\n");
    }
    lines += &make_workers(options, &authority, &authority.pem())?;
    write(&coordinator.join("tokens"), &lines)?;
    tell(options)
}

/// Adds workers to the folder that an earlier call made. The authority's key of that time is gone:
/// where certificates are asked for, another authority's word about clients counts as well.
fn add_workers(options: &Options) -> anyhow::Result<()> {
    let coordinator = options.folder.join("coordinator");
    let tokens = coordinator.join("tokens");
    let unreadable = || BadInput(format!("{} cannot be read", tokens.display()));
    let known = fs::read_to_string(&tokens).with_context(unreadable)?;
    for name in &options.workers {
        let taken = known
            .lines()
            .any(|line| line.split(' ').nth(2) == Some(name));
        if taken || options.folder.join("workers").join(name).exists() {
            return Err(BadInput(format!("--worker {name}: this worker already exists")).into());
        }
    }
    let authority = authority(options.days)?;
    let believed = fs::read_to_string(options.folder.join("worker").join("authority.pem"))?;
    let lines = make_workers(options, &authority, &believed)?;
    let clients = coordinator.join("client-authority.pem");
    if clients.exists() {
        append(&clients, &authority.pem())?;
    }
    append(&tokens, &lines)?;
    writeln!(
        io::stdout(),
        "{} in {}/workers; restart the coordinator so that it knows them",
        count(options.workers.len() as u64, "worker"),
        options.folder.display()
    )?;
    Ok(())
}

/// Makes the folders of named workers; returns their lines of the coordinator's tokens.
fn make_workers(
    options: &Options,
    authority: &CertifiedIssuer<'static, KeyPair>,
    believed: &str,
) -> anyhow::Result<String> {
    let workers = options.folder.join("workers");
    if !options.workers.is_empty() && !workers.exists() {
        make_folder(&workers)?;
    }
    let mut lines = String::new();
    for name in &options.workers {
        let token = make_client(options, authority, &workers.join(name), "worker", believed)?;
        lines += &format!("worker {token} {name}\n");
    }
    Ok(lines)
}

/// Makes what a client shows and believes; returns its token.
fn make_client(
    options: &Options,
    authority: &CertifiedIssuer<'static, KeyPair>,
    folder: &Path,
    role: &str,
    believed: &str,
) -> anyhow::Result<String> {
    make_folder(folder)?;
    let usage = ExtendedKeyUsagePurpose::ClientAuth;
    let name = format!("brdfarm {role}");
    sign(authority, &name, Vec::new(), usage, options.days, folder)?;
    let token = token()?;
    write(&folder.join("token"), &token)?;
    write(&folder.join("authority.pem"), believed)?;
    Ok(token)
}

fn check_names(names: &[String]) -> anyhow::Result<()> {
    for (number, name) in names.iter().enumerate() {
        if !is_credential_name(name) || name == OPERATOR || name == "worker" {
            let what = format!(
                "--worker {name}: a name has 1 to 64 letters, digits, dots, hyphens and underscores, \
                 and is neither \"operator\" nor \"worker\""
            );
            return Err(BadInput(what).into());
        }
        if names[..number].contains(name) {
            return Err(BadInput(format!("--worker {name}: it is given twice")).into());
        }
    }
    Ok(())
}

fn tell(options: &Options) -> anyhow::Result<()> {
    let folder = options.folder.display();
    let host = options.hosts.first().map_or("localhost", String::as_str);
    let worker = match options.workers.first() {
        Some(name) => format!("workers/{name}"),
        None => "worker".to_owned(),
    };
    writeln!(
        io::stdout(),
        "brdfarm coordinator serve --listen 0.0.0.0:7117 --credentials {folder}/coordinator\n\
         brdfarm worker connect https://{host}:7117 --credentials {folder}/{worker}\n\
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
    let parameters = CertificateParams::new(hosts)?;
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

/// Adds to a file of this folder.
fn append(path: &Path, text: &str) -> anyhow::Result<()> {
    let file = OpenOptions::new().append(true).open(path);
    let written = file.and_then(|mut file| file.write_all(text.as_bytes()));
    written.with_context(|| format!("cannot write {}", path.display()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hosts_are_names_or_addresses() {
        for good in ["farm.lab.org", "node-7", "*.lab.org", "10.0.0.7", "::1"] {
            assert_eq!(host(good).as_deref(), Ok(good));
        }
        for bad in ["", "*.", "https://farm", "farm:7117", "a b", "-x", "é.org"] {
            assert!(host(bad).is_err(), "{bad:?}");
        }
    }
}

//! `brdfarm credentials`: certificates and tokens, so that the secure set-up is as short as the
//! insecure one.

mod authority;
mod files;

use crate::failure::BadInput;
use crate::plural::count;
use anyhow::Context;
use authority::Authority;
use clap::Args;
use files::{append, make_folder, read, replace, write};
use jobqueue::identity::{OPERATOR, is_credential_name};
use rustls::pki_types::ServerName;
use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// Random bytes of a token.
const TOKEN_BYTES: usize = 32;

/// Those who get a folder, beside the coordinator; also the names of the roles.
const ROLES: [&str; 3] = ["worker", "operator", "reader"];

/// Make certificates and tokens for a farm
///
/// Writes a folder for each role: coordinator, worker, operator, reader. Serve with --credentials
/// DIR/coordinator. Copy to each machine only the folder of the role that runs there. The folder
/// authority has the key that signs certificates: keep it here, or where nobody else comes. With it the
/// same command adds hosts (--host) and workers (--worker) later, and makes certificates valid again
/// (--renew).
#[derive(Debug, Args)]
pub struct Options {
    /// The folder to make, or to add to
    #[arg(value_name = "DIR")]
    folder: PathBuf,
    /// A name or address of the coordinator, as in its URL; can be repeated, and adds to an existing
    /// folder. localhost and 127.0.0.1 are always included
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
    /// Sign all certificates of an existing folder again, valid for --days from now. Keys and tokens
    /// stay
    #[arg(long)]
    renew: bool,
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

/// Makes them, or adds to those that were made.
pub fn execute(options: &Options) -> anyhow::Result<()> {
    check_names(&options.workers)?;
    if options.folder.exists() {
        change(options)
    } else if options.renew {
        let what = format!(
            "--renew: there are no credentials in {}",
            options.folder.display()
        );
        Err(BadInput(what).into())
    } else {
        make(options)
    }
}

fn make(options: &Options) -> anyhow::Result<()> {
    let folder = &options.folder;
    make_folder(folder)?;
    let authority = Authority::new(options.days)?;
    let kept = folder.join("authority");
    authority.keep(&kept)?;
    write(&kept.join("hosts"), &options.hosts.join("\n"))?;
    let coordinator = folder.join("coordinator");
    make_folder(&coordinator)?;
    authority.sign_coordinator(with_loopback(&options.hosts), &coordinator)?;
    if options.mutual_tls {
        write(&coordinator.join("client-authority.pem"), &authority.pem())?;
    }
    let mut lines = String::new();
    for role in ROLES {
        let token = make_client(&authority, &folder.join(role), role, &authority.pem())?;
        let name = if role == "worker" { " worker" } else { "" };
        lines += &format!("{role} {token}{name}\n");
    }
    lines += &make_workers(options, &authority, &authority.pem())?;
    write(&coordinator.join("tokens"), &lines)?;
    tell(options)
}

/// The names of this machine are always a coordinator's, too.
fn with_loopback(hosts: &[String]) -> Vec<String> {
    let always = ["localhost", "127.0.0.1", "::1"].map(str::to_owned);
    always.into_iter().chain(hosts.iter().cloned()).collect()
}

/// Adds to the folder that an earlier call made.
fn change(options: &Options) -> anyhow::Result<()> {
    let folder = options.folder.display();
    if options.mutual_tls {
        let what = format!("{folder} already exists: --mutual-tls is for a new folder");
        return Err(BadInput(what).into());
    }
    if options.workers.is_empty() && options.hosts.is_empty() && !options.renew {
        let what = format!(
            "{folder} already exists: choose a new folder, or add to it with --worker and --host, or make \
             its certificates valid for longer with --renew"
        );
        return Err(BadInput(what).into());
    }
    let kept = options.folder.join("authority");
    let authority = if kept.join("key.pem").exists() {
        Some(Authority::kept(&kept, options.days)?)
    } else {
        None
    };
    if authority.is_none() && (options.renew || !options.hosts.is_empty()) {
        let what = format!(
            "{folder} has no authority/key.pem, which signs certificates: bring it back, or make a new \
             folder"
        );
        return Err(BadInput(what).into());
    }
    if !options.workers.is_empty() {
        add_workers(options, authority.as_ref())?;
    }
    if let Some(authority) = &authority {
        sign_again(options, authority)?;
    }
    Ok(())
}

/// Signs the coordinator's certificate again where there are more hosts, and every one with --renew.
fn sign_again(options: &Options, authority: &Authority) -> anyhow::Result<()> {
    let folder = &options.folder;
    let known = folder.join("authority").join("hosts");
    let mut hosts: Vec<String> = read(&known)?.lines().map(str::to_owned).collect();
    let before = hosts.len();
    for host in &options.hosts {
        if !hosts.contains(host) {
            hosts.push(host.clone());
        }
    }
    let added = hosts.len() - before;
    if added == 0 && !options.renew {
        if !options.hosts.is_empty() {
            writeln!(io::stdout(), "the certificate has these hosts already")?;
        }
        return Ok(());
    }
    replace(&known, &hosts.join("\n"))?;
    authority.renew_coordinator(with_loopback(&hosts), &folder.join("coordinator"))?;
    if !options.renew {
        writeln!(
            io::stdout(),
            "{} added to the certificate in {}/coordinator; restart the coordinator with it",
            count(added as u64, "host"),
            folder.display()
        )?;
        return Ok(());
    }
    renew_clients(options, authority)
}

/// Signs the certificates of all clients again, and gives each the authority's new certificate.
fn renew_clients(options: &Options, authority: &Authority) -> anyhow::Result<()> {
    let folder = &options.folder;
    let mut clients: Vec<(&str, PathBuf)> = ROLES
        .map(|role| (role, folder.join(role)))
        .into_iter()
        .collect();
    let workers = folder.join("workers");
    if workers.exists() {
        let unreadable = || format!("cannot list {}", workers.display());
        for worker in fs::read_dir(&workers).with_context(unreadable)? {
            clients.push(("worker", worker.with_context(unreadable)?.path()));
        }
    }
    for (role, client) in &clients {
        authority.renew_client(role, client)?;
        replace(&client.join("authority.pem"), &authority.pem())?;
    }
    let believed = folder.join("coordinator").join("client-authority.pem");
    let copies = if believed.exists() {
        // Workers whom an earlier version added had other authorities; now all have this one.
        replace(&believed, &authority.pem())?;
        "; the coordinator asks for certificates, so copy each folder to its machine again"
    } else {
        ""
    };
    writeln!(
        io::stdout(),
        "{} in {} valid for {}; restart the coordinator with its folder{copies}",
        count(clients.len() as u64 + 1, "certificate"),
        folder.display(),
        count(options.days, "day"),
    )?;
    Ok(())
}

/// Adds workers. Where the authority's key is gone, as in folders of earlier versions, another signs,
/// and where certificates are asked for, its word about clients counts as well.
fn add_workers(options: &Options, authority: Option<&Authority>) -> anyhow::Result<()> {
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
    let believed = read(&options.folder.join("worker").join("authority.pem"))?;
    let lines = match authority {
        Some(authority) => make_workers(options, authority, &believed)?,
        None => {
            let another = Authority::new(options.days)?;
            let clients = coordinator.join("client-authority.pem");
            if clients.exists() {
                append(&clients, &another.pem())?;
            }
            make_workers(options, &another, &believed)?
        }
    };
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
    authority: &Authority,
    believed: &str,
) -> anyhow::Result<String> {
    let workers = options.folder.join("workers");
    if !options.workers.is_empty() && !workers.exists() {
        make_folder(&workers)?;
    }
    let mut lines = String::new();
    for name in &options.workers {
        let token = make_client(authority, &workers.join(name), "worker", believed)?;
        lines += &format!("worker {token} {name}\n");
    }
    Ok(lines)
}

/// Makes what a client shows and believes; returns its token.
fn make_client(
    authority: &Authority,
    folder: &Path,
    role: &str,
    believed: &str,
) -> anyhow::Result<String> {
    make_folder(folder)?;
    authority.sign_client(role, folder)?;
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

fn token() -> anyhow::Result<String> {
    let mut bytes = [0; TOKEN_BYTES];
    getrandom::fill(&mut bytes)
        .map_err(|error| anyhow::anyhow!("the system gives no random numbers: {error}"))?;
    Ok(bytes.iter().map(|byte| format!("{byte:02x}")).collect())
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

//! How a command reaches a coordinator.

use crate::failure::BadInput;
use anyhow::Context;
use clap::Args;
use coordinator::security::{Security, Tls};
use datastore::Holder;
use proto::{
    ControlClient, HealthClient,
    client::{self, Credentials, with_deadline},
};
use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use tonic::{Code, Request, Response, Status};

/// The largest token or certificate file, bytes.
const CREDENTIAL_BYTES_MAX: u64 = 64 << 10;

/// The default URL of a coordinator.
const COORDINATOR_DEFAULT: &str = "http://127.0.0.1:7117";

/// The default folder of a store.
const STORE_DEFAULT: &str = "store";

/// How a client checks the coordinator, and what it shows.
#[derive(Clone, Debug, Args)]
pub struct CredentialOptions {
    /// A folder that `brdfarm credentials` made: the token to show, authority.pem to check the
    /// coordinator with, and certificate.pem with key.pem if the coordinator asks for one. Files that
    /// are missing are not used. The token can also be in BRDFARM_TOKEN, but not on the command line,
    /// which other users of the machine can read
    #[arg(long, value_name = "DIR", env = "BRDFARM_CREDENTIALS")]
    credentials: Option<PathBuf>,
}

/// Which coordinator a command speaks to.
#[derive(Clone, Debug, Args)]
pub struct CoordinatorOptions {
    /// The coordinator's URL [default: that of the process that serves the store in the folder
    /// `store`, else http://127.0.0.1:7117]
    #[arg(long = "coordinator", value_name = "URL", env = "BRDFARM_COORDINATOR")]
    url: Option<String>,
    /// Who serves the store that was meant.
    #[arg(skip)]
    holder: Option<Holder>,
    #[command(flatten)]
    credentials: CredentialOptions,
}

impl CredentialOptions {
    /// Reads what the folder and the environment hold.
    pub fn load(&self) -> anyhow::Result<Credentials> {
        let file = |name| match &self.credentials {
            Some(folder) => read_if_there(&folder.join(name)),
            None => Ok(None),
        };
        if let Some(folder) = self.credentials.as_ref().filter(|folder| !folder.is_dir()) {
            return Err(BadInput(format!(
                "--credentials {}: no such folder",
                folder.display()
            ))
            .into());
        }
        let token = match file("token")? {
            Some(token) => Some(text(token, "token")?),
            None => std::env::var("BRDFARM_TOKEN").ok(),
        };
        let identity = match (file("certificate.pem")?, file("key.pem")?) {
            (Some(certificate), Some(key)) => Some((certificate, key)),
            (None, None) => None,
            _ => return Err(BadInput("certificate.pem and key.pem go together".to_owned()).into()),
        };
        Ok(Credentials {
            token: token.map(|token| token.trim().to_owned()),
            authority: file("authority.pem")?,
            identity,
        })
    }
}

impl CoordinatorOptions {
    /// The coordinator's URL.
    pub fn url(&self) -> String {
        match (self.found(), &self.url) {
            (Some(holder), _) => holder.url,
            (None, Some(url)) => url.clone(),
            (None, None) => COORDINATOR_DEFAULT.to_owned(),
        }
    }

    /// The process that the lock file of the default store names, if no coordinator was given.
    fn found(&self) -> Option<Holder> {
        let by_default = || match self.url {
            Some(_) => None,
            None => Holder::of(Path::new(STORE_DEFAULT)),
        };
        self.holder.clone().or_else(by_default)
    }

    /// The same options for whoever serves a store.
    pub fn of(&self, holder: Holder) -> Self {
        Self {
            holder: Some(holder),
            ..self.clone()
        }
    }

    /// The credentials for this coordinator. Anyone who holds a store's lock can write any address
    /// into it, so an address without TLS that was found there is shown no token.
    pub fn credentials(&self) -> anyhow::Result<Credentials> {
        let mut credentials = self.credentials.load()?;
        if self
            .found()
            .is_some_and(|holder| !holder.url.starts_with("https://"))
        {
            credentials.token = None;
        }
        Ok(credentials)
    }

    /// Makes one call and waits for its answer.
    pub fn call<M, R, F>(
        &self,
        message: M,
        method: impl FnOnce(ControlClient, Request<M>) -> F,
    ) -> anyhow::Result<R>
    where
        F: Future<Output = Result<Response<R>, Status>>,
    {
        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_all()
            .build()?;
        runtime.block_on(async {
            let client = self.connect()?;
            let answer = method(client, with_deadline(message)).await;
            answer
                .map(Response::into_inner)
                .map_err(|status| self.error(&status))
        })
    }

    /// A client; has to be called inside a runtime.
    pub fn connect(&self) -> anyhow::Result<ControlClient> {
        let credentials = self.credentials()?;
        Ok(client::control(&self.url(), &credentials).map_err(BadInput)?)
    }

    /// A client of the health service; has to be called inside a runtime.
    pub fn connect_health(&self) -> anyhow::Result<HealthClient> {
        let credentials = self.credentials()?;
        Ok(client::health(&self.url(), &credentials).map_err(BadInput)?)
    }

    /// What a status means for whoever called.
    pub fn error(&self, status: &Status) -> anyhow::Error {
        let message = status.message();
        match status.code() {
            Code::InvalidArgument => BadInput(message.to_owned()).into(),
            Code::Unavailable | Code::DeadlineExceeded | Code::Unknown => {
                anyhow::anyhow!("the coordinator {} does not answer: {message}", self.url())
            }
            _ => anyhow::anyhow!("{message}"),
        }
    }
}

/// A credential as text.
pub fn text(bytes: Vec<u8>, name: &str) -> anyhow::Result<String> {
    Ok(String::from_utf8(bytes).map_err(|_| BadInput(format!("{name} is no plain text")))?)
}

/// Reads a file of credentials; `None` where there is none.
pub fn read_if_there(path: &Path) -> anyhow::Result<Option<Vec<u8>>> {
    let unreadable = || format!("cannot read {}", path.display());
    let bytes = match fs::metadata(path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
        metadata => metadata.with_context(unreadable)?.len(),
    };
    if bytes > CREDENTIAL_BYTES_MAX {
        let path = path.display();
        let what = format!("{path}: {bytes} bytes are no token and no certificate");
        return Err(BadInput(what).into());
    }
    Ok(Some(fs::read(path).with_context(unreadable)?))
}

/// Reads the credentials of a coordinator, or of pages in a browser.
pub fn security(folder: &Path) -> anyhow::Result<Security> {
    let file = |name: &str| {
        let path = folder.join(name);
        let absent = || BadInput(format!("--credentials: there is no {}", path.display()));
        Ok::<_, anyhow::Error>(read_if_there(&path)?.ok_or_else(absent)?)
    };
    let tokens = text(file("tokens")?, "tokens")?.parse();
    let tokens = tokens.map_err(|error| {
        BadInput(format!(
            "--credentials: {}: {error}",
            folder.join("tokens").display()
        ))
    })?;
    Ok(Security {
        tls: Some(Tls {
            certificate: file("certificate.pem")?,
            key: file("key.pem")?,
            client_authority: read_if_there(&folder.join("client-authority.pem"))?,
        }),
        tokens: Some(tokens),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_token_is_shown_to_whoever_only_says_where_it_listens() {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("token"), "secret").unwrap();
        let options = CoordinatorOptions {
            url: Some("http://127.0.0.1:7117".to_owned()),
            holder: None,
            credentials: CredentialOptions {
                credentials: Some(folder.path().to_owned()),
            },
        };
        let token = |options: &CoordinatorOptions| options.credentials().unwrap().token;
        assert_eq!(token(&options).as_deref(), Some("secret"));
        let holder = |url: &str| options.of(Holder::here(url.to_owned()));
        assert_eq!(holder("http://127.0.0.1:1").url(), "http://127.0.0.1:1");
        assert_eq!(token(&holder("http://127.0.0.1:1")), None);
        let closed = holder("https://127.0.0.1:1");
        assert_eq!(token(&closed).as_deref(), Some("secret"));
    }
}

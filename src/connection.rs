//! How a command reaches a coordinator.

use crate::failure::BadInput;
use anyhow::Context;
use clap::Args;
use proto::{
    ControlClient,
    client::{self, Credentials, with_deadline},
};
use std::fs;
use std::path::{Path, PathBuf};
use tonic::{Code, Request, Response, Status};

/// The largest token or certificate file, bytes.
const CREDENTIAL_BYTES_MAX: u64 = 64 << 10;

/// Whom a client believes and what it shows.
#[derive(Clone, Debug, Args)]
pub struct CredentialOptions {
    /// The token of the role, in a file; it can also stand in BRDFARM_TOKEN, and never on the
    /// command line, which other users of the machine can read
    #[arg(
        long,
        value_name = "FILE",
        env = "BRDFARM_TOKEN_FILE",
        hide_env_values = true
    )]
    token_file: Option<PathBuf>,
    /// The certificate of the authority that vouches for the coordinator, for https
    #[arg(long, value_name = "FILE", env = "BRDFARM_AUTHORITY")]
    authority: Option<PathBuf>,
    /// This side's certificate, where the coordinator asks for one
    #[arg(
        long,
        value_name = "FILE",
        requires = "key",
        env = "BRDFARM_CERTIFICATE"
    )]
    certificate: Option<PathBuf>,
    /// The key of the certificate
    #[arg(
        long,
        value_name = "FILE",
        requires = "certificate",
        env = "BRDFARM_KEY"
    )]
    key: Option<PathBuf>,
}

/// Which coordinator a command speaks to.
#[derive(Clone, Debug, Args)]
pub struct CoordinatorOptions {
    /// The coordinator
    #[arg(
        long = "coordinator",
        value_name = "URL",
        default_value = "http://127.0.0.1:7117",
        env = "BRDFARM_COORDINATOR"
    )]
    url: String,
    #[command(flatten)]
    credentials: CredentialOptions,
}

impl CredentialOptions {
    /// Reads what the files and the environment hold.
    pub fn load(&self) -> anyhow::Result<Credentials> {
        let token = match &self.token_file {
            Some(path) => Some(
                String::from_utf8(read(path)?)
                    .map_err(|_| BadInput(format!("{}: a token is plain text", path.display())))?,
            ),
            None => std::env::var("BRDFARM_TOKEN").ok(),
        };
        let identity = match (&self.certificate, &self.key) {
            (Some(certificate), Some(key)) => Some((read(certificate)?, read(key)?)),
            _ => None,
        };
        Ok(Credentials {
            token: token.map(|token| token.trim().to_owned()),
            authority: self.authority.as_deref().map(read).transpose()?,
            identity,
        })
    }
}

impl CoordinatorOptions {
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
        let credentials = self.credentials.load()?;
        Ok(client::control(&self.url, &credentials).map_err(BadInput)?)
    }

    /// What a status means for whoever called.
    pub fn error(&self, status: &Status) -> anyhow::Error {
        let message = status.message();
        match status.code() {
            Code::InvalidArgument => BadInput(message.to_owned()).into(),
            Code::Unavailable | Code::DeadlineExceeded | Code::Unknown => {
                anyhow::anyhow!("the coordinator {} does not answer: {message}", self.url)
            }
            _ => anyhow::anyhow!("{message}"),
        }
    }
}

fn read(path: &Path) -> anyhow::Result<Vec<u8>> {
    let unreadable = || format!("cannot read {}", path.display());
    let bytes = fs::metadata(path).with_context(unreadable)?.len();
    if bytes > CREDENTIAL_BYTES_MAX {
        let path = path.display();
        return Err(BadInput(format!(
            "{path}: {bytes} bytes are no token and no certificate"
        ))
        .into());
    }
    fs::read(path).with_context(unreadable)
}

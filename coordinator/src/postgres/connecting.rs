//! Connections to a database.

use super::fault::{Fault, told};
use crate::limits;
use deadpool_postgres::{
    Hook, HookError, Manager, ManagerConfig, Object, Pool, PoolError, RecyclingMethod, Runtime,
    Transaction,
};
use std::{env, fs, path::PathBuf};
use thiserror::Error;
use tokio_postgres::{
    Config, NoTls, Row,
    config::{Host, SslMode},
    error::SqlState,
    types::ToSql,
};

/// What every connection is told first. A transaction whose coordinator froze or went away ends
/// and lets go of its locks.
const SETTINGS: &str = "\
    SET synchronous_commit = on; \
    SET jit = off; \
    SET statement_timeout = '300s'; \
    SET idle_in_transaction_session_timeout = '15s'; \
    SET tcp_keepalives_idle = 10; \
    SET tcp_keepalives_interval = 5; \
    SET tcp_keepalives_count = 3; \
    SET application_name = 'brdfarm'";

/// Why a database cannot be used.
#[derive(Debug, Error)]
pub enum DatabaseError {
    /// Its name makes no sense.
    #[error("{0:?} names no database: postgres://USER@HOST:PORT/DATABASE is wanted")]
    Name(String),
    /// It asks for TLS.
    #[error(
        "{0} asks for TLS by sslmode=require, which this program does not speak to a database: \
         reach it over a Unix socket, a private network or a tunnel"
    )]
    Tls(String),
    /// The server has no such database.
    #[error("there is no database {0}: make it with `createdb`, or name another")]
    Missing(String),
    /// Nobody answers, or we are not let in.
    #[error(
        "the database {name} cannot be reached: {reason}; see that it runs, and that host, port, \
         user and password are right"
    )]
    Unreachable {
        /// Its name, without a password.
        name: String,
        /// What it or the system said.
        reason: String,
    },
    /// Its schema is of an older program.
    #[error(
        "the database {0} has the tables of an older brdfarm: start a coordinator on it, which \
         brings them up to date"
    )]
    Older(String),
    /// A store is being copied from it, or into it.
    #[error("`brdfarm store migrate` is at work on {0}: wait until it ends")]
    Moving(String),
    /// It does not do what it is asked.
    #[error("the database {name} cannot be used: {reason}")]
    Away {
        /// Its name, without a password.
        name: String,
        /// What it or the system said.
        reason: String,
    },
}

/// A pool of connections to one database.
#[derive(Clone)]
pub(crate) struct Database {
    pool: Pool,
    name: String,
}

impl Database {
    /// Whether a store's name is a database's.
    pub fn is_named_by(store: &str) -> bool {
        ["postgres://", "postgresql://"]
            .iter()
            .any(|scheme| store.starts_with(scheme))
    }

    /// A pool of connections that are made when they are needed. A password comes from the URL, or
    /// from PGPASSWORD, or from the file that PGPASSFILE names, or from ~/.pgpass.
    pub fn new(url: &str) -> Result<Self, DatabaseError> {
        // The error could repeat the password.
        let unnamed = |_| DatabaseError::Name(without_password(url));
        let mut config: Config = url.parse().map_err(unnamed)?;
        let name = without_password(url);
        if config.get_ssl_mode() == SslMode::Require {
            return Err(DatabaseError::Tls(name));
        }
        config.connect_timeout(limits::DATABASE_CONNECT_WAIT);
        config.tcp_user_timeout(limits::DATABASE_SILENCE_MAX);
        if config.get_password().is_none()
            && let Some(password) = password(&config)
        {
            config.password(password);
        }
        let manager = ManagerConfig {
            recycling_method: RecyclingMethod::Fast,
        };
        let settled = Hook::async_fn(|client, _| {
            Box::pin(async move {
                let settled = client.batch_execute(SETTINGS).await;
                settled.map_err(HookError::Backend)
            })
        });
        let pool = Pool::builder(Manager::from_config(config, NoTls, manager))
            .max_size(limits::DATABASE_CONNECTIONS_MAX)
            .runtime(Runtime::Tokio1)
            .wait_timeout(Some(limits::DATABASE_CONNECT_WAIT))
            .create_timeout(Some(limits::DATABASE_CONNECT_WAIT))
            .post_create(settled)
            .build()
            .map_err(|error| DatabaseError::Away {
                name: name.clone(),
                reason: error.to_string(),
            })?;
        Ok(Self { pool, name })
    }

    /// The URL, without a password.
    pub fn name(&self) -> &str {
        &self.name
    }

    pub async fn connection(&self) -> Result<Object, PoolError> {
        self.pool.get().await
    }

    /// Ends the connections that nobody uses, and makes no more.
    pub fn close(&self) {
        self.pool.close();
    }

    /// The error of a database that should be there now.
    pub(super) fn away(&self, fault: Fault) -> DatabaseError {
        let name = self.name.clone();
        let reason = match fault {
            Fault::Older => return DatabaseError::Older(name),
            Fault::Moving => return DatabaseError::Moving(name),
            Fault::Pool(PoolError::Backend(error))
                if error.code() == Some(&SqlState::INVALID_CATALOG_NAME) =>
            {
                return DatabaseError::Missing(name);
            }
            Fault::Pool(error) => {
                let reason = match error {
                    PoolError::Backend(error) => told(&error),
                    error => error.to_string(),
                };
                return DatabaseError::Unreachable { name, reason };
            }
            Fault::Database(error) => told(&error),
            Fault::Damaged(reason) => reason,
            fault => format!("{fault:?}"),
        };
        DatabaseError::Away { name, reason }
    }
}

/// Rows of a statement, which is prepared once a connection.
pub(super) async fn query(
    transaction: &Transaction<'_>,
    statement: &str,
    parameters: &[&(dyn ToSql + Sync)],
) -> Result<Vec<Row>, Fault> {
    let statement = transaction.prepare_cached(statement).await?;
    Ok(transaction.query(&statement, parameters).await?)
}

/// Runs a statement that gives no rows; says how many it changed.
pub(super) async fn execute(
    transaction: &Transaction<'_>,
    statement: &str,
    parameters: &[&(dyn ToSql + Sync)],
) -> Result<u64, Fault> {
    let statement = transaction.prepare_cached(statement).await?;
    Ok(transaction.execute(&statement, parameters).await?)
}

/// A database's URL as it may be shown.
pub(crate) fn without_password(url: &str) -> String {
    let Some((scheme, rest)) = url.split_once("://") else {
        return url.to_owned();
    };
    let (authority, place) = match rest.split_once('/') {
        Some((authority, place)) => (authority, format!("/{place}")),
        None => (rest, String::new()),
    };
    let place = place.split('?').next().unwrap_or_default();
    let authority = match authority.rsplit_once('@') {
        Some((user, host)) => {
            let user = user.split(':').next().unwrap_or_default();
            format!("{user}@{host}")
        }
        None => authority.to_owned(),
    };
    format!("{scheme}://{authority}{place}")
}

fn password(config: &Config) -> Option<String> {
    if let Ok(password) = env::var("PGPASSWORD") {
        return Some(password);
    }
    let file = env::var_os("PGPASSFILE").map(PathBuf::from);
    let file = file.or_else(|| Some(PathBuf::from(env::var_os("HOME")?).join(".pgpass")))?;
    let host = match config.get_hosts().first()? {
        Host::Tcp(host) => host.clone(),
        Host::Unix(_) => "localhost".to_owned(),
    };
    let port = config.get_ports().first().copied().unwrap_or(5432);
    let user = config.get_user()?;
    let database = config.get_dbname().unwrap_or(user);
    let wanted = [&host, &port.to_string(), database, user];
    password_of(&fs::read_to_string(file).ok()?, wanted)
}

/// The password of the first line that fits: host, port, database, user and password, parted by
/// colons; a star fits all, a backslash takes a colon's or a backslash's meaning.
fn password_of(lines: &str, wanted: [&str; 4]) -> Option<String> {
    lines.lines().find_map(|line| {
        let mut fields = vec![String::new()];
        let mut characters = line.chars();
        while let Some(character) = characters.next() {
            match character {
                ':' => fields.push(String::new()),
                '\\' => fields.last_mut()?.push(characters.next()?),
                other => fields.last_mut()?.push(other),
            }
        }
        let [known @ .., password] = &fields[..] else {
            return None;
        };
        let fits = known.len() == wanted.len()
            && known
                .iter()
                .zip(wanted)
                .all(|(known, wanted)| known == "*" || known == wanted);
        fits.then(|| password.clone())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_password_is_found_and_never_told() {
        let lines = "# comment\nother:*:*:me:no\nhost:5432:farm:me:a\\:b\\\\c\n*:*:*:*:last\n";
        let of = |host, user| password_of(lines, [host, "5432", "farm", user]);
        assert_eq!(of("host", "me").as_deref(), Some("a:b\\c"));
        assert_eq!(of("else", "you").as_deref(), Some("last"));
        let url = "postgres://me:secret@host:5432/farm?password=secret";
        assert_eq!(without_password(url), "postgres://me@host:5432/farm");
        let database = Database::new(url).unwrap();
        assert_eq!(database.name(), "postgres://me@host:5432/farm");
        let error = Database::new("postgres://me:secret@host:port/")
            .err()
            .unwrap();
        assert!(!error.to_string().contains("secret"), "{error}");
    }
}

//! Connections to a database.

use super::{
    DatabaseError, encryption,
    fault::{Fault, told},
};

use deadpool_postgres::{
    Hook, HookError, Manager, ManagerConfig, Object, Pool, PoolError, QueueMode, RecyclingMethod,
    Runtime, Transaction,
};
use std::{env, error::Error as _, fs, io, path::PathBuf};
use tokio_postgres::{
    Config, Row,
    config::{Host, SslMode},
    error::SqlState,
    types::ToSql,
};

/// What every connection is told first. A transaction whose coordinator froze or went away ends
/// and lets go of its locks.
fn settings() -> String {
    format!(
        "SET synchronous_commit = on; \
         SET jit = off; \
         SET plan_cache_mode = force_generic_plan; \
         SET enable_bitmapscan = off; \
         SET statement_timeout = {statement}; \
         SET idle_in_transaction_session_timeout = {idle}; \
         SET tcp_keepalives_idle = {keepalive}; \
         SET tcp_keepalives_interval = {interval}; \
         SET tcp_keepalives_count = {count}; \
         SET application_name = 'brdfarm'",
        statement = limits::DATABASE_STATEMENT_MAX.as_millis(),
        idle = limits::DATABASE_TRANSACTION_IDLE_MAX.as_millis(),
        keepalive = limits::DATABASE_KEEPALIVE_IDLE.as_secs(),
        interval = limits::DATABASE_KEEPALIVE_INTERVAL.as_secs(),
        count = limits::DATABASE_KEEPALIVE_COUNT,
    )
}

/// A pool of connections to one database.
#[derive(Clone)]
pub struct Database {
    pool: Pool,
    name: String,
}

impl Database {
    /// A pool of connections that are made when they are needed. A password comes from the URL, or
    /// from PGPASSWORD, or from the file that PGPASSFILE names, or from ~/.pgpass.
    pub fn new(url: &str) -> Result<Self, DatabaseError> {
        let (rest, parameters) = encryption::take(url);
        let mut config = parse(&rest)?;
        let name = name_of(&config);
        let variable = |name: &str| env::var_os(name);
        let encryption =
            parameters
                .encryption(variable)
                .map_err(|reason| DatabaseError::Encryption {
                    name: name.clone(),
                    reason,
                })?;
        let is_local = |host: &Host| matches!(host, Host::Unix(_));
        config.ssl_mode(if config.get_hosts().iter().all(is_local) {
            SslMode::Disable
        } else {
            encryption.mode
        });
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
                let settled = client.batch_execute(&settings()).await;
                settled.map_err(HookError::Backend)
            })
        });
        let pool = Pool::builder(Manager::from_config(config, encryption.connector, manager))
            .max_size(limits::DATABASE_CONNECTIONS_MAX)
            // The one that was used last: its server process has everything at hand.
            .queue_mode(QueueMode::Lifo)
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

    pub(crate) async fn connection(&self) -> Result<Object, PoolError> {
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
            Fault::Pool(PoolError::Backend(error)) if is_about_tls(&error) => told(&error),
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

/// Whether somebody answered, but TLS did not come about: neither the server's own word nor one of
/// the system.
fn is_about_tls(error: &tokio_postgres::Error) -> bool {
    let of_system = |cause: &io::Error| {
        let inner = cause.get_ref();
        inner.is_none_or(|inner| !inner.is::<rustls::Error>())
    };
    error.code().is_none()
        && error.source().is_some_and(|cause| {
            let cause = cause.downcast_ref::<io::Error>();
            !cause.is_some_and(of_system)
        })
}

/// Prepares statements that this connection has not prepared yet. Statements that were prepared
/// before reach the server in the order in which their futures are first polled, so that several
/// under way cost one round trip.
pub(super) async fn prepare(
    transaction: &Transaction<'_>,
    statements: &[&str],
) -> Result<(), Fault> {
    for statement in statements {
        transaction.prepare_cached(statement).await?;
    }
    Ok(())
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
pub fn without_secrets(url: &str) -> String {
    let (rest, _) = encryption::take(url);
    parse(&rest).map_or_else(|_| "postgres://...".to_owned(), |config| name_of(&config))
}

fn parse(url: &str) -> Result<Config, DatabaseError> {
    let parsed: Result<Config, _> = url.parse();
    // A password with an @ in it was taken apart at the wrong place: no part of it is repeated.
    let is_clear = url.matches('@').count() <= 1;
    let unnamed = |reason: String| DatabaseError::Name(reason);
    let config = parsed.map_err(|error| match error.source() {
        Some(cause) if is_clear => unnamed(cause.to_string()),
        _ => unnamed("this one is not".to_owned()),
    })?;
    let is_strange = |host: &Host| matches!(host, Host::Tcp(host) if host.contains(['@', '/']));
    let is_at = |database: &str| database.contains('@');
    if config.get_hosts().iter().any(is_strange) || config.get_dbname().is_some_and(is_at) {
        return Err(unnamed("this one has an @ where none can be".to_owned()));
    }
    Ok(config)
}

/// What people are told a database is called: its URL, less what may be a secret.
fn name_of(config: &Config) -> String {
    let user = config.get_user().map(|user| format!("{user}@"));
    let ports = config.get_ports();
    let hosts = config.get_hosts().iter().enumerate().map(|(at, host)| {
        let port = ports.get(at).or(ports.first());
        let port = port.map_or_else(String::new, |port| format!(":{port}"));
        match host {
            Host::Tcp(host) if host.contains(':') => format!("[{host}]{port}"),
            Host::Tcp(host) => format!("{host}{port}"),
            Host::Unix(folder) => folder.display().to_string(),
        }
    });
    format!(
        "postgres://{}{}/{}",
        user.unwrap_or_default(),
        hosts.collect::<Vec<_>>().join(","),
        config.get_dbname().unwrap_or_default()
    )
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
        let named = |url: &str| Database::new(url).map(|database| database.name().to_owned());
        let url = "postgres://me:secret@host:5432/farm?password=secret&sslmode=require";
        assert_eq!(named(url).unwrap(), "postgres://me@host:5432/farm");
        for (url, name) in [
            (
                "postgres://me:se/cret@[::1]/farm",
                "postgres://me@[::1]:5432/farm",
            ),
            (
                "postgres://me:se?cret@a:1,b:2/farm",
                "postgres://me@a:1,b:2/farm",
            ),
            (
                "postgres://me@/farm?host=/run/pg",
                "postgres://me@/run/pg/farm",
            ),
        ] {
            assert_eq!(named(url).unwrap(), name);
        }
        for url in [
            "postgres://me:secret@host:port/",
            "postgres://me:se@cret@host/farm",
            "postgres://me:se@cret/et@host/farm",
            "postgres://me:se@x?cret=@host/farm",
        ] {
            let error = named(url).unwrap_err().to_string();
            assert!(!error.contains("cret"), "{error}");
        }
        let error = named("postgres://me:secret@host/farm?sslmode=strict").unwrap_err();
        let said = "postgres://me@host:5432/farm: sslmode=strict is none of disable, ";
        assert!(error.to_string().starts_with(said), "{error}");
        let error = named("postgres://host/farm?colour=red").unwrap_err();
        assert!(error.to_string().ends_with("unknown option `colour`"));
    }
}

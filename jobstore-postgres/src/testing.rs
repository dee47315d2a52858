//! A private PostgreSQL server, of Debian's packages, that ends with whoever started it.

use std::{
    env, fs,
    io::Write,
    net::TcpListener,
    os::unix::{
        fs::{PermissionsExt, chown},
        process::CommandExt,
    },
    path::{Path, PathBuf},
    process::{Child, ChildStdin, Command, Stdio},
    sync::{
        OnceLock,
        atomic::{AtomicU32, Ordering},
    },
    thread,
    time::{Duration, Instant},
};

/// Starts the server, and once its input ends stops it and removes what it wrote: a test that
/// panics or is killed leaves nothing behind.
const KEEPER: &str = r#"
    trap '' INT TERM
    set -- "$1" "$2" $3
    bin=$1; folder=$2; shift 2
    "$bin/postgres" -D "$folder/data" -k "$folder" -c listen_addresses= "$@" 2>"$folder/log" &
    server=$!
    while read -r order; do
        if [ "$order" = restart ]; then
            wait $server
            "$bin/postgres" -D "$folder/data" -k "$folder" -c listen_addresses= "$@" 2>>"$folder/log" &
            server=$!
        fi
    done
    kill -QUIT $server 2>/dev/null
    wait $server
    rm -rf "$folder"
"#;

/// A server in a folder of its own, reached through a socket there.
pub struct Server {
    folder: PathBuf,
    port: u16,
    keeper: Child,
    orders: Option<ChildStdin>,
}

fn programs() -> PathBuf {
    let versions = fs::read_dir("/usr/lib/postgresql");
    let versions = versions.expect("PostgreSQL is not installed: deploy/install-postgres.sh");
    let mut found: Vec<PathBuf> = versions
        .filter_map(|version| Some(version.ok()?.path().join("bin")))
        .filter(|bin| bin.join("initdb").is_file())
        .collect();
    found.sort();
    found
        .pop()
        .expect("PostgreSQL is not installed: deploy/install-postgres.sh")
}

/// The server refuses to run as root: then it runs as the user that its package made.
fn unprivileged() -> Option<(u32, u32)> {
    if !rustix::process::getuid().is_root() {
        return None;
    }
    let users = fs::read_to_string("/etc/passwd").unwrap();
    let user = users
        .lines()
        .find(|line| line.starts_with("postgres:"))
        .unwrap();
    let mut numbers = user
        .split(':')
        .skip(2)
        .map(|number| number.parse().unwrap());
    Some((numbers.next().unwrap(), numbers.next().unwrap()))
}

fn command(program: &Path, user: Option<(u32, u32)>) -> Command {
    let mut command = Command::new(program);
    command.current_dir("/");
    if let Some((user, group)) = user {
        command.uid(user).gid(group);
    }
    command
}

/// To processes of which some may have ended by themselves.
fn signal(name: &str, pids: &[&str]) {
    let sent = Command::new("kill")
        .args(["-s", name])
        .args(pids)
        .stderr(Stdio::null())
        .status();
    sent.unwrap();
}

/// Whether a process is there, and more than a number that nobody has asked for yet.
fn is_alive(pid: &str) -> bool {
    let Ok(stat) = fs::read_to_string(format!("/proc/{pid}/stat")) else {
        return false;
    };
    let state = stat.rsplit(") ").next().unwrap_or_default();
    !state.starts_with(['Z', 'X'])
}

impl Server {
    /// Starts a server; `settings` as on its command line.
    pub fn start(settings: &str) -> Self {
        Self::start_on(5432, settings, &[])
    }

    /// The same, reached at 127.0.0.1 as well, with a certificate and its key, PEM, for TLS. It
    /// speaks that once its setting `ssl` is on.
    pub fn start_with_certificate(certificate: &str, key: &str) -> Self {
        let free = TcpListener::bind("127.0.0.1:0").unwrap();
        let port = free.local_addr().unwrap().port();
        drop(free);
        let settings = format!("-c listen_addresses=127.0.0.1 -c port={port}");
        let files = [("server.crt", certificate), ("server.key", key)];
        Self::start_on(port, &settings, &files)
    }

    /// `files` go beside its data.
    fn start_on(port: u16, settings: &str, files: &[(&str, &str)]) -> Self {
        let bin = programs();
        let folder = tempfile::Builder::new()
            .prefix("brdfarm-postgres")
            .tempdir();
        let folder = folder.unwrap().keep();
        let user = unprivileged();
        if let Some((user, group)) = user {
            chown(&folder, Some(user), Some(group)).unwrap();
        }
        let made = command(&bin.join("initdb"), user)
            .args([
                "-A",
                "trust",
                "-U",
                "brdfarm",
                "-E",
                "UTF8",
                "--locale=C",
                "--no-sync",
                "-D",
            ])
            .arg(folder.join("data"))
            .output()
            .unwrap();
        assert!(
            made.status.success(),
            "{}",
            String::from_utf8_lossy(&made.stderr)
        );
        for (name, text) in files {
            let path = folder.join("data").join(name);
            fs::write(&path, text).unwrap();
            fs::set_permissions(&path, fs::Permissions::from_mode(0o600)).unwrap();
            if let Some((user, group)) = user {
                chown(&path, Some(user), Some(group)).unwrap();
            }
        }
        let mut keeper = command(Path::new("/bin/sh"), user)
            .args(["-c", KEEPER, "keeper"])
            .arg(&bin)
            .arg(&folder)
            .arg(settings)
            .process_group(0)
            .stdin(Stdio::piped())
            .spawn()
            .unwrap();
        let orders = keeper.stdin.take();
        let server = Self {
            folder,
            port,
            keeper,
            orders,
        };
        server.wait();
        server
    }

    /// Waits until it takes connections.
    pub fn wait(&self) {
        let began = Instant::now();
        while !self.is_ready() {
            assert!(
                began.elapsed() < Duration::from_secs(60),
                "PostgreSQL does not start"
            );
            thread::sleep(Duration::from_millis(50));
        }
    }

    /// Whether it takes connections.
    pub fn is_ready(&self) -> bool {
        let asked = Command::new(programs().join("pg_isready"))
            .args(["-q", "-p", &self.port.to_string(), "-h"])
            .arg(&self.folder)
            .status();
        asked.unwrap().success()
    }

    /// Its URL.
    pub fn url(&self) -> String {
        format!(
            "postgres://brdfarm@/postgres?host={}&port={}",
            self.folder.display(),
            self.port
        )
    }

    /// Its URL at a name of this machine.
    pub fn url_at(&self, host: &str) -> String {
        format!("postgres://brdfarm@{host}:{}/postgres", self.port)
    }

    /// Kills all its processes, as the loss of its machine does.
    pub fn kill(&self) {
        let file = fs::read_to_string(self.folder.join("data/postmaster.pid")).unwrap();
        let pid = file.lines().next().unwrap();
        // Stopped it starts no more of them; one that was left would keep the next server out.
        signal("STOP", &[pid]);
        let children = fs::read_to_string(format!("/proc/{pid}/task/{pid}/children")).unwrap();
        let mut all: Vec<&str> = children.split_whitespace().collect();
        all.push(pid);
        signal("KILL", &all);
        while all.iter().any(|pid| is_alive(pid)) {
            thread::sleep(Duration::from_millis(2));
        }
    }

    /// Starts it again after it was killed.
    pub fn restart(&mut self) {
        writeln!(self.orders.as_mut().unwrap(), "restart").unwrap();
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.orders = None;
        self.keeper.wait().unwrap();
    }
}

/// The URL of a schema that nobody else uses, in the database that BRDFARM_TEST_POSTGRES names, or
/// of a server that all tests of this process share. Nothing in it outlives the tests, so it syncs
/// nothing.
pub async fn fresh_schema() -> String {
    static SERVER: OnceLock<Server> = OnceLock::new();
    static SCHEMAS: AtomicU32 = AtomicU32::new(0);
    let url = env::var("BRDFARM_TEST_POSTGRES").unwrap_or_else(|_| {
        let settings = "-c fsync=off -c full_page_writes=off -c max_connections=200";
        SERVER.get_or_init(|| Server::start(settings)).url()
    });
    schema_in(&url, SCHEMAS.fetch_add(1, Ordering::Relaxed)).await
}

/// The URL of a new schema in a database.
pub async fn schema_in(url: &str, number: u32) -> String {
    let name = format!("brdfarm_{}_{number}", std::process::id());
    run(
        url,
        &format!("DROP SCHEMA IF EXISTS {name} CASCADE; CREATE SCHEMA {name}"),
    )
    .await;
    let separator = if url.contains('?') { '&' } else { '?' };
    format!("{url}{separator}options=-csearch_path%3D{name}")
}

/// Runs statements.
pub async fn run(url: &str, statements: &str) {
    let client = client(url).await;
    client.batch_execute(statements).await.unwrap();
}

/// A connection.
pub async fn client(url: &str) -> tokio_postgres::Client {
    let connected = tokio_postgres::connect(url, tokio_postgres::NoTls).await;
    let (client, connection) = connected.unwrap();
    tokio::spawn(connection);
    client
}

//! A farm of real processes that can be hurt.

pub use crate::draws::{Draws, seed};
pub use crate::process::Process;
use serde_json::Value;
use std::collections::BTreeSet;
use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

/// How long anything may take at the very most, unless BRDFARM_PATIENCE_SECONDS says otherwise.
const PATIENCE: Duration = Duration::from_secs(900);

pub struct Harness {
    directory: tempfile::TempDir,
    /// The coordinator's address; the same after each restart.
    pub address: String,
    pub coordinator: Option<Process>,
    /// What coordinators and commands find in their environment, and workers do not.
    pub environment: Vec<(&'static str, String)>,
    pub lease_seconds: u32,
    pub check_percent: u32,
    /// Further options of the coordinator.
    pub options: String,
}

pub fn patience() -> Duration {
    let given = std::env::var("BRDFARM_PATIENCE_SECONDS").ok();
    let given = given.map(|seconds| {
        seconds
            .parse()
            .expect("BRDFARM_PATIENCE_SECONDS is a number")
    });
    given.map_or(PATIENCE, Duration::from_secs)
}

pub fn wait_for(what: &str, mut done: impl FnMut() -> bool) {
    let deadline = Instant::now() + patience();
    while !done() {
        assert!(Instant::now() < deadline, "waited in vain for {what}");
        std::thread::sleep(Duration::from_millis(10));
    }
}

impl Harness {
    /// A farm that is going to render `materials` small materials, `samples` paths a pixel.
    pub fn new(materials: u32, samples: u32) -> Self {
        let directory = tempfile::tempdir().expect("a directory");
        let specification = format!(
            "name = \"hurt\"\nmaterials = {materials}\n[image]\nwidth = 16\nheight = 16\n\
             [integrator]\nkind = \"path\"\nsamples_per_pixel = {samples}\n"
        );
        fs::write(directory.path().join("spec.toml"), specification).expect("written");
        Self {
            directory,
            address: "127.0.0.1:0".to_owned(),
            coordinator: None,
            environment: Vec::new(),
            lease_seconds: 2,
            check_percent: 0,
            options: String::new(),
        }
    }

    pub fn path(&self) -> &Path {
        self.directory.path()
    }

    pub fn store(&self) -> PathBuf {
        self.path().join("farm")
    }

    pub fn command(&self, program: &str, arguments: &str) -> Command {
        let mut command = Command::new(program);
        command.current_dir(self.path());
        command.args(arguments.split_whitespace());
        command
    }

    pub fn run(&self, arguments: &str) -> Output {
        let mut command = self.command(env!("CARGO_BIN_EXE_brdfarm"), arguments);
        command.envs(self.environment.clone());
        command.output().expect("brdfarm runs")
    }

    pub fn succeed(&self, arguments: &str) -> String {
        let output = self.run(arguments);
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "brdfarm {arguments}: {said}");
        String::from_utf8(output.stdout).expect("UTF-8")
    }

    pub fn serve(&self) -> String {
        format!(
            "coordinator serve --spec spec.toml --store farm --listen {} --lease-seconds {} \
             --check-percent {} {}",
            self.address, self.lease_seconds, self.check_percent, self.options
        )
    }

    /// Starts the coordinator, or starts it again on the same address.
    pub fn start(&mut self) {
        let arguments = self.serve();
        let command = self.command(env!("CARGO_BIN_EXE_brdfarm"), &arguments);
        self.start_as(command);
    }

    /// The same with another command line.
    pub fn start_as(&mut self, mut command: Command) {
        let errors = File::options()
            .create(true)
            .append(true)
            .open(self.path().join("coordinator.log"))
            .expect("a log");
        command.envs(self.environment.clone());
        let Some((process, url)) = Process::serving(command.stderr(errors)) else {
            panic!("the coordinator does not start: {}", self.log());
        };
        self.address = url.rsplit('/').next().expect("a part").to_owned();
        self.coordinator = Some(process);
    }

    pub fn kill_coordinator(&mut self) {
        self.coordinator.take().expect("a coordinator").kill();
    }

    /// What coordinators said on standard error.
    pub fn log(&self) -> String {
        fs::read_to_string(self.path().join("coordinator.log")).unwrap_or_default()
    }

    /// A worker whose log is kept under its name.
    pub fn worker(&self, name: &str, address: &str) -> Process {
        self.worker_of(name, &[address])
    }

    /// The same, of any of several coordinators.
    pub fn worker_of(&self, name: &str, addresses: &[&str]) -> Process {
        let urls = addresses.join(" http://");
        let arguments = format!(
            "worker connect http://{urls} --name {name} --threads 1 --backend native \
             --log info,worker=debug --log-format json"
        );
        let log = File::options()
            .create(true)
            .append(true)
            .open(self.path().join(format!("{name}.worker")))
            .expect("a log");
        let mut command = self.command(env!("CARGO_BIN_EXE_brdfarm"), &arguments);
        Process::spawn(command.stdout(Stdio::null()).stderr(log))
    }

    /// Leases that a worker knows it has been given; the coordinator counts them before it tells.
    pub fn leases_known_to(&self, name: &str) -> usize {
        let said = fs::read_to_string(self.path().join(format!("{name}.worker")));
        said.unwrap_or_default().matches("\"leased\"").count()
    }

    /// Materials whose completion some worker was told of, once for every time.
    pub fn acknowledged(&self) -> Vec<u64> {
        let files = fs::read_dir(self.path()).expect("a directory");
        let files = files.map(|file| file.expect("a file").path());
        let logs = files.filter(|path| path.extension().is_some_and(|kind| kind == "worker"));
        let mut materials = Vec::new();
        for log in logs {
            let text = fs::read_to_string(log).expect("a log");
            // A killed worker can leave half a line.
            let lines = text
                .lines()
                .filter_map(|line| serde_json::from_str(line).ok());
            let told = lines.filter(|line: &Value| line["fields"]["message"] == "completed");
            materials.extend(told.filter_map(|line| line["span"]["material"].as_u64()));
        }
        materials
    }

    /// Materials that the completion log has, in its order, less those that it takes back.
    pub fn completed(&self) -> Vec<u64> {
        let log = fs::read_to_string(self.store().join("completions.log")).unwrap_or_default();
        let whole = log.rsplit_once('\n').map_or("", |(whole, _)| whole);
        let mut materials = Vec::new();
        for line in whole.lines() {
            let (_, json) = line.split_once(' ').expect("a checksum");
            let entry: Value = serde_json::from_str(json).expect("JSON");
            match entry["retracted"].as_u64() {
                Some(retracted) => materials.retain(|material| *material != retracted),
                None => materials.push(entry["material"].as_u64().expect("a completion")),
            }
        }
        materials
    }

    pub fn status(&self) -> Value {
        let arguments = format!("status --json --coordinator http://{}", self.address);
        let output = self.run(&arguments);
        serde_json::from_slice(&output.stdout).unwrap_or_default()
    }

    pub fn wait_until_finished(&self) {
        wait_for("the end of the set", || self.status()["finished"] == true);
    }

    /// The manifest of a store: a function of its images.
    pub fn manifest(&self, store: &str) -> String {
        let out = format!("{store}.jsonl");
        let arguments =
            format!("dataset manifest export --store {store} --format jsonl --out {out}");
        self.succeed(&arguments);
        fs::read_to_string(self.path().join(out)).expect("a manifest")
    }

    /// The farm's set is complete and what an undisturbed run makes.
    pub fn expect_the_undisturbed_set(&self) {
        self.succeed("dataset verify --store farm");
        self.succeed("run --spec spec.toml --store undisturbed --backend native");
        assert_eq!(self.manifest("farm"), self.manifest("undisturbed"));
    }

    /// The same, and nothing was ever completed twice.
    pub fn expect_undisturbed(&self) {
        self.expect_the_undisturbed_set();
        let materials = self.completed();
        let once: BTreeSet<u64> = materials.iter().copied().collect();
        assert_eq!(
            materials.len(),
            once.len(),
            "a material was completed twice"
        );
    }
}

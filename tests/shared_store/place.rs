//! A folder, databases, and the programs that work on them.

use crate::process::Process;
use crate::server;
use std::fs;
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::Duration;
use tokio::runtime::Runtime;

/// How long anything may take at the very most.
pub const PATIENCE: Duration = Duration::from_secs(300);

pub struct Place {
    folder: tempfile::TempDir,
    runtime: Runtime,
    /// What commands find in their environment.
    pub environment: Vec<(&'static str, String)>,
}

impl Place {
    /// With a specification of this many small materials.
    pub fn new(materials: u32) -> Self {
        let place = Self {
            folder: tempfile::tempdir().expect("a folder"),
            runtime: Runtime::new().expect("a runtime"),
            environment: Vec::new(),
        };
        let specification = format!(
            "name = \"shared\"\nmaterials = {materials}\n[image]\nwidth = 16\nheight = 16\n\
             [integrator]\nkind = \"path\"\nsamples_per_pixel = 16\n"
        );
        fs::write(place.path().join("spec.toml"), specification).expect("written");
        place
    }

    pub fn path(&self) -> &Path {
        self.folder.path()
    }

    /// The URL of a database that nobody else uses.
    pub fn database(&self) -> String {
        self.runtime.block_on(server::fresh_schema())
    }

    /// Runs statements in a database.
    pub fn sql(&self, url: &str, statements: &str) {
        self.runtime.block_on(server::run(url, statements));
    }

    /// A number that a database is asked for.
    pub fn number(&self, url: &str, query: &str) -> i64 {
        self.runtime.block_on(async {
            let client = server::client(url).await;
            let row = client.query_one(query, &[]).await;
            row.expect("a row").get(0)
        })
    }

    pub fn command(&self, arguments: &str) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_brdfarm"));
        command.current_dir(self.path());
        command.envs(self.environment.clone());
        command.args(arguments.split_whitespace());
        command
    }

    pub fn run(&self, arguments: &str) -> Output {
        self.command(arguments).output().expect("brdfarm runs")
    }

    /// What a command says that has to end well.
    pub fn succeed(&self, arguments: &str) -> String {
        let output = self.run(arguments);
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "brdfarm {arguments}: {said}");
        String::from_utf8(output.stdout).expect("UTF-8")
    }

    /// What a command says that has to fail so, on both outputs.
    pub fn refuse(&self, arguments: &str, code: i32) -> String {
        let output = self.run(arguments);
        let said = [output.stdout, output.stderr].concat();
        let said = String::from_utf8(said).expect("UTF-8");
        assert_eq!(output.status.code(), Some(code), "{arguments}: {said}");
        said
    }

    /// A coordinator on a store, and its URL.
    pub fn coordinator(&self, store: &str, options: &str) -> (Process, String) {
        let arguments = format!(
            "coordinator serve --spec spec.toml --store {store} --listen 127.0.0.1:0 {options}"
        );
        Process::serving(&mut self.command(&arguments)).expect("it listens")
    }

    /// Renders all that is left.
    pub fn work(&self, coordinator: &str, name: &str) {
        let arguments =
            format!("worker connect {coordinator} --name {name} --threads 1 --backend native");
        let worker = Process::spawn(self.command(&arguments).stdout(Stdio::null()));
        assert_eq!(worker.ended(PATIENCE).code(), Some(0));
    }

    /// The manifest of a store: a function of its images.
    pub fn manifest(&self, store: &str) -> Vec<u8> {
        self.succeed(&format!(
            "dataset manifest export --store {store} --format csv --out m.csv"
        ));
        fs::read(self.path().join("m.csv")).expect("a manifest")
    }
}

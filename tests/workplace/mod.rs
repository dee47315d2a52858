//! A folder in which the program is run.

use std::path::Path;
use std::process::{Child, Command, Output, Stdio};

pub struct Workplace(tempfile::TempDir);

impl Workplace {
    /// Without anything.
    pub fn empty() -> Self {
        Self(tempfile::tempdir().expect("a folder"))
    }

    pub fn path(&self) -> &Path {
        self.0.path()
    }

    fn command(&self, arguments: &str) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_brdfarm"));
        command
            .current_dir(self.path())
            .args(arguments.split_whitespace());
        command
    }

    pub fn run(&self, arguments: &str) -> Output {
        self.command(arguments).output().expect("a program")
    }

    /// A command under way.
    pub fn spawn(&self, arguments: &str) -> Child {
        self.command(arguments)
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .expect("a program")
    }

    /// What a command says that has to end well.
    #[track_caller]
    pub fn succeed(&self, arguments: &str) -> String {
        let output = self.run(arguments);
        let errors = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "brdfarm {arguments}: {errors}");
        String::from_utf8(output.stdout).expect("UTF-8")
    }
}

//! A folder with a small store, and the programs that are run in it.

use std::fs;
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};

/// Small images, so that 14 of them take a fraction of a second.
const SPECIFICATION: &str = r#"
name = "small"
materials = 12
[image]
width = 32
height = 32
[integrator]
kind = "path"
samples_per_pixel = 16
"#;

pub struct Workplace(tempfile::TempDir);

impl Workplace {
    /// With a store of so many materials.
    pub fn rendered(materials: u32) -> Self {
        let place = Self::empty();
        fs::write(place.path().join("spec.toml"), SPECIFICATION).unwrap();
        place.succeed(&format!("run --spec spec.toml --materials {materials}"));
        place
    }

    /// Without anything.
    pub fn empty() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    pub fn path(&self) -> &Path {
        self.0.path()
    }

    pub fn run(&self, arguments: &str) -> Output {
        Command::new(env!("CARGO_BIN_EXE_brdfarm"))
            .current_dir(self.path())
            .args(arguments.split_whitespace())
            .output()
            .unwrap()
    }

    /// A command under way.
    pub fn spawn(&self, arguments: &str) -> Child {
        Command::new(env!("CARGO_BIN_EXE_brdfarm"))
            .current_dir(self.path())
            .args(arguments.split_whitespace())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap()
    }

    /// What a command says that has to end well.
    pub fn succeed(&self, arguments: &str) -> String {
        let output = self.run(arguments);
        let errors = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "brdfarm {arguments}: {errors}");
        String::from_utf8(output.stdout).unwrap()
    }
}

/// What a script of the repository says, run in the workplace.
pub fn python(place: &Workplace, script: &str, arguments: &[&str]) -> String {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let clients = root.join("target/python-clients");
    assert!(
        clients.exists(),
        "the Python readers are missing: run tests/clients/install.sh, or tests/run.sh for all tests"
    );
    let output = Command::new("python3")
        .arg(root.join(script))
        .args(arguments)
        .env("PYTHONPATH", clients)
        .current_dir(place.path())
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{script}: {said}{errors}");
    said
}

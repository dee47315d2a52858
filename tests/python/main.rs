//! The Python package, tested in Python: the package of `python/` with this build's library and
//! command, as a wheel puts them together. `deploy/wheels.sh` tries the wheels themselves.

#![allow(clippy::unwrap_used, reason = "a panic here is a failed test")]

use std::{
    env, fs,
    os::unix::fs::symlink,
    path::{Path, PathBuf},
    process::Command,
};

#[test]
fn the_package_does_what_its_docstrings_say() {
    let place = Installed::new();
    place.pytest(&["tests/python/package"]);
}

#[test]
fn the_quickstart_notebook_runs() {
    let place = Installed::new();
    place.pytest(&["tests/python/notebook"]);
}

#[test]
#[ignore = "needs PyTorch, 5 GB: tests/python.sh installs and runs it"]
fn loaders_of_pytorch_read_a_store() {
    let place = Installed::new();
    place.pytest(&["tests/python/loaders"]);
}

/// A folder that Python imports the package from.
struct Installed(tempfile::TempDir);

impl Installed {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let package = folder.path().join("brdfarm");
        let source = root().join("python/package/brdfarm");
        fs::create_dir_all(package.join("bin")).unwrap();
        for entry in fs::read_dir(source).unwrap() {
            let path = entry.unwrap().path();
            if path.is_file() {
                symlink(&path, package.join(path.file_name().unwrap())).unwrap();
            }
        }
        let command = Path::new(env!("CARGO_BIN_EXE_brdfarm"));
        // Cargo builds the library for Python beside the one for Rust, which this test depends on.
        let library = command.with_file_name("deps").join("lib_native.so");
        assert!(library.exists(), "{}", library.display());
        symlink(library, package.join("_native.abi3.so")).unwrap();
        symlink(command, package.join("bin/brdfarm")).unwrap();
        Self(folder)
    }

    fn pytest(&self, arguments: &[&str]) {
        let clients = root().join("target/python-clients");
        assert!(
            clients.exists(),
            "pytest is missing: run tests/clients/install.sh, or tests/run.sh for all tests"
        );
        let path = env::join_paths([self.0.path(), &clients]).unwrap();
        let output = Command::new("python3")
            .args(["-m", "pytest", "-q", "-p", "no:cacheprovider"])
            .args(arguments)
            .env("PYTHONPATH", path)
            .env("PYTHONDONTWRITEBYTECODE", "1")
            .env_remove("BRDFARM_COMMAND")
            .current_dir(root())
            .output()
            .unwrap();
        let said = String::from_utf8_lossy(&output.stdout);
        let errors = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{said}{errors}");
    }
}

fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

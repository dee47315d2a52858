//! Scripts that read what leaves a store, with the Python readers of `tests/clients`.

use crate::workplace::Workplace;
use std::path::Path;
use std::process::Command;

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

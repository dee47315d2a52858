//! What stands in `deploy/` is checked, and the checks see what is broken on purpose.

use std::path::Path;
use std::process::{Command, Output};

fn check(arguments: &[&str]) -> Output {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut command = Command::new(root.join("deploy/check.sh"));
    command
        .args(arguments)
        .env("BRDFARM", env!("CARGO_BIN_EXE_brdfarm"))
        // Where tests/clients/install.sh put the Python packages that the checks read YAML with.
        .env("PYTHONPATH", root.join("target/python-clients"))
        .env("CHECK_OFFLINE", "1");
    command.output().expect("bash runs")
}

fn text(output: &Output) -> String {
    let streams = [&output.stdout, &output.stderr];
    streams.map(|bytes| String::from_utf8_lossy(bytes)).concat()
}

#[test]
fn names_resolve_and_credentials_are_read_by_those_who_need_them() {
    let output = check(&[]);
    assert!(output.status.success(), "{}", text(&output));
}

#[test]
fn what_is_broken_on_purpose_is_called_wrong() {
    let output = check(&["--self-test"]);
    assert!(output.status.success(), "{}", text(&output));
}

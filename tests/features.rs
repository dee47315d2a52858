//! What the command is built of.

#![allow(clippy::unwrap_used, reason = "a panic here is a failed test")]

use std::process::Command;

/// The packages that a build of the command compiles.
fn packages(features: &str) -> Vec<String> {
    let output = Command::new(env!("CARGO"))
        .args(["tree", "--package", "brdfarm", "--edges", "normal,build"])
        .args(["--prefix", "none", "--format", "{p}", "--offline"])
        .args(["--features", features])
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .output()
        .unwrap();
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{errors}");
    let names = String::from_utf8(output.stdout).unwrap();
    let first = names.lines().filter_map(|line| line.split(' ').next());
    first.map(str::to_owned).collect()
}

#[test]
fn burn_and_inverse_are_built_for_the_training_step_alone() {
    let is_burn = |name: &String| name == "burn" || name.starts_with("burn-");
    assert!(!packages("").iter().any(is_burn));
    assert!(packages("training").iter().any(is_burn));
    let is_inverse = |name: &String| name == "inverse";
    assert!(!packages("").iter().any(is_inverse));
    assert!(packages("training").iter().any(is_inverse));
}

#[test]
fn clients_of_databases_and_buckets_are_built_for_clusters_alone() {
    // tokio-postgres speaks to PostgreSQL; quick-xml reads what the three clouds answer.
    for client in ["tokio-postgres", "quick-xml"] {
        let is_client = |name: &String| name == client;
        assert!(!packages("").iter().any(is_client), "{client}");
        assert!(!packages("training").iter().any(is_client), "{client}");
        assert!(packages("cluster").iter().any(is_client), "{client}");
    }
}

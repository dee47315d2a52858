//! The documentation: generated pages are those that the code writes, and every link leads somewhere.
//!
//! `BRDFARM_WRITE_REFERENCE=1` writes the generated pages instead of comparing them.
#![allow(clippy::unwrap_used, reason = "a panic here is a failed test")]

mod links;
mod markdown;

use std::path::{Path, PathBuf};
use std::process::Command;
use std::{env, fs};

/// Pages outside of docs/ whose links are checked.
const PAGES: [&str; 8] = [
    "README.md",
    "ARCHITECTURE.md",
    "CHANGELOG.md",
    "CONTRIBUTING.md",
    "SECURITY.md",
    "deploy/README.md",
    "bench/mitsuba/README.md",
    "tests/farm_faults/README.md",
];

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn run(command: &mut Command) {
    let output = command.output().unwrap();
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{command:?}: {errors}");
}

/// Compares a generated page with the committed one, or writes it.
fn compare(written: &Path) {
    let name = written.file_name().unwrap();
    let committed = root().join("docs/reference").join(name);
    let written = fs::read_to_string(written).unwrap();
    if env::var_os("BRDFARM_WRITE_REFERENCE").is_some() {
        fs::write(&committed, written).unwrap();
        return;
    }
    let there = fs::read_to_string(&committed).unwrap_or_default();
    let mut lines = (1..).zip(there.lines().zip(written.lines()));
    let different = lines.find(|(_, (there, written))| there != written);
    assert!(
        there == written,
        "{} is stale: {different:?}. CONTRIBUTING.md says how to write it again",
        committed.display()
    );
}

/// The page of the command line has the commands of the feature `training`.
#[cfg(feature = "training")]
#[test]
fn the_pages_of_command_specification_and_columns_are_those_that_the_code_writes() {
    let folder = tempfile::tempdir().unwrap();
    let mut command = Command::new(env!("CARGO_BIN_EXE_brdfarm"));
    run(command.args(["reference", "--out"]).arg(folder.path()));
    for name in ["command.md", "specification.md", "columns.md"] {
        compare(&folder.path().join(name));
    }
}

#[test]
fn the_page_of_the_python_package_is_that_of_its_sources() {
    let folder = tempfile::tempdir().unwrap();
    let page = folder.path().join("python.md");
    let script = root().join("docs/tools/python_reference.py");
    run(Command::new("python3").arg(script).arg(&page));
    compare(&page);
}

#[test]
fn the_command_that_writes_the_pages_is_hidden() {
    let mut command = Command::new(env!("CARGO_BIN_EXE_brdfarm"));
    let help = command.arg("--help").output().unwrap().stdout;
    let help = String::from_utf8(help).unwrap();
    assert!(help.contains("\n  completions "), "{help}");
    assert!(!help.contains("\n  reference "), "{help}");
}

/// Every Markdown file below docs/, relative to the repository.
fn pages_of_docs() -> Vec<PathBuf> {
    let mut folders = vec![root().join("docs")];
    let mut pages = Vec::new();
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|ending| ending == "md") {
                pages.push(path.strip_prefix(root()).unwrap().to_owned());
            }
        }
    }
    pages.sort();
    pages
}

#[test]
fn every_link_leads_to_a_file_and_every_anchor_to_a_heading() {
    let pages = PAGES.iter().map(PathBuf::from).chain(pages_of_docs());
    let faults: Vec<_> = pages
        .flat_map(|page| links::faults(root(), &page))
        .collect();
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

#[test]
fn the_summary_has_every_page_of_the_book_and_no_other() {
    let text = fs::read_to_string(root().join("docs/SUMMARY.md")).unwrap();
    let mut listed: Vec<_> = markdown::read(&text)
        .links
        .into_iter()
        .map(|link| Path::new("docs").join(link))
        .collect();
    listed.push("docs/SUMMARY.md".into());
    listed.sort();
    assert_eq!(listed, pages_of_docs());
}

/// mdBook copies other files of docs/ into the site, over the pages that it writes.
#[test]
fn no_other_file_of_the_book_has_the_name_of_a_page() {
    for page in pages_of_docs() {
        let html = root().join(page).with_extension("html");
        assert!(!html.exists(), "{}", html.display());
    }
}

/// Three versions had gone by before the table of them said so.
#[test]
fn the_table_of_the_renderers_versions_has_each_once() {
    let changes = fs::read_to_string(root().join("CHANGELOG.md")).unwrap();
    let (_, table) = changes
        .split_once("\n## Versions of the renderer\n")
        .unwrap();
    let table = table.split("\n## ").next().unwrap();
    let rows = table.lines().filter_map(|line| {
        let cell = line.strip_prefix("| ")?.split(" |").next()?;
        cell.parse::<u32>().ok()
    });
    let newest: u32 = dataset::RENDERER_VERSION.parse().unwrap();
    let expected: Vec<u32> = (1..=newest).collect();
    assert_eq!(rows.collect::<Vec<_>>(), expected);
}

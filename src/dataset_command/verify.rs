//! `brdfarm dataset verify`.

use super::StoreOptions;
use crate::plural::count;
use crate::{cores, progress};
use clap::Args;
use coordinator::{ReadOnlyStore, verify::verify};
use std::io::{self, Write};

/// Faults that are listed.
const FAULTS_SHOWN_MAX: usize = 100;

/// Check every image: present, intact, finite, and what it says it is
///
/// Reads every image of a store: computes its digest, decodes it, and compares what it says of
/// itself with what the specification and the ledger say. Changes nothing.
#[derive(Debug, Args)]
pub struct Options {
    #[command(flatten)]
    store: StoreOptions,
    /// Threads to read with; 0 takes one a core
    #[arg(long, default_value_t = 0, value_name = "N",
          value_parser = clap::value_parser!(u64).range(..=cores::COUNT_MAX))]
    threads: u64,
}

/// Checks a store.
pub fn execute(options: &Options) -> anyhow::Result<()> {
    let store = ReadOnlyStore::open(&options.store.store)?;
    let materials = store.specification().materials;
    check(&store, materials, cores::count(options.threads))
}

/// Checks the first `materials` of a store with so many threads and says what was found; faults
/// are an error.
pub fn check(store: &ReadOnlyStore, materials: u32, threads: usize) -> anyhow::Result<()> {
    let images = u64::from(materials) * store.specification().views.len() as u64;
    let bar = progress::bar(images, "images checked");
    let report = verify(store, materials, threads, &|looked_at| {
        bar.set_position(looked_at)
    });
    bar.finish_and_clear();
    let mut out = io::stdout();
    for fault in report.faults.iter().take(FAULTS_SHOWN_MAX) {
        writeln!(out, "{fault}")?;
    }
    if report.faults.len() > FAULTS_SHOWN_MAX {
        writeln!(out, "and {} more", report.faults.len() - FAULTS_SHOWN_MAX)?;
    }
    if report.log_lines_damaged > 0 {
        let lines = count(report.log_lines_damaged, "line");
        writeln!(out, "completions.log: {lines} damaged")?;
    }
    anyhow::ensure!(
        report.is_sound(),
        "{}; {} of {} sound",
        count(report.faults.len() as u64, "fault"),
        report.images_sound,
        count(images, "image")
    );
    writeln!(
        out,
        "verified {} of {}, {:.1} MB",
        count(report.images_sound, "image"),
        count(report.materials, "material"),
        report.bytes_sound as f64 / 1e6
    )?;
    Ok(())
}

//! `brdfarm dataset verify`.

use super::StoreOptions;
use crate::progress;
use clap::Args;
use coordinator::{ReadOnlyStore, verify::verify};
use std::io::{self, Write};
use std::num::NonZero;
use std::thread::available_parallelism;

/// Faults that are listed.
const FAULTS_SHOWN_MAX: usize = 100;

/// Reads every image of a store: computes its digest, decodes it, and compares what it says of
/// itself with what the specification and the ledger say. Changes nothing.
#[derive(Debug, Args)]
pub struct Options {
    #[command(flatten)]
    store: StoreOptions,
    /// Threads to read with; 0 takes every core
    #[arg(long, default_value_t = 0)]
    threads: usize,
}

/// Checks a store.
pub fn execute(options: &Options) -> anyhow::Result<()> {
    let store = ReadOnlyStore::open(&options.store.store)?;
    let threads = match options.threads {
        0 => available_parallelism().map_or(1, NonZero::get),
        threads => threads,
    };
    check(&store, threads)
}

/// Checks a store with so many threads and says what was found; faults are an error.
pub fn check(store: &ReadOnlyStore, threads: usize) -> anyhow::Result<()> {
    let specification = store.specification();
    let images = u64::from(specification.materials) * specification.views.len() as u64;
    let bar = progress::bar(images, "images checked");
    let report = verify(store, threads, &|looked_at| bar.set_position(looked_at));
    bar.finish_and_clear();
    let mut out = io::stdout();
    for fault in report.faults.iter().take(FAULTS_SHOWN_MAX) {
        writeln!(out, "{fault}")?;
    }
    if report.faults.len() > FAULTS_SHOWN_MAX {
        writeln!(out, "and {} more", report.faults.len() - FAULTS_SHOWN_MAX)?;
    }
    anyhow::ensure!(
        report.is_sound(),
        "{} faults; {} of {images} images are sound",
        report.faults.len(),
        report.images_sound
    );
    writeln!(
        out,
        "verified {} images of {} materials, {:.1} MB",
        report.images_sound,
        report.materials,
        report.bytes_sound as f64 / 1e6
    )?;
    Ok(())
}

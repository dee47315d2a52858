//! `brdfarm dataset manifest export`.

use super::StoreOptions;
use clap::{Args, Subcommand, ValueEnum};
use coordinator::ReadOnlyStore;
use coordinator::export::{self, export};
use std::io::{self, Write};
use std::path::PathBuf;

/// What can be done with a manifest.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Write the manifest of a store
    Export(Options),
}

/// Writes one row an image: labels, split, geometry, digest, size, path and measured error.
///
/// The same images give the same bytes, wherever and in whatever order they were rendered.
#[derive(Debug, Args)]
pub struct Options {
    #[command(flatten)]
    store: StoreOptions,
    /// How the manifest is written
    #[arg(long, value_enum)]
    format: Format,
    /// Where to; in the store as manifest.jsonl, .csv or .parquet where it is left out
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Write a manifest of an incomplete store
    #[arg(long)]
    partial: bool,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum Format {
    /// One JSON object a line
    Jsonl,
    /// Comma-separated values; lists become columns name_0, name_1, ...
    Csv,
    /// Apache Parquet, lists as fixed-size lists, descriptions in the metadata
    Parquet,
}

/// Writes the manifest.
pub fn execute(Command::Export(options): &Command) -> anyhow::Result<()> {
    let (format, name) = match options.format {
        Format::Jsonl => (export::Format::Jsonl, "manifest.jsonl"),
        Format::Csv => (export::Format::Csv, "manifest.csv"),
        Format::Parquet => (export::Format::Parquet, "manifest.parquet"),
    };
    let store = ReadOnlyStore::open(&options.store.store)?;
    let path = match &options.out {
        Some(path) => path.clone(),
        None => store.path().join(name),
    };
    let exported = export(&store, format, options.partial, &path)?;
    let mut out = io::stdout();
    write!(out, "{}: {} rows", path.display(), exported.rows)?;
    if exported.materials_missing > 0 {
        write!(out, ", {} materials missing", exported.materials_missing)?;
    }
    writeln!(out)?;
    Ok(())
}

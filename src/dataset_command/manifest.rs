//! `brdfarm dataset manifest export`.

use super::StoreOptions;
use crate::plural::count;
use clap::{Args, Subcommand, ValueEnum};
use datastore::ReadOnlyStore;
use export::manifest::{self, export};
use std::fs::File;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// What can be done with a manifest.
#[derive(Debug, Subcommand)]
pub enum Command {
    Export(Options),
}

/// Write the manifest of a store
///
/// One row for each image: labels, split, geometry, digest, size, path and measured error.
/// The same images give the same bytes, wherever and in whatever order they were rendered.
#[derive(Debug, Args)]
pub struct Options {
    #[command(flatten)]
    store: StoreOptions,
    /// The format of the manifest
    #[arg(long, value_enum)]
    format: Format,
    /// The file to write, or - for standard output [default: manifest.jsonl, .csv or .parquet in the
    /// store's folder, or in this folder if the store is a database]
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Write the manifest even if materials are missing
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
    let format = match options.format {
        Format::Jsonl => manifest::Format::Jsonl,
        Format::Csv => manifest::Format::Csv,
        Format::Parquet => manifest::Format::Parquet,
    };
    let store = ReadOnlyStore::open(&options.store.store)?;
    let path = match &options.out {
        Some(path) if path == Path::new("-") => return to_stdout(&store, format, options.partial),
        Some(path) => path.clone(),
        None => {
            let folder = store.name().folder().unwrap_or(Path::new(""));
            folder.join(format!("manifest.{}", format.ending()))
        }
    };
    let exported = export(&store, format, options.partial, &path)?;
    let mut out = io::stdout();
    write!(out, "{}: {}", path.display(), count(exported.rows, "row"))?;
    if exported.materials_missing > 0 {
        let missing = count(exported.materials_missing, "material");
        write!(out, ", {missing} missing")?;
    }
    writeln!(out)?;
    Ok(())
}

/// Writes the manifest to standard output once it is whole, and what is to be said of it to standard
/// error.
fn to_stdout(store: &ReadOnlyStore, format: manifest::Format, partial: bool) -> anyhow::Result<()> {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("manifest");
    let exported = export(store, format, partial, &path)?;
    io::copy(&mut File::open(&path)?, &mut io::stdout())?;
    if exported.materials_missing > 0 {
        let missing = count(exported.materials_missing, "material");
        writeln!(io::stderr(), "{missing} missing")?;
    }
    Ok(())
}

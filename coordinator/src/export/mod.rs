//! The manifest: one row an image, by material and view, as JSON Lines, CSV or Parquet.
//!
//! Rows are written as they are made, so memory does not grow with the dataset, and a store always
//! gives the same bytes. The columns, their types, units and descriptions are
//! [`dataset::manifest::columns`].

mod csv;
mod jsonl;
mod parquet;

use crate::{file_error::FileError, store::ReadOnlyStore};
use dataset::manifest::Row;
use std::{
    fs::{self, File},
    io::{self, BufWriter, Write},
    path::{Path, PathBuf},
    str::FromStr,
};
use thiserror::Error;

/// How a manifest is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// One JSON object a line.
    Jsonl,
    /// Comma-separated values with a line of names; lists become columns `name_0`, `name_1`, ...
    Csv,
    /// Apache Parquet; lists are fixed-size lists. Compressed with Snappy, which needs no C
    /// compiler to build.
    Parquet,
}

/// Why there is no manifest.
#[derive(Debug, Error)]
pub enum ExportError {
    /// The dataset is not complete.
    #[error(
        "{missing} of the {materials} materials in {} are not complete: finish them with \
         `brdfarm run`, or pass --partial for a manifest of the others",
        store.display()
    )]
    Incomplete {
        /// The store.
        store: PathBuf,
        /// Materials that are not complete.
        missing: u32,
        /// Materials the store should have.
        materials: u32,
    },
    /// A material was completed with another number of views.
    #[error("material {0} has views that the specification does not have: verify the store")]
    Views(u32),
    /// The Parquet encoder failed.
    #[error("cannot write Parquet: {0}")]
    Parquet(#[from] ::parquet::errors::ParquetError),
    /// A file cannot be read or written.
    #[error(transparent)]
    File(#[from] FileError),
    /// The manifest cannot be written.
    #[error(transparent)]
    Io(#[from] io::Error),
}

/// What was written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Exported {
    /// Rows: images.
    pub rows: u64,
    /// Materials that are missing in it.
    pub materials_missing: u32,
}

/// A manifest under way. Rows come in order; nothing is whole before `finish`.
trait Manifest {
    fn write(&mut self, row: &Row) -> Result<(), ExportError>;
    fn finish(self: Box<Self>) -> Result<(), ExportError>;
}

impl FromStr for Format {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        match name {
            "jsonl" => Ok(Self::Jsonl),
            "csv" => Ok(Self::Csv),
            "parquet" => Ok(Self::Parquet),
            _ => Err(format!(
                "there is no manifest format {name:?}: choose jsonl, csv or parquet"
            )),
        }
    }
}

/// Writes a store's manifest to the file `output`, which appears when it is whole and durable. What
/// is no plain file, such as a device or a pipe, is written to directly: a rename would replace it.
///
/// # Errors
/// Refuses a store that is not complete unless `partial`.
pub fn export(
    store: &ReadOnlyStore,
    format: Format,
    partial: bool,
    output: &Path,
) -> Result<Exported, ExportError> {
    let missing = store.materials_missing();
    if missing > 0 && !partial {
        return Err(ExportError::Incomplete {
            store: store.path().to_owned(),
            missing,
            materials: store.specification().materials,
        });
    }
    let unable = |error| FileError::new("write", output)(error);
    let named = |error| match error {
        ExportError::Io(error) => unable(error).into(),
        error => error,
    };
    if fs::symlink_metadata(output).is_ok_and(|there| !there.is_file()) {
        let file = File::create(output).map_err(unable)?;
        return write(store, format, file).map_err(named);
    }
    let mut beside = output.as_os_str().to_owned();
    beside.push(".new");
    let beside = PathBuf::from(beside);
    let file = File::create(&beside).map_err(unable)?;
    let written = file
        .try_clone()
        .map_err(ExportError::Io)
        .and_then(|file| write(store, format, file))
        .and_then(|exported| {
            file.sync_all()
                .and_then(|()| fs::rename(&beside, output))
                .map_err(unable)?;
            Ok(exported)
        });
    if written.is_err() {
        // The error that counts is the one before.
        let _ = fs::remove_file(&beside);
    }
    written.map_err(named)
}

fn write(store: &ReadOnlyStore, format: Format, file: File) -> Result<Exported, ExportError> {
    let file = BufWriter::new(file);
    let mut manifest: Box<dyn Manifest> = match format {
        Format::Jsonl => Box::new(jsonl::Jsonl::new(file)),
        Format::Csv => Box::new(csv::Csv::new(file)?),
        Format::Parquet => Box::new(parquet::Parquet::new(file, store)?),
    };
    let exported = write_rows(store, manifest.as_mut())?;
    manifest.finish()?;
    Ok(exported)
}

fn write_rows(store: &ReadOnlyStore, manifest: &mut dyn Manifest) -> Result<Exported, ExportError> {
    let specification = store.specification();
    let hash = store.specification_hash();
    let mut exported = Exported {
        rows: 0,
        materials_missing: 0,
    };
    for material in 0..specification.materials {
        let Some(completion) = store.completion(material)? else {
            exported.materials_missing += 1;
            continue;
        };
        if completion.views.len() != specification.views.len() {
            return Err(ExportError::Views(material));
        }
        let sampled = specification.material(material);
        for (view, done) in (0..).zip(&completion.views) {
            manifest.write(&Row::new(specification, hash, &sampled, view, done))?;
            exported.rows += 1;
        }
    }
    Ok(exported)
}

fn flush(mut file: impl Write) -> Result<(), ExportError> {
    Ok(file.flush()?)
}

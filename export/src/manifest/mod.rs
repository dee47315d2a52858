//! The manifest: one row an image, by material and view, as JSON Lines, CSV or Parquet.
//!
//! Rows are written as they are made, so memory does not grow with the dataset, and a store always
//! gives the same bytes. The columns, their types, units and descriptions are
//! [`dataset::manifest::columns`].

pub mod check;
mod csv;
pub(crate) mod error;
mod jsonl;
pub(crate) mod parquet;
pub mod read;

use crate::{
    error::ExportError,
    file::{unable, write_whole},
    selection::{Chosen, ChosenImage, Selection},
};
use dataset::manifest::Row;
use datastore::ReadOnlyStore;
use imagestore::FileError;
use std::{io::Write, path::Path};

pub use error::ManifestError;

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
    fn write(&mut self, row: &Row) -> Result<(), ManifestError>;
    fn finish(self: Box<Self>) -> Result<(), ManifestError>;
}

impl Format {
    /// All formats.
    pub const ALL: [Self; 3] = [Self::Jsonl, Self::Csv, Self::Parquet];

    /// The ending of such files' names.
    pub fn ending(self) -> &'static str {
        match self {
            Self::Jsonl => "jsonl",
            Self::Csv => "csv",
            Self::Parquet => "parquet",
        }
    }
}

/// Writes a store's manifest to the file `output`, which appears when it is whole and durable. What
/// is no plain file, such as a device or a pipe, is written to directly.
///
/// # Errors
/// Refuses a store that is not complete unless `partial`.
pub fn export(
    store: &ReadOnlyStore,
    format: Format,
    partial: bool,
    output: &Path,
) -> Result<Exported, ExportError> {
    let selection = Selection {
        partial,
        ..Selection::default()
    };
    let chosen = selection.choose(store)?;
    export_chosen(store, &chosen, format, output, |_, image| image.row)
}

/// Writes the manifest of what was chosen. `place` has the last word on each row: it knows where
/// the image of a material went.
pub(crate) fn export_chosen(
    store: &ReadOnlyStore,
    chosen: &Chosen,
    format: Format,
    output: &Path,
    place: impl Fn(u32, ChosenImage) -> Row,
) -> Result<Exported, ExportError> {
    write_whole(output, |file| {
        let named = |error| match error {
            ManifestError::Io(error) => FileError::into(unable("write", output)(error)),
            error => ExportError::Manifest(error),
        };
        let mut manifest: Box<dyn Manifest + '_> = match format {
            Format::Jsonl => Box::new(jsonl::Jsonl::new(file)),
            Format::Csv => Box::new(csv::Csv::new(file).map_err(named)?),
            Format::Parquet => Box::new(parquet::Parquet::new(file, store).map_err(named)?),
        };
        let mut rows = 0;
        for &material in &chosen.materials {
            for image in chosen.images_of(store, material)? {
                manifest.write(&place(material, image)).map_err(named)?;
                rows += 1;
            }
        }
        manifest.finish().map_err(named)?;
        Ok(Exported {
            rows,
            materials_missing: chosen.materials_missing,
        })
    })
}

fn flush(mut file: impl Write) -> Result<(), ManifestError> {
    Ok(file.flush()?)
}

//! JSON Lines: every row an object, its keys in the order of the columns.

use super::{Manifest, ManifestError, flush};
use dataset::manifest::Row;
use std::io::{self, Write};

pub(super) struct Jsonl<W> {
    file: W,
}

impl<W: Write> Jsonl<W> {
    pub fn new(file: W) -> Self {
        Self { file }
    }
}

impl<W: Write> Manifest for Jsonl<W> {
    fn write(&mut self, row: &Row) -> Result<(), ManifestError> {
        serde_json::to_writer(&mut self.file, row).map_err(io::Error::from)?;
        Ok(self.file.write_all(b"\n")?)
    }

    fn finish(self: Box<Self>) -> Result<(), ManifestError> {
        flush(self.file)
    }
}

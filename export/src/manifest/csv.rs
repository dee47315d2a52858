//! CSV after RFC 4180, with `\n` at the end of lines. A list of n numbers becomes n columns.

use super::{Manifest, ManifestError, flush};
use dataset::manifest::{Kind, Row, Value, columns};
use std::io::{self, Write};

pub(super) struct Csv<W: Write> {
    writer: csv::Writer<W>,
    fields: Vec<String>,
}

impl<W: Write> Csv<W> {
    pub fn new(file: W) -> Result<Self, ManifestError> {
        let mut writer = csv::WriterBuilder::new().from_writer(file);
        let names = names();
        writer.write_record(&names).map_err(io::Error::from)?;
        Ok(Self {
            writer,
            fields: Vec::with_capacity(names.len()),
        })
    }
}

impl<W: Write> Manifest for Csv<W> {
    fn write(&mut self, row: &Row) -> Result<(), ManifestError> {
        self.fields.clear();
        for value in row.values() {
            match value {
                Value::Text(text) => self.fields.push(text.clone()),
                Value::U32(number) => self.fields.push(number.to_string()),
                Value::U64(number) => self.fields.push(number.to_string()),
                Value::F64(number) => self.fields.push(shortest(*number)),
                Value::Bool(truth) => self.fields.push(truth.to_string()),
                Value::F64List(list) => self.fields.extend(list.iter().copied().map(shortest)),
                Value::Missing => unreachable!("what is written has every value"),
            }
        }
        let written = self.writer.write_record(&self.fields);
        Ok(written.map_err(io::Error::from)?)
    }

    fn finish(self: Box<Self>) -> Result<(), ManifestError> {
        let file = self.writer.into_inner();
        flush(file.map_err(|error| io::Error::from(error.into_error().kind()))?)
    }
}

/// The names of all columns, lists spread.
pub(super) fn names() -> Vec<String> {
    let mut names = Vec::new();
    for column in columns() {
        match column.kind {
            Kind::F64List(length) => {
                names.extend((0..length).map(|place| format!("{}_{place}", column.name)));
            }
            _ => names.push(column.name.to_owned()),
        }
    }
    names
}

/// The shortest text that reads back to the same bits, with an exponent where digits would be many.
fn shortest(number: f64) -> String {
    format!("{number:?}")
}

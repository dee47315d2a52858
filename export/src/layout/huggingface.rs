//! Parquet shards as Hugging Face's `datasets` reads them: the manifest's columns, then the files'
//! bytes, a column for each product.
//!
//! Pillow opens no EXR, so only previews are of the `Image` feature; the rest are bytes. The
//! features stand in the schema's metadata, under the key that `datasets` looks for.

use super::{Unit, Work, unit::column_name};
use crate::{
    error::ExportError,
    manifest::{ManifestError, parquet as rows},
    product::{Encoding, Kind, Product},
};
use arrow_array::{ArrayRef, RecordBatch, StringArray, StructArray, builder::BinaryBuilder};
use arrow_schema::{ArrowError, DataType, Field, Fields, Schema};
use dataset::manifest::{Column, Kind as ColumnKind, columns};
use parquet::{arrow::ArrowWriter, errors::ParquetError};
use serde_json::{Map, Value, json};
use std::{collections::HashMap, sync::Arc};

/// Bytes of files in a row group, about: what a reader of one row has to fetch, and what the
/// encoder keeps in memory.
const ROW_GROUP_BYTES: u64 = 32 << 20;

/// Writes a shard.
pub(super) fn write(
    work: &Work<'_>,
    unit: &Unit,
    tell: &(dyn Fn() + Sync),
) -> Result<(), ExportError> {
    let schema = Arc::new(schema(&work.kinds));
    work.place.write(&unit.path, |file| {
        let properties = rows::properties(work.store);
        let mut writer =
            ArrowWriter::try_new(file, Arc::clone(&schema), Some(properties)).map_err(encoding)?;
        let mut group = Group::new(&work.kinds);
        for &material in &unit.materials {
            work.each_image(unit, material, |image, products| {
                group.labels.append(&image.row);
                let name = format!("{material:06}.v{:02}", image.view);
                for (files, product) in group.files.iter_mut().zip(products) {
                    group.bytes += product.bytes.len() as u64;
                    files.append(&name, &product);
                }
                tell();
                Ok(())
            })?;
            if group.bytes >= ROW_GROUP_BYTES {
                group.write(&mut writer, &schema).map_err(encoding)?;
            }
        }
        group.write(&mut writer, &schema).map_err(encoding)?;
        writer.close().map_err(encoding)?;
        Ok(())
    })
}

fn encoding(error: ParquetError) -> ExportError {
    ManifestError::Parquet(error).into()
}

/// Rows that are encoded together.
struct Group {
    labels: rows::Rows,
    files: Vec<Files>,
    bytes: u64,
}

/// The files of one kind.
struct Files {
    kind: Kind,
    bytes: BinaryBuilder,
    names: Vec<String>,
}

impl Group {
    fn new(kinds: &[Kind]) -> Self {
        let files = kinds.iter().map(|&kind| Files {
            kind,
            bytes: BinaryBuilder::new(),
            names: Vec::new(),
        });
        Self {
            labels: rows::Rows::new(),
            files: files.collect(),
            bytes: 0,
        }
    }

    /// Writes what was collected as a row group of its own.
    fn write<W: std::io::Write + Send>(
        &mut self,
        writer: &mut ArrowWriter<W>,
        schema: &Arc<Schema>,
    ) -> Result<(), ParquetError> {
        if self.bytes == 0 {
            return Ok(());
        }
        let mut arrays = self.labels.finish();
        arrays.extend(self.files.iter_mut().map(Files::finish));
        let batch = RecordBatch::try_new(Arc::clone(schema), arrays)
            .map_err(|error: ArrowError| ParquetError::External(Box::new(error)))?;
        writer.write(&batch)?;
        writer.flush()?;
        self.bytes = 0;
        Ok(())
    }
}

impl Files {
    fn append(&mut self, name: &str, product: &Product) {
        self.bytes.append_value(&product.bytes);
        self.names
            .push(format!("{name}.{}", product.kind.extension));
    }

    fn finish(&mut self) -> ArrayRef {
        let bytes: ArrayRef = Arc::new(self.bytes.finish());
        let names = std::mem::take(&mut self.names);
        match self.kind.encoding {
            Encoding::Exr | Encoding::Npy => bytes,
            Encoding::Png => Arc::new(StructArray::new(
                picture_fields(),
                vec![bytes, Arc::new(StringArray::from(names))],
                None,
            )),
        }
    }
}

/// What `datasets` keeps a picture as.
fn picture_fields() -> Fields {
    Fields::from(vec![
        Field::new("bytes", DataType::Binary, true),
        Field::new("path", DataType::Utf8, true),
    ])
}

fn schema(kinds: &[Kind]) -> Schema {
    let mut fields: Vec<Field> = columns().iter().map(rows::field).collect();
    fields.extend(kinds.iter().map(|&kind| {
        let data = match kind.encoding {
            Encoding::Exr | Encoding::Npy => DataType::Binary,
            Encoding::Png => DataType::Struct(picture_fields()),
        };
        // Nullable, though no value is: `datasets` takes a picture for one only then.
        Field::new(column_name(kind), data, true)
    }));
    let mut features: Map<String, Value> = columns()
        .iter()
        .map(|column| (column.name.to_owned(), feature(column)))
        .collect();
    features.extend(kinds.iter().map(|&kind| {
        let feature = match kind.encoding {
            Encoding::Exr | Encoding::Npy => json!({"dtype": "binary", "_type": "Value"}),
            Encoding::Png => json!({"_type": "Image"}),
        };
        (column_name(kind).to_owned(), feature)
    }));
    let info = json!({"info": {"features": features}});
    Schema::new(fields).with_metadata(HashMap::from([(
        "huggingface".to_owned(),
        info.to_string(),
    )]))
}

/// A label's type as `datasets` names it.
fn feature(column: &Column) -> Value {
    let value = |name: &str| json!({"dtype": name, "_type": "Value"});
    match column.kind {
        ColumnKind::Text => value("string"),
        ColumnKind::U32 => value("uint32"),
        ColumnKind::U64 => value("uint64"),
        ColumnKind::F64 => value("float64"),
        ColumnKind::Bool => value("bool"),
        ColumnKind::F64List(length) => {
            json!({"feature": value("float64"), "length": length, "_type": "List"})
        }
    }
}

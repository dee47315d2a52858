//! Apache Parquet. Units and descriptions are the fields' metadata; the specification is the
//! file's.

use super::{Manifest, ManifestError, flush};
use arrow_array::{
    ArrayRef, RecordBatch,
    builder::{
        BooleanBuilder, FixedSizeListBuilder, Float64Builder, StringBuilder, UInt32Builder,
        UInt64Builder,
    },
};
use arrow_schema::{DataType, Field, Schema};
use dataset::{
    RENDERER_VERSION, Specification,
    manifest::{Column, Kind, Row, Value, columns},
};
use datastore::ReadOnlyStore;
use parquet::{
    arrow::ArrowWriter,
    basic::Compression,
    errors::ParquetError,
    file::{metadata::KeyValue, properties::WriterProperties},
};
use std::{io::Write, sync::Arc};

/// Rows that are encoded together.
const BATCH_ROWS: usize = 1024;

/// Rows in a row group: what the encoder keeps in memory.
const ROW_GROUP_ROWS: usize = 4 * BATCH_ROWS;

/// The key of the file's metadata that holds the specification as JSON.
pub(crate) const SPECIFICATION_KEY: &str = "brdfarm.specification";

pub(super) struct Parquet<W: Write + Send> {
    writer: ArrowWriter<W>,
    schema: Arc<Schema>,
    rows: Rows,
}

/// Rows that are collected column by column.
pub(crate) struct Rows {
    builders: Vec<Builder>,
    count: usize,
}

/// Collects the values of one column.
enum Builder {
    Text(StringBuilder),
    U32(UInt32Builder),
    U64(UInt64Builder),
    F64(Float64Builder),
    Bool(BooleanBuilder),
    F64List(FixedSizeListBuilder<Float64Builder>),
}

impl Rows {
    /// None yet.
    pub fn new() -> Self {
        Self {
            builders: columns().iter().map(Builder::of).collect(),
            count: 0,
        }
    }

    /// Adds one.
    pub fn append(&mut self, row: &Row) {
        for (builder, value) in self.builders.iter_mut().zip(row.values()) {
            builder.append(value);
        }
        self.count += 1;
    }

    /// All columns, which begin anew.
    pub fn finish(&mut self) -> Vec<ArrayRef> {
        self.count = 0;
        self.builders.iter_mut().map(Builder::finish).collect()
    }
}

/// How Parquet of a store is written, and what its metadata say of the dataset.
pub(crate) fn properties(store: &ReadOnlyStore) -> WriterProperties {
    properties_of(store.specification(), &[])
}

/// The same for a specification without a store, with more metadata: keys and values.
pub(crate) fn properties_of(
    specification: &Specification,
    more: &[(&str, &str)],
) -> WriterProperties {
    let entry = |key: &str, value: String| KeyValue::new(key.to_owned(), value);
    let mut entries = vec![
        entry("brdfarm.dataset", specification.name.clone()),
        entry(SPECIFICATION_KEY, specification.to_json()),
        entry(
            "brdfarm.specification_hash",
            specification.hash().to_string(),
        ),
        entry("brdfarm.renderer_version", RENDERER_VERSION.to_owned()),
    ];
    let more = more
        .iter()
        .map(|(key, value)| entry(key, (*value).to_owned()));
    entries.extend(more);
    WriterProperties::builder()
        .set_compression(Compression::SNAPPY)
        .set_max_row_group_row_count(Some(ROW_GROUP_ROWS))
        .set_created_by(concat!("brdfarm ", env!("CARGO_PKG_VERSION")).to_owned())
        .set_key_value_metadata(Some(entries))
        .build()
}

impl<W: Write + Send> Parquet<W> {
    pub fn new(file: W, store: &ReadOnlyStore) -> Result<Self, ManifestError> {
        let schema = Arc::new(Schema::new(
            columns().iter().map(field).collect::<Vec<Field>>(),
        ));
        let writer = ArrowWriter::try_new(file, Arc::clone(&schema), Some(properties(store)))?;
        Ok(Self {
            writer,
            schema,
            rows: Rows::new(),
        })
    }

    fn write_batch(&mut self) -> Result<(), ManifestError> {
        let batch = RecordBatch::try_new(Arc::clone(&self.schema), self.rows.finish())
            .map_err(|error| ParquetError::External(Box::new(error)))?;
        Ok(self.writer.write(&batch)?)
    }
}

impl<W: Write + Send> Manifest for Parquet<W> {
    fn write(&mut self, row: &Row) -> Result<(), ManifestError> {
        self.rows.append(row);
        if self.rows.count == BATCH_ROWS {
            self.write_batch()?;
        }
        Ok(())
    }

    fn finish(mut self: Box<Self>) -> Result<(), ManifestError> {
        if self.rows.count > 0 {
            self.write_batch()?;
        }
        flush(self.writer.into_inner()?)
    }
}

/// A column's type, unit and description.
pub(crate) fn field(column: &Column) -> Field {
    let kind = match column.kind {
        Kind::Text => DataType::Utf8,
        Kind::U32 => DataType::UInt32,
        Kind::U64 => DataType::UInt64,
        Kind::F64 => DataType::Float64,
        Kind::Bool => DataType::Boolean,
        Kind::F64List(length) => DataType::FixedSizeList(Arc::new(item()), length as i32),
    };
    let metadata = [
        ("unit".to_owned(), column.unit.to_owned()),
        ("description".to_owned(), column.description.to_owned()),
    ];
    Field::new(column.name, kind, false).with_metadata(metadata)
}

fn item() -> Field {
    Field::new("item", DataType::Float64, false)
}

impl Builder {
    fn of(column: &Column) -> Self {
        match column.kind {
            Kind::Text => Self::Text(StringBuilder::new()),
            Kind::U32 => Self::U32(UInt32Builder::new()),
            Kind::U64 => Self::U64(UInt64Builder::new()),
            Kind::F64 => Self::F64(Float64Builder::new()),
            Kind::Bool => Self::Bool(BooleanBuilder::new()),
            Kind::F64List(length) => {
                let list = FixedSizeListBuilder::new(Float64Builder::new(), length as i32);
                Self::F64List(list.with_field(item()))
            }
        }
    }

    fn append(&mut self, value: &Value) {
        match (self, value) {
            (Self::Text(builder), Value::Text(text)) => builder.append_value(text),
            (Self::U32(builder), Value::U32(number)) => builder.append_value(*number),
            (Self::U64(builder), Value::U64(number)) => builder.append_value(*number),
            (Self::F64(builder), Value::F64(number)) => builder.append_value(*number),
            (Self::Bool(builder), Value::Bool(truth)) => builder.append_value(*truth),
            (Self::F64List(builder), Value::F64List(list)) => {
                builder.values().append_slice(list);
                builder.append(true);
            }
            (_, value) => unreachable!("a manifest's values have their columns' kinds: {value:?}"),
        }
    }

    fn finish(&mut self) -> ArrayRef {
        match self {
            Self::Text(builder) => Arc::new(builder.finish()),
            Self::U32(builder) => Arc::new(builder.finish()),
            Self::U64(builder) => Arc::new(builder.finish()),
            Self::F64(builder) => Arc::new(builder.finish()),
            Self::Bool(builder) => Arc::new(builder.finish()),
            Self::F64List(builder) => Arc::new(builder.finish()),
        }
    }
}

//! The table as Parquet. Units and descriptions are the fields' metadata; the specification and the
//! plan are the file's.

use super::{ENCODINGS, ENTRIES, Finding, PARAMETERS, Plan, Row};
use crate::error::ExportError;
use crate::file::{FileError, unable, write_whole};
use crate::manifest::{ManifestError, parquet::properties_of};
use arrow_array::builder::{FixedSizeListBuilder, Float64Builder, ListBuilder, UInt32Builder};
use arrow_array::{ArrayRef, RecordBatch};
use arrow_schema::{DataType, Field, Schema};
use parquet::arrow::ArrowWriter;
use parquet::errors::ParquetError;
use std::io::Write;
use std::path::Path;
use std::sync::Arc;

/// The key of the file's metadata that holds the plan as JSON.
pub(super) const PLAN_KEY: &str = "brdfarm.observability";

/// Rows that are encoded together: 3 MB.
const BATCH_ROWS: usize = 1024;

/// A list of one encoding: its name, how many numbers it has, unit and description.
struct List {
    name: &'static str,
    length: usize,
    unit: &'static str,
    description: &'static str,
    of: fn(&Finding) -> &[f64],
}

/// The lists of each encoding, in the order of the columns.
const LISTS: [List; 4] = [
    List {
        name: "information",
        length: ENTRIES,
        unit: "1",
        description: "information matrix J'J of the ten parameters over their ranges, row by row, for \
                      noise of unit variance in each encoded channel; that of a set is the sum over \
                      its views",
        of: |finding| &finding.information,
    },
    List {
        name: "uncertainty",
        length: PARAMETERS,
        unit: "1",
        description: "bound of the norm of the error of each column of J; infinite for a derivative \
                      that does not exist",
        of: |finding| &finding.uncertainty,
    },
    List {
        name: "bound",
        length: PARAMETERS,
        unit: "range of the parameter",
        description: "Cramer-Rao bound: least standard deviation of an unbiased estimate of each \
                      parameter, all others unknown too, for noise of noise_sd; infinite where a \
                      change of it looks no larger than the uncertainty. Uncertainties of a set's \
                      views add up, so compare sets by their weights",
        of: |finding| &finding.bound,
    },
    List {
        name: "weight",
        length: PARAMETERS,
        unit: "1",
        description: "observable weight: share of the variance of a uniform prior that the images \
                      remove, for noise of noise_sd; 0 to 1",
        of: |finding| &finding.weight,
    },
];

/// Writes the table, which appears when it is whole and durable. `rows` gives those of a material, one
/// for each set of the plan.
pub(super) fn write(
    plan: &Plan,
    description: &str,
    path: &Path,
    rows: impl Fn(u32) -> Result<Vec<Row>, ExportError>,
) -> Result<(), ExportError> {
    let failed = |error: ManifestError| match error {
        ManifestError::Io(error) => FileError::into(unable("write", path)(error)),
        error => ExportError::Manifest(error),
    };
    write_whole(path, |file| {
        let mut table = Table::new(file, plan, description).map_err(failed)?;
        for &material in &plan.materials {
            for row in rows(material)? {
                table.append(material, &row).map_err(failed)?;
            }
        }
        table.finish().map_err(failed)
    })
}

/// A table under way.
struct Table<W: Write + Send> {
    writer: ArrowWriter<W>,
    schema: Arc<Schema>,
    columns: Columns,
    rows: usize,
}

/// Rows that are collected column by column.
struct Columns {
    material: UInt32Builder,
    views: ListBuilder<UInt32Builder>,
    /// The lists of the first encoding, then those of the next.
    lists: Vec<FixedSizeListBuilder<Float64Builder>>,
}

impl<W: Write + Send> Table<W> {
    fn new(file: W, plan: &Plan, description: &str) -> Result<Self, ManifestError> {
        let schema = Arc::new(schema(plan));
        let properties = properties_of(&plan.specification, &[(PLAN_KEY, description)]);
        let writer = ArrowWriter::try_new(file, Arc::clone(&schema), Some(properties))?;
        Ok(Self {
            writer,
            schema,
            columns: Columns::new(),
            rows: 0,
        })
    }

    fn append(&mut self, material: u32, row: &Row) -> Result<(), ManifestError> {
        self.columns.append(material, row);
        self.rows += 1;
        if self.rows == BATCH_ROWS {
            self.write_batch()?;
        }
        Ok(())
    }

    fn write_batch(&mut self) -> Result<(), ManifestError> {
        self.rows = 0;
        let batch = RecordBatch::try_new(Arc::clone(&self.schema), self.columns.finish())
            .map_err(|error| ParquetError::External(Box::new(error)))?;
        Ok(self.writer.write(&batch)?)
    }

    fn finish(mut self) -> Result<(), ManifestError> {
        if self.rows > 0 {
            self.write_batch()?;
        }
        Ok(self.writer.into_inner()?.flush()?)
    }
}

impl Columns {
    fn new() -> Self {
        let list = |list: &List| {
            let builder = FixedSizeListBuilder::new(Float64Builder::new(), list.length as i32);
            builder.with_field(item(DataType::Float64))
        };
        Self {
            material: UInt32Builder::new(),
            views: ListBuilder::new(UInt32Builder::new()).with_field(item(DataType::UInt32)),
            lists: (0..ENCODINGS)
                .flat_map(|_| LISTS.iter().map(list))
                .collect(),
        }
    }

    fn append(&mut self, material: u32, row: &Row) {
        self.material.append_value(material);
        self.views.values().append_slice(&row.views);
        self.views.append(true);
        let findings = row.findings.iter();
        let values = findings.flat_map(|finding| LISTS.iter().map(|list| (list.of)(finding)));
        for (builder, values) in self.lists.iter_mut().zip(values) {
            builder.values().append_slice(values);
            builder.append(true);
        }
    }

    /// All columns, which begin anew.
    fn finish(&mut self) -> Vec<ArrayRef> {
        let mut columns: Vec<ArrayRef> = vec![
            Arc::new(self.material.finish()),
            Arc::new(self.views.finish()),
        ];
        let lists = self.lists.iter_mut();
        columns.extend(lists.map(|list| -> ArrayRef { Arc::new(list.finish()) }));
        columns
    }
}

fn schema(plan: &Plan) -> Schema {
    let mut fields = vec![
        described(
            Field::new("material_index", DataType::UInt32, false),
            "1",
            "the material's index",
        ),
        described(
            Field::new(
                "views",
                DataType::List(Arc::new(item(DataType::UInt32))),
                false,
            ),
            "1",
            "the views whose images are looked at together",
        ),
    ];
    for encoding in plan.encodings {
        for list in &LISTS {
            let name = format!("{}_{encoding}", list.name);
            let item = Arc::new(item(DataType::Float64));
            let kind = DataType::FixedSizeList(item, list.length as i32);
            let field = Field::new(name, kind, false);
            fields.push(described(field, list.unit, list.description));
        }
    }
    Schema::new(fields)
}

fn described(field: Field, unit: &str, description: &str) -> Field {
    let metadata = [("unit", unit), ("description", description)];
    field.with_metadata(metadata.map(|(key, value)| (key.to_owned(), value.to_owned())))
}

fn item(kind: DataType) -> Field {
    Field::new("item", kind, false)
}

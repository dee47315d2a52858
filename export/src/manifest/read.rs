//! Reading manifests: rows of any of the three formats, checked against the columns.
//!
//! The order of columns is free in Parquet and JSON Lines and the dataset's in CSV, whose lists are
//! spread; names and types have to be those of [`dataset::manifest::columns`]. What a file says
//! more is an error too: it is not the manifest that it seems to be.

use super::{Format, parquet::SPECIFICATION_KEY};
use crate::file::unable;
use arrow_array::{
    Array, BooleanArray, FixedSizeListArray, Float64Array, RecordBatch, StringArray, UInt32Array,
    UInt64Array,
};
use dataset::{
    Specification, SpecificationError,
    manifest::{Column, Kind, Row, Value, columns},
};
use imagestore::FileError;
use parquet::{arrow::arrow_reader::ParquetRecordBatchReaderBuilder, errors::ParquetError};
use std::{
    fs::File,
    io::{self, BufRead, BufReader, Read},
    panic::{self, AssertUnwindSafe},
    path::{Path, PathBuf},
};
use thiserror::Error;

/// The longest line of JSON that is read, bytes.
const LINE_BYTES_MAX: u64 = 1 << 20;

/// Rows that are decoded together.
const BATCH_ROWS: usize = 1024;

/// Why a manifest cannot be read.
#[derive(Debug, Error)]
pub enum ReadError {
    /// Its name ends in nothing known.
    #[error("{}: a manifest's name ends in .jsonl, .csv or .parquet", .0.display())]
    Format(PathBuf),
    /// A row cannot be understood.
    #[error("{}, row {row}: {reason}", path.display())]
    Row {
        /// The file.
        path: PathBuf,
        /// Counted from 1, without the line of names.
        row: u64,
        /// What is wrong.
        reason: String,
    },
    /// The file as a whole cannot be understood.
    #[error("{}: {reason}", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
    /// The specification inside is not valid.
    #[error("{}: {source}", path.display())]
    Specification {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        source: Box<SpecificationError>,
    },
    /// The system would not read it.
    #[error(transparent)]
    File(#[from] FileError),
}

impl Format {
    /// The format that a file's name says.
    ///
    /// # Errors
    /// When it says none.
    pub fn of(path: &Path) -> Result<Self, ReadError> {
        let ending = path.extension().and_then(|ending| ending.to_str());
        Self::ALL
            .into_iter()
            .find(|format| ending == Some(format.ending()))
            .ok_or_else(|| ReadError::Format(path.to_owned()))
    }
}

/// Hands all rows of a manifest to `take`, in order, with their numbers, counted from 1.
///
/// # Errors
/// At the first row that cannot be understood, or when `take` fails.
pub fn read<E: From<ReadError>>(
    path: &Path,
    mut take: impl FnMut(u64, Row) -> Result<(), E>,
) -> Result<(), E> {
    match Format::of(path)? {
        Format::Jsonl => read_jsonl(path, &mut take),
        Format::Csv => read_csv(path, &mut take),
        Format::Parquet => read_parquet(path, &mut take),
    }
}

/// The specification that a Parquet manifest carries.
///
/// # Errors
/// When it is of another format, or has none.
pub fn read_specification(path: &Path) -> Result<Specification, ReadError> {
    let damaged = |reason: String| ReadError::Damaged {
        path: path.to_owned(),
        reason,
    };
    let json = read_metadata(path, SPECIFICATION_KEY)?
        .ok_or_else(|| damaged("it carries no specification".to_owned()))?;
    Specification::from_json(&json).map_err(|source| ReadError::Specification {
        path: path.to_owned(),
        source: Box::new(source),
    })
}

/// The value of a key of a Parquet file's metadata; `None` where it has none.
pub(crate) fn read_metadata(path: &Path, key: &str) -> Result<Option<String>, ReadError> {
    let builder = open_parquet(path)?;
    let entries = builder.metadata().file_metadata().key_value_metadata();
    let entry = entries.and_then(|entries| entries.iter().find(|entry| entry.key == key));
    Ok(entry.and_then(|entry| entry.value.clone()))
}

fn bad_row(path: &Path, row: u64, reason: impl ToString) -> ReadError {
    ReadError::Row {
        path: path.to_owned(),
        row,
        reason: reason.to_string(),
    }
}

fn read_jsonl<E: From<ReadError>>(
    path: &Path,
    take: &mut impl FnMut(u64, Row) -> Result<(), E>,
) -> Result<(), E> {
    let file = File::open(path)
        .map_err(unable("read", path))
        .map_err(ReadError::from)?;
    let mut file = BufReader::new(file);
    let mut line = Vec::new();
    for number in 1.. {
        line.clear();
        let read = file
            .by_ref()
            .take(LINE_BYTES_MAX)
            .read_until(b'\n', &mut line);
        if read
            .map_err(unable("read", path))
            .map_err(ReadError::from)?
            == 0
        {
            break;
        }
        if line.len() as u64 == LINE_BYTES_MAX {
            let reason = format!("it is longer than {LINE_BYTES_MAX} bytes");
            return Err(bad_row(path, number, reason).into());
        }
        let row = row_of_json(&line).map_err(|reason| bad_row(path, number, reason))?;
        take(number, row)?;
    }
    Ok(())
}

fn row_of_json(line: &[u8]) -> Result<Row, String> {
    let object: serde_json::Map<String, serde_json::Value> =
        serde_json::from_slice(line).map_err(|error| error.to_string())?;
    if let Some(unknown) = object
        .keys()
        .find(|key| !columns().iter().any(|column| column.name == **key))
    {
        return Err(format!("there is no column {unknown:?}"));
    }
    let values = columns()
        .iter()
        .map(|column| {
            let Some(field) = object.get(column.name) else {
                return missing(column);
            };
            value_of_json(column, field)
                .ok_or_else(|| format!("{} is {field}, which is no {:?}", column.name, column.kind))
        })
        .collect::<Result<Vec<Value>, String>>()?;
    Row::from_values(values).ok_or_else(|| "it has values of other types".to_owned())
}

/// The value of a column that a manifest lacks: nothing where earlier versions wrote none.
fn missing(column: &Column) -> Result<Value, String> {
    if column.optional {
        Ok(Value::Missing)
    } else {
        Err(format!("{} is missing", column.name))
    }
}

fn value_of_json(column: &Column, field: &serde_json::Value) -> Option<Value> {
    Some(match column.kind {
        Kind::Text => Value::Text(field.as_str()?.to_owned()),
        Kind::U32 => Value::U32(field.as_u64()?.try_into().ok()?),
        Kind::U64 => Value::U64(field.as_u64()?),
        Kind::F64 => Value::F64(field.as_f64()?),
        Kind::Bool => Value::Bool(field.as_bool()?),
        Kind::F64List(_) => {
            let numbers = field.as_array()?.iter();
            Value::F64List(
                numbers
                    .map(serde_json::Value::as_f64)
                    .collect::<Option<_>>()?,
            )
        }
    })
}

fn read_csv<E: From<ReadError>>(
    path: &Path,
    take: &mut impl FnMut(u64, Row) -> Result<(), E>,
) -> Result<(), E> {
    let damaged = |error: csv::Error| {
        if error.is_io_error() {
            ReadError::File(unable("read", path)(io::Error::from(error)))
        } else {
            ReadError::Damaged {
                path: path.to_owned(),
                reason: error.to_string(),
            }
        }
    };
    let mut reader = csv::Reader::from_path(path).map_err(damaged)?;
    let expected = super::csv::names();
    let names = reader.headers().map_err(damaged)?;
    // Manifests of earlier versions end sooner, among the optional columns.
    let fields = names.len().clamp(required_fields(), expected.len());
    let expected = expected.iter().take(fields);
    if let Some((found, name)) = names
        .iter()
        .chain(std::iter::repeat(""))
        .zip(expected)
        .find(|(found, name)| found != name)
    {
        let reason = format!("a column is called {found:?} where {name} is expected");
        return Err(bad_row(path, 0, reason).into());
    }
    let mut record = csv::StringRecord::new();
    for number in 1.. {
        if !reader.read_record(&mut record).map_err(damaged)? {
            break;
        }
        let row = row_of_record(&record, fields).map_err(|reason| bad_row(path, number, reason))?;
        take(number, row)?;
    }
    Ok(())
}

/// How many fields a row has without the optional columns, which are the last.
fn required_fields() -> usize {
    let required = columns().iter().filter(|column| !column.optional);
    let fields = required.map(|column| match column.kind {
        Kind::F64List(length) => length,
        _ => 1,
    });
    fields.sum()
}

/// The row of a record whose manifest has this many fields a row.
fn row_of_record(record: &csv::StringRecord, count: usize) -> Result<Row, String> {
    let mut fields = record.iter().take(count);
    let mut left = count;
    let values = columns()
        .iter()
        .map(|column| {
            if left == 0 && column.optional {
                return Ok(Value::Missing);
            }
            let mut next = || {
                left = left.saturating_sub(1);
                fields.next().unwrap_or_default()
            };
            let field = next();
            let wrong = || {
                format!(
                    "{} is {field:?}, which is no {:?}",
                    column.name, column.kind
                )
            };
            let value = match column.kind {
                Kind::Text => Some(Value::Text(field.to_owned())),
                Kind::U32 => field.parse().ok().map(Value::U32),
                Kind::U64 => field.parse().ok().map(Value::U64),
                Kind::F64 => field.parse().ok().map(Value::F64),
                Kind::Bool => field.parse().ok().map(Value::Bool),
                Kind::F64List(length) => {
                    let rest = (1..length).map(|_| next());
                    let numbers = std::iter::once(field).chain(rest);
                    let numbers: Option<Vec<f64>> = numbers.map(|n| n.parse().ok()).collect();
                    numbers.map(Value::F64List)
                }
            };
            value.ok_or_else(wrong)
        })
        .collect::<Result<Vec<Value>, String>>()?;
    Row::from_values(values).ok_or_else(|| "it has values of other types".to_owned())
}

fn open_parquet(path: &Path) -> Result<ParquetRecordBatchReaderBuilder<File>, ReadError> {
    let file = File::open(path).map_err(unable("read", path))?;
    guarded(path, || ParquetRecordBatchReaderBuilder::try_new(file))
}

/// The decoder is not ours: should some input make it panic, the file is damaged like any other.
fn guarded<T>(
    path: &Path,
    decode: impl FnOnce() -> Result<T, ParquetError>,
) -> Result<T, ReadError> {
    let damaged = |reason| ReadError::Damaged {
        path: path.to_owned(),
        reason,
    };
    panic::catch_unwind(AssertUnwindSafe(decode))
        .map_err(|_| damaged("the decoder gave up on it".to_owned()))?
        .map_err(|error| damaged(error.to_string()))
}

fn read_parquet<E: From<ReadError>>(
    path: &Path,
    take: &mut impl FnMut(u64, Row) -> Result<(), E>,
) -> Result<(), E> {
    let mut number = 0;
    each_batch(path, |batch| {
        for place in 0..batch.num_rows() {
            number += 1;
            let row = row_of_batch(batch, place).map_err(|reason| bad_row(path, number, reason))?;
            take(number, row)?;
        }
        Ok(())
    })
}

/// Hands all rows of a Parquet file to `take`, some at a time, in order.
pub(crate) fn each_batch<E: From<ReadError>>(
    path: &Path,
    mut take: impl FnMut(&RecordBatch) -> Result<(), E>,
) -> Result<(), E> {
    let builder = open_parquet(path)?;
    let mut batches = guarded(path, || builder.with_batch_size(BATCH_ROWS).build())?;
    loop {
        let next = guarded(path, || {
            batches
                .next()
                .transpose()
                .map_err(|error| ParquetError::External(Box::new(error)))
        })?;
        let Some(batch) = next else { return Ok(()) };
        take(&batch)?;
    }
}

fn row_of_batch(batch: &RecordBatch, place: usize) -> Result<Row, String> {
    let values = columns()
        .iter()
        .map(|column| {
            let Some(array) = batch.column_by_name(column.name) else {
                return missing(column);
            };
            value_of_array(column, array.as_ref(), place)
                .ok_or_else(|| format!("{} is no {:?}", column.name, column.kind))
        })
        .collect::<Result<Vec<Value>, String>>()?;
    Row::from_values(values).ok_or_else(|| "it has values of other types".to_owned())
}

fn value_of_array(column: &Column, array: &dyn Array, place: usize) -> Option<Value> {
    if array.is_null(place) {
        return None;
    }
    let any = array.as_any();
    Some(match column.kind {
        Kind::Text => Value::Text(any.downcast_ref::<StringArray>()?.value(place).to_owned()),
        Kind::U32 => Value::U32(any.downcast_ref::<UInt32Array>()?.value(place)),
        Kind::U64 => Value::U64(any.downcast_ref::<UInt64Array>()?.value(place)),
        Kind::F64 => Value::F64(any.downcast_ref::<Float64Array>()?.value(place)),
        Kind::Bool => Value::Bool(any.downcast_ref::<BooleanArray>()?.value(place)),
        Kind::F64List(_) => {
            let list = any.downcast_ref::<FixedSizeListArray>()?.value(place);
            Value::F64List(
                list.as_any()
                    .downcast_ref::<Float64Array>()?
                    .values()
                    .to_vec(),
            )
        }
    })
}

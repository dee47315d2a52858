use crate::{
    cheap_image::small_specification,
    complete_store::{completion, make_store},
};
use arrow_array::{
    Array, BooleanArray, FixedSizeListArray, Float64Array, RecordBatch, StringArray, UInt32Array,
    UInt64Array,
};
use dataset::manifest::{Kind, Row, Value, columns};
use datastore::ReadOnlyStore;
use export::{
    ExportError,
    manifest::{Exported, Format, export},
};
use parquet::arrow::arrow_reader::ParquetRecordBatchReaderBuilder;
use std::fs::{self, File};

const MATERIALS: u32 = 7;

fn complete_store() -> (tempfile::TempDir, ReadOnlyStore, Vec<Row>) {
    let folder = tempfile::tempdir().unwrap();
    let specification = small_specification(MATERIALS);
    // Completed in any order, exported in one.
    make_store(folder.path(), &specification, [3, 0, 6, 1, 5, 2, 4]);
    let mut rows = Vec::new();
    for material in 0..MATERIALS {
        let sampled = specification.material(material);
        let (completion, _) = completion(&specification, material);
        for (view, done) in (0..).zip(&completion.views) {
            let hash = specification.hash();
            rows.push(Row::new(&specification, hash, &sampled, view, done));
        }
    }
    let store = ReadOnlyStore::open(folder.path()).unwrap();
    (folder, store, rows)
}

#[test]
fn exporting_twice_gives_the_same_bytes() {
    let (folder, store, rows) = complete_store();
    for format in [Format::Jsonl, Format::Csv, Format::Parquet] {
        let paths: Vec<_> = (0..4)
            .map(|number| folder.path().join(format!("{number}")))
            .collect();
        for path in &paths {
            let exported = export(&store, format, false, path).unwrap();
            assert_eq!(exported.rows, rows.len() as u64);
        }
        let bytes = fs::read(&paths[0]).unwrap();
        for path in &paths[1..] {
            assert!(fs::read(path).unwrap() == bytes, "{format:?}");
        }
        assert!(!folder.path().join("0.new").exists());
    }
}

#[test]
fn json_lines_are_the_rows() {
    let (folder, store, rows) = complete_store();
    let path = folder.path().join("manifest.jsonl");
    export(&store, Format::Jsonl, false, &path).unwrap();
    let text = fs::read_to_string(path).unwrap();
    assert_eq!(text.lines().count(), rows.len());
    for (line, row) in text.lines().zip(rows) {
        assert_eq!(line, serde_json::to_string(&row).unwrap());
    }
}

#[test]
fn csv_reads_back_to_the_rows() {
    let (folder, store, rows) = complete_store();
    let path = folder.path().join("manifest.csv");
    export(&store, Format::Csv, false, &path).unwrap();
    let mut reader = csv::Reader::from_path(path).unwrap();
    let names = reader.headers().unwrap().clone();
    let records: Vec<csv::StringRecord> = reader.records().map(Result::unwrap).collect();
    assert_eq!(records.len(), rows.len());
    for (record, row) in records.iter().zip(rows) {
        let mut fields = names.iter().zip(record);
        for (column, value) in columns().iter().zip(row.values()) {
            let numbers = match value {
                Value::F64List(list) => list
                    .iter()
                    .enumerate()
                    .map(|(place, number)| (format!("{}_{place}", column.name), *number))
                    .collect(),
                Value::F64(number) => vec![(column.name.to_owned(), *number)],
                other => {
                    let text = match other {
                        Value::Text(text) => text.clone(),
                        Value::U32(number) => number.to_string(),
                        Value::U64(number) => number.to_string(),
                        Value::Bool(truth) => truth.to_string(),
                        Value::F64(_) | Value::F64List(_) | Value::Missing => {
                            unreachable!("matched before, and a manifest lacks nothing")
                        }
                    };
                    assert_eq!(fields.next(), Some((column.name, text.as_str())));
                    continue;
                }
            };
            for (expected_name, number) in numbers {
                let (name, field) = fields.next().unwrap();
                assert_eq!(name, expected_name);
                assert_eq!(field.parse::<f64>().unwrap().to_bits(), number.to_bits());
            }
        }
        assert_eq!(fields.next(), None);
    }
}

#[test]
fn parquet_reads_back_to_the_rows_with_units_and_specification() {
    let (folder, store, rows) = complete_store();
    let path = folder.path().join("manifest.parquet");
    export(&store, Format::Parquet, false, &path).unwrap();
    let builder = ParquetRecordBatchReaderBuilder::try_new(File::open(path).unwrap()).unwrap();
    let metadata = builder.metadata().file_metadata().clone();
    let entries = metadata.key_value_metadata().unwrap();
    let specification = entries
        .iter()
        .find(|entry| entry.key == "brdfarm.specification")
        .unwrap();
    assert_eq!(
        specification.value.as_deref(),
        Some(store.specification().to_json().as_str())
    );
    for (field, column) in builder.schema().fields().iter().zip(columns()) {
        assert_eq!(field.name(), column.name);
        assert!(!field.is_nullable());
        assert_eq!(field.metadata()["unit"], column.unit);
        assert_eq!(field.metadata()["description"], column.description);
    }
    let batches: Vec<RecordBatch> = builder.build().unwrap().map(Result::unwrap).collect();
    let mut read = Vec::new();
    for batch in &batches {
        for row in 0..batch.num_rows() {
            let values = columns().iter().zip(batch.columns());
            read.push(
                values
                    .map(|(column, array)| value(array.as_ref(), column.kind, row))
                    .collect::<Vec<Value>>(),
            );
        }
    }
    let expected: Vec<Vec<Value>> = rows.iter().map(|row| row.values().to_vec()).collect();
    assert_eq!(read, expected);
}

fn value(array: &dyn Array, kind: Kind, row: usize) -> Value {
    let any = array.as_any();
    match kind {
        Kind::Text => {
            let strings = any.downcast_ref::<StringArray>().unwrap();
            Value::Text(strings.value(row).to_owned())
        }
        Kind::U32 => Value::U32(any.downcast_ref::<UInt32Array>().unwrap().value(row)),
        Kind::U64 => Value::U64(any.downcast_ref::<UInt64Array>().unwrap().value(row)),
        Kind::F64 => Value::F64(any.downcast_ref::<Float64Array>().unwrap().value(row)),
        Kind::Bool => Value::Bool(any.downcast_ref::<BooleanArray>().unwrap().value(row)),
        Kind::F64List(length) => {
            let lists = any.downcast_ref::<FixedSizeListArray>().unwrap();
            let list = lists.value(row);
            let list = list.as_any().downcast_ref::<Float64Array>().unwrap();
            assert_eq!(list.len(), length);
            Value::F64List(list.values().to_vec())
        }
    }
}

#[test]
fn a_set_with_holes_is_refused_unless_partial() {
    let folder = tempfile::tempdir().unwrap();
    let specification = small_specification(MATERIALS);
    make_store(folder.path(), &specification, [1, 5]);
    let store = ReadOnlyStore::open(folder.path()).unwrap();
    let path = folder.path().join("manifest.jsonl");
    let refused = export(&store, Format::Jsonl, false, &path).unwrap_err();
    assert!(
        matches!(refused, ExportError::Incomplete { missing: 5, .. }),
        "{refused}"
    );
    assert!(!path.exists());
    for format in [Format::Jsonl, Format::Csv, Format::Parquet] {
        let exported = export(&store, format, true, &path).unwrap();
        let expected = Exported {
            rows: 6,
            materials_missing: 5,
        };
        assert_eq!(exported, expected);
    }
}

#[test]
fn a_manifest_that_cannot_be_written_leaves_nothing() {
    let (folder, store, _) = complete_store();
    let path = folder.path().join("no such folder/manifest.csv");
    assert!(export(&store, Format::Csv, false, &path).is_err());
    let taken = folder.path().join("taken");
    fs::create_dir(&taken).unwrap();
    assert!(export(&store, Format::Csv, false, &taken).is_err());
}

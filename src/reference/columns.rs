//! The page of the manifest's columns.

use super::markdown::{head, prose, table};
use dataset::manifest::{Column, Kind, columns};

const INTRODUCTION: &str = "\
A manifest has one row for each image. `brdfarm dataset manifest export` writes it as Parquet, CSV or \
JSON Lines, and every export has one beside its images. The columns are the same in all formats, in \
this order. In CSV a list becomes columns `name_0`, `name_1` and so on. In Parquet the unit and the \
meaning of a column are metadata of its field.

The type `uint32` is an unsigned integer of 32 bits, and `float64[3]` is a list of three 64-bit floats. \
Unit `1` means a pure number. Unit `white` is the radiance of a perfect white diffuser at the origin \
that faces the bulb. Matrices are stored row by row.

";

/// The page.
pub fn page() -> String {
    let mut page = head("The columns of a manifest") + INTRODUCTION;
    page += "No value is ever null.\n\n";
    if columns().iter().any(|column| column.optional) {
        page += "Manifests of earlier versions lack the columns that are marked \"newer\".\n\n";
    }
    page += &table(
        ["column", "type", "unit", "meaning"],
        columns().iter().map(row),
    );
    page
}

fn row(column: &Column) -> [String; 4] {
    let newer = if column.optional { " (newer)" } else { "" };
    [
        format!("`{}`{newer}", column.name),
        kind(column.kind),
        column.unit.to_owned(),
        prose(column.description),
    ]
}

fn kind(kind: Kind) -> String {
    match kind {
        Kind::Text => "text".to_owned(),
        Kind::U32 => "uint32".to_owned(),
        Kind::U64 => "uint64".to_owned(),
        Kind::F64 => "float64".to_owned(),
        Kind::Bool => "boolean".to_owned(),
        Kind::F64List(length) => format!("float64[{length}]"),
    }
}

//! One row for an image: everything a reader may want to know of it, column by column.
//!
//! A manifest is a function of the images: it has no seconds and no workers' names. The columns
//! are data, [`columns`], so every format is written from the same table.

mod columns;

use crate::{
    Digest, ErrorStatistics, SampledMaterial, Specification, ViewGeometry, sobol::DIMENSIONS,
    specification::View,
};
use columns::COLUMNS;
use serde::{Deserialize, Serialize, Serializer, ser::SerializeMap};

/// What is known of an image that is in the store.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CompletedView {
    /// The digest of the file.
    pub digest: Digest,
    /// The size of the file.
    pub bytes: u64,
    /// The measured error and its cost.
    pub statistics: ErrorStatistics,
}

/// Where a store keeps an image, relative to the store: `blobs/` and the first two digits, then all
/// digits and `.exr`. 256 folders keep each small.
pub fn blob_path(digest: &Digest) -> String {
    let hex = digest.to_string();
    format!("blobs/{}/{hex}.exr", &hex[..2])
}

/// The type of a column's values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// UTF-8 text.
    Text,
    /// An unsigned integer of 32 bits.
    U32,
    /// An unsigned integer of 64 bits.
    U64,
    /// A finite 64-bit float.
    F64,
    /// True or false.
    Bool,
    /// So many finite 64-bit floats; matrices are row-major.
    F64List(usize),
}

/// The value of one column in one row.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum Value {
    /// Of [`Kind::Text`].
    Text(String),
    /// Of [`Kind::U32`].
    U32(u32),
    /// Of [`Kind::U64`].
    U64(u64),
    /// Of [`Kind::F64`].
    F64(f64),
    /// Of [`Kind::Bool`].
    Bool(bool),
    /// Of [`Kind::F64List`].
    F64List(Vec<f64>),
}

impl Value {
    /// The kind of column that the value fits.
    pub fn kind(&self) -> Kind {
        match self {
            Self::Text(_) => Kind::Text,
            Self::U32(_) => Kind::U32,
            Self::U64(_) => Kind::U64,
            Self::F64(_) => Kind::F64,
            Self::Bool(_) => Kind::Bool,
            Self::F64List(list) => Kind::F64List(list.len()),
        }
    }
}

/// A column of the manifest.
#[derive(Clone, Copy, Debug)]
pub struct Column {
    /// The name, in lower case with underscores.
    pub name: &'static str,
    /// The type of its values.
    pub kind: Kind,
    /// The unit, `"1"` for pure numbers, empty for what is no quantity.
    pub unit: &'static str,
    /// One sentence.
    pub description: &'static str,
    value: fn(&Image<'_>) -> Value,
}

/// All that a row is worked out from.
struct Image<'a> {
    specification: &'a Specification,
    specification_hash: Digest,
    sampled: &'a SampledMaterial,
    bins: [u8; DIMENSIONS],
    view_index: u32,
    view: &'a View,
    geometry: ViewGeometry,
    done: &'a CompletedView,
}

/// The columns in order.
pub fn columns() -> &'static [Column] {
    &COLUMNS
}

/// One image's values.
#[derive(Clone, Debug, PartialEq)]
pub struct Row(Vec<Value>);

impl Row {
    /// The row of an image.
    ///
    /// # Panics
    ///
    /// If the specification has no view of that index. Whoever completed the image has already
    /// refused it.
    pub fn new(
        specification: &Specification,
        specification_hash: Digest,
        sampled: &SampledMaterial,
        view: u32,
        done: &CompletedView,
    ) -> Self {
        let place = view as usize;
        let (Some(geometry), Some(described)) = (
            specification.view_geometry(place),
            specification.views.get(place),
        ) else {
            unreachable!("a row of view {view}, but the specification has none of that index");
        };
        let image = Image {
            specification,
            specification_hash,
            sampled,
            bins: sampled.bins(),
            view_index: view,
            view: described,
            geometry,
            done,
        };
        Self(
            COLUMNS
                .iter()
                .map(|column| (column.value)(&image))
                .collect(),
        )
    }

    /// The values, in the order of [`columns`] and of their kinds.
    pub fn values(&self) -> Vec<Value> {
        self.0.clone()
    }
}

/// A map from the columns' names to the values, in the columns' order. As JSON every number reads
/// back to the same bits.
impl Serialize for Row {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(Some(self.0.len()))?;
        for (column, value) in COLUMNS.iter().zip(&self.0) {
            map.serialize_entry(column.name, value)?;
        }
        map.end()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    fn completed() -> CompletedView {
        CompletedView {
            digest: Digest::of(b"an image"),
            bytes: 31_415,
            statistics: ErrorStatistics {
                mean: 0.1 + 0.2,
                p95: 1e-3 / 3.0,
                max: f64::MIN_POSITIVE,
                within_target: 1.0 - f64::EPSILON,
                samples: (1 << 63) + 1,
                evaluations: 7,
            },
        }
    }

    fn row(material: u32, view: u32) -> Row {
        let preset = Specification::preset();
        let sampled = preset.material(material);
        Row::new(&preset, preset.hash(), &sampled, view, &completed())
    }

    #[test]
    fn values_have_the_kinds_of_their_columns() {
        for view in 0..14 {
            let values = row(5, view).values();
            assert_eq!(values.len(), columns().len());
            for (column, value) in columns().iter().zip(values) {
                assert_eq!(value.kind(), column.kind, "{}", column.name);
            }
        }
    }

    #[test]
    fn columns_are_described_once_each() {
        let names: BTreeSet<_> = columns().iter().map(|column| column.name).collect();
        assert_eq!(names.len(), columns().len());
        for column in columns() {
            assert!(column.description.ends_with('.'), "{}", column.name);
            let plain = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_';
            assert!(column.name.chars().all(plain), "{}", column.name);
        }
    }

    #[test]
    fn described_bin_ranges_are_those_of_the_bins() {
        for (name, [low, high]) in crate::colour::BIN_RANGES {
            let name = format!("bin_{name}");
            let column = columns().iter().find(|column| column.name == name).unwrap();
            assert!(
                column
                    .description
                    .contains(&format!("over {low} to {high} ")),
                "{}",
                column.description
            );
        }
    }

    #[test]
    fn json_reads_back_to_the_same_bits() {
        for material in 0..200 {
            let row = row(material, material % 14);
            let json = serde_json::to_string(&row).unwrap();
            let read: serde_json::Value = serde_json::from_str(&json).unwrap();
            for (column, value) in columns().iter().zip(row.values()) {
                let field = &read[column.name];
                match value {
                    Value::Text(text) => assert_eq!(field.as_str(), Some(text.as_str())),
                    Value::U32(number) => assert_eq!(field.as_u64(), Some(number.into())),
                    Value::U64(number) => assert_eq!(field.as_u64(), Some(number)),
                    Value::Bool(truth) => assert_eq!(field.as_bool(), Some(truth)),
                    Value::F64(number) => same_bits(field, number),
                    Value::F64List(list) => {
                        assert_eq!(field.as_array().map(Vec::len), Some(list.len()));
                        for (place, number) in list.into_iter().enumerate() {
                            same_bits(&field[place], number);
                        }
                    }
                }
            }
        }
    }

    fn same_bits(field: &serde_json::Value, number: f64) {
        assert_eq!(field.as_f64().map(f64::to_bits), Some(number.to_bits()));
    }

    #[test]
    fn the_path_is_the_digest() {
        let digest = Digest::from_bytes(std::array::from_fn(|place| place as u8 + 0xa0));
        let path = blob_path(&digest);
        assert_eq!(path, format!("blobs/a0/{digest}.exr"));
        assert_eq!(path.len(), 6 + 3 + 64 + 4);
    }
}

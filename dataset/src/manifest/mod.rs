//! One row for an image: everything a reader may want to know of it, column by column.
//!
//! A manifest is a function of the images: it has no seconds and no workers' names. The columns
//! are data, [`columns()`], so every format is written from the same table.

mod column;
mod columns;

use crate::{
    Digest, ErrorStatistics, ParseDigestError, PixelStatistics, SampledMaterial, Specification,
};
use column::Image;
pub use column::{Column, CompletedView, Kind, Value, blob_path};
use columns::COLUMNS;
use serde::{Serialize, Serializer, ser::SerializeMap};
use std::fmt;

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
        let index = view as usize;
        let (Some(geometry), Some(described)) = (
            specification.view_geometry(index),
            specification.views.get(index),
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

    /// The row of these values, which were read from somewhere; `None` unless they are as many as
    /// the [`columns()`] and of their kinds.
    pub fn from_values(values: Vec<Value>) -> Option<Self> {
        let fits = values.len() == COLUMNS.len()
            && COLUMNS
                .iter()
                .zip(&values)
                .all(|(column, value)| value.fits(column));
        fits.then_some(Self(values))
    }

    /// The same row of an image that is kept in another file.
    pub fn with_path(mut self, path: String) -> Self {
        if let Some(place) = column_index("path") {
            self.0[place] = Value::Text(path);
        }
        self
    }

    /// The values, in the order of [`columns()`] and of their kinds.
    pub fn values(&self) -> &[Value] {
        &self.0
    }

    /// The value of the column `name`; `None` where there is no such column.
    pub fn value(&self, name: &str) -> Option<&Value> {
        self.0.get(column_index(name)?)
    }

    /// The material's and the view's index.
    pub fn image(&self) -> (u32, u32) {
        let index = |name| match self.value(name) {
            Some(Value::U32(index)) => *index,
            _ => unreachable!("every row has a {name}"),
        };
        (index("material"), index("view"))
    }

    /// What the row says of the image's file.
    ///
    /// # Errors
    /// When the digest is none; rows that were made by [`Row::new`] have one.
    pub fn completed_view(&self) -> Result<CompletedView, ParseDigestError> {
        let (mut digest, mut bytes) = ("", 0);
        let mut statistics = ErrorStatistics {
            mean: 0.0,
            p95: 0.0,
            max: 0.0,
            within_target: 0.0,
            samples: 0,
            evaluations: 0,
        };
        for (column, value) in COLUMNS.iter().zip(&self.0) {
            match (column.name, value) {
                ("digest", Value::Text(text)) => digest = text,
                ("bytes", Value::U64(number)) => bytes = *number,
                ("error_mean", Value::F64(number)) => statistics.mean = *number,
                ("error_p95", Value::F64(number)) => statistics.p95 = *number,
                ("error_max", Value::F64(number)) => statistics.max = *number,
                ("within_target", Value::F64(number)) => statistics.within_target = *number,
                ("samples", Value::U64(number)) => statistics.samples = *number,
                ("evaluations", Value::U64(number)) => statistics.evaluations = *number,
                _ => {}
            }
        }
        let number = |name| match self.value(name) {
            Some(Value::F64(number)) => Some(*number),
            _ => None,
        };
        let pixels = || {
            Some(PixelStatistics {
                sample_share: number("sample_share")?,
                brightness_mean: number("brightness_mean")?,
                brightness_p99: number("brightness_p99")?,
                dark_share: number("dark_share")?,
                above_white_share: number("above_white_share")?,
            })
        };
        Ok(CompletedView {
            digest: digest.parse()?,
            bytes,
            statistics,
            pixels: pixels(),
        })
    }

    /// The first column whose value is not `other`'s, apart from where the image is kept and from what
    /// one of them lacks. Numbers are compared bit by bit.
    pub fn first_difference(&self, other: &Self) -> Option<&'static Column> {
        let mut columns = COLUMNS.iter().zip(self.0.iter().zip(&other.0));
        let different = columns
            .find(|(column, (mine, theirs))| column.name != "path" && !same_bits(mine, theirs));
        different.map(|(column, _)| column)
    }
}

fn column_index(name: &str) -> Option<usize> {
    COLUMNS.iter().position(|column| column.name == name)
}

fn same_bits(a: &Value, b: &Value) -> bool {
    match (a, b) {
        (Value::F64(a), Value::F64(b)) => a.to_bits() == b.to_bits(),
        (Value::F64List(a), Value::F64List(b)) => {
            let bits = |list: &[f64]| list.iter().map(|number| number.to_bits()).collect();
            let (a, b): (Vec<u64>, Vec<u64>) = (bits(a), bits(b));
            a == b
        }
        (Value::Missing, _) | (_, Value::Missing) => true,
        (a, b) => a == b,
    }
}

impl fmt::Display for Value {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Text(text) => formatter.write_str(text),
            Self::U32(number) => write!(formatter, "{number}"),
            Self::U64(number) => write!(formatter, "{number}"),
            Self::F64(number) => write!(formatter, "{number:?}"),
            Self::Bool(truth) => write!(formatter, "{truth}"),
            Self::F64List(list) => write!(formatter, "{list:?}"),
            Self::Missing => Ok(()),
        }
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
            pixels: Some(PixelStatistics {
                sample_share: 0.25,
                brightness_mean: 0.1 / 3.0,
                brightness_p99: 2.0 / 3.0,
                dark_share: 1.0 - f64::EPSILON,
                above_white_share: f64::MIN_POSITIVE,
            }),
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
            let row = row(5, view);
            let values = row.values();
            assert_eq!(values.len(), columns().len());
            for (column, value) in columns().iter().zip(values) {
                assert!(value.fits(column), "{}", column.name);
            }
        }
    }

    #[test]
    fn a_row_tells_what_it_was_made_of() {
        let made = row(5, 3);
        assert_eq!(made.image(), (5, 3));
        assert_eq!(made.completed_view().unwrap(), completed());
        let read = Row::from_values(made.values().to_vec()).unwrap();
        assert_eq!(read, made);
        assert_eq!(Row::from_values(made.values()[1..].to_vec()), None);
        let moved = read.with_path("elsewhere".to_owned());
        assert!(moved.first_difference(&made).is_none());
        for (place, column) in columns().iter().enumerate() {
            if column.name == "path" {
                continue;
            }
            let mut values = made.values().to_vec();
            values[place] = match &values[place] {
                Value::Text(text) => Value::Text(format!("{text}0")),
                Value::U32(number) => Value::U32(number + 1),
                Value::U64(number) => Value::U64(number ^ 1),
                Value::F64(number) => Value::F64(number.next_up()),
                Value::Bool(truth) => Value::Bool(!truth),
                Value::F64List(list) => {
                    let mut list = list.clone();
                    list[0] = list[0].next_up();
                    Value::F64List(list)
                }
                Value::Missing => unreachable!("it was just made"),
            };
            let edited = Row::from_values(values).unwrap();
            let found = edited.first_difference(&made).map(|column| column.name);
            assert_eq!(found, Some(column.name));
        }
    }

    #[test]
    fn what_earlier_versions_did_not_write_is_no_difference() {
        let made = row(5, 3);
        let mut values = made.values().to_vec();
        for (value, column) in values.iter_mut().zip(columns()) {
            if column.optional {
                *value = Value::Missing;
            }
        }
        let earlier = Row::from_values(values.clone()).unwrap();
        assert!(earlier.first_difference(&made).is_none());
        assert_eq!(earlier.completed_view().unwrap().pixels, None);
        values[0] = Value::Missing;
        assert_eq!(Row::from_values(values), None);
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
                    Value::U32(number) => assert_eq!(field.as_u64(), Some((*number).into())),
                    Value::U64(number) => assert_eq!(field.as_u64(), Some(*number)),
                    Value::Bool(truth) => assert_eq!(field.as_bool(), Some(*truth)),
                    Value::F64(number) => assert_bits(field, *number),
                    Value::F64List(list) => {
                        assert_eq!(field.as_array().map(Vec::len), Some(list.len()));
                        for (place, number) in list.iter().enumerate() {
                            assert_bits(&field[place], *number);
                        }
                    }
                    Value::Missing => panic!("{}", column.name),
                }
            }
        }
    }

    fn assert_bits(field: &serde_json::Value, number: f64) {
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

//! What a column is, and what a row is worked out from.

use crate::{
    Digest, ErrorStatistics, PixelStatistics, SampledMaterial, Specification, ViewGeometry,
    sobol::DIMENSIONS, specification::View,
};
use serde::{Deserialize, Serialize};

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
    /// How bright it is; absent where an earlier version recorded the image. It can be worked out from
    /// the pixels.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pixels: Option<PixelStatistics>,
}

impl CompletedView {
    /// Whether both say the same of one image, as far as both say it: earlier versions recorded no
    /// brightness.
    pub fn agrees_with(&self, other: &Self) -> bool {
        let brightness = self.pixels.zip(other.pixels);
        self.digest == other.digest
            && self.bytes == other.bytes
            && self.statistics == other.statistics
            && brightness.is_none_or(|(one, other)| one == other)
    }
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
    /// This many finite 64-bit floats; matrices are row-major.
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
    /// Nothing is known. Only in a column that may be absent ([`Column::optional`]): in a row that was
    /// read from a manifest of an earlier version, that is of an image which an earlier version
    /// recorded, or that is of a specification whose mesh is not loaded. No manifest is written with it.
    Missing,
}

impl Value {
    /// Whether the value can stand in a column.
    pub fn fits(&self, column: &Column) -> bool {
        let kind = match self {
            Self::Text(_) => Kind::Text,
            Self::U32(_) => Kind::U32,
            Self::U64(_) => Kind::U64,
            Self::F64(_) => Kind::F64,
            Self::Bool(_) => Kind::Bool,
            Self::F64List(list) => Kind::F64List(list.len()),
            Self::Missing => return column.optional,
        };
        kind == column.kind
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
    /// Whether a manifest may lack it: earlier versions wrote none.
    pub optional: bool,
    pub(super) value: fn(&Image<'_>) -> Value,
}

/// All that a row is worked out from.
pub(super) struct Image<'a> {
    pub(super) specification: &'a Specification,
    pub(super) specification_hash: Digest,
    pub(super) sampled: &'a SampledMaterial,
    pub(super) bins: [u8; DIMENSIONS],
    pub(super) view_index: u32,
    pub(super) view: &'a View,
    pub(super) geometry: ViewGeometry,
    pub(super) done: &'a CompletedView,
}

//! Why a file is no mesh that can be rendered.

use crate::limits::{
    COORDINATE_MAX, FILE_BYTES_MAX, SIDE_FRACTION_MIN, SIDE_MIN, TRIANGLES_MAX, VERTICES_MAX,
};
use std::fmt::{self, Display, Formatter};

/// Why a file is no mesh that can be rendered: one sentence, which names the place.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum MeshError {
    /// The file is larger than [`FILE_BYTES_MAX`].
    #[error(
        "the file has {bytes} bytes, but a mesh may have at most {FILE_BYTES_MAX}: simplify it"
    )]
    FileTooLarge {
        /// The file's length.
        bytes: u64,
    },
    /// A line of a text is not what the format allows.
    #[error("line {line}: {message}")]
    Syntax {
        /// The line, counted from 1.
        line: usize,
        /// What is wrong.
        message: String,
    },
    /// The header of a PLY file lacks something that is needed.
    #[error("the PLY header {message}")]
    PlyHeader {
        /// What is wrong, as the sentence goes on.
        message: String,
    },
    /// A value of a PLY file cannot be what it is.
    #[error("{element} {index}: property `{property}` {message}")]
    PlyValue {
        /// The element's name.
        element: String,
        /// Which of these elements, counted from 0.
        index: usize,
        /// The property's name.
        property: String,
        /// What is wrong, as the sentence goes on.
        message: &'static str,
    },
    /// The header of a PLY file announces more than the file has bytes for.
    #[error(
        "the PLY header announces {count} of element `{element}`, but the {bytes} bytes that \
         follow cannot hold them: the file is incomplete"
    )]
    PlyCount {
        /// The element's name.
        element: String,
        /// How many are announced.
        count: u64,
        /// How many bytes are left for them.
        bytes: usize,
    },
    /// The file ends too soon.
    #[error("the file is incomplete: it ends before {element} {index} of {count} is complete")]
    Truncated {
        /// The element's name.
        element: String,
        /// The element that is incomplete, counted from 0.
        index: usize,
        /// How many the header announces.
        count: u64,
    },
    /// More follows the last element of a PLY file.
    #[error(
        "the file goes on for {bytes} bytes after the last element that the PLY header announces: \
         header and data do not fit together"
    )]
    PlyExcess {
        /// How many bytes follow.
        bytes: usize,
    },
    /// There are no faces at all.
    #[error("the file has no faces: a point cloud cannot be rendered, so export a surface")]
    NoFaces,
    /// A face has too few or too many corners.
    #[error(
        "{place}: the face has {corners} corners: export the mesh with triangles or quadrilaterals"
    )]
    Corners {
        /// The face.
        place: Place,
        /// How many corners it has.
        corners: usize,
    },
    /// A face names something that is not there.
    #[error("{place}: {what} index {index} is out of range: {range}")]
    IndexOutOfRange {
        /// The face.
        place: Place,
        /// What the index counts.
        what: &'static str,
        /// The index, as it stands in the file.
        index: i64,
        /// Which indices are allowed.
        range: String,
    },
    /// Some corners have a normal or a texture coordinate, and others have none.
    #[error(
        "line {line}: some faces have {what} and others do not: export them for all faces or for none"
    )]
    Mixed {
        /// The first line that differs from those before it.
        line: usize,
        /// What some faces have.
        what: &'static str,
    },
    /// Lists that must be equally long are not.
    #[error("there are {count} {what} for {vertices} vertices")]
    Lengths {
        /// What the list holds.
        what: &'static str,
        /// How long it is.
        count: usize,
        /// How many vertices there are.
        vertices: usize,
    },
    /// There are more triangles than [`TRIANGLES_MAX`].
    #[error("the mesh has more than {TRIANGLES_MAX} triangles: simplify it")]
    TooManyTriangles,
    /// There are more vertices than [`VERTICES_MAX`].
    #[error("the mesh has more than {VERTICES_MAX} {what}, which its triangles cannot use")]
    TooManyVertices {
        /// What there is too much of.
        what: &'static str,
    },
    /// A number is NaN or infinite.
    #[error("{place}: the {attribute} is not finite")]
    NotFinite {
        /// Which one.
        place: Place,
        /// What it is.
        attribute: Attribute,
    },
    /// A coordinate is larger than [`COORDINATE_MAX`].
    #[error("{place}: a coordinate is beyond {COORDINATE_MAX:e}: export the mesh in larger units")]
    CoordinateTooLarge {
        /// The vertex.
        place: Place,
    },
    /// A normal or a tangent has no direction.
    #[error("{place}: the {attribute} has length zero: let the exporter compute it again")]
    ZeroLength {
        /// Which one.
        place: Place,
        /// What it is.
        attribute: Attribute,
    },
    /// Nothing is left to be rendered.
    #[error("the mesh has no triangle with an area")]
    Empty,
    /// The mesh is too small for its units or for its distance from the origin.
    #[error(
        "the mesh is too small: its longest side must be at least {SIDE_MIN:e}, and at least \
         {SIDE_FRACTION_MIN:e} of its largest coordinate: scale it, or move it to the origin"
    )]
    TooSmall,
}

/// What a vertex has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Attribute {
    /// Where it is.
    Position,
    /// Its normal.
    Normal,
    /// Its tangent.
    Tangent,
    /// Its texture coordinate.
    Uv,
}

impl Display for Attribute {
    fn fmt(&self, formatter: &mut Formatter<'_>) -> fmt::Result {
        formatter.write_str(match self {
            Self::Position => "position",
            Self::Normal => "normal",
            Self::Tangent => "tangent",
            Self::Uv => "texture coordinate",
        })
    }
}

/// A place in a file. OBJ files count everything from 1; PLY files count lines from 1, vertices and
/// faces from 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// A line of the text.
    Line(usize),
    /// A vertex.
    Vertex(usize),
    /// A normal of an OBJ file: the line `vn` of this number.
    Normal(usize),
    /// A texture coordinate of an OBJ file: the line `vt` of this number.
    Uv(usize),
    /// A face.
    Face(usize),
}

impl Display for Place {
    fn fmt(&self, formatter: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::Line(number) => write!(formatter, "line {number}"),
            Self::Vertex(number) => write!(formatter, "vertex {number}"),
            Self::Normal(number) => write!(formatter, "vn {number}"),
            Self::Uv(number) => write!(formatter, "vt {number}"),
            Self::Face(number) => write!(formatter, "face {number}"),
        }
    }
}

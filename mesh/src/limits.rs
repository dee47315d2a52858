//! How large a mesh may be.

/// The largest file, in bytes: a million triangles with normals, tangents and texture coordinates take
/// 60 MB in binary and 200 MB as text.
pub const FILE_BYTES_MAX: u64 = 512 << 20;
/// The most triangles.
pub const TRIANGLES_MAX: usize = 1 << 22;
/// The most vertices, normals or texture coordinates: triangles cannot use more.
pub const VERTICES_MAX: usize = 3 * TRIANGLES_MAX;
/// The largest coordinate, by magnitude, in the file's own units.
pub const COORDINATE_MAX: f64 = 1e9;
/// The least longest side of the box that holds the triangles, in the file's own units.
pub const SIDE_MIN: f64 = 1e-9;
/// The least longest side of that box as a fraction of the largest coordinate. A mesh that is smaller
/// and as far from the origin has lost its shape in rounding.
pub const SIDE_FRACTION_MIN: f64 = 1e-9;
/// The longest header of a PLY file, in bytes.
pub const PLY_HEADER_BYTES_MAX: usize = 1 << 20;
/// The most elements of a PLY file, and the most properties of each.
pub const PLY_NAMES_MAX: usize = 256;

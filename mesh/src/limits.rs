//! How large a mesh may be.

/// The largest file, in bytes: a million triangles with normals, tangents and texture coordinates take
/// 60 MB in binary and 200 MB as text.
pub const FILE_BYTES_MAX: u64 = 512 << 20;
/// The most triangles.
pub const TRIANGLES_MAX: usize = 1 << 22;
/// The largest coordinate, by magnitude, in the file's own units.
pub const COORDINATE_MAX: f64 = 1e9;

//! Triangle meshes from OBJ and PLY files: read, checked and limited.
//!
//! Files come from anybody. Whatever their bytes, reading them does not panic, takes memory for at
//! most a small multiple of the file, and takes time in proportion to it. A file is refused with one
//! sentence that names the place of its fault ([`MeshError`]).
//!
//! Both readers are our own; their modules say what was wrong with the libraries that exist.

mod check;
mod error;
pub mod limits;
mod obj;
mod ply;
mod text;

pub use error::{Attribute, MeshError, Place};

use check::Parts;

/// A checked triangle mesh, in the units and axes of its file.
///
/// Each list of a vertex's properties is as long as that of the positions. Every position is finite
/// and every index is in range. Every triangle has an area; its winding agrees with its normals, if
/// there are normals. Normals and tangents are of unit length. Vertices are numbered in the order in
/// which the triangles use them, and each is used.
#[derive(Clone, Debug)]
pub struct Mesh {
    positions: Vec<[f64; 3]>,
    triangles: Vec<[u32; 3]>,
    normals: Option<Vec<[f64; 3]>>,
    tangents: Option<Vec<[f64; 3]>>,
    uvs: Option<Vec<[f64; 2]>>,
    without_area: usize,
}

/// Compares what is rendered, not how many triangles were left out.
impl PartialEq for Mesh {
    fn eq(&self, other: &Self) -> bool {
        self.positions == other.positions
            && self.triangles == other.triangles
            && self.normals == other.normals
            && self.tangents == other.tangents
            && self.uvs == other.uvs
    }
}

impl Mesh {
    /// Reads the bytes of an OBJ or a PLY file; one that begins as a PLY file does is one.
    ///
    /// # Errors
    /// Where the bytes are too many, no mesh, or one that cannot be rendered; the sentence says where.
    pub fn read(bytes: &[u8]) -> Result<Self, MeshError> {
        if bytes.len() as u64 > limits::FILE_BYTES_MAX {
            let bytes = bytes.len() as u64;
            return Err(MeshError::FileTooLarge { bytes });
        }
        if ply::is_ply(bytes) {
            ply::read(bytes)
        } else {
            obj::read(bytes)
        }
    }

    /// A mesh of these numbers, checked as those of a file are.
    ///
    /// Like a file's, its vertices are numbered anew, triangles without an area are left out, and
    /// triangles wound against their normals are turned around.
    ///
    /// # Errors
    /// Where the numbers are no mesh that can be rendered; vertices and faces are counted from 0.
    pub fn new(
        positions: Vec<[f64; 3]>,
        triangles: Vec<[u32; 3]>,
        normals: Option<Vec<[f64; 3]>>,
        tangents: Option<Vec<[f64; 3]>>,
        uvs: Option<Vec<[f64; 2]>>,
    ) -> Result<Self, MeshError> {
        let parts = Parts {
            positions,
            triangles,
            normals,
            tangents,
            uvs,
        };
        parts.into_mesh(|_, vertex| Place::Vertex(vertex))
    }

    /// The mesh as a binary PLY file with numbers of 64 bits, from which [`Mesh::read`] reads an equal
    /// mesh. The largest meshes make a file that is larger than may be read.
    pub fn to_ply(&self) -> Vec<u8> {
        ply::write(self)
    }

    /// Where the vertices are.
    pub fn positions(&self) -> &[[f64; 3]] {
        &self.positions
    }

    /// The vertices of each triangle, counter-clockwise as seen from its front.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// The vertices' unit normals; without them each triangle is flat.
    pub fn normals(&self) -> Option<&[[f64; 3]]> {
        self.normals.as_deref()
    }

    /// The vertices' unit tangents.
    pub fn tangents(&self) -> Option<&[[f64; 3]]> {
        self.tangents.as_deref()
    }

    /// The vertices' texture coordinates.
    pub fn uvs(&self) -> Option<&[[f64; 2]]> {
        self.uvs.as_deref()
    }

    /// How many triangles were left out because they have no area: no ray can meet them.
    pub fn without_area(&self) -> usize {
        self.without_area
    }

    /// The least and the largest corner of the box along the axes that holds the triangles.
    pub fn bounds(&self) -> [[f64; 3]; 2] {
        let mut bounds = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];
        for position in &self.positions {
            check::extend(&mut bounds, *position);
        }
        bounds
    }
}

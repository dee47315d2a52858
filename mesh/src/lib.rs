//! Triangle meshes from OBJ and PLY files: read, checked and limited.

mod error;
pub mod limits;

pub use error::MeshError;

/// A checked triangle mesh, in the units and axes of its file.
///
/// Each list of a vertex's properties is as long as that of the positions. Every position is finite,
/// every index is in range, every triangle has an area, and normals and tangents are of unit length.
#[derive(Clone, Debug, PartialEq)]
pub struct Mesh {
    positions: Vec<[f64; 3]>,
    triangles: Vec<[u32; 3]>,
    normals: Option<Vec<[f64; 3]>>,
    tangents: Option<Vec<[f64; 3]>>,
    uvs: Option<Vec<[f64; 2]>>,
}

impl Mesh {
    /// Reads the bytes of an OBJ or a PLY file; one that begins as a PLY file does is one.
    ///
    /// # Errors
    /// Where the bytes are too many, no mesh, or one that cannot be rendered; the sentence says where.
    pub fn read(bytes: &[u8]) -> Result<Self, MeshError> {
        let _ = bytes;
        Err(MeshError::Empty)
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

    /// The least and the largest corner of the box along the axes that holds the triangles.
    pub fn bounds(&self) -> [[f64; 3]; 2] {
        let mut bounds = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];
        for vertex in self.triangles.as_flattened() {
            let position = self.positions[*vertex as usize];
            for axis in 0..3 {
                bounds[0][axis] = bounds[0][axis].min(position[axis]);
                bounds[1][axis] = bounds[1][axis].max(position[axis]);
            }
        }
        bounds
    }
}

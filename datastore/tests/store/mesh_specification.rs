//! A small dataset whose sample is a mesh.

use crate::cheap_image::small_specification;
use dataset::{
    Specification,
    specification::{SampleMesh, Shape},
};

/// A small dataset with a sample that is a mesh: a tent, `height` above its valleys.
pub fn mesh_specification(materials: u32, height: f64) -> Specification {
    let tent = format!(
        "v -1 -1 0\nv 0 -1 {height}\nv 1 -1 0\nv -1 1 0\nv 0 1 {height}\nv 1 1 0\n\
         f 1 2 5 4\nf 2 3 6 5\n"
    );
    let mut specification = small_specification(materials);
    specification.sample.shape = Shape::Mesh;
    specification.sample.mesh = Some(SampleMesh::of_bytes(tent.into_bytes()).unwrap());
    specification
}

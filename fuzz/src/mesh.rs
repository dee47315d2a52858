//! Meshes as OBJ and PLY.

use crate::mesh_invariants;
use mesh::Mesh;

/// Reads a mesh, which must have what is promised and must read back.
pub fn mesh(bytes: &[u8]) -> bool {
    let mesh = Mesh::read(bytes);
    if let Ok(mesh) = &mesh {
        mesh_invariants::check(mesh);
    }
    mesh.is_ok()
}

/// A mesh with everything that a mesh may have, in each format.
pub fn seeds() -> [Vec<u8>; 4] {
    let obj = "o a\nv 0 0 0\nv 1 0 0\nv 1 1 0.5\nv 0 1 .25e-1\nvt 0 0\nvt 1 0\nvn 0 0 1\nvn 0 1 1\n\
        usemtl b\nf 1/1/1 2/2/2 3/1/1 -1/-1/-1\nf 1/1/1 \\\n2/2/2 3/1/1\n";
    let properties: String = "x y z nx ny nz tx ty tz u v"
        .split(' ')
        .map(|name| format!("property float {name}\n"))
        .collect();
    let rest = "property list uchar int vertex_indices\nend_header\n";
    let header = |format| {
        format!("ply\nformat {format} 1.0\nelement vertex 3\n{properties}element face 1\n{rest}")
    };
    let rows = "0 0 0 0 0 1 1 0 0 0 0\n2 0 0 0 0 1 1 0 0 1 0\n0 1 0 0 1 1 1 0 0 0 1\n3 0 1 2\n";
    let mut big_endian = header("binary_big_endian").into_bytes();
    let (vertices, _) = rows.split_once("3 0").unwrap();
    for number in vertices.split_ascii_whitespace() {
        big_endian.extend(number.parse::<f32>().unwrap().to_be_bytes());
    }
    big_endian.extend([3, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 2]);
    let text = (header("ascii") + rows).into_bytes();
    let little_endian = Mesh::read(&text).unwrap().to_ply();
    [obj.as_bytes().to_vec(), text, big_endian, little_endian]
}

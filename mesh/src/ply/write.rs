//! The binary PLY file of a mesh.

use crate::Mesh;

/// Writes little-endian numbers of 64 bits, and indices of 32.
pub fn write(mesh: &Mesh) -> Vec<u8> {
    let (positions, triangles) = (mesh.positions(), mesh.triangles());
    let mut properties = vec!["x", "y", "z"];
    if mesh.normals().is_some() {
        properties.extend(["nx", "ny", "nz"]);
    }
    if mesh.tangents().is_some() {
        properties.extend(["tx", "ty", "tz"]);
    }
    if mesh.uvs().is_some() {
        properties.extend(["u", "v"]);
    }
    let mut header = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\n",
        positions.len()
    );
    for property in &properties {
        header += &format!("property double {property}\n");
    }
    header += &format!(
        "element face {}\nproperty list uchar uint vertex_indices\nend_header\n",
        triangles.len()
    );
    let vertices_bytes = positions.len() * properties.len() * size_of::<f64>();
    let faces_bytes = triangles.len() * (1 + 3 * size_of::<u32>());
    let mut file = Vec::with_capacity(header.len() + vertices_bytes + faces_bytes);
    file.extend(header.as_bytes());
    let (normals, tangents, uvs) = (mesh.normals(), mesh.tangents(), mesh.uvs());
    for (vertex, position) in positions.iter().enumerate() {
        let normal = normals.iter().flat_map(|normals| &normals[vertex]);
        let tangent = tangents.iter().flat_map(|tangents| &tangents[vertex]);
        let uv = uvs.iter().flat_map(|uvs| &uvs[vertex]);
        for number in position.iter().chain(normal).chain(tangent).chain(uv) {
            file.extend(number.to_le_bytes());
        }
    }
    for triangle in triangles {
        file.push(3);
        for vertex in triangle {
            file.extend(vertex.to_le_bytes());
        }
    }
    file
}

//! What is true of every mesh that is read.

use mesh::{Mesh, limits};

/// Checks what [`Mesh`] promises, and that it reads back.
pub fn check(mesh: &Mesh) {
    let (positions, triangles) = (mesh.positions(), mesh.triangles());
    assert!((1..=limits::TRIANGLES_MAX).contains(&triangles.len()));
    let within = |coordinate: &f64| coordinate.abs() <= limits::COORDINATE_MAX;
    assert!(positions.as_flattened().iter().all(within));
    let vectors = [mesh.normals(), mesh.tangents()];
    for vectors in vectors.into_iter().flatten() {
        assert_eq!(vectors.len(), positions.len());
        for [x, y, z] in vectors {
            assert!(((x * x + y * y + z * z).sqrt() - 1.0).abs() < 1e-14);
        }
    }
    if let Some(uvs) = mesh.uvs() {
        assert_eq!(uvs.len(), positions.len());
        assert!(uvs.as_flattened().iter().all(|number| number.is_finite()));
    }
    let mut numbered = 0;
    for triangle in triangles {
        for vertex in triangle {
            assert!(*vertex <= numbered, "numbered in the order of use");
            numbered = numbered.max(vertex + 1);
        }
        let [a, b, c] = triangle.map(|vertex| positions[vertex as usize]);
        let u: [f64; 3] = std::array::from_fn(|axis| b[axis] - a[axis]);
        let v: [f64; 3] = std::array::from_fn(|axis| c[axis] - a[axis]);
        let normal = [
            u[1] * v[2] - u[2] * v[1],
            u[2] * v[0] - u[0] * v[2],
            u[0] * v[1] - u[1] * v[0],
        ];
        assert_ne!(normal, [0.0; 3], "each triangle has an area");
        if let Some(normals) = mesh.normals() {
            let [l, m, n] = triangle.map(|vertex| normals[vertex as usize]);
            let along: f64 = (0..3)
                .map(|axis| normal[axis] * (l[axis] + (m[axis] + n[axis])))
                .sum();
            assert!(along >= 0.0, "wound as the normals say");
        }
    }
    assert_eq!(numbered as usize, positions.len(), "each vertex is used");
    let [least, most] = mesh.bounds();
    let longest = (0..3).map(|axis| most[axis] - least[axis]);
    assert!(longest.fold(0.0, f64::max) >= limits::SIDE_MIN);
    let again = Mesh::read(&mesh.to_ply()).unwrap();
    assert_eq!(again, *mesh);
    assert_eq!(again.without_area(), 0);
}

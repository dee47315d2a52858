//! How long a large mesh takes to read. `cargo test -p mesh --test speed -- --ignored --nocapture`

#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a panic here is a failed test; what is measured is printed"
)]

use mesh::Mesh;
use std::{fmt::Write, time::Instant};

/// Vertices along each side of a wavy sheet: half a million of them, and a million triangles.
const SIDE: u32 = 708;

fn sheet() -> Mesh {
    let side = 0..SIDE;
    let height = |x: u32, y: u32| f64::from((x * 7 + y * 13) % 29) / 100.0;
    let positions = side.clone().flat_map(|y| {
        side.clone()
            .map(move |x| [f64::from(x), f64::from(y), height(x, y)])
    });
    let positions: Vec<_> = positions.collect();
    let squares = (0..SIDE - 1).flat_map(|y| (0..SIDE - 1).map(move |x| SIDE * y + x));
    let triangles = squares.flat_map(|corner| {
        let (right, above) = (corner + 1, corner + SIDE);
        [[corner, right, above + 1], [corner, above + 1, above]]
    });
    let triangles = triangles.collect();
    let normals = positions
        .iter()
        .map(|[x, y, _]| [x % 3.0 - 1.0, y % 3.0 - 1.0, 2.0]);
    let normals = normals.collect();
    Mesh::new(positions, triangles, Some(normals), None, None).unwrap()
}

fn obj(mesh: &Mesh) -> String {
    let mut text = String::new();
    for [x, y, z] in mesh.positions() {
        writeln!(text, "v {x} {y} {z}").unwrap();
    }
    for [x, y, z] in mesh.normals().unwrap() {
        writeln!(text, "vn {x} {y} {z}").unwrap();
    }
    for triangle in mesh.triangles() {
        let [a, b, c] = triangle.map(|vertex| vertex + 1);
        writeln!(text, "f {a}//{a} {b}//{b} {c}//{c}").unwrap();
    }
    text
}

fn text_ply(mesh: &Mesh) -> String {
    let file = mesh.to_ply();
    let end = file
        .windows(11)
        .position(|word| word == b"end_header\n")
        .unwrap()
        + 11;
    let header = str::from_utf8(&file[..end]).unwrap();
    let mut text = header.replace("binary_little_endian", "ascii");
    for ([x, y, z], [nx, ny, nz]) in mesh.positions().iter().zip(mesh.normals().unwrap()) {
        writeln!(text, "{x} {y} {z} {nx} {ny} {nz}").unwrap();
    }
    for [a, b, c] in mesh.triangles() {
        writeln!(text, "3 {a} {b} {c}").unwrap();
    }
    text
}

#[test]
#[ignore = "measures"]
fn a_million_triangles() {
    let mesh = sheet();
    println!(
        "{} triangles, {} vertices",
        mesh.triangles().len(),
        mesh.positions().len()
    );
    for (name, file) in [
        ("binary PLY", mesh.to_ply()),
        ("text PLY", text_ply(&mesh).into_bytes()),
        ("OBJ", obj(&mesh).into_bytes()),
    ] {
        let start = Instant::now();
        let read = Mesh::read(&file).unwrap();
        let seconds = start.elapsed().as_secs_f64();
        println!("{name}: {} MB, {seconds:.3} s", file.len() / 1_000_000);
        assert_eq!(read, mesh);
    }
}

//! Each fault has its sentence, which names the place.

#![allow(
    clippy::unwrap_used,
    reason = "a panic here is a failed test, which says where"
)]

mod cube;

use cube::{binary_ply, text_ply};
use mesh::{Mesh, MeshError};

/// Vertices of a square, and a texture coordinate and a normal, on lines 1 to 6.
const SQUARE: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvn 0 0 1\n";

fn refusal(bytes: impl AsRef<[u8]>) -> String {
    let sentence = Mesh::read(bytes.as_ref()).unwrap_err().to_string();
    assert!(
        !sentence.contains('\n') && !sentence.ends_with('.'),
        "{sentence}"
    );
    assert!(sentence.len() < 250, "{sentence}");
    sentence
}

/// Asserts that the square with these lines added, the first of which is line 7, is refused so.
#[track_caller]
fn obj_refused(lines: &str, expected: &str) {
    let sentence = refusal(format!("{SQUARE}{lines}"));
    assert!(sentence.contains(expected), "{sentence}");
}

/// Asserts that the cube's text with one part replaced is refused so.
#[track_caller]
fn ply_refused(part: &str, by: &str, expected: &str) {
    let text = text_ply();
    assert!(text.contains(part), "{part}");
    let sentence = refusal(text.replacen(part, by, 1));
    assert!(sentence.contains(expected), "{sentence}");
}

#[test]
fn what_is_no_mesh_is_named() {
    for empty in ["", "\n\n", "# nothing\n", SQUARE, "ply"] {
        let sentence = refusal(empty);
        assert!(
            sentence.contains("no faces") || empty == "ply",
            "{sentence}"
        );
    }
    assert!(
        refusal("solid cube\n facet normal 0 0 1\n").contains("line 1: `solid` is no statement")
    );
    assert!(refusal(b"glTF\x02\0\0\0").contains("line 1: `glTF"));
    assert!(refusal(b"\x89PNG\r\n\x1a\n\0\0").contains("is this an OBJ or a PLY file?"));
    assert!(refusal("ply\n").contains("the PLY header does not end: the file is incomplete"));
}

#[test]
fn faults_of_the_faces_of_an_obj_file_are_named_by_line() {
    obj_refused("f 1 2\n", "line 7: the face has 2 corners");
    obj_refused(
        "f 1 2 3 4 1 2 3\n",
        "line 7: the face has 7 corners: export the mesh with triangles or quadrilaterals",
    );
    obj_refused("f\n", "line 7: the face has 0 corners");
    obj_refused(
        "f 1 2 3\nf 1 2 5\n",
        "line 8: vertex index 5 is out of range: the file has 4 vertices",
    );
    obj_refused(
        "f 1 2 -5\n",
        "vertex index -5 is out of range: before this line there are 4",
    );
    obj_refused(
        "f 0 1 2\n",
        "vertex index 0 is out of range: indices of an OBJ file count from 1",
    );
    obj_refused(
        "f 1 2 99999999999\n",
        "vertex index 99999999999 is out of range",
    );
    obj_refused("f 1 2 9223372036854775807\n", "is out of range");
    obj_refused("f 1 2 -9223372036854775808\n", "is out of range");
    obj_refused(
        "f 1 2 9223372036854775808\n",
        "line 7: `9223372036854775808` is no vertex index",
    );
    obj_refused(
        "f 1/2 2/1 3/1\n",
        "texture coordinate index 2 is out of range: the file has 1",
    );
    obj_refused(
        "f 1//1 2//2 3//1\n",
        "normal index 2 is out of range: the file has 1 normals",
    );
    obj_refused("f 1 2 3.5\n", "line 7: `3.5` is no vertex index");
    obj_refused("f 1 2 /1\n", "line 7: `/1` is no corner of a face");
    obj_refused(
        "f 1/1/1/1 2 3\n",
        "line 7: `1/1/1/1` is no corner of a face",
    );
    obj_refused(
        "f 1//1 2//1 3//1\nf 1 3 4\n",
        "line 8: some faces have normals and others do not",
    );
    obj_refused(
        "f 1/1 2 3\n",
        "line 7: some faces have texture coordinates and others do not",
    );
}

#[test]
fn faults_of_the_numbers_of_an_obj_file_are_named_by_line() {
    obj_refused(
        "v 1 2\n",
        "line 7: the statement needs 3 to 7 numbers, but has 2",
    );
    obj_refused("v 1 2 3 4 5 6 7 8\n", "needs 3 to 7 numbers, but has 8");
    obj_refused("v 1 2 zwei\n", "line 7: `zwei` is no number");
    obj_refused(
        "vn 1 2\n",
        "line 7: the statement needs 3 numbers, but has 2",
    );
    obj_refused("v 1 2 nan\n", "line 7: the position is not finite");
    obj_refused("v 1 -inf 2\n", "line 7: the position is not finite");
    obj_refused("v 1 1e400 2\n", "line 7: the position is not finite");
    obj_refused("v 1 2 -1.1e9\n", "line 7: a coordinate is beyond 1e9");
    obj_refused(
        "vn 0 0 0\nf 1//2 2//2 3//2\n",
        "vn 2: the normal has length zero",
    );
    obj_refused(
        "vn 0 nan 0\nf 1//2 2//2 3//2\n",
        "vn 2: the normal is not finite",
    );
    obj_refused(
        "vt nan\nf 1/2 2/2 3/2\n",
        "vt 2: the texture coordinate is not finite",
    );
    obj_refused("f 1 1 2\n", "the mesh has no triangle with an area");
    let long = format!("{}\n", "x".repeat(100_000));
    obj_refused(
        &long,
        "line 7: `xxxxxxxxxxxxxxxxxxxxxxxx...` is no statement",
    );
}

#[test]
fn faults_of_a_ply_header_are_named() {
    ply_refused(
        "element vertex 8",
        "element vertex 9",
        "line 19: `2 1` is more than the header announces for a line",
    );
    ply_refused("format ascii 1.0\n", "", "has no line `format`");
    ply_refused(
        "ascii 1.0",
        "ascii 2.0",
        "line 2: the version is `2.0`, but must be 1.0",
    );
    ply_refused("ascii", "utf8", "line 2: `utf8` is no format of PLY files");
    ply_refused(
        "ascii 1.0",
        "ascii 1.0\nformat ascii 1.0",
        "line 3: the format is declared twice",
    );
    ply_refused("double x", "real x", "line 5: `real` is no type of numbers");
    ply_refused("double y", "double x", "line 6: `x` is declared twice");
    ply_refused(
        "double y",
        "list int int y",
        "must declare the numbers `x`, `y` and `z`",
    );
    ply_refused(
        "property double z\n",
        "",
        "must declare the numbers `x`, `y` and `z`",
    );
    ply_refused(
        "comment a cube",
        "color 1",
        "line 3: `color` is no statement of a PLY header",
    );
    let comments = "comment\n".repeat(200_000);
    ply_refused(
        "comment a cube\n",
        &comments,
        "does not end within its first 1048576 bytes",
    );
}

#[test]
fn faults_of_what_a_ply_header_declares_are_named() {
    ply_refused(
        "element vertex 8",
        "element point 8",
        "has no element `vertex`",
    );
    ply_refused(
        "element vertex 8",
        "element vertex -8",
        "line 4: `-8` is no number of elements",
    );
    ply_refused(
        "element vertex 8",
        "element vertex 8 9",
        "line 4: `9` is too much",
    );
    ply_refused(
        "element face 6",
        "element vertex 6",
        "line 8: `vertex` is declared twice",
    );
    ply_refused(
        "element face 6",
        "element face 0",
        "the file has no faces: a point cloud",
    );
    ply_refused(
        "vertex_indices",
        "corners",
        "has no property `vertex_indices`",
    );
    ply_refused(
        "uchar int",
        "uchar float",
        "must declare the corners of a face as a list of whole",
    );
    ply_refused(
        "list uchar int",
        "int",
        "must declare the corners of a face as a list of whole",
    );
    ply_refused(
        "list uchar int",
        "list float int",
        "a list must have a length and numbers",
    );
    ply_refused(
        "list uchar int",
        "list uchar list int",
        "a list must have a length and numbers",
    );
    ply_refused(
        "comment a cube",
        "property int a",
        "line 3: a property stands before the first",
    );
    let names: String = (0..300)
        .map(|name| format!("property int p{name}\n"))
        .collect();
    ply_refused(
        "property double x\n",
        &names,
        "there are more than 256 names",
    );
}

#[test]
fn faults_of_a_ply_file_are_named_by_vertex_and_face() {
    ply_refused(
        "4 4 5 6 7",
        "4 4 5 6 8",
        "face 1: vertex index 8 is out of range: the file has 8",
    );
    ply_refused(
        "4 4 5 6 7",
        "4 4 5 6 -1",
        "face 1: vertex index -1 is out of range",
    );
    ply_refused(
        "4 4 5 6 7",
        "4 4 5 6 6.5",
        "face 1: property `vertex_indices` holds a number that",
    );
    ply_refused("4 4 5 6 7", "2 4 5", "face 1: the face has 2 corners");
    ply_refused(
        "4 4 5 6 7",
        "7 4 5 6 7 1 2 3",
        "face 1: the face has 7 corners: export",
    );
    ply_refused(
        "4 4 5 6 7",
        "-4 4 5 6 7",
        "face 1: property `vertex_indices` is a list whose",
    );
    ply_refused(
        "4 4 5 6 7",
        "4 4 5 6 7 9",
        "line 20: `9` is more than the header announces",
    );
    ply_refused(
        "4 4 5 6 7",
        "4 4 5 6",
        "line 20: the line ends before property `vertex_indices`",
    );
    ply_refused("1 1 1\n", "1 one 1\n", "line 17: `one` is no number");
    ply_refused(
        "1 1 1\n",
        "1 nan 1\n",
        "vertex 6: the position is not finite",
    );
    ply_refused(
        "1 1 1\n",
        "1 1 1e10\n",
        "vertex 6: a coordinate is beyond 1e9",
    );
    ply_refused(
        "4 4 5 6 7",
        "4 4 5 6 7\n3 0 1 2",
        "the file goes on for 10 bytes after the last",
    );
}

#[test]
fn directions_without_length_are_named() {
    let ply = |numbers: &str, vector: &str| {
        let properties: String = ["x", "y", "z"]
            .iter()
            .map(|axis| axis.to_string())
            .chain(numbers.split(' ').map(str::to_owned))
            .map(|name| format!("property float {name}\n"))
            .collect();
        format!(
            "ply\nformat ascii 1.0\nelement vertex 4\n{properties}element face 1\n\
             property list uchar int vertex_index\nend_header\n\
             0 0 0 0 0 0\n1 0 0 0 0 1\n0 1 0 {vector}\n0 0 1 0 0 1\n3 1 2 3\n"
        )
    };
    let normal = |vector: &str| ply("nx ny nz", vector);
    assert!(
        Mesh::read(normal("1 0 0").as_bytes()).is_ok(),
        "vertex 0 is not used"
    );
    assert!(refusal(normal("0 -0 0")).contains("vertex 2: the normal has length zero"));
    assert!(refusal(normal("0 inf 0")).contains("vertex 2: the normal is not finite"));
    let tangent = |vector: &str| ply("tx ty tz", vector);
    assert!(refusal(tangent("0 0 0")).contains("vertex 2: the tangent has length zero"));
    assert!(refusal(tangent("0 nan 0")).contains("vertex 2: the tangent is not finite"));
    let uv = ply("u v w", "nan 0 0");
    assert!(refusal(uv).contains("vertex 2: the texture coordinate is not finite"));
}

#[test]
fn a_binary_file_is_as_long_as_its_header_says() {
    for big_endian in [false, true] {
        let file = binary_ply(big_endian);
        assert!(refusal(&file[..file.len() - 1]).contains("ends before face 5 of 6 is complete"));
        assert!(refusal(&file[..file.len() - 150]).contains("announces 8 of element `vertex`"));
        let excess = [&file[..], b"\n?"].concat();
        assert!(refusal(excess).contains("goes on for 2 bytes after the last element"));
        assert!(Mesh::read(&[&file[..], b"\r\n"].concat()).is_ok());
    }
}

#[test]
fn a_mesh_without_a_size_is_refused() {
    let triangle = |at: f64, side: f64| {
        let positions = vec![[at, 0.0, 0.0], [at + side, 0.0, 0.0], [at, side, 0.0]];
        Mesh::new(positions, vec![[0, 1, 2]], None, None, None)
    };
    for (at, side) in [(0.0, 0.0), (7.0, 0.0)] {
        assert_eq!(triangle(at, side), Err(MeshError::Empty));
    }
    for (at, side) in [(9e8, 0.5), (0.0, 1e-10), (1.0, 1e-10)] {
        assert_eq!(triangle(at, side), Err(MeshError::TooSmall));
    }
    for (at, side) in [(9e8, 2.0), (0.0, 1e-9), (0.0, 1e9)] {
        assert!(triangle(at, side).is_ok());
    }
    let sentence = MeshError::TooSmall.to_string();
    assert!(
        sentence.contains("scale it, or move it to the origin"),
        "{sentence}"
    );
}

#[test]
fn a_mesh_made_in_memory_is_checked_alike() {
    let positions = vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    let sentence = |triangle, normals, uvs| {
        let mesh = Mesh::new(positions.clone(), vec![triangle], normals, None, uvs);
        mesh.unwrap_err().to_string()
    };
    assert_eq!(
        sentence([0, 1, 3], None, None),
        "face 0: vertex index 3 is out of range: there are 3 vertices, counted from 0"
    );
    let normals = Some(vec![[0.0, 0.0, 1.0]; 2]);
    assert_eq!(
        sentence([0, 1, 2], normals, None),
        "there are 2 normals for 3 vertices"
    );
    let uvs = Some(vec![[0.0; 2]; 4]);
    assert_eq!(
        sentence([0, 1, 2], None, uvs),
        "there are 4 texture coordinates for 3 vertices"
    );
    let none = Mesh::new(Vec::new(), Vec::new(), None, None, None);
    assert_eq!(none, Err(MeshError::Empty));
    let many = vec![[0, 1, 2]; mesh::limits::TRIANGLES_MAX + 1];
    let many = Mesh::new(positions, many, None, None, None);
    assert_eq!(many, Err(MeshError::TooManyTriangles));
}

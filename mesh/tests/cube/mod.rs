//! A cube in every format.

#![allow(dead_code, reason = "each test uses some of it")]

/// Corners of the cube.
pub const CORNERS: [[f64; 3]; 8] = [
    [-1.0, -1.0, -1.0],
    [1.0, -1.0, -1.0],
    [1.0, 1.0, -1.0],
    [-1.0, 1.0, -1.0],
    [-1.0, -1.0, 1.0],
    [1.0, -1.0, 1.0],
    [1.0, 1.0, 1.0],
    [-1.0, 1.0, 1.0],
];

/// Faces of the cube, counter-clockwise as seen from outside.
pub const FACES: [[usize; 4]; 6] = [
    [0, 3, 2, 1],
    [4, 5, 6, 7],
    [0, 1, 5, 4],
    [2, 3, 7, 6],
    [1, 2, 6, 5],
    [0, 4, 7, 3],
];

/// Outward normals of the faces.
pub const NORMALS: [[f64; 3]; 6] = [
    [0.0, 0.0, -1.0],
    [0.0, 0.0, 1.0],
    [0.0, -1.0, 0.0],
    [0.0, 1.0, 0.0],
    [1.0, 0.0, 0.0],
    [-1.0, 0.0, 0.0],
];

/// Texture coordinates.
pub const UVS: [[f64; 2]; 4] = [[0.0, 0.0], [0.25, 0.0], [0.25, 1.0], [0.0, 1.0]];

pub fn obj_positions() -> String {
    CORNERS
        .iter()
        .map(|[x, y, z]| format!("v {x} {y} {z}\n"))
        .collect()
}

pub fn obj_face(corners: impl Iterator<Item = String>) -> String {
    format!("f {}\n", corners.collect::<Vec<_>>().join(" "))
}

/// The cube as OBJ, of whose corners a function writes the indices, given corner and face from 0.
pub fn obj_of(indices: impl Fn(usize, usize) -> String) -> String {
    let mut text = obj_positions();
    for [u, v] in UVS {
        text += &format!("vt {u} {v}\n");
    }
    for [x, y, z] in NORMALS {
        text += &format!("vn {x} {y} {z}\n");
    }
    for (face, corners) in FACES.iter().enumerate() {
        text += &obj_face(corners.iter().map(|corner| indices(*corner, face)));
    }
    text
}

fn header(format: &str, vertices: usize, properties: &[&str]) -> String {
    let properties: String = properties
        .iter()
        .map(|name| format!("property double {name}\n"))
        .collect();
    format!(
        "ply\nformat {format} 1.0\ncomment a cube\nelement vertex {vertices}\n{properties}\
         element face 6\nproperty list uchar int vertex_indices\nend_header\n"
    )
}

/// The cube as a text, without normals.
pub fn text_ply() -> String {
    let mut text = header("ascii", 8, &["x", "y", "z"]);
    for [x, y, z] in CORNERS {
        text += &format!("{x} {y} {z}\n");
    }
    for [a, b, c, d] in FACES {
        text += &format!("4 {a} {b} {c} {d}\n");
    }
    text
}

/// The cube as a text, with normals and perhaps texture coordinates: four vertices a face.
pub fn text_ply_rows(normals: bool, uvs: bool) -> String {
    let mut names = vec!["x", "y", "z"];
    names.extend(["nx", "ny", "nz"].iter().filter(|_| normals));
    names.extend(["s", "t"].iter().filter(|_| uvs));
    let mut text = header("ascii", 24, &names);
    for (corners, normal) in FACES.iter().zip(NORMALS) {
        for corner in corners {
            let normal = normal.iter().filter(|_| normals);
            let uv = UVS[corner % 4].iter().filter(|_| uvs);
            let numbers = CORNERS[*corner].iter().chain(normal).chain(uv);
            let numbers: Vec<String> = numbers.map(f64::to_string).collect();
            text += &(numbers.join(" ") + "\n");
        }
    }
    for face in 0..6 {
        let first = 4 * face;
        text += &format!("4 {first} {} {} {}\n", first + 1, first + 2, first + 3);
    }
    text
}

/// The cube in binary, without normals.
pub fn binary_ply(big_endian: bool) -> Vec<u8> {
    let format = if big_endian {
        "binary_big_endian"
    } else {
        "binary_little_endian"
    };
    let mut file = header(format, 8, &["x", "y", "z"]).into_bytes();
    for number in CORNERS.as_flattened() {
        file.extend(if big_endian {
            number.to_be_bytes()
        } else {
            number.to_le_bytes()
        });
    }
    for face in FACES {
        file.push(4);
        for corner in face {
            let corner = corner as u32;
            file.extend(if big_endian {
                corner.to_be_bytes()
            } else {
                corner.to_le_bytes()
            });
        }
    }
    file
}

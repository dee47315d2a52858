//! One cube, written in every way that is read, is one mesh.

#![allow(
    clippy::unwrap_used,
    reason = "a panic here is a failed test, which says where"
)]

mod cube;

use cube::{
    CORNERS, FACES, NORMALS, binary_ply, obj_face, obj_of, obj_positions, text_ply, text_ply_rows,
};
use mesh::Mesh;

fn read(bytes: impl AsRef<[u8]>) -> Mesh {
    Mesh::read(bytes.as_ref()).unwrap()
}

#[test]
fn a_cube_is_the_same_in_every_format() {
    let positive = read(obj_of(|corner, _| format!("{}", corner + 1)));
    assert_eq!(positive.positions().len(), 8);
    assert_eq!(positive.triangles().len(), 12);
    assert_eq!(positive.bounds(), [[-1.0; 3], [1.0; 3]]);
    let negative = read(obj_of(|corner, _| format!("{}", corner as i32 - 8)));
    assert_eq!(negative, positive);
    assert_eq!(read(text_ply()), positive);
    for big_endian in [false, true] {
        assert_eq!(read(binary_ply(big_endian)), positive);
    }
    assert_eq!(read(positive.to_ply()), positive);
}

#[test]
fn a_cube_with_normals_is_the_same_in_every_format() {
    let absolute = read(obj_of(|corner, face| {
        format!("{}//{}", corner + 1, face + 1)
    }));
    assert_eq!(absolute.positions().len(), 24);
    let relative = read(obj_of(|corner, face| {
        format!("{}//{}", corner as i32 - 8, face as i32 - 6)
    }));
    assert_eq!(relative, absolute);
    assert_eq!(read(text_ply_rows(true, false)), absolute);
    let with_uvs = read(obj_of(|corner, face| {
        format!("{}/{}/{}", corner + 1, corner % 4 + 1, face + 1)
    }));
    assert_eq!(with_uvs.uvs().unwrap().len(), 24);
    assert_eq!(read(text_ply_rows(true, true)), with_uvs);
    assert_eq!(read(with_uvs.to_ply()), with_uvs);
    assert_eq!(absolute.normals(), with_uvs.normals());
    let without_normals = read(obj_of(|corner, _| {
        format!("{}/{}", corner + 1, corner % 4 + 1)
    }));
    assert!(without_normals.normals().is_none());
    assert_eq!(without_normals.positions().len(), 8);
}

#[test]
fn every_statement_but_those_of_a_mesh_is_ignored() {
    let plain = obj_of(|corner, _| format!("{}", corner + 1));
    let noise = "# comment\n\nmtllib /etc/passwd\no cube\ng a b\ns off\nusemtl red\nl 1 2\np 1\n";
    assert_eq!(read(format!("{noise}{plain}s 1\n")), read(&plain));
    assert_eq!(read(plain.replace('\n', "\r\n")), read(&plain));
    assert_eq!(read(plain.replace('\n', "\r")), read(&plain));
    assert_eq!(read(plain.replace(' ', " \\\n ")), read(&plain));
    assert_eq!(read(plain.replace('\n', " # \u{e9}\n")), read(&plain));
    let comment = format!("# C:\\models\\\n{plain}");
    assert_eq!(read(comment), read(&plain));
    let mut latin = b"g \xe9\n".to_vec();
    latin.extend(plain.as_bytes());
    assert_eq!(read(latin), read(&plain));
}

#[test]
fn other_elements_and_properties_of_a_ply_file_are_skipped() {
    let ply = text_ply();
    for end in ["\n", "\r\n", "\r"] {
        assert_eq!(read(ply.replace('\n', end)), read(&ply));
    }
    let more = ply
        .replace(
            "property double y",
            "property list uchar int n\nproperty double y",
        )
        .replace(
            "element face",
            "element empty 4000000000\nelement edge 2\nproperty int a\nelement face",
        )
        .replace("end_header", "property uchar red\nend_header");
    let mut lines: Vec<String> = more.lines().map(str::to_owned).collect();
    let start = lines.iter().position(|line| line == "end_header").unwrap() + 1;
    for line in &mut lines[start..start + 8] {
        let (x, rest) = line.split_once(' ').unwrap();
        *line = format!("{x} 2 7 8 {rest}");
    }
    for line in &mut lines[start + 8..] {
        *line += " 255";
    }
    lines.splice(
        start + 8..start + 8,
        ["1".to_owned(), String::new(), "2".to_owned()],
    );
    assert_eq!(read(lines.join("\n")), read(&ply));
}

#[test]
fn names_of_tangents_and_texture_coordinates_have_several_spellings() {
    let mesh = |tangent: [&str; 3], uv: [&str; 2]| {
        let names = [&["x", "y", "z"][..], &tangent, &uv].concat();
        let properties: String = names
            .iter()
            .map(|name| format!("property float {name}\n"))
            .collect();
        read(format!(
            "ply\nformat ascii 1.0\nelement vertex 3\n{properties}element face 1\n\
             property list uchar int vertex_index\nend_header\n\
             0 0 0 2 0 0 .5 1.\n1 0 0 2 0 0 1 0\n0 1 0 2 0 0 0 1\n3 0 1 2\n"
        ))
    };
    let short = mesh(["tx", "ty", "tz"], ["u", "v"]);
    assert_eq!(short.tangents().unwrap(), [[1.0, 0.0, 0.0]; 3]);
    assert_eq!(short.uvs().unwrap(), [[0.5, 1.0], [1.0, 0.0], [0.0, 1.0]]);
    assert_eq!(
        mesh(["tangent_x", "tangent_y", "tangent_z"], ["s", "t"]),
        short
    );
    assert_eq!(mesh(["tx", "ty", "tz"], ["texture_u", "texture_v"]), short);
    assert_eq!(mesh(["tx", "ty", "a"], ["u", "b"]).tangents(), None);
}

#[test]
fn every_type_of_number_is_read() {
    for (name, bytes) in [
        ("char", 1),
        ("int8", 1),
        ("uchar", 1),
        ("uint8", 1),
        ("short", 2),
        ("int16", 2),
        ("ushort", 2),
        ("uint16", 2),
        ("int", 4),
        ("int32", 4),
        ("uint", 4),
        ("uint32", 4),
    ] {
        let mut file = format!(
            "ply\nformat binary_big_endian 1.0\nelement vertex 3\nproperty {name} x\n\
             property {name} y\nproperty {name} z\nelement face 1\n\
             property list {name} {name} vertex_indices\nend_header\n"
        )
        .into_bytes();
        for number in [0, 0, 0, 1, 0, 0, 0, 1, 0, 3, 0, 1, 2_u32] {
            file.extend(&number.to_be_bytes()[4 - bytes..]);
        }
        let mesh = read(file);
        assert_eq!(
            mesh.positions(),
            [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
        );
    }
}

#[test]
fn a_quadrilateral_is_split_from_its_first_corner() {
    let mesh = read("v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n");
    assert_eq!(mesh.triangles(), [[0, 1, 2], [0, 2, 3]]);
}

#[test]
fn triangles_are_turned_to_their_normals() {
    let inwards = |(corner, face): (usize, usize)| format!("{}//{}", corner + 1, face + 1);
    let mut text = obj_positions();
    for (face, normal) in NORMALS.iter().enumerate() {
        let [x, y, z] = normal.map(|component| 3.0 * component);
        text += &format!("vn {x} {y} {z}\n");
        let _ = face;
    }
    let mut turned = text.clone();
    for (face, corners) in FACES.iter().enumerate() {
        text += &obj_face(corners.iter().map(|corner| inwards((*corner, face))));
        turned += &obj_face(corners.iter().rev().map(|corner| inwards((*corner, face))));
    }
    let (mesh, turned) = (read(text), read(turned));
    for mesh in [&mesh, &turned] {
        for triangle in mesh.triangles() {
            let [a, b, c] = triangle.map(|vertex| mesh.positions()[vertex as usize]);
            let normal = mesh.normals().unwrap()[triangle[0] as usize];
            let u: [f64; 3] = std::array::from_fn(|axis| b[axis] - a[axis]);
            let v: [f64; 3] = std::array::from_fn(|axis| c[axis] - a[axis]);
            let cross = [
                u[1] * v[2] - u[2] * v[1],
                u[2] * v[0] - u[0] * v[2],
                u[0] * v[1] - u[1] * v[0],
            ];
            assert_eq!(cross, normal.map(|component| 4.0 * component));
        }
    }
    assert_eq!(CORNERS.len(), 8);
}

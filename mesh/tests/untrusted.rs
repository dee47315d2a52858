//! Whatever the bytes are, they are read or refused: no panic, little memory, little time.

#![allow(
    clippy::unwrap_used,
    reason = "a panic here is a failed test, which says where"
)]

mod cube;
mod invariants;

use cube::{binary_ply, obj_of, text_ply, text_ply_rows};
use mesh::{Mesh, MeshError, limits};
use proptest::prelude::*;

/// A small valid file of each kind.
fn files() -> Vec<Vec<u8>> {
    let with_normals = obj_of(|corner, face| format!("{}//{}", corner + 1, face + 1));
    let with_all = obj_of(|corner, face| {
        format!(
            "{}/{}/{}",
            corner as i32 - 8,
            corner % 4 + 1,
            face as i32 - 6
        )
    });
    let doubles = Mesh::read(with_all.as_bytes()).unwrap().to_ply();
    vec![
        obj_of(|corner, _| (corner + 1).to_string()).into_bytes(),
        with_normals.into_bytes(),
        with_all.into_bytes(),
        text_ply().into_bytes(),
        text_ply_rows(true, true).into_bytes(),
        binary_ply(false),
        binary_ply(true),
        doubles,
    ]
}

#[test]
fn every_beginning_of_a_file_is_read_or_refused() {
    for file in files() {
        let whole = Mesh::read(&file).unwrap();
        for length in 0..file.len() {
            if let Ok(mesh) = Mesh::read(&file[..length]) {
                invariants::check(&mesh);
                let is_text = !file.windows(6).any(|word| word == b"binary");
                assert!(is_text, "{length} of {} bytes", file.len());
                assert!(mesh.triangles().len() <= whole.triangles().len());
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    #[test]
    fn a_damaged_file_is_read_or_refused(
        file in 0..8_usize,
        damages in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..8),
    ) {
        let mut bytes = files()[file].clone();
        for (at, byte) in damages {
            let at = at.index(bytes.len());
            bytes[at] = byte;
        }
        if let Ok(mesh) = Mesh::read(&bytes) {
            invariants::check(&mesh);
        }
    }

    #[test]
    fn a_file_with_other_words_is_read_or_refused(
        file in 0..5_usize,
        at in any::<prop::sample::Index>(),
        word in prop::sample::select(vec![
            "0", "-1", "1", "4294967296", "1e300", "nan", "inf", "1e-320", "f", "v", "vn", "#", "\\\n",
            "list", "element", "end_header", "/", "//", "\r", "3",
        ]),
    ) {
        let text = String::from_utf8(files()[file].clone()).unwrap();
        let mut words: Vec<&str> = text.split_inclusive([' ', '\n']).collect();
        let at = at.index(words.len());
        let ended = format!("{word}{}", &words[at][words[at].len() - 1..]);
        words[at] = &ended;
        if let Ok(mesh) = Mesh::read(words.concat().as_bytes()) {
            invariants::check(&mesh);
        }
    }

    #[test]
    fn a_mesh_reads_back(
        positions in prop::collection::vec(prop::array::uniform3(-1e3..1e3), 3..12),
        triangles in prop::collection::vec(prop::array::uniform3(0..12_u32), 1..20),
        directions in prop::collection::vec(prop::array::uniform3(-1.0..1.0), 12),
        exponent in -300..300_i32,
        has in any::<[bool; 3]>(),
    ) {
        let count = positions.len();
        let triangles: Vec<_> = triangles
            .into_iter()
            .map(|triangle| triangle.map(|vertex| vertex % count as u32))
            .collect();
        let scale: f64 = format!("1e{exponent}").parse().unwrap();
        let vectors = || directions[..count].iter().map(|vector| vector.map(|part| part * scale));
        let uvs = directions[..count].iter().map(|[u, v, _]| [*u, *v]);
        let mesh = Mesh::new(
            positions,
            triangles.clone(),
            has[0].then(|| vectors().collect()),
            has[1].then(|| vectors().collect()),
            has[2].then(|| uvs.collect()),
        );
        if let Ok(mesh) = mesh {
            invariants::check(&mesh);
            prop_assert_eq!(mesh.triangles().len() + mesh.without_area(), triangles.len());
        }
    }
}

#[test]
fn triangles_of_any_size_are_kept_exactly() {
    let mut positions = Vec::new();
    let mut triangles = Vec::new();
    for (number, size) in [1e3, 1.0, 1e-3_f64].into_iter().enumerate() {
        let size = size * 1.000_000_1;
        let at = 0.1 * number as f64;
        positions.extend([
            [at, at, at],
            [at + size, at, at],
            [at, at + size, at + size / 3.0],
        ]);
        let first = 3 * number as u32;
        triangles.push([first, first + 1, first + 2]);
    }
    let mesh = Mesh::new(positions.clone(), triangles.clone(), None, None, None).unwrap();
    assert_eq!(
        (mesh.positions(), mesh.triangles()),
        (&positions[..], &triangles[..])
    );
    let mut text = String::new();
    for [x, y, z] in &positions {
        text += &format!("v {x} {y} {z:e}\n");
    }
    for [a, b, c] in &triangles {
        text += &format!("f {} {} {}\n", a + 1, b + 1, c + 1);
    }
    let read = Mesh::read(text.as_bytes()).unwrap();
    assert_eq!(read, mesh);
    assert_eq!(Mesh::read(&mesh.to_ply()).unwrap(), mesh);
}

#[test]
fn triangles_without_an_area_are_left_out_and_counted() {
    let text = "v 0 0 0\nv 1 0 0\nv 2 0 0\nv 0 1 0\nvn 0 0 0\nvn 0 0 1\n\
        f 1//1 1//1 2//1\nf 1//1 2//1 3//1\nf 1//2 2//2 4//2\nf 1//2 2//2 4//2\n";
    let mesh = Mesh::read(text.as_bytes()).unwrap();
    assert_eq!(mesh.without_area(), 2);
    assert_eq!(
        mesh.triangles(),
        [[0, 1, 2]; 2],
        "a triangle may stand twice"
    );
    assert_eq!(mesh.bounds()[1], [1.0, 1.0, 0.0], "vertex 3 is not used");
    invariants::check(&mesh);
}

#[test]
fn a_file_that_is_too_large_is_refused_by_its_length() {
    let bytes = vec![0; limits::FILE_BYTES_MAX as usize + 1];
    let bytes_max = Mesh::read(&bytes);
    assert_eq!(
        bytes_max,
        Err(MeshError::FileTooLarge { bytes: 536_870_913 })
    );
}

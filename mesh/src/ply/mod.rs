//! PLY: text, and binary in both byte orders.
//!
//! Read are the elements `vertex` and `face`, with the names of properties that programs in use give
//! them; other elements and properties are skipped.
//!
//! The reader is our own. ply-rs-bw 4.0.1 was tried and has these faults: of two properties with one
//! name it forgets one, so that it reads every later number in the wrong place and says nothing; it
//! ignores numbers beyond those that a line should have; it refuses numbers such as `1.` and headers
//! with a comment that is not UTF-8; and it builds what an element without properties announces,
//! though no byte of the file backs it.

mod body;
mod header;
mod vertices;
mod write;

pub use write::write;

use crate::{Mesh, MeshError, Place, check::Parts, limits::TRIANGLES_MAX};
use body::{Body, Row};
use header::{Element, Header, Kind, Property};
use vertices::read_vertices;

/// Names of the list of a face's corners.
const INDICES: [&str; 2] = ["vertex_indices", "vertex_index"];

/// Whether bytes begin as a PLY file does.
pub fn is_ply(bytes: &[u8]) -> bool {
    matches!(bytes, [b'p', b'l', b'y', b'\n' | b'\r', ..])
}

/// Reads a mesh from the bytes of a PLY file.
pub fn read(bytes: &[u8]) -> Result<Mesh, MeshError> {
    let (header, lines) = Header::parse(bytes)?;
    let find = |name: &str| header.elements.iter().find(|element| element.name == name);
    let vertices = match (find("vertex"), find("face")) {
        (_, None | Some(Element { count: 0, .. })) => return Err(MeshError::NoFaces),
        (None, _) => {
            return Err(header_lacks("has no element `vertex`"));
        }
        (Some(vertices), Some(_)) => vertices.count,
    };
    let mut body = Body::new(header.encoding, lines);
    let mut parts = Parts::default();
    for element in &header.elements {
        body.check_count(element)?;
        match element.name.as_str() {
            "vertex" => read_vertices(&mut body, element, &mut parts)?,
            "face" => parts.triangles = read_faces(&mut body, element, vertices)?,
            _ => skip(&mut body, element)?,
        }
    }
    body.finish()?;
    parts.into_mesh(|_, vertex| Place::Vertex(vertex))
}

fn skip(body: &mut Body<'_>, element: &Element) -> Result<(), MeshError> {
    // An element without properties has no bytes in the file, however many rows it announces.
    if element.properties.is_empty() {
        return Ok(());
    }
    for index in element.rows() {
        let row = Row { element, index };
        body.start_row(row)?;
        for property in &element.properties {
            body.skip(row, property)?;
        }
        body.end_row()?;
    }
    Ok(())
}

fn read_faces(
    body: &mut Body<'_>,
    element: &Element,
    vertices: u64,
) -> Result<Vec<[u32; 3]>, MeshError> {
    let properties = &element.properties;
    let list = properties
        .iter()
        .position(|property| INDICES.contains(&property.name.as_str()));
    let Some(list) = list else {
        return Err(header_lacks(
            "has no property `vertex_indices` of the element `face`",
        ));
    };
    if element.count > TRIANGLES_MAX as u64 {
        return Err(MeshError::TooManyTriangles);
    }
    let mut triangles = Vec::with_capacity(element.rows().len());
    for index in element.rows() {
        let row = Row { element, index };
        body.start_row(row)?;
        for (number, property) in properties.iter().enumerate() {
            if number != list {
                body.skip(row, property)?;
                continue;
            }
            let (corners, [a, b, c, d]) = read_corners(body, row, property, vertices)?;
            triangles.push([a, b, c]);
            if corners == 4 {
                triangles.push([a, c, d]);
            }
        }
        body.end_row()?;
        if triangles.len() > TRIANGLES_MAX {
            return Err(MeshError::TooManyTriangles);
        }
    }
    Ok(triangles)
}

/// Reads the list of a face's three or four corners, and tells how many there are.
fn read_corners(
    body: &mut Body<'_>,
    row: Row<'_>,
    property: &Property,
    vertices: u64,
) -> Result<(usize, [u32; 4]), MeshError> {
    let (length, item) = match property.kind {
        Kind::List(length, item) if !item.is_float() => (length, item),
        _ => {
            return Err(header_lacks(
                "must declare the corners of a face as a list of whole numbers",
            ));
        }
    };
    let place = Place::Face(row.index);
    let count = body.list_length(row, property, length)?;
    if !(3..=4).contains(&count) {
        let corners = count;
        return Err(MeshError::Corners { place, corners });
    }
    let mut corners = [0; 4];
    for vertex in corners.iter_mut().take(count) {
        let index = body.number(row, property, item)?;
        // NaN is not whole either.
        if index.fract() != 0.0 {
            return Err(row.value(property, "holds a number that is not whole"));
        }
        if !(0.0..vertices as f64).contains(&index) {
            return Err(MeshError::IndexOutOfRange {
                place,
                what: "vertex",
                index: index as i64,
                range: format!("the file has {vertices} vertices, counted from 0"),
            });
        }
        *vertex = index as u32;
    }
    Ok((count, corners))
}

fn header_lacks(message: &str) -> MeshError {
    let message = message.to_owned();
    MeshError::PlyHeader { message }
}

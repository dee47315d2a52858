//! The element `vertex` of a PLY file.

use super::{
    body::{Body, Row},
    header::{Element, Kind, Scalar},
    header_lacks,
};
use crate::{MeshError, check::Parts, limits::VERTICES_MAX};

/// What is read of a vertex: position, normal, tangent, texture coordinate.
const NUMBERS: usize = 3 + 3 + 3 + 2;

/// A group of properties: where its numbers stand among the [`NUMBERS`], and the names that programs
/// give them.
struct Group {
    start: usize,
    names: &'static [&'static [&'static str]],
}

const POSITION: Group = Group {
    start: 0,
    names: &[&["x", "y", "z"]],
};
const NORMAL: Group = Group {
    start: 3,
    names: &[&["nx", "ny", "nz"]],
};
const TANGENT: Group = Group {
    start: 6,
    names: &[
        &["tx", "ty", "tz"],
        &["tangent_x", "tangent_y", "tangent_z"],
    ],
};
const UV: Group = Group {
    start: 9,
    names: &[&["u", "v"], &["s", "t"], &["texture_u", "texture_v"]],
};

/// Where the numbers of a vertex go: of each property the type, and which of the [`NUMBERS`] it is.
type Slots = Vec<Option<(Scalar, usize)>>;

impl Group {
    /// Takes the first names of which all are there as numbers; a group with a part missing is
    /// ignored, as unknown properties are.
    fn find(&self, element: &Element, slots: &mut Slots) -> bool {
        self.names.iter().any(|names| {
            let found: Option<Vec<_>> = names.iter().map(|name| number(element, name)).collect();
            for (part, (property, scalar)) in found.iter().flatten().enumerate() {
                if let Some(slot) = slots.get_mut(*property) {
                    *slot = Some((*scalar, self.start + part));
                }
            }
            found.is_some()
        })
    }
}

/// The place and the type of a property that is a number.
fn number(element: &Element, name: &str) -> Option<(usize, Scalar)> {
    let mut properties = element.properties.iter();
    let place = properties.position(|property| property.name == name)?;
    match element.properties.get(place)?.kind {
        Kind::Number(scalar) => Some((place, scalar)),
        Kind::List(..) => None,
    }
}

/// Reads what the vertices have.
pub fn read_vertices(
    body: &mut Body<'_>,
    element: &Element,
    parts: &mut Parts,
) -> Result<(), MeshError> {
    let mut slots = vec![None; element.properties.len()];
    if !POSITION.find(element, &mut slots) {
        return Err(header_lacks(
            "must declare the numbers `x`, `y` and `z` of the element `vertex`",
        ));
    }
    if element.count > VERTICES_MAX as u64 {
        return Err(MeshError::TooManyVertices { what: "vertices" });
    }
    let rows = element.rows().len();
    let mut normals = NORMAL
        .find(element, &mut slots)
        .then(|| Vec::with_capacity(rows));
    let mut tangents = TANGENT
        .find(element, &mut slots)
        .then(|| Vec::with_capacity(rows));
    let mut uvs = UV
        .find(element, &mut slots)
        .then(|| Vec::with_capacity(rows));
    parts.positions.reserve_exact(rows);
    let mut numbers = [0.0; NUMBERS];
    for index in element.rows() {
        let row = Row { element, index };
        body.start_row(row)?;
        for (property, slot) in element.properties.iter().zip(&slots) {
            match slot {
                Some((scalar, slot)) => numbers[*slot] = body.number(row, property, *scalar)?,
                None => body.skip(row, property)?,
            }
        }
        body.end_row()?;
        let [x, y, z, nx, ny, nz, tx, ty, tz, u, v] = numbers;
        parts.positions.push([x, y, z]);
        push(&mut normals, [nx, ny, nz]);
        push(&mut tangents, [tx, ty, tz]);
        push(&mut uvs, [u, v]);
    }
    parts.normals = normals;
    parts.tangents = tangents;
    parts.uvs = uvs;
    Ok(())
}

fn push<T>(values: &mut Option<Vec<T>>, value: T) {
    if let Some(values) = values {
        values.push(value);
    }
}

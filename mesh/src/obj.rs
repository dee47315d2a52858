//! Wavefront OBJ: the statements `v`, `vt`, `vn` and `f`.
//!
//! Other statements of the format are ignored; material libraries are never opened. What is no
//! statement of the format is refused, so that a file of another kind is not taken for an empty mesh.
//!
//! The reader is our own. tobj 4.0.5 was tried and has these faults, which cannot be mended from
//! outside: its errors name neither a line nor a face; where some corners have normals and others have
//! none, it drops normals and says nothing; it makes a mesh of each group, so that a file of 2 MB with
//! many groups takes 150 MB; and it refuses lines that a backslash continues.

use crate::{
    Attribute, Mesh, MeshError, Place,
    check::{Parts, check_position},
    limits::{TRIANGLES_MAX, VERTICES_MAX},
    text::{Lines, number, quoted, take_word},
};
use std::{borrow::Cow, collections::HashMap};

/// Stands for a normal or a texture coordinate that a corner does not have.
const ABSENT: u32 = u32::MAX;

/// Numbers after `v`: three coordinates, a weight, a colour.
const NUMBERS_MAX: usize = 7;

/// Statements that say nothing about triangles: those of the format (Wavefront, "Advanced Visualizer",
/// appendix B1), and two that other programs write.
const IGNORED: &str = "g usemtl o s l p vp mtllib usemap maplib mg bevel c_interp d_interp lod \
    shadow_obj trace_obj ctech stech cstype deg bmat step curv curv2 surf parm trim hole scrv sp end \
    con call csh bsp bzp cdc cdp res vc usemat";

/// What a corner's three indices count, in their order.
const COUNTED: [&str; 3] = ["vertex", "texture coordinate", "normal"];
const COUNTED_PLURAL: [&str; 3] = ["vertices", "texture coordinates", "normals"];

/// Indices of a corner's position, texture coordinate and normal, counted from 0.
type Corner = [u32; 3];

#[derive(Default)]
struct Reader {
    positions: Vec<[f64; 3]>,
    uvs: Vec<[f64; 2]>,
    normals: Vec<[f64; 3]>,
    triangles: Vec<[u32; 3]>,
    /// Vertices of the mesh: each corner once, with the line of its first use.
    corners: Vec<(Corner, u32)>,
    vertex_of_corner: HashMap<Corner, u32>,
    /// Whether corners have texture coordinates and normals, once the first face has said so.
    has: Option<[bool; 2]>,
}

/// Reads a mesh from the bytes of an OBJ file.
pub fn read(bytes: &[u8]) -> Result<Mesh, MeshError> {
    let mut reader = Reader::default();
    let mut lines = Lines::of(bytes);
    while let Some(line) = next_statement(&mut lines) {
        let number = lines.number();
        let statement = continued(line, &mut lines);
        reader.statement(&statement, number)?;
    }
    reader.into_mesh()
}

/// The next line up to its comment.
fn next_statement<'a>(lines: &mut Lines<'a>) -> Option<&'a [u8]> {
    let (line, _) = lines.take()?;
    let comment = line.iter().position(|byte| *byte == b'#');
    let statement = comment.and_then(|at| line.get(..at)).unwrap_or(line);
    Some(statement.trim_ascii_end())
}

/// The statement, joined with the lines that follow where it ends with a backslash. A backslash at the
/// end of a comment does not count, since it may be that of a folder's name.
fn continued<'a>(statement: &'a [u8], lines: &mut Lines<'a>) -> Cow<'a, [u8]> {
    let Some(start) = statement.strip_suffix(b"\\") else {
        return Cow::Borrowed(statement);
    };
    let mut joined = start.to_vec();
    while let Some(next) = next_statement(lines) {
        joined.push(b' ');
        let Some(next) = next.strip_suffix(b"\\") else {
            joined.extend(next);
            break;
        };
        joined.extend(next);
    }
    Cow::Owned(joined)
}

fn syntax(line: usize, message: impl Into<String>) -> MeshError {
    let message = message.into();
    MeshError::Syntax { line, message }
}

impl Reader {
    fn statement(&mut self, mut rest: &[u8], number: usize) -> Result<(), MeshError> {
        let Some(keyword) = take_word(&mut rest) else {
            return Ok(());
        };
        match keyword {
            b"v" => {
                let [x, y, z, ..] = numbers(rest, number, 3..=NUMBERS_MAX)?;
                check_position([x, y, z], Place::Line(number))?;
                push(&mut self.positions, [x, y, z], 0)
            }
            b"vt" => {
                let [u, v, ..] = numbers(rest, number, 1..=3)?;
                push(&mut self.uvs, [u, v], 1)
            }
            b"vn" => {
                let [x, y, z, ..] = numbers(rest, number, 3..=3)?;
                push(&mut self.normals, [x, y, z], 2)
            }
            b"f" => self.face(rest, number),
            _ if is_ignored(keyword) => Ok(()),
            _ => Err(syntax(
                number,
                format!(
                    "{} is no statement of an OBJ file; is this an OBJ or a PLY file?",
                    quoted(keyword)
                ),
            )),
        }
    }

    fn face(&mut self, mut rest: &[u8], line: usize) -> Result<(), MeshError> {
        let mut vertices = [0; 4];
        let mut count = 0;
        while let Some(word) = take_word(&mut rest) {
            // Corners beyond the fourth are only counted.
            if let Some(vertex) = vertices.get_mut(count) {
                let corner = self.corner(word, line)?;
                *vertex = self.vertex(corner, line)?;
            }
            count += 1;
        }
        let [a, b, c, d] = vertices;
        match count {
            3 => self.triangles.push([a, b, c]),
            4 => self.triangles.extend([[a, b, c], [a, c, d]]),
            corners => {
                let place = Place::Line(line);
                return Err(MeshError::Corners { place, corners });
            }
        }
        if self.triangles.len() > TRIANGLES_MAX {
            return Err(MeshError::TooManyTriangles);
        }
        Ok(())
    }

    /// Reads `7`, `7/1`, `7//3` or `7/1/3`.
    fn corner(&mut self, word: &[u8], line: usize) -> Result<Corner, MeshError> {
        let counts = [self.positions.len(), self.uvs.len(), self.normals.len()];
        let mut corner = [ABSENT; 3];
        let mut parts = word.split(|byte| *byte == b'/');
        for (which, index) in corner.iter_mut().enumerate() {
            match parts.next() {
                None | Some([]) => {}
                Some(part) => *index = resolved(part, which, counts, line)?,
            }
        }
        let [position, uv, normal] = corner;
        if position == ABSENT || parts.next().is_some() {
            let message = format!(
                "{} is no corner of a face: it must be written v, v/vt, v//vn or v/vt/vn",
                quoted(word)
            );
            return Err(syntax(line, message));
        }
        let has = [uv != ABSENT, normal != ABSENT];
        let [uvs, normals] = *self.has.get_or_insert(has);
        for (differs, what) in [
            (uvs != has[0], "texture coordinates"),
            (normals != has[1], "normals"),
        ] {
            if differs {
                return Err(MeshError::Mixed { line, what });
            }
        }
        Ok(corner)
    }

    /// The mesh's vertex that a corner is.
    fn vertex(&mut self, corner: Corner, line: usize) -> Result<u32, MeshError> {
        let new = self.corners.len() as u32;
        let vertex = *self.vertex_of_corner.entry(corner).or_insert(new);
        if vertex == new {
            push(&mut self.corners, (corner, line as u32), 0)?;
        }
        Ok(vertex)
    }

    fn into_mesh(self) -> Result<Mesh, MeshError> {
        drop(self.vertex_of_corner);
        let Some([has_uvs, has_normals]) = self.has else {
            return Err(MeshError::NoFaces);
        };
        let corners = &self.corners;
        let parts = Parts {
            positions: looked_up(corners, 0, self.positions)?,
            triangles: self.triangles,
            uvs: has_uvs
                .then(|| looked_up(corners, 1, self.uvs))
                .transpose()?,
            normals: has_normals
                .then(|| looked_up(corners, 2, self.normals))
                .transpose()?,
            tangents: None,
        };
        parts.into_mesh(|attribute, vertex| {
            let corner = corners.get(vertex).map_or([0; 3], |(corner, _)| *corner);
            let [position, uv, normal] = corner.map(|index| index as usize + 1);
            match attribute {
                Attribute::Normal => Place::Normal(normal),
                Attribute::Uv => Place::Uv(uv),
                Attribute::Position | Attribute::Tangent => Place::Vertex(position),
            }
        })
    }
}

fn is_ignored(keyword: &[u8]) -> bool {
    let mut ignored = IGNORED.split_ascii_whitespace();
    ignored.any(|known| known.as_bytes() == keyword)
}

/// The numbers of a statement, followed by zeros; `count` says how many there may be.
fn numbers(
    mut rest: &[u8],
    line: usize,
    count: std::ops::RangeInclusive<usize>,
) -> Result<[f64; NUMBERS_MAX], MeshError> {
    let mut numbers = [0.0; NUMBERS_MAX];
    let mut given = 0;
    while let Some(word) = take_word(&mut rest) {
        if let Some(slot) = numbers.get_mut(given) {
            *slot = number(word)
                .ok_or_else(|| syntax(line, format!("{} is no number", quoted(word))))?;
        }
        given += 1;
    }
    if !count.contains(&given) {
        let (least, most) = (count.start(), count.end());
        let message = if least == most {
            format!("the statement needs {least} numbers, but has {given}")
        } else {
            format!("the statement needs {least} to {most} numbers, but has {given}")
        };
        return Err(syntax(line, message));
    }
    Ok(numbers)
}

/// Resolves an index: from 1 from the beginning of the file, or from -1 back from this line.
fn resolved(word: &[u8], which: usize, counts: [usize; 3], line: usize) -> Result<u32, MeshError> {
    let what = COUNTED[which];
    let Some(index) = number::<i64>(word) else {
        return Err(syntax(line, format!("{} is no {what} index", quoted(word))));
    };
    let before = counts[which];
    let absolute = if index < 0 {
        (before as i64).checked_add(index)
    } else {
        index.checked_sub(1)
    };
    match absolute {
        Some(absolute) if (0..VERTICES_MAX as i64).contains(&absolute) => Ok(absolute as u32),
        _ => Err(MeshError::IndexOutOfRange {
            place: Place::Line(line),
            what,
            index,
            range: match index {
                0 => "indices of an OBJ file count from 1".to_owned(),
                1.. => format!("a mesh has at most {VERTICES_MAX}"),
                ..0 => format!("before this line there are {before}"),
            },
        }),
    }
}

/// The values that the corners name by the first, second or third of their indices. Frees the list, so
/// that at most one is there twice.
fn looked_up<T: Copy>(
    corners: &[(Corner, u32)],
    which: usize,
    values: Vec<T>,
) -> Result<Vec<T>, MeshError> {
    let mut found = Vec::with_capacity(corners.len());
    for (corner, line) in corners {
        let index = corner[which];
        let Some(value) = values.get(index as usize) else {
            return Err(MeshError::IndexOutOfRange {
                place: Place::Line(*line as usize),
                what: COUNTED[which],
                index: i64::from(index) + 1,
                range: format!("the file has {} {}", values.len(), COUNTED_PLURAL[which]),
            });
        };
        found.push(*value);
    }
    Ok(found)
}

fn push<T>(values: &mut Vec<T>, value: T, which: usize) -> Result<(), MeshError> {
    if values.len() >= VERTICES_MAX {
        let what = COUNTED_PLURAL[which];
        return Err(MeshError::TooManyVertices { what });
    }
    values.push(value);
    Ok(())
}

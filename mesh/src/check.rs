//! What makes lists of numbers a mesh.
//!
//! Files name a vertex that is at fault in their own ways, so the checks ask for a vertex's name
//! where they need one.

use crate::{
    Attribute, Mesh, MeshError, Place,
    limits::{COORDINATE_MAX, SIDE_FRACTION_MIN, SIDE_MIN, TRIANGLES_MAX, VERTICES_MAX},
};

/// Marks a vertex that no triangle uses.
const UNUSED: u32 = u32::MAX;

/// How far the square of a unit vector's length may be from 1 by rounding. A vector this close is left
/// as it is, so that normalising twice changes nothing.
const UNIT_SQUARE_TOLERANCE: f64 = 16.0 * f64::EPSILON;

/// The numbers of a mesh as they stand in a file; each face is one or two triangles.
#[derive(Default)]
pub struct Parts {
    pub positions: Vec<[f64; 3]>,
    pub triangles: Vec<[u32; 3]>,
    pub normals: Option<Vec<[f64; 3]>>,
    pub tangents: Option<Vec<[f64; 3]>>,
    pub uvs: Option<Vec<[f64; 2]>>,
}

impl Parts {
    /// Checks everything that [`Mesh`] promises, and establishes what can be established.
    pub fn into_mesh(
        mut self,
        place: impl Fn(Attribute, usize) -> Place,
    ) -> Result<Mesh, MeshError> {
        self.check_counts()?;
        for (vertex, position) in self.positions.iter().enumerate() {
            check_position(*position, place(Attribute::Position, vertex))?;
        }
        self.check_indices()?;
        let triangles_before = self.triangles.len();
        let positions = &self.positions;
        self.triangles
            .retain(|triangle| double_area(positions, *triangle) != [0.0; 3]);
        if self.triangles.is_empty() {
            return Err(MeshError::Empty);
        }
        let without_area = triangles_before - self.triangles.len();
        let used = used(&self.triangles, self.positions.len());
        check_size(&self.positions, &used)?;
        for (vectors, attribute) in [
            (&mut self.normals, Attribute::Normal),
            (&mut self.tangents, Attribute::Tangent),
        ] {
            for (vertex, vector) in vectors.iter_mut().flatten().enumerate() {
                if used[vertex] {
                    let place = || place(attribute, vertex);
                    *vector = unit(*vector, attribute, place)?;
                }
            }
        }
        for (vertex, uv) in self.uvs.iter().flatten().enumerate() {
            if used[vertex] && !uv.iter().all(|coordinate| coordinate.is_finite()) {
                return Err(MeshError::NotFinite {
                    place: place(Attribute::Uv, vertex),
                    attribute: Attribute::Uv,
                });
            }
        }
        self.turn_to_normals();
        Ok(self.numbered_by_use(without_area))
    }

    fn check_counts(&self) -> Result<(), MeshError> {
        if self.triangles.len() > TRIANGLES_MAX {
            return Err(MeshError::TooManyTriangles);
        }
        let vertices = self.positions.len();
        if vertices > VERTICES_MAX {
            return Err(MeshError::TooManyVertices { what: "vertices" });
        }
        let counts = [
            ("normals", self.normals.as_ref().map(Vec::len)),
            ("tangents", self.tangents.as_ref().map(Vec::len)),
            ("texture coordinates", self.uvs.as_ref().map(Vec::len)),
        ];
        for (what, count) in counts {
            if let Some(count) = count
                && count != vertices
            {
                return Err(MeshError::Lengths {
                    what,
                    count,
                    vertices,
                });
            }
        }
        Ok(())
    }

    /// Readers name the face of their file before; this is for meshes that are made in memory.
    fn check_indices(&self) -> Result<(), MeshError> {
        let vertices = self.positions.len();
        for (face, triangle) in self.triangles.iter().enumerate() {
            for index in triangle {
                if *index as usize >= vertices {
                    return Err(MeshError::IndexOutOfRange {
                        place: Place::Face(face),
                        what: "vertex",
                        index: i64::from(*index),
                        range: format!("there are {vertices} vertices, counted from 0"),
                    });
                }
            }
        }
        Ok(())
    }

    /// Turns each triangle whose winding is against its normals.
    fn turn_to_normals(&mut self) {
        let Some(normals) = &self.normals else {
            return;
        };
        for triangle in &mut self.triangles {
            let [n0, n1, n2] = triangle.map(|vertex| normals[vertex as usize]);
            let geometric = double_area(&self.positions, *triangle);
            // n1 and n2 are added first: turned around, the sum is the same to the last bit, and
            // the product changes nothing but its sign.
            let sum: [f64; 3] = std::array::from_fn(|axis| n0[axis] + (n1[axis] + n2[axis]));
            if dot(geometric, sum) < 0.0 {
                triangle.swap(1, 2);
            }
        }
    }

    /// Numbers the vertices in the order in which triangles use them, and drops the rest.
    fn numbered_by_use(self, without_area: usize) -> Mesh {
        let mut numbers = vec![UNUSED; self.positions.len()];
        let mut order = Vec::new();
        let mut triangles = self.triangles;
        for vertex in triangles.as_flattened_mut() {
            let number = &mut numbers[*vertex as usize];
            if *number == UNUSED {
                *number = order.len() as u32;
                order.push(*vertex as usize);
            }
            *vertex = *number;
        }
        Mesh {
            positions: in_order(self.positions, &order),
            triangles,
            normals: self.normals.map(|normals| in_order(normals, &order)),
            tangents: self.tangents.map(|tangents| in_order(tangents, &order)),
            uvs: self.uvs.map(|uvs| in_order(uvs, &order)),
            without_area,
        }
    }
}

/// Refuses a position that is not finite or too far out.
pub fn check_position(position: [f64; 3], place: Place) -> Result<(), MeshError> {
    let largest = largest(position);
    if !largest.is_finite() {
        let attribute = Attribute::Position;
        return Err(MeshError::NotFinite { place, attribute });
    }
    if largest > COORDINATE_MAX {
        return Err(MeshError::CoordinateTooLarge { place });
    }
    Ok(())
}

fn in_order<T: Copy>(values: Vec<T>, order: &[usize]) -> Vec<T> {
    order.iter().map(|vertex| values[*vertex]).collect()
}

fn used(triangles: &[[u32; 3]], vertices: usize) -> Vec<bool> {
    let mut used = vec![false; vertices];
    for vertex in triangles.as_flattened() {
        used[*vertex as usize] = true;
    }
    used
}

fn check_size(positions: &[[f64; 3]], used: &[bool]) -> Result<(), MeshError> {
    let positions = || positions.iter().zip(used).filter(|(_, used)| **used);
    let mut bounds = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];
    for (position, _) in positions() {
        extend(&mut bounds, *position);
    }
    let longest = largest(difference(bounds[1], bounds[0]));
    let coordinate = largest(bounds[0]).max(largest(bounds[1]));
    if longest < SIDE_MIN.max(SIDE_FRACTION_MIN * coordinate) {
        return Err(MeshError::TooSmall);
    }
    Ok(())
}

/// Extends a box so that it holds a point.
pub fn extend(bounds: &mut [[f64; 3]; 2], point: [f64; 3]) {
    for axis in 0..3 {
        bounds[0][axis] = bounds[0][axis].min(point[axis]);
        bounds[1][axis] = bounds[1][axis].max(point[axis]);
    }
}

/// A vector of a triangle's front normal, as long as twice its area.
fn double_area(positions: &[[f64; 3]], triangle: [u32; 3]) -> [f64; 3] {
    let [a, b, c] = triangle.map(|vertex| positions[vertex as usize]);
    cross(difference(b, a), difference(c, a))
}

fn unit(
    vector: [f64; 3],
    attribute: Attribute,
    place: impl Fn() -> Place,
) -> Result<[f64; 3], MeshError> {
    let largest = largest(vector);
    if !largest.is_finite() {
        let place = place();
        return Err(MeshError::NotFinite { place, attribute });
    }
    if largest == 0.0 {
        let place = place();
        return Err(MeshError::ZeroLength { place, attribute });
    }
    if (dot(vector, vector) - 1.0).abs() <= UNIT_SQUARE_TOLERANCE {
        return Ok(vector);
    }
    // The square of a long or a short vector would overflow or vanish.
    let scaled = vector.map(|component| component / largest);
    let length = dot(scaled, scaled).sqrt();
    Ok(scaled.map(|component| component / length))
}

/// The largest magnitude of a component; NaN if one is NaN.
fn largest(vector: [f64; 3]) -> f64 {
    let [x, y, z] = vector.map(f64::abs);
    if x.is_nan() || y.is_nan() || z.is_nan() {
        f64::NAN
    } else {
        x.max(y).max(z)
    }
}

fn difference(to: [f64; 3], from: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|axis| to[axis] - from[axis])
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn normalised(vector: [f64; 3]) -> Result<[f64; 3], MeshError> {
        unit(vector, Attribute::Normal, || Place::Vertex(0))
    }

    #[test]
    fn vectors_of_any_length_become_unit_vectors() {
        for length in [5e-324, 1e-200, 0.7, 1.0, 3.0, 1e200, f64::MAX] {
            assert_eq!(normalised([0.0, -length, 0.0]), Ok([0.0, -1.0, 0.0]));
        }
    }

    #[test]
    fn a_unit_vector_stays_as_it_is() {
        for number in 1..2000 {
            let number = f64::from(number);
            let vector = [number, number * 0.37 - 31.0, 211.0 / number];
            let once = normalised(vector).unwrap();
            assert_eq!(normalised(once), Ok(once));
        }
    }

    #[test]
    fn the_turned_triangle_has_the_opposite_normal() {
        let positions = [[0.1, 0.2, 0.3], [1.7, -0.3, 0.9], [-0.2, 1.1, 1e-7]];
        let [front, back] = [[0, 1, 2], [0, 2, 1]].map(|turn| double_area(&positions, turn));
        assert_eq!(front, back.map(|component| -component));
    }
}

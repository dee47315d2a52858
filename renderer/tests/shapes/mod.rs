//! Closed and open meshes that tests make, by their vertices and triangles.

#![allow(dead_code, reason = "each test uses some of them")]

use renderer::vector::Vec3;
use std::f64::consts::PI;

/// Vertices and the corners of triangles, counter-clockwise as seen from the front.
#[derive(Clone, Debug)]
pub struct Shape {
    pub positions: Vec<Vec3>,
    pub triangles: Vec<[u32; 3]>,
}

impl Shape {
    /// The same with each vertex moved by `to`.
    pub fn moved(mut self, to: impl Fn(Vec3) -> Vec3) -> Self {
        for position in &mut self.positions {
            *position = to(*position);
        }
        self
    }

    /// The corners of a triangle.
    pub fn corners(&self, triangle: usize) -> [Vec3; 3] {
        self.triangles[triangle].map(|vertex| self.positions[vertex as usize])
    }
}

/// A grid of `columns` x `rows` quadrilaterals over the unit square, each split in two. Vertex (i, j) is
/// at `at(i, j)`; where `wraps`, the last column or row is joined to the first.
fn grid([columns, rows]: [u32; 2], wraps: [bool; 2], at: impl Fn(f64, f64) -> Vec3) -> Shape {
    let counts = [0, 1].map(|axis| [columns, rows][axis] + u32::from(!wraps[axis]));
    let index = |i: u32, j: u32| (j % counts[1]) * counts[0] + i % counts[0];
    let place = |k: u32, count: u32| f64::from(k) / f64::from(count);
    let all = (0..counts[1]).flat_map(|j| (0..counts[0]).map(move |i| [i, j]));
    let cells = (0..rows).flat_map(|j| (0..columns).map(move |i| [i, j]));
    Shape {
        positions: all
            .map(|[i, j]| at(place(i, columns), place(j, rows)))
            .collect(),
        triangles: cells
            .flat_map(|[i, j]| {
                let [a, b] = [index(i, j), index(i + 1, j)];
                let [c, d] = [index(i + 1, j + 1), index(i, j + 1)];
                [[a, b, c], [a, c, d]]
            })
            .collect(),
    }
}

/// A torus about z of 2 `columns` `rows` triangles: closed.
pub fn torus(columns: u32, rows: u32, radius: f64, tube: f64) -> Shape {
    grid([columns, rows], [true, true], |i, j| {
        let [(sin_i, cos_i), (sin_j, cos_j)] = [i, j].map(|x| libm::sincos(2.0 * PI * x));
        let outward = radius + tube * cos_j;
        Vec3::new(outward * cos_i, outward * sin_i, tube * sin_j)
    })
}

/// A sphere of 20 `frequency`^2 triangles: the icosahedron's, each divided, with all vertices at `radius`.
/// Closed; vertices of its edges are there more than once, at the same place.
pub fn sphere(frequency: u32, radius: f64) -> Shape {
    let golden = 0.5 * (1.0 + 5f64.sqrt());
    let mut corners = Vec::new();
    for (a, b) in [
        (1.0, golden),
        (-1.0, golden),
        (1.0, -golden),
        (-1.0, -golden),
    ] {
        corners.extend([
            Vec3::new(0.0, a, b),
            Vec3::new(a, b, 0.0),
            Vec3::new(b, 0.0, a),
        ]);
    }
    let side = 2.0 + 1e-9;
    let mut shape = Shape {
        positions: Vec::new(),
        triangles: Vec::new(),
    };
    for i in 0..12 {
        for j in i + 1..12 {
            for k in j + 1..12 {
                let [a, mut b, mut c] = [i, j, k].map(|at: usize| corners[at]);
                let is_face = [b - a, c - b, a - c]
                    .iter()
                    .all(|edge| edge.length() < side);
                if !is_face {
                    continue;
                }
                if (b - a).cross(c - a).dot(a) < 0.0 {
                    (b, c) = (c, b);
                }
                divide(&mut shape, [a, b, c], frequency, radius);
            }
        }
    }
    shape
}

/// Adds a triangle, divided into `frequency`^2, its vertices at `radius`. A vertex is the same to the last
/// bit from both sides of an edge: its terms are summed in an order that the corners decide.
fn divide(shape: &mut Shape, corners: [Vec3; 3], frequency: u32, radius: f64) {
    let first = shape.positions.len() as u32;
    let mut row_starts = Vec::new();
    for i in 0..=frequency {
        row_starts.push(shape.positions.len() as u32 - first);
        for j in 0..=frequency - i {
            let weights = [frequency - i - j, j, i].map(f64::from);
            let mut terms = [0, 1, 2].map(|at| corners[at] * weights[at]);
            terms.sort_by(|a, b| {
                <[f64; 3]>::from(*a)
                    .partial_cmp(&(*b).into())
                    .expect("numbers")
            });
            let nonzero = terms.into_iter().filter(|term| term.length_squared() > 0.0);
            let sum = nonzero.fold(Vec3::default(), |sum, term| sum + term);
            shape.positions.push(sum.normalized() * radius);
        }
    }
    let at = |i: u32, j: u32| first + row_starts[i as usize] + j;
    for i in 0..frequency {
        for j in 0..frequency - i {
            shape.triangles.push([at(i, j), at(i, j + 1), at(i + 1, j)]);
            if j + 1 < frequency - i {
                shape
                    .triangles
                    .push([at(i, j + 1), at(i + 1, j + 1), at(i + 1, j)]);
            }
        }
    }
}

/// The mantle of a cylinder along x, of 2 `columns` `rows` triangles: open at both ends.
pub fn cylinder(columns: u32, rows: u32, radius: f64, length: f64) -> Shape {
    grid([columns, rows], [true, false], |i, j| {
        let (sin, cos) = libm::sincos(2.0 * PI * i);
        Vec3::new(length * (j - 0.5), radius * sin, radius * cos)
    })
}

/// A cloth of 2 `side`^2 triangles that lies over a ball and falls in folds: open, 1 across.
pub fn cloth(side: u32) -> Shape {
    grid([side, side], [false, false], |i, j| {
        let (x, y) = (2.0 * i - 1.0, 2.0 * j - 1.0);
        let outward = libm::hypot(x, y);
        let around = libm::atan2(y, x);
        // The ball's top, and beyond it a slope that folds more the further out it is.
        let over = if outward < 0.5 {
            (0.36 - outward * outward).max(0.0).sqrt()
        } else {
            let fall = outward - 0.5;
            0.331_662_479_035_54 - 1.2 * fall
        };
        let folds = 0.12 * (outward - 0.35).max(0.0) * libm::cos(9.0 * around + 2.0 * outward);
        Vec3::new(0.5 * x, 0.5 * y, 0.5 * (over + folds))
    })
}

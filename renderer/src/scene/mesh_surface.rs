//! A mesh as the surface of a sample: where its triangles are, and how the material lies on them.

use super::frame::Frame;
use crate::geometry::{
    BackendChoice, FIRST_TRIANGLE, GeometryError, PrimitiveId, Sphere, TracedMesh, Triangles,
};
use crate::vector::Vec3;
use dataset::specification::{LoadedMesh, Sample};
use std::sync::Arc;

/// The squared length below which what is left of a direction, made perpendicular to another, is rounding.
const PERPENDICULAR_MIN: f64 = 1e-20;

/// How far a point is moved off its triangle, to the front, in units of the scene's largest coordinate: a
/// hundred times what rounding moves it.
const OFF_SURFACE: f64 = 1.0 / (1u64 << 45) as f64;

/// A mesh in the scene. It is built once for the scenes of all views.
#[derive(Clone, Debug)]
pub struct MeshSurface {
    traced: Arc<TracedMesh>,
    loaded: Arc<LoadedMesh>,
    /// The least and the largest corner of the box along the axes that holds it.
    bounds: [Vec3; 2],
    /// How far a point is moved off its triangle, in metres.
    off_surface: f64,
}

/// A point of a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OnTriangle {
    /// Which triangle.
    pub triangle: u32,
    /// The weights of its second and third corner.
    pub weights: [f64; 2],
}

/// The surface at a point of a triangle.
#[derive(Clone, Copy, Debug)]
pub struct MeshPoint {
    /// Where, a little to the front of the triangle.
    pub position: Vec3,
    /// The frame of the material there.
    pub frame: Frame,
    /// The unit normal of the triangle.
    pub facet: Vec3,
}

/// The corners of a triangle, or of a part of one. Points between them have means of what they have.
#[derive(Clone, Copy, Debug)]
pub struct Corners {
    /// Where they are.
    pub positions: [Vec3; 3],
    /// Their normals; `None` where those are the triangle's own.
    pub normals: Option<[Vec3; 3]>,
    /// What the x axes of their frames are made of; `None` where the mesh has neither tangents nor texture
    /// coordinates.
    pub along: Option<[Vec3; 3]>,
}

impl Corners {
    /// Those of four equal parts.
    pub fn divided(&self) -> [Self; 4] {
        let positions = divided(self.positions);
        let [normals, along] = [self.normals, self.along].map(|of_corners| of_corners.map(divided));
        std::array::from_fn(|part| Self {
            positions: positions[part],
            normals: normals.map(|normals| normals[part]),
            along: along.map(|along| along[part]),
        })
    }
}

/// The corners of four equal parts, where those of the whole have a, b and c.
fn divided([a, b, c]: [Vec3; 3]) -> [[Vec3; 3]; 4] {
    let [ab, bc, ca] = [(a + b) * 0.5, (b + c) * 0.5, (c + a) * 0.5];
    [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
}

impl MeshSurface {
    /// The mesh of a specification's sample.
    ///
    /// # Errors
    /// Where the mesh is not loaded, or the backend cannot be had.
    pub fn new(sample: &Sample, backend: BackendChoice) -> Result<Self, GeometryError> {
        let loaded = sample.loaded_mesh().ok_or(GeometryError::MeshNotLoaded)?;
        let positions: Box<[Vec3]> = loaded
            .placed(sample.side_m)
            .into_iter()
            .map(Vec3::from)
            .collect();
        let corners = loaded.mesh().triangles().into();
        let triangles =
            Triangles::new(positions, corners).map_err(|reason| GeometryError::Mesh { reason })?;
        let bounds = bounds(&triangles);
        let reach = bounds[0].length().max(bounds[1].length());
        Ok(Self {
            traced: Arc::new(TracedMesh::new(triangles, backend)?),
            loaded: Arc::clone(loaded),
            bounds,
            off_surface: OFF_SURFACE * reach,
        })
    }

    /// What rays meet.
    pub fn traced(&self) -> &Arc<TracedMesh> {
        &self.traced
    }

    /// The least and the largest corner of the box along the axes that holds it, in metres.
    pub fn bounds(&self) -> [Vec3; 2] {
        self.bounds
    }

    /// A ball that holds it.
    pub fn ball(&self) -> Sphere {
        let [lower, upper] = self.bounds;
        Sphere {
            centre: (lower + upper) * 0.5,
            radius: 0.5 * (upper - lower).length(),
        }
    }

    /// The triangle of a hit, by the hit's id.
    pub fn triangle(primitive: PrimitiveId) -> Option<u32> {
        primitive.0.checked_sub(FIRST_TRIANGLE.0)
    }

    /// The surface at a point.
    pub fn point(&self, at: OnTriangle) -> MeshPoint {
        let triangles = self.traced.triangles();
        let [a, b, c] = triangles.at(at.triangle as usize);
        let facet = (b - a).cross(c - a).normalized();
        let between = self.between(at);
        let normal = self.loaded.mesh().normals().map_or(facet, |normals| {
            let mean = between(normals);
            // Normals that point away from each other may leave none.
            if mean.length_squared() > PERPENDICULAR_MIN {
                mean.normalized()
            } else {
                facet
            }
        });
        let [v, w] = at.weights;
        let position = a * (1.0 - v - w) + b * v + c * w;
        MeshPoint {
            position: position + facet * self.off_surface,
            frame: self.frame(at, normal),
            facet,
        }
    }

    /// The corners of a triangle.
    pub fn corners(&self, triangle: usize) -> Corners {
        let vertices = self.traced.triangles().corners()[triangle];
        let of_vertices = |all: &[[f64; 3]]| vertices.map(|at| Vec3::from(all[at as usize]));
        let mesh = self.loaded.mesh();
        Corners {
            positions: self.traced.triangles().at(triangle),
            normals: mesh.normals().map(of_vertices),
            along: match mesh.tangents() {
                Some(tangents) => Some(of_vertices(tangents)),
                None => self.growth_of_u(triangle as u32).map(|along| [along; 3]),
            },
        }
    }

    /// The texture coordinates at a point; `None` where the mesh has none.
    pub fn uv(&self, at: OnTriangle) -> Option<[f64; 2]> {
        let uvs = self.loaded.mesh().uvs()?;
        let corners = self.traced.triangles().corners()[at.triangle as usize];
        let [a, b, c] = corners.map(|vertex| uvs[vertex as usize]);
        let [v, w] = at.weights;
        Some([0, 1].map(|axis| a[axis] * (1.0 - v - w) + b[axis] * v + c[axis] * w))
    }

    /// The mean of what three vertices have, by their weights at a point.
    fn between(&self, at: OnTriangle) -> impl Fn(&[[f64; 3]]) -> Vec3 {
        let corners = self.traced.triangles().corners()[at.triangle as usize];
        let [v, w] = at.weights;
        move |of_vertices| {
            let [a, b, c] = corners.map(|vertex| Vec3::from(of_vertices[vertex as usize]));
            a * (1.0 - v - w) + b * v + c * w
        }
    }

    /// The frame of the material about a normal: its x is the mesh's tangent, or else the direction in which
    /// the texture coordinate u grows across the triangle, made perpendicular to the normal. Where there is
    /// neither, the frame is the world's, carried as on a sphere.
    fn frame(&self, at: OnTriangle, normal: Vec3) -> Frame {
        let along = match self.loaded.mesh().tangents() {
            Some(tangents) => Some(self.between(at)(tangents)),
            None => self.growth_of_u(at.triangle),
        };
        let across = along.map(|along| along - normal * normal.dot(along));
        match across {
            Some(across) if across.length_squared() > PERPENDICULAR_MIN => {
                let x = across.normalized();
                Frame {
                    x,
                    y: normal.cross(x),
                    z: normal,
                }
            }
            _ => Frame::carried(normal),
        }
    }

    /// The unit direction in which u grows across a triangle; `None` where u or v is the same everywhere.
    fn growth_of_u(&self, triangle: u32) -> Option<Vec3> {
        let uvs = self.loaded.mesh().uvs()?;
        let triangles = self.traced.triangles();
        let [a, b, c] = triangles.at(triangle as usize);
        let [at_a, at_b, at_c] = triangles.corners()[triangle as usize].map(|v| uvs[v as usize]);
        let [b_u, b_v] = [0, 1].map(|axis| at_b[axis] - at_a[axis]);
        let [c_u, c_v] = [0, 1].map(|axis| at_c[axis] - at_a[axis]);
        let area = b_u * c_v - b_v * c_u;
        let growth = (b - a) * c_v - (c - a) * b_v;
        let growth = if area < 0.0 { -growth } else { growth };
        let length = growth.length();
        (area != 0.0 && length > 0.0 && length.is_finite()).then(|| growth * (1.0 / length))
    }
}

/// The corners of the box along the axes that holds the triangles.
fn bounds(triangles: &Triangles) -> [Vec3; 2] {
    let infinity = Vec3::new(f64::INFINITY, f64::INFINITY, f64::INFINITY);
    let vertices = triangles.corners().as_flattened().iter();
    vertices.fold([infinity, -infinity], |[lower, upper], vertex| {
        let at = triangles.positions()[*vertex as usize];
        [
            Vec3::new(lower.x.min(at.x), lower.y.min(at.y), lower.z.min(at.z)),
            Vec3::new(upper.x.max(at.x), upper.y.max(at.y), upper.z.max(at.z)),
        ]
    })
}

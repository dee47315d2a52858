//! Triangles, and where a ray meets them, in 64-bit floats and without gaps.
//!
//! A ray is turned to run along an axis (Woop, Benthin and Wald, "Watertight Ray/Triangle Intersection",
//! Journal of Computer Graphics Techniques 2(1), 2013), where each edge of a triangle is to one side of
//! it. Here the side is exact: products of two floats that round to the same are told apart by what
//! rounding left of them (Dekker 1971). So two triangles with an edge in common never disagree about it,
//! and a ray that runs through the edge meets both.

use super::primitive::{Bounds, COORDINATE_MAX_METRES, Intersection, PrimitiveId, Ray};
use super::shapes::Shapes;
use crate::vector::Vec3;

/// Triangles between shared vertices.
#[derive(Debug)]
pub struct Triangles {
    positions: Box<[Vec3]>,
    corners: Box<[[u32; 3]]>,
}

impl Triangles {
    /// From the vertices, in metres, and the three vertices of each triangle, counter-clockwise as seen
    /// from its front.
    ///
    /// # Errors
    /// If there is no triangle, an index is out of range, or a coordinate is not within 1e9 metres.
    pub fn new(positions: Box<[Vec3]>, corners: Box<[[u32; 3]]>) -> Result<Self, &'static str> {
        if corners.is_empty() {
            return Err("it has no triangle");
        }
        let vertices = corners.as_flattened();
        if vertices.iter().any(|at| *at as usize >= positions.len()) {
            return Err("a triangle has a vertex that is not there");
        }
        let reach = |at: &Vec3| Bounds::point(*at).reach();
        // Never true for NaN.
        if !positions
            .iter()
            .all(|at| reach(at) <= COORDINATE_MAX_METRES)
        {
            return Err("it reaches beyond 1e9 metres from the origin");
        }
        Ok(Self { positions, corners })
    }

    /// How many there are.
    pub fn count(&self) -> usize {
        self.corners.len()
    }

    /// The vertices, in metres.
    pub fn positions(&self) -> &[Vec3] {
        &self.positions
    }

    /// The vertices of each triangle.
    pub fn corners(&self) -> &[[u32; 3]] {
        &self.corners
    }

    /// Where the corners of a triangle are.
    pub fn at(&self, triangle: usize) -> [Vec3; 3] {
        self.corners[triangle].map(|vertex| self.positions[vertex as usize])
    }
}

impl Shapes for Triangles {
    type Prepared = ShearedRay;

    fn count(&self) -> usize {
        self.corners.len()
    }

    fn bounds(&self, id: PrimitiveId) -> Bounds {
        let corners = self.at(id.0 as usize).map(Bounds::point);
        corners.into_iter().fold(Bounds::EMPTY, Bounds::union)
    }

    fn prepare(&self, ray: &Ray) -> ShearedRay {
        ShearedRay::new(ray)
    }

    #[inline(always)]
    fn intersect(
        &self,
        id: PrimitiveId,
        ray: &ShearedRay,
        distance_max: f64,
    ) -> Option<Intersection> {
        ray.intersect(self.at(id.0 as usize), distance_max)
    }
}

/// A ray, and the shear that turns it to run along an axis.
#[derive(Clone, Copy, Debug)]
pub struct ShearedRay {
    origin: Vec3,
    /// The axes of the world that become x, y and z: the ray is longest along the last.
    axes: [usize; 3],
    /// What x and y lose for each z, and the metres along the ray for each z.
    shear: [f64; 3],
}

impl ShearedRay {
    fn new(ray: &Ray) -> Self {
        let size = [0, 1, 2].map(|axis| ray.direction[axis].abs());
        let z = if size[0] >= size[1] && size[0] >= size[2] {
            0
        } else if size[1] >= size[2] {
            1
        } else {
            2
        };
        let axes = [(z + 1) % 3, (z + 2) % 3, z];
        let [along_x, along_y, along_z] = axes.map(|axis| ray.direction[axis]);
        Self {
            origin: ray.origin,
            axes,
            shear: [along_x / along_z, along_y / along_z, 1.0 / along_z],
        }
    }

    /// A point as seen along the ray: x and y beside it, and the metres along it.
    #[inline(always)]
    fn seen(&self, point: Vec3) -> [f64; 3] {
        let offset = point - self.origin;
        let [x, y, z] = self.axes.map(|axis| offset[axis]);
        let [shear_x, shear_y, scale] = self.shear;
        [x - shear_x * z, y - shear_y * z, scale * z]
    }

    /// Where the ray meets a triangle at a distance in (0, `distance_max`]; u and v are the weights of the
    /// second and the third corner.
    #[inline(always)]
    fn intersect(&self, corners: [Vec3; 3], distance_max: f64) -> Option<Intersection> {
        let [a, b, c] = corners.map(|corner| self.seen(corner));
        let sides = [side(c, b), side(a, c), side(b, a)];
        let is_outside =
            sides.iter().any(|side| *side < 0.0) && sides.iter().any(|side| *side > 0.0);
        let total = sides[0] + sides[1] + sides[2];
        if is_outside || total == 0.0 {
            return None;
        }
        let distance = (sides[0] * a[2] + sides[1] * b[2] + sides[2] * c[2]) / total;
        // False for NaN too.
        let is_met = distance > 0.0 && distance <= distance_max;
        is_met.then(|| Intersection {
            distance,
            u: sides[1] / total,
            v: sides[2] / total,
        })
    }
}

/// On which side of the edge from `b` to `a` the ray runs: twice the area between them, whose sign is exact.
/// For the edge from `a` to `b` it is the same with the other sign.
#[inline(always)]
fn side([ax, ay, _]: [f64; 3], [bx, by, _]: [f64; 3]) -> f64 {
    let (first, second) = (ax * by, ay * bx);
    if first == second {
        // Rounding is monotonic, so only equal products hide which is larger.
        return product_error(ax, by, first) - product_error(ay, bx, second);
    }
    first - second
}

/// The exact product of two numbers less the rounded one, where no part of it is subnormal (Dekker, "A
/// Floating-Point Technique for Extending the Available Precision", Numerische Mathematik 18, 1971).
#[cold]
fn product_error(a: f64, b: f64, product: f64) -> f64 {
    let halves = |x: f64| {
        let scaled = x * ((1u64 << 27) + 1) as f64;
        let high = scaled - (scaled - x);
        [high, x - high]
    };
    let ([a_high, a_low], [b_high, b_low]) = (halves(a), halves(b));
    a_low * b_low - (((product - a_high * b_high) - a_low * b_high) - a_high * b_low)
}

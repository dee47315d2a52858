//! Rectangles, spheres and cylinders, and where a ray meets them, in 64-bit floats.
//!
//! Both backends decide every hit with the functions here, so their answers have the same bits.

use crate::vector::Vec3;

/// How far the squared length of a ray's direction may be from 1.
const DIRECTION_TOLERANCE: f64 = 1e-6;
/// How far a rectangle's axes may be from unit length and from a right angle.
const AXIS_TOLERANCE: f64 = 1e-9;
/// The largest coordinate a primitive may reach, in metres. Far inside what 32-bit bounds hold,
/// with their areas, and far outside any scene.
pub(super) const COORDINATE_MAX_METRES: f64 = 1e9;

/// A half-line. A ray whose direction is not of unit length to 1e-6 in the square (zero, not
/// finite) meets nothing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Where it starts, in metres.
    pub origin: Vec3,
    /// Where it goes; of unit length, so that distances are metres.
    pub direction: Vec3,
}

impl Ray {
    /// The point at `distance` metres from the origin.
    pub fn at(&self, distance: f64) -> Vec3 {
        self.origin + self.direction * distance
    }

    pub(super) fn is_unit(&self) -> bool {
        // False for NaN too.
        (self.direction.length_squared() - 1.0).abs() <= DIRECTION_TOLERANCE
    }
}

/// The index of a primitive in its geometry's list, or of a triangle, counted from
/// [`super::FIRST_TRIANGLE`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct PrimitiveId(pub u32);

impl PrimitiveId {
    /// The id of no primitive: what "none" is inside the loops over primitives.
    pub(crate) const NONE: Self = Self(u32::MAX);
}

/// A flat rectangle, seen from both sides. Its points are `corner + u_axis * u * u_length +
/// v_axis * v * v_length` for u and v in [0, 1): half open, so that of rectangles laid edge to
/// edge one alone holds the edge.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rectangle {
    /// Where u and v are 0, in metres.
    pub corner: Vec3,
    /// The unit vector along which u grows.
    pub u_axis: Vec3,
    /// The unit vector along which v grows, at a right angle to `u_axis`.
    pub v_axis: Vec3,
    /// `u_axis` x `v_axis`, the front.
    pub normal: Vec3,
    /// The side along `u_axis`, in metres.
    pub u_length: f64,
    /// The side along `v_axis`, in metres.
    pub v_length: f64,
}

impl Rectangle {
    /// From a corner, two unit axes at a right angle, and the sides along them in metres.
    /// [`super::Geometry::new`] checks them.
    pub fn new(corner: Vec3, u_axis: Vec3, v_axis: Vec3, u_length: f64, v_length: f64) -> Self {
        Self {
            corner,
            u_axis,
            v_axis,
            normal: u_axis.cross(v_axis),
            u_length,
            v_length,
        }
    }

    /// The point at (u, v), each in [0, 1].
    pub fn point(&self, u: f64, v: f64) -> Vec3 {
        self.corner + self.u_axis * (u * self.u_length) + self.v_axis * (v * self.v_length)
    }

    /// Its corners, in the order in which its outline visits them.
    pub fn corners(&self) -> [Vec3; 4] {
        [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]].map(|[u, v]| self.point(u, v))
    }

    /// From a point to the nearest of the rectangle.
    pub fn distance(&self, from: Vec3) -> f64 {
        let offset = from - self.corner;
        let along_u = offset.dot(self.u_axis).clamp(0.0, self.u_length);
        let along_v = offset.dot(self.v_axis).clamp(0.0, self.v_length);
        (offset - self.u_axis * along_u - self.v_axis * along_v).length()
    }

    /// The density at `direction` (unit) of the directions from `origin` to points that are evenly
    /// spread over the rectangle, a steradian. For a direction that misses it, the density about a
    /// larger one.
    pub fn density(&self, origin: Vec3, direction: Vec3) -> f64 {
        let cosine = self.normal.dot(direction);
        let height = self.normal.dot(origin - self.corner);
        if cosine * height >= 0.0 {
            return 0.0;
        }
        let distance = height / cosine;
        distance * distance / (cosine.abs() * self.u_length * self.v_length)
    }

    fn intersect(&self, ray: &Ray, distance_max: f64) -> Option<Intersection> {
        let offset = ray.origin - self.corner;
        let cosine = self.normal.dot(ray.direction);
        // A ray in the plane gives an infinity or a NaN, which no comparison lets through.
        let distance = -self.normal.dot(offset) / cosine;
        if !(distance > 0.0 && distance <= distance_max) {
            return None;
        }
        let in_plane = offset + ray.direction * distance;
        let along_u = in_plane.dot(self.u_axis);
        let along_v = in_plane.dot(self.v_axis);
        let inside =
            (0.0..self.u_length).contains(&along_u) && (0.0..self.v_length).contains(&along_v);
        // The quotients stay below 1: a number below another by a last place or more has a
        // quotient with it that is no nearer to 1 than the largest float below 1.
        inside.then(|| Intersection {
            distance,
            u: along_u / self.u_length,
            v: along_v / self.v_length,
        })
    }

    fn check(&self) -> Result<(), &'static str> {
        let unit = |axis: Vec3| (axis.length() - 1.0).abs() <= AXIS_TOLERANCE;
        if !(unit(self.u_axis) && unit(self.v_axis)) {
            return Err("an axis of the rectangle is not of unit length");
        }
        // Never true for NaN, so NaN is refused: the same holds of every check below.
        let square = self.u_axis.dot(self.v_axis).abs() <= AXIS_TOLERANCE;
        if !square {
            return Err("the axes of the rectangle are not at a right angle");
        }
        if self.normal != self.u_axis.cross(self.v_axis) {
            return Err("the normal of the rectangle is not the vector product of its axes");
        }
        if !(self.u_length > 0.0 && self.v_length > 0.0) {
            return Err("a side of the rectangle is not a positive number");
        }
        Ok(())
    }

    fn bounds(&self) -> Bounds {
        let u_side = self.u_axis * self.u_length;
        let v_side = self.v_axis * self.v_length;
        let corners = [
            self.corner,
            self.corner + u_side,
            self.corner + v_side,
            self.corner + u_side + v_side,
        ];
        corners.iter().fold(Bounds::EMPTY, |bounds, &corner| {
            bounds.union(Bounds::point(corner))
        })
    }
}

/// A sphere, seen from both sides.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sphere {
    /// The centre, in metres.
    pub centre: Vec3,
    /// The radius, in metres.
    pub radius: f64,
}

impl Sphere {
    /// The nearest of the roots at positive distances. The discriminant is taken from the vector
    /// between the centre and the ray's nearest point to it, which keeps its digits for a small
    /// and distant sphere, and the root that would cancel from the product of the two roots
    /// (Haines, Guenther and Akenine-Moeller, "Precision Improvements for Ray/Sphere
    /// Intersection", Ray Tracing Gems, 2019, chapter 7).
    fn intersect(&self, ray: &Ray, distance_max: f64) -> Option<Intersection> {
        let to_centre = self.centre - ray.origin;
        let along = to_centre.dot(ray.direction);
        let across = to_centre - ray.direction * along;
        let discriminant = self.radius * self.radius - across.length_squared();
        if discriminant.is_nan() || discriminant < 0.0 {
            return None;
        }
        let product = to_centre.length_squared() - self.radius * self.radius;
        let [near, far] = roots(along, discriminant.sqrt(), product);
        let distance = if near > 0.0 { near } else { far };
        (distance > 0.0 && distance <= distance_max).then_some(Intersection {
            distance,
            u: 0.0,
            v: 0.0,
        })
    }

    fn check(&self) -> Result<(), &'static str> {
        if self.radius > 0.0 {
            Ok(())
        } else {
            Err("the radius of the sphere is not a positive number")
        }
    }

    fn bounds(&self) -> Bounds {
        let reach = Vec3::new(self.radius, self.radius, self.radius);
        Bounds {
            lower: self.centre - reach,
            upper: self.centre + reach,
        }
    }
}

/// The mantle of a cylinder, seen from both sides: the points at `radius` from the axis whose place
/// along it, from `start` on, is in [0, `length`). It has no lids.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cylinder {
    /// Where the axis begins, in metres.
    pub start: Vec3,
    /// The unit vector along the axis.
    pub axis: Vec3,
    /// The radius, in metres.
    pub radius: f64,
    /// The length, in metres.
    pub length: f64,
}

impl Cylinder {
    /// As for a sphere, in the plane across the axis, where a ray of unit length is shorter.
    fn intersect(&self, ray: &Ray, distance_max: f64) -> Option<Intersection> {
        let across_axis = |v: Vec3| v - self.axis * v.dot(self.axis);
        let direction = across_axis(ray.direction);
        let to_axis = across_axis(self.start - ray.origin);
        // A ray along the axis gives an infinity or a NaN, which no comparison lets through.
        let scale = 1.0 / direction.length_squared();
        let along = to_axis.dot(direction) * scale;
        let across = to_axis - direction * along;
        let radius_squared = self.radius * self.radius;
        let discriminant = (radius_squared - across.length_squared()) * scale;
        if discriminant.is_nan() || discriminant < 0.0 {
            return None;
        }
        let product = (to_axis.length_squared() - radius_squared) * scale;
        let at = |distance: f64| {
            let place = (ray.at(distance) - self.start).dot(self.axis);
            let is_met =
                distance > 0.0 && distance <= distance_max && (0.0..self.length).contains(&place);
            is_met.then(|| Intersection {
                distance,
                u: place / self.length,
                v: 0.0,
            })
        };
        let [near, far] = roots(along, discriminant.sqrt(), product);
        at(near).or_else(|| at(far))
    }

    fn check(&self) -> Result<(), &'static str> {
        let unit = (self.axis.length() - 1.0).abs() <= AXIS_TOLERANCE;
        if !unit {
            return Err("the axis of the cylinder is not of unit length");
        }
        if !(self.radius > 0.0 && self.length > 0.0) {
            return Err("the radius or the length of the cylinder is not a positive number");
        }
        Ok(())
    }

    fn bounds(&self) -> Bounds {
        let reach = Vec3::new(self.radius, self.radius, self.radius);
        [self.start, self.start + self.axis * self.length]
            .into_iter()
            .fold(Bounds::EMPTY, |bounds, end| {
                let around = Bounds {
                    lower: end - reach,
                    upper: end + reach,
                };
                bounds.union(around)
            })
    }
}

/// The roots `along` -+ `half_chord`, whose product is known: the one that would cancel is the quotient
/// of the product and the other.
fn roots(along: f64, half_chord: f64, product: f64) -> [f64; 2] {
    if along >= 0.0 {
        let far = along + half_chord;
        [product / far, far]
    } else {
        let near = along - half_chord;
        [near, product / near]
    }
}

/// Something a ray can meet.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Primitive {
    /// A flat rectangle.
    Rectangle(Rectangle),
    /// A sphere.
    Sphere(Sphere),
    /// The mantle of a cylinder.
    Cylinder(Cylinder),
}

impl Primitive {
    /// Where the ray first meets the primitive at a distance in (0, `distance_max`];
    /// `distance_max` is finite, so the distance is.
    pub(crate) fn intersect(&self, ray: &Ray, distance_max: f64) -> Option<Intersection> {
        match self {
            Self::Rectangle(rectangle) => rectangle.intersect(ray, distance_max),
            Self::Sphere(sphere) => sphere.intersect(ray, distance_max),
            Self::Cylinder(cylinder) => cylinder.intersect(ray, distance_max),
        }
    }

    /// What is wrong with the primitive's numbers, if anything is.
    pub(super) fn check(&self) -> Result<(), &'static str> {
        match self {
            Self::Rectangle(rectangle) => rectangle.check(),
            Self::Sphere(sphere) => sphere.check(),
            Self::Cylinder(cylinder) => cylinder.check(),
        }?;
        if self.bounds().reach() <= COORDINATE_MAX_METRES {
            Ok(())
        } else {
            Err("it reaches beyond 1e9 metres from the origin")
        }
    }

    pub(crate) fn bounds(&self) -> Bounds {
        match self {
            Self::Rectangle(rectangle) => rectangle.bounds(),
            Self::Sphere(sphere) => sphere.bounds(),
            Self::Cylinder(cylinder) => cylinder.bounds(),
        }
    }
}

/// Where a ray meets one primitive.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Intersection {
    pub distance: f64,
    pub u: f64,
    pub v: f64,
}

/// The nearest thing that a ray meets.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Metres along the ray; positive and finite.
    pub distance: f64,
    /// What is hit; of several at the same distance the one of the lowest id.
    pub primitive: PrimitiveId,
    /// Where on a rectangle, in [0, 1) along its `u_axis`, or along a cylinder; the weight of a
    /// triangle's second corner; 0 on a sphere.
    pub u: f64,
    /// Where on a rectangle, in [0, 1) along its `v_axis`; the weight of a triangle's third corner; 0 on
    /// others.
    pub v: f64,
}

/// A box along the axes that holds a primitive, before any padding.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Bounds {
    pub lower: Vec3,
    pub upper: Vec3,
}

impl Bounds {
    pub(super) const EMPTY: Self = Self {
        lower: Vec3::new(f64::INFINITY, f64::INFINITY, f64::INFINITY),
        upper: Vec3::new(f64::NEG_INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY),
    };

    pub(super) const fn point(point: Vec3) -> Self {
        Self {
            lower: point,
            upper: point,
        }
    }

    pub(super) fn union(self, other: Self) -> Self {
        Self {
            lower: componentwise(self.lower, other.lower, least),
            upper: componentwise(self.upper, other.upper, greatest),
        }
    }

    /// The largest coordinate by magnitude; NaN where any coordinate is.
    pub(crate) fn reach(&self) -> f64 {
        let corners = [self.lower, self.upper].map(<[f64; 3]>::from);
        corners
            .as_flattened()
            .iter()
            .fold(0.0, |reach, coordinate| greatest(reach, coordinate.abs()))
    }
}

fn componentwise(a: Vec3, b: Vec3, choose: fn(f64, f64) -> f64) -> Vec3 {
    Vec3::new(choose(a.x, b.x), choose(a.y, b.y), choose(a.z, b.z))
}

/// The lesser, or NaN where either is: `f64::min` would hide it.
fn least(a: f64, b: f64) -> f64 {
    if a.is_nan() || a < b { a } else { b }
}

/// The greater, or NaN where either is: `f64::max` would hide it.
fn greatest(a: f64, b: f64) -> f64 {
    if a.is_nan() || a > b { a } else { b }
}

//! Asking a scene what a ray meets.

use std::ptr;

use super::abi;
use super::callbacks::{Query, QueryState};
use super::scene::{Scene, single};
use crate::geometry::native;
use crate::geometry::primitive::{Hit, PrimitiveId, Ray};
use crate::geometry::shapes::Shapes;
use crate::rounding::rounded_up;
use crate::vector::Vec3;

/// How far from the origin, along any axis, Embree's ray may start, in multiples of the scene's reach
/// (its largest coordinate). That of a ray from farther away starts where the ray comes near: its
/// 32-bit twin would leave the padding.
const ORIGIN_REACH_MAX: f64 = 8.0;

/// From how far away a ray is still followed to the scene, in multiples of its reach: the rounding of
/// where it comes near is 2^-52 of this, far less than what the ball is wider than the scene.
const FAR_REACH_MAX: f64 = (1u64 << 32) as f64;

/// The radius of the ball about the origin where the ray of one from far away starts, in multiples of the
/// scene's reach. It holds every box of the scene, whose corners are within sqrt(3) of the reach, and
/// their padding.
const BALL_REACH: f64 = 2.0;

impl<S: Shapes> Scene<S> {
    /// As [`crate::geometry::native::intersect`], the same bits.
    pub fn intersect(&self, ray: &Ray, from: PrimitiveId, distance_max: f64) -> Option<Hit> {
        let begin = match self.begin(ray) {
            Begin::At(begin) => begin,
            Begin::Never => return None,
            Begin::TooFar => {
                return native::intersect(&*self.user_data.shapes, ray, from, distance_max);
            }
        };
        let mut state = QueryState {
            ray: self.user_data.shapes.prepare(ray),
            begin,
            from,
            target: PrimitiveId::NONE,
            distance_max,
            hit: None,
        };
        let mut query = Query::<S>::new(&mut state);
        let mut rayhit = abi::RayHit {
            ray: embree_ray(ray, begin, distance_max),
            hit: abi::Hit {
                normal: [0.0; 3],
                u: 0.0,
                v: 0.0,
                primitive_id: abi::INVALID_GEOMETRY_ID,
                geometry_id: abi::INVALID_GEOMETRY_ID,
                instance_id: abi::INVALID_GEOMETRY_ID,
                instance_primitive_id: abi::INVALID_GEOMETRY_ID,
            },
        };
        let mut arguments = arguments(&mut query);
        // SAFETY: the scene is alive and committed. Everything pointed to is on this stack,
        // aligned by its type, and reached during the call through these pointers alone.
        unsafe {
            (self.device.functions.intersect)(
                self.handle.as_ptr(),
                &raw mut rayhit,
                &raw mut arguments,
            );
        }
        state.hit
    }

    /// As [`crate::geometry::native::occluded`], the same answer.
    pub fn occluded(
        &self,
        ray: &Ray,
        from: PrimitiveId,
        target: PrimitiveId,
        distance_max: f64,
    ) -> bool {
        let begin = match self.begin(ray) {
            Begin::At(begin) => begin,
            Begin::Never => return false,
            Begin::TooFar => {
                let shapes = &*self.user_data.shapes;
                return native::occluded(shapes, ray, from, target, distance_max);
            }
        };
        let mut state = QueryState {
            ray: self.user_data.shapes.prepare(ray),
            begin,
            from,
            target,
            distance_max,
            hit: None,
        };
        let mut query = Query::<S>::new(&mut state);
        let mut embree_ray = embree_ray(ray, begin, distance_max);
        let mut arguments = arguments(&mut query);
        // SAFETY: as in `intersect`.
        unsafe {
            (self.device.functions.occluded)(
                self.handle.as_ptr(),
                &raw mut embree_ray,
                &raw mut arguments,
            );
        }
        state.hit.is_some()
    }

    /// How far along a ray Embree's begins: 0 for one that starts near the scene, and otherwise where it
    /// comes near.
    fn begin(&self, ray: &Ray) -> Begin {
        if within(ray.origin, self.reach * ORIGIN_REACH_MAX) {
            return Begin::At(0.0);
        }
        if !within(ray.origin, self.reach * FAR_REACH_MAX) {
            return Begin::TooFar;
        }
        let radius = self.reach * BALL_REACH;
        let scale = 1.0 / ray.direction.length_squared();
        let along = -ray.origin.dot(ray.direction) * scale;
        let across = ray.at(along);
        let half_chord2 = (radius * radius - across.length_squared()) * scale;
        if half_chord2 < 0.0 || along < 0.0 {
            return Begin::Never;
        }
        Begin::At((along - half_chord2.sqrt()).max(0.0))
    }
}

/// Where Embree's ray begins.
enum Begin {
    /// So many metres along the ray.
    At(f64),
    /// The ray meets nothing.
    Never,
    /// So far away that rounding decides what the ray meets: a question for the native loop.
    TooFar,
}

/// Whether no coordinate of a point is larger than this by magnitude.
fn within(point: Vec3, reach: f64) -> bool {
    // False for NaN too.
    point.x.abs() <= reach && point.y.abs() <= reach && point.z.abs() <= reach
}

fn arguments<S: Shapes>(query: &mut Query<S>) -> abi::QueryArguments {
    abi::QueryArguments {
        flags: 0,
        feature_mask: abi::FEATURE_FLAGS_ALL,
        // From the whole query, not its first field: the callbacks read on behind it.
        context: ptr::from_mut(query).cast(),
        filter: ptr::null(),
        callback: ptr::null(),
        width_distance_factor_min: 0.0,
    }
}

fn embree_ray(ray: &Ray, begin: f64, distance_max: f64) -> abi::Ray {
    abi::Ray {
        origin: single(ray.at(begin)),
        near: 0.0,
        direction: single(ray.direction),
        time: 0.0,
        far: rounded_up(distance_max - begin),
        mask: u32::MAX,
        id: 0,
        flags: 0,
    }
}

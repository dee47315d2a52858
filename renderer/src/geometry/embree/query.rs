//! Asking a scene what a ray meets.

use std::ptr;

use super::abi;
use super::callbacks::{Query, QueryState};
use super::scene::{Scene, single};
use crate::geometry::native;
use crate::geometry::primitive::{Hit, PrimitiveId, Ray};
use crate::rounding::rounded_up;
use crate::vector::Vec3;

impl Scene {
    /// As [`native::intersect`], the same bits.
    pub fn intersect(&self, ray: &Ray, from: PrimitiveId) -> Option<Hit> {
        if !self.is_near(ray.origin) {
            return native::intersect(&self.user_data.primitives, ray, from);
        }
        let mut state = QueryState {
            ray: *ray,
            from,
            target: PrimitiveId::NONE,
            distance_max: f64::MAX,
            hit: None,
        };
        let mut query = Query::new(&mut state);
        let mut rayhit = abi::RayHit {
            ray: embree_ray(ray, f64::MAX),
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

    /// As [`native::occluded`], the same answer.
    pub fn occluded(
        &self,
        ray: &Ray,
        from: PrimitiveId,
        target: PrimitiveId,
        distance_max: f64,
    ) -> bool {
        if !self.is_near(ray.origin) {
            let primitives = &self.user_data.primitives;
            return native::occluded(primitives, ray, from, target, distance_max);
        }
        let mut state = QueryState {
            ray: *ray,
            from,
            target,
            distance_max,
            hit: None,
        };
        let mut query = Query::new(&mut state);
        let mut embree_ray = embree_ray(ray, distance_max);
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

    fn is_near(&self, origin: Vec3) -> bool {
        // False for NaN too.
        origin.x.abs() <= self.origin_max
            && origin.y.abs() <= self.origin_max
            && origin.z.abs() <= self.origin_max
    }
}

fn arguments(query: &mut Query) -> abi::QueryArguments {
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

fn embree_ray(ray: &Ray, distance_max: f64) -> abi::Ray {
    abi::Ray {
        origin: single(ray.origin),
        near: 0.0,
        direction: single(ray.direction),
        time: 0.0,
        far: rounded_up(distance_max),
        mask: u32::MAX,
        id: 0,
        flags: 0,
    }
}

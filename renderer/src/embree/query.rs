//! Asking a scene, and answering what Embree asks back for each primitive that a ray may meet.

use std::ffi::c_int;
use std::ptr;

use super::abi::{self, QueryFunctionArguments};
use super::scene::{Scene, UserData, single};
use crate::geometry::{Hit, Primitive, PrimitiveId, Ray, native};
use crate::rounding::rounded_up;
use crate::vector::Vec3;

/// What one query asks and has found so far.
struct QueryState {
    ray: Ray,
    from: PrimitiveId,
    target: PrimitiveId,
    distance_max: f64,
    hit: Option<Hit>,
}

/// Embree's context with our states behind it, one for each ray, found by the ray's id: a ray
/// keeps its id when Embree moves it to another lane.
#[repr(C)]
struct Query {
    context: abi::QueryContext,
    states: *mut QueryState,
    state_count: usize,
}

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

impl Query {
    fn new(state: &mut QueryState) -> Self {
        Self {
            context: abi::QueryContext {
                instance_id: abi::INVALID_GEOMETRY_ID,
                instance_primitive_id: abi::INVALID_GEOMETRY_ID,
            },
            states: state,
            state_count: 1,
        }
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

// The callbacks. Neither of them can panic: slices are read through `get`, and the arithmetic is
// that of floats. (A panic would abort at the `extern "C"` boundary, not unwind into Embree.)

pub unsafe extern "C" fn intersect_callback(arguments: *const QueryFunctionArguments) {
    // SAFETY: Embree passes what the function asks for.
    unsafe {
        each_lane(arguments, |primitive, id, state| {
            let met = primitive.meet(&state.ray, state.distance_max)?;
            // The order in which Embree finds hits is its own affair: at the same distance the
            // lower id wins, as in the native loop.
            let nearer = match &state.hit {
                None => true,
                Some(hit) => {
                    met.distance < hit.distance
                        || (met.distance == hit.distance && id < hit.primitive)
                }
            };
            if !nearer {
                return None;
            }
            state.distance_max = met.distance;
            state.hit = Some(Hit {
                distance: met.distance,
                primitive: id,
                u: met.u,
                v: met.v,
            });
            Some(rounded_up(met.distance))
        });
    }
}

pub unsafe extern "C" fn occluded_callback(arguments: *const QueryFunctionArguments) {
    // SAFETY: Embree passes what the function asks for.
    unsafe {
        each_lane(arguments, |primitive, id, state| {
            if id == state.target {
                return None;
            }
            let met = primitive.meet(&state.ray, state.distance_max)?;
            if met.distance >= state.distance_max {
                return None;
            }
            state.hit = Some(Hit {
                distance: met.distance,
                primitive: id,
                u: met.u,
                v: met.v,
            });
            // How Embree is told that the ray is occluded.
            Some(f32::NEG_INFINITY)
        });
    }
}

/// Calls `test` for every ray of the packet that takes part and does not leave this primitive;
/// what it returns becomes the end of the ray.
///
/// # Safety
///
/// The arguments must be those of a query of a [`Scene`], whose context is a [`Query`].
#[inline(always)]
unsafe fn each_lane(
    arguments: *const QueryFunctionArguments,
    test: impl Fn(&Primitive, PrimitiveId, &mut QueryState) -> Option<f32>,
) {
    // SAFETY: Embree passes arguments that live through the call. The user data is the scene's;
    // the context is the head of the query's.
    let (arguments, data, query) = unsafe {
        let arguments = &*arguments;
        (
            arguments,
            &*arguments.user_data.cast::<UserData>(),
            &*arguments.context.cast::<Query>(),
        )
    };
    let id = PrimitiveId(arguments.primitive_id);
    let Some(primitive) = data.primitives.get(arguments.primitive_id as usize) else {
        return;
    };
    let lane_count = arguments.lane_count as usize;
    let fields = arguments.rays.cast::<f32>();
    for lane in 0..lane_count {
        // SAFETY: the mask has a value for every lane.
        let valid: c_int = unsafe { *arguments.valid.add(lane) };
        if valid == 0 {
            continue;
        }
        // SAFETY: a packet holds `lane_count` values of each field of `abi::Ray`, and ids are as
        // wide as floats.
        let ray_id = unsafe {
            *fields
                .add(abi::RAY_FIELD_ID * lane_count + lane)
                .cast::<u32>()
        };
        if ray_id as usize >= query.state_count {
            continue;
        }
        // SAFETY: the id is in range, and the query's owner keeps its hands off the states while
        // Embree runs; other lanes have other ids.
        let state = unsafe { &mut *query.states.add(ray_id as usize) };
        if id == state.from {
            continue;
        }
        if let Some(far) = test(primitive, id, state) {
            // SAFETY: as for the id.
            unsafe { *fields.add(abi::RAY_FIELD_FAR * lane_count + lane) = far };
        }
    }
}

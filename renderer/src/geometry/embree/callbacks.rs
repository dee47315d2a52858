//! What Embree calls back for: the bounds of primitives, and the hits of rays that may meet them.

use std::ffi::c_int;
use std::sync::Arc;

use super::abi::{self, BoundsFunctionArguments, QueryFunctionArguments};
use crate::geometry::primitive::{Hit, PrimitiveId};
use crate::geometry::shapes::Shapes;
use crate::rounding::rounded_up;

/// What the callbacks read.
pub struct UserData<S> {
    /// What is hit.
    pub shapes: Arc<S>,
    /// Ready-made: Embree may ask for them with subnormal numbers switched off.
    pub bounds: Box<[abi::Bounds]>,
}

/// What one query asks and has found so far.
pub struct QueryState<S: Shapes> {
    /// The ray, prepared for the shapes.
    pub ray: S::Prepared,
    /// How far along the ray Embree's own begins, in metres.
    pub begin: f64,
    /// The primitive that it leaves.
    pub from: PrimitiveId,
    /// The primitive that does not hide anything.
    pub target: PrimitiveId,
    /// Farther hits do not count.
    pub distance_max: f64,
    /// The nearest hit so far.
    pub hit: Option<Hit>,
}

/// Embree's context with our states behind it, one for each ray, found by the ray's id: a ray
/// keeps its id when Embree moves it to another lane.
#[repr(C)]
pub struct Query<S: Shapes> {
    context: abi::QueryContext,
    states: *mut QueryState<S>,
    state_count: usize,
}

impl<S: Shapes> Query<S> {
    /// A query of one ray.
    pub fn new(state: &mut QueryState<S>) -> Self {
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

// The callbacks. None of them can panic: indices are checked, and the arithmetic is
// that of floats. (A panic would abort at the `extern "C"` boundary, not unwind into Embree.)

/// Writes a primitive's bounds.
pub unsafe extern "C" fn bounds_callback<S: Shapes>(arguments: *const BoundsFunctionArguments) {
    // SAFETY: Embree passes arguments that live through the call, with the user data that the
    // scene was built with.
    let (arguments, data) = unsafe {
        let arguments = &*arguments;
        (arguments, &*arguments.user_data.cast::<UserData<S>>())
    };
    if let Some(bounds) = data.bounds.get(arguments.primitive_id as usize) {
        // SAFETY: Embree asks for the bounds to be written there.
        unsafe { *arguments.bounds = *bounds };
    }
}

/// Keeps the nearest hit.
pub unsafe extern "C" fn intersect_callback<S: Shapes>(arguments: *const QueryFunctionArguments) {
    // SAFETY: Embree passes what the function asks for.
    unsafe {
        each_lane::<S>(arguments, |shapes, id, state| {
            let found = shapes.intersect(id, &state.ray, state.distance_max)?;
            // The order in which Embree finds hits is its own affair: at the same distance the
            // lower id wins, as in the native loop.
            let nearer = match &state.hit {
                None => true,
                Some(hit) => {
                    found.distance < hit.distance
                        || (found.distance == hit.distance && id < hit.primitive)
                }
            };
            if !nearer {
                return None;
            }
            state.distance_max = found.distance;
            state.hit = Some(Hit {
                distance: found.distance,
                primitive: id,
                u: found.u,
                v: found.v,
            });
            Some(rounded_up(found.distance - state.begin))
        });
    }
}

/// Keeps any hit.
pub unsafe extern "C" fn occluded_callback<S: Shapes>(arguments: *const QueryFunctionArguments) {
    // SAFETY: Embree passes what the function asks for.
    unsafe {
        each_lane::<S>(arguments, |shapes, id, state| {
            if id == state.target {
                return None;
            }
            let found = shapes.intersect(id, &state.ray, state.distance_max)?;
            if found.distance >= state.distance_max {
                return None;
            }
            state.hit = Some(Hit {
                distance: found.distance,
                primitive: id,
                u: found.u,
                v: found.v,
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
/// The arguments must be those of a query of a scene built here, whose context is a [`Query`].
#[inline(always)]
unsafe fn each_lane<S: Shapes>(
    arguments: *const QueryFunctionArguments,
    test: impl Fn(&S, PrimitiveId, &mut QueryState<S>) -> Option<f32>,
) {
    // SAFETY: Embree passes arguments that live through the call. The user data is the scene's;
    // the context is the head of the query's.
    let (arguments, data, query) = unsafe {
        let arguments = &*arguments;
        (
            arguments,
            &*arguments.user_data.cast::<UserData<S>>(),
            &*arguments.context.cast::<Query<S>>(),
        )
    };
    let id = PrimitiveId(arguments.primitive_id);
    if arguments.primitive_id as usize >= data.shapes.count() {
        return;
    }
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
        if let Some(far) = test(&data.shapes, id, state) {
            // SAFETY: as for the id.
            unsafe { *fields.add(abi::RAY_FIELD_FAR * lane_count + lane) = far };
        }
    }
}

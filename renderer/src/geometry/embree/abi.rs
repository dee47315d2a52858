//! Embree's structures and constants as C lays them out in versions 4.3 and 4.4, built with one
//! level of instances (the default).

use std::ffi::{c_int, c_uint, c_void};
use std::mem::{align_of, offset_of, size_of};

/// A handle of Embree's: a pointer to what only Embree knows.
macro_rules! handle {
    ($($name:ident),*) => {$(
        #[repr(C)]
        pub struct $name {
            _opaque: [u8; 0],
        }
    )*};
}
handle!(Device, Scene, Geometry);

pub const DEVICE_PROPERTY_VERSION: c_int = 0;
pub const DEVICE_PROPERTY_NATIVE_RAY8_SUPPORTED: c_int = 33;
pub const DEVICE_PROPERTY_NATIVE_RAY16_SUPPORTED: c_int = 34;
pub const DEVICE_PROPERTY_USER_GEOMETRY_SUPPORTED: c_int = 100;
pub const GEOMETRY_TYPE_USER: c_int = 120;
pub const SCENE_FLAG_ROBUST: c_int = 1 << 2;
pub const INVALID_GEOMETRY_ID: c_uint = c_uint::MAX;
pub const FEATURE_FLAGS_ALL: c_uint = c_uint::MAX;
pub const ERROR_NONE: c_int = 0;

/// What an error code of Embree's means.
pub fn error_text(code: c_int) -> &'static str {
    match code {
        ERROR_NONE => "it gave no reason",
        2 => "invalid argument",
        3 => "invalid operation",
        4 => "out of memory",
        5 => "the processor lacks the instruction set",
        6 => "cancelled",
        _ => "unknown error",
    }
}

/// `RTCBounds`
#[repr(C, align(16))]
#[derive(Clone, Copy)]
pub struct Bounds {
    pub lower: [f32; 3],
    pub align0: f32,
    pub upper: [f32; 3],
    pub align1: f32,
}

/// `RTCRay`. A packet of N rays (`RTCRayN`) holds N values of each field, field after field.
#[repr(C, align(16))]
pub struct Ray {
    pub origin: [f32; 3],
    pub near: f32,
    pub direction: [f32; 3],
    pub time: f32,
    pub far: f32,
    pub mask: c_uint,
    pub id: c_uint,
    pub flags: c_uint,
}

/// The index of `far` among the fields of a packet.
pub const RAY_FIELD_FAR: usize = 8;
/// The index of `id` among the fields of a packet.
pub const RAY_FIELD_ID: usize = 10;

/// `RTCHit`
#[repr(C, align(16))]
pub struct Hit {
    pub normal: [f32; 3],
    pub u: f32,
    pub v: f32,
    pub primitive_id: c_uint,
    pub geometry_id: c_uint,
    pub instance_id: c_uint,
    pub instance_primitive_id: c_uint,
}

/// `RTCRayHit`
#[repr(C)]
pub struct RayHit {
    pub ray: Ray,
    pub hit: Hit,
}

/// `RTCRayQueryContext`
#[repr(C)]
pub struct QueryContext {
    pub instance_id: c_uint,
    pub instance_primitive_id: c_uint,
}

/// `RTCIntersectArguments` and `RTCOccludedArguments`, which are laid out alike. The last field
/// is there in builds with `RTC_MIN_WIDTH` alone; the others never read it.
#[repr(C)]
pub struct QueryArguments {
    pub flags: c_uint,
    pub feature_mask: c_uint,
    pub context: *mut QueryContext,
    pub filter: *const c_void,
    pub callback: *const c_void,
    pub width_distance_factor_min: f32,
}

/// `RTCBoundsFunctionArguments`
#[repr(C)]
pub struct BoundsFunctionArguments {
    pub user_data: *mut c_void,
    pub primitive_id: c_uint,
    pub time_step: c_uint,
    pub bounds: *mut Bounds,
}

/// `RTCIntersectFunctionNArguments` and `RTCOccludedFunctionNArguments`, which differ in one
/// respect: `rays` is a packet of rays with their hits behind them in the first, of rays alone in
/// the second. The rays come first in both.
#[repr(C)]
pub struct QueryFunctionArguments {
    pub valid: *mut c_int,
    pub user_data: *mut c_void,
    pub primitive_id: c_uint,
    pub context: *mut QueryContext,
    pub rays: *mut c_void,
    pub lane_count: c_uint,
    pub geometry_id: c_uint,
}

pub type BoundsFunction = unsafe extern "C" fn(*const BoundsFunctionArguments);
pub type QueryFunction = unsafe extern "C" fn(*const QueryFunctionArguments);

// What a C compiler makes of the headers for x86-64 (and for aarch64, where pointers and
// alignments are the same).
#[cfg(target_pointer_width = "64")]
const _: () = {
    assert!(size_of::<Bounds>() == 32 && align_of::<Bounds>() == 16);
    assert!(offset_of!(Bounds, upper) == 16);

    assert!(size_of::<Ray>() == 48 && align_of::<Ray>() == 16);
    assert!(offset_of!(Ray, near) == 12);
    assert!(offset_of!(Ray, direction) == 16);
    assert!(offset_of!(Ray, time) == 28);
    assert!(offset_of!(Ray, far) == 4 * RAY_FIELD_FAR);
    assert!(offset_of!(Ray, mask) == 36);
    assert!(offset_of!(Ray, id) == 4 * RAY_FIELD_ID);
    assert!(offset_of!(Ray, flags) == 44);

    assert!(size_of::<Hit>() == 48 && align_of::<Hit>() == 16);
    assert!(offset_of!(Hit, primitive_id) == 20);
    assert!(offset_of!(Hit, geometry_id) == 24);
    assert!(offset_of!(Hit, instance_id) == 28);
    assert!(offset_of!(Hit, instance_primitive_id) == 32);
    assert!(size_of::<RayHit>() == 96 && offset_of!(RayHit, hit) == 48);

    assert!(size_of::<QueryContext>() == 8);
    assert!(size_of::<QueryArguments>() == 40);
    assert!(offset_of!(QueryArguments, context) == 8);
    assert!(offset_of!(QueryArguments, filter) == 16);
    assert!(offset_of!(QueryArguments, callback) == 24);

    assert!(size_of::<BoundsFunctionArguments>() == 24);
    assert!(offset_of!(BoundsFunctionArguments, primitive_id) == 8);
    assert!(offset_of!(BoundsFunctionArguments, bounds) == 16);

    assert!(size_of::<QueryFunctionArguments>() == 48);
    assert!(offset_of!(QueryFunctionArguments, primitive_id) == 16);
    assert!(offset_of!(QueryFunctionArguments, context) == 24);
    assert!(offset_of!(QueryFunctionArguments, rays) == 32);
    assert!(offset_of!(QueryFunctionArguments, lane_count) == 40);
    assert!(offset_of!(QueryFunctionArguments, geometry_id) == 44);
};

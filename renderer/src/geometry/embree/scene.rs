//! A scene: our shapes as one user geometry under Embree's hierarchy.

use std::ffi::c_void;
use std::fmt::{Debug, Formatter, Result as FormatResult};
use std::ptr::NonNull;
use std::sync::Arc;

use super::abi;
use super::callbacks::{self, UserData};
use super::device::{self, Device, Isa};
use super::error::EmbreeError;
use crate::geometry::primitive::{Bounds, PrimitiveId};
use crate::geometry::shapes::Shapes;
use crate::vector::Vec3;

/// How much each side of a bound is moved outwards, in multiples of the scene's reach.
///
/// Within a reach of 1 and origins within 8, distances stay below 16. Rounding origin, direction
/// and bound to 32 bits moves a ray against a bound by at most (8 + 16 + 1) x 2^-24, and the slab
/// test, three roundings of numbers below 9 (and a reciprocal good to a few units in the last
/// place), by at most 60 x 2^-24. The sum is under 2^-17.
const PADDING: f64 = 1.0 / 65_536.0;
/// The least padding, in metres: it keeps the bounds of a tiny scene clear of numbers that Embree
/// flushes to zero.
const PADDING_MIN_METRES: f64 = 1e-12;

/// A committed scene.
pub struct Scene<S: Shapes> {
    pub(super) device: &'static Device,
    pub(super) handle: NonNull<abi::Scene>,
    /// Shared with the callbacks, which know its address.
    pub(super) user_data: Arc<UserData<S>>,
    /// The largest coordinate of the shapes, by magnitude.
    pub(super) reach: f64,
}

// SAFETY: a committed scene may be used and released on any thread.
unsafe impl<S: Shapes> Send for Scene<S> {}
// SAFETY: Embree allows queries of one committed scene from any number of threads at once, the
// callbacks only read the user data, and what they write belongs to one query.
unsafe impl<S: Shapes> Sync for Scene<S> {}

impl<S: Shapes> Debug for Scene<S> {
    fn fmt(&self, formatter: &mut Formatter<'_>) -> FormatResult {
        formatter
            .debug_struct("Scene")
            .field("reach", &self.reach)
            .finish_non_exhaustive()
    }
}

impl<S: Shapes> Drop for Scene<S> {
    fn drop(&mut self) {
        // SAFETY: the handle is ours and used no more. The user data goes after it.
        unsafe { (self.device.functions.release_scene)(self.handle.as_ptr()) };
    }
}

/// A geometry until the scene holds it.
struct GeometryHandle {
    device: &'static Device,
    handle: NonNull<abi::Geometry>,
}

impl Drop for GeometryHandle {
    fn drop(&mut self) {
        // SAFETY: this gives back our reference; a scene that holds the geometry has its own.
        unsafe { (self.device.functions.release_geometry)(self.handle.as_ptr()) };
    }
}

impl<S: Shapes> Scene<S> {
    /// Builds the hierarchy on the calling thread. The shapes have been checked.
    pub fn new(shapes: Arc<S>, isa: Option<Isa>) -> Result<Self, EmbreeError> {
        let device = device::device(isa)?;
        let functions = device.functions;
        // Checked by the geometry to be far below.
        let count = u32::try_from(shapes.count()).unwrap_or(u32::MAX);
        let bounds = (0..count).map(|id| shapes.bounds(PrimitiveId(id)));
        let bounds: Vec<Bounds> = bounds.collect();
        let reach = bounds.iter().map(Bounds::reach).fold(0.0, f64::max);
        let padding = (reach * PADDING).max(PADDING_MIN_METRES);
        let user_data = Arc::new(UserData {
            shapes,
            bounds: bounds
                .iter()
                .map(|bounds| padded(bounds, padding))
                .collect(),
        });
        let data = Arc::as_ptr(&user_data).cast_mut().cast::<c_void>();

        // SAFETY: the device is alive.
        let handle = NonNull::new(unsafe { (functions.new_scene)(device.handle) });
        device.outcome("rtcNewScene")?;
        let scene = Self {
            device,
            handle: handle.ok_or(nameless("rtcNewScene"))?,
            user_data,
            reach,
        };
        // SAFETY: as above.
        let handle = unsafe { (functions.new_geometry)(device.handle, abi::GEOMETRY_TYPE_USER) };
        let handle = NonNull::new(handle);
        device.outcome("rtcNewGeometry")?;
        let geometry = GeometryHandle {
            device,
            handle: handle.ok_or(nameless("rtcNewGeometry"))?,
        };
        let (scene_handle, geometry_handle) = (scene.handle.as_ptr(), geometry.handle.as_ptr());
        // SAFETY: both handles are alive through this block. `data` points to what the
        // scene owns and drops after its handle, and every callback reads it as what it is.
        unsafe {
            (functions.set_scene_flags)(scene_handle, abi::SCENE_FLAG_ROBUST);
            device.outcome("rtcSetSceneFlags")?;
            (functions.set_primitive_count)(geometry_handle, count);
            device.outcome("rtcSetGeometryUserPrimitiveCount")?;
            (functions.set_user_data)(geometry_handle, data);
            device.outcome("rtcSetGeometryUserData")?;
            (functions.set_bounds_function)(geometry_handle, callbacks::bounds_callback::<S>, data);
            device.outcome("rtcSetGeometryBoundsFunction")?;
            (functions.set_intersect_function)(geometry_handle, callbacks::intersect_callback::<S>);
            device.outcome("rtcSetGeometryIntersectFunction")?;
            (functions.set_occluded_function)(geometry_handle, callbacks::occluded_callback::<S>);
            device.outcome("rtcSetGeometryOccludedFunction")?;
            (functions.commit_geometry)(geometry_handle);
            device.outcome("rtcCommitGeometry")?;
            (functions.attach_geometry)(scene_handle, geometry_handle);
            device.outcome("rtcAttachGeometry")?;
            (functions.commit_scene)(scene_handle);
            device.outcome("rtcCommitScene")?;
        }
        Ok(scene)
    }
}

fn nameless(call: &'static str) -> EmbreeError {
    EmbreeError::Build {
        call,
        reason: abi::error_text(abi::ERROR_NONE),
    }
}

fn padded(bounds: &Bounds, padding: f64) -> abi::Bounds {
    let padding = Vec3::new(padding, padding, padding);
    abi::Bounds {
        lower: single(bounds.lower - padding),
        align0: 0.0,
        upper: single(bounds.upper + padding),
        align1: 0.0,
    }
}

/// To the nearest 32-bit floats; the padding allows for it.
pub fn single(v: Vec3) -> [f32; 3] {
    [v.x as f32, v.y as f32, v.z as f32]
}

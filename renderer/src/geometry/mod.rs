//! What rays meet: rectangles, spheres and cylinders, behind two backends that give the same bits.
//!
//! The native backend tests the primitives one after another. Embree builds a hierarchy over
//! them and leaves out those that a ray cannot meet; whether it meets the rest is decided by the
//! same 64-bit code. The choice therefore changes how long an image takes and never a byte of it.

mod backend;
mod embree;
mod native;
mod primitive;

use std::sync::{Arc, Once};

pub use backend::{BackendChoice, BackendKind, UnknownBackend};
pub use embree::{EmbreeError, Isa, UnknownIsa};
pub use primitive::{Cylinder, Hit, Primitive, PrimitiveId, Ray, Rectangle, Sphere};

use embree::Scene;

/// From how many primitives on `auto` takes Embree.
///
/// Nanoseconds for one `intersect` (and one `occluded`) on one core of an AVX2 server at 2.4 GHz,
/// rays as in the tests: the sample, a chart's patches and a bulb first, mixed rectangles and
/// spheres second.
///
/// | primitives | native | Embree | native, mixed | Embree, mixed |
/// | ---: | ---: | ---: | ---: | ---: |
/// | 3 | 55 (43) | 83 (70) | 55 (43) | 85 (72) |
/// | 10 | 107 (98) | 108 (93) | 134 (109) | 109 (82) |
/// | 30 | 250 (235) | 140 (120) | 323 (250) | 134 (100) |
/// | 100 | 720 (660) | 222 (193) | 1190 (780) | 217 (152) |
/// | 300 | 2100 (2000) | 430 (320) | 3900 (2100) | 305 (195) |
pub const EMBREE_PRIMITIVES_MIN: usize = 12;
/// The most primitives a geometry holds: 2 GiB of them, well within 32-bit ids.
pub const PRIMITIVES_MAX: usize = 1 << 24;

/// Why a geometry cannot be built.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum GeometryError {
    /// A primitive's numbers make no sense.
    #[error("primitive {index} cannot be traced: {reason}")]
    Primitive {
        /// Its index in the list.
        index: usize,
        /// What is wrong with it.
        reason: &'static str,
    },
    /// The list is too long.
    #[error("{count} primitives are more than the {PRIMITIVES_MAX} that one geometry holds")]
    TooMany {
        /// The length of the list.
        count: usize,
    },
    /// Embree was asked for and cannot be used.
    #[error(transparent)]
    Embree(#[from] EmbreeError),
}

/// Primitives ready to be traced, from any number of threads at once.
#[derive(Debug)]
pub struct Geometry {
    primitives: Arc<[Primitive]>,
    // None: native.
    scene: Option<Scene>,
}

impl Geometry {
    /// Checks the primitives and builds the backend. Ids are indices in the list.
    ///
    /// # Errors
    ///
    /// If a primitive is not finite, of no extent or skewed; if there are more than
    /// [`PRIMITIVES_MAX`]; if Embree, or an instruction set, was asked for by name and cannot be
    /// used; if `EMBREE_LIBRARY` names one that cannot be, unless native tracing was asked for.
    pub fn new(primitives: Vec<Primitive>, choice: BackendChoice) -> Result<Self, GeometryError> {
        let primitives = checked(primitives)?;
        let scene = match choice {
            BackendChoice::Native => None,
            BackendChoice::Embree => Some(Scene::new(Arc::clone(&primitives), None)?),
            BackendChoice::EmbreeOn(isa) => Some(Scene::new(Arc::clone(&primitives), Some(isa))?),
            BackendChoice::Auto if primitives.len() < EMBREE_PRIMITIVES_MIN => {
                embree::check_named()?;
                None
            }
            BackendChoice::Auto => match Scene::new(Arc::clone(&primitives), None) {
                Ok(scene) => Some(scene),
                Err(error @ EmbreeError::Named { .. }) => return Err(error.into()),
                Err(error) => {
                    warn_once(&error);
                    None
                }
            },
        };
        Ok(Self { primitives, scene })
    }

    /// Which backend traces.
    pub fn backend(&self) -> BackendKind {
        match self.scene {
            None => BackendKind::Native,
            Some(_) => BackendKind::Embree,
        }
    }

    /// The primitives, in the order of their ids.
    pub fn primitives(&self) -> &[Primitive] {
        &self.primitives
    }

    /// The nearest hit at a positive, finite distance. `from` is never hit: name the planar
    /// primitive that the ray leaves and no offset is needed.
    pub fn intersect(&self, ray: &Ray, from: Option<PrimitiveId>) -> Option<Hit> {
        if !ray.is_unit() {
            return None;
        }
        let from = from.unwrap_or(PrimitiveId::NONE);
        match &self.scene {
            None => native::intersect(&self.primitives, ray, from),
            Some(scene) => scene.intersect(ray, from),
        }
    }

    /// Whether anything but `from` and `target` is found at a distance in (0, `distance_max`).
    /// `distance_max` may be infinite; nothing is found below one that is zero, negative or NaN.
    pub fn occluded(
        &self,
        ray: &Ray,
        from: Option<PrimitiveId>,
        target: Option<PrimitiveId>,
        distance_max: f64,
    ) -> bool {
        if !(ray.is_unit() && distance_max > 0.0) {
            return false;
        }
        let from = from.unwrap_or(PrimitiveId::NONE);
        let target = target.unwrap_or(PrimitiveId::NONE);
        let distance_max = distance_max.min(f64::MAX);
        match &self.scene {
            None => native::occluded(&self.primitives, ray, from, target, distance_max),
            Some(scene) => scene.occluded(ray, from, target, distance_max),
        }
    }
}

fn checked(primitives: Vec<Primitive>) -> Result<Arc<[Primitive]>, GeometryError> {
    let count = primitives.len();
    if count > PRIMITIVES_MAX {
        return Err(GeometryError::TooMany { count });
    }
    for (index, primitive) in primitives.iter().enumerate() {
        primitive
            .check()
            .map_err(|reason| GeometryError::Primitive { index, reason })?;
    }
    Ok(primitives.into())
}

/// A farm renders thousands of views with one answer to whether Embree loads: say it once.
fn warn_once(error: &EmbreeError) {
    static WARNED: Once = Once::new();
    WARNED.call_once(|| {
        tracing::warn!("tracing without Embree, which is slower for this scene: {error}");
    });
}

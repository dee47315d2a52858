//! What rays meet: rectangles, spheres, cylinders and triangles, behind two backends that give the same
//! bits.
//!
//! The native backend tests the shapes one after another. Embree builds a hierarchy over
//! them and leaves out those that a ray cannot meet; whether it meets the rest is decided by the
//! same 64-bit code. The choice therefore changes how long an image takes and never a byte of it.

mod backend;
mod embree;
mod mesh;
mod native;
mod primitive;
mod shapes;
mod triangles;

use std::sync::{Arc, Once};

pub use backend::{BackendChoice, BackendKind, UnknownBackend};
pub use embree::{EmbreeError, Isa, UnknownIsa};
pub use mesh::{FIRST_TRIANGLE, TracedMesh};
pub use primitive::{Cylinder, Hit, Primitive, PrimitiveId, Ray, Rectangle, Sphere};

pub use triangles::Triangles;

use embree::Scene;
use shapes::{PrimitiveList, Shapes};

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
    /// The specification's mesh has only been named.
    #[error(
        "the sample is a mesh that is not loaded: read the specification from its file, with the mesh \
         beside it"
    )]
    MeshNotLoaded,
    /// A mesh cannot be traced.
    #[error("the mesh cannot be traced: {reason}")]
    Mesh {
        /// What is wrong with it.
        reason: &'static str,
    },
    /// Embree was asked for and cannot be used.
    #[error(transparent)]
    Embree(#[from] EmbreeError),
}

/// Primitives ready to be traced, and perhaps a mesh, from any number of threads at once.
#[derive(Debug)]
pub struct Geometry {
    primitives: Arc<PrimitiveList>,
    // None: native.
    scene: Option<Scene<PrimitiveList>>,
    mesh: Option<Arc<TracedMesh>>,
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
        let primitives = Arc::new(checked(primitives)?);
        let scene = hierarchy(&primitives, choice)?;
        Ok(Self {
            primitives,
            scene,
            mesh: None,
        })
    }

    /// A mesh, and a few primitives beside it, which are tested one after another.
    ///
    /// # Errors
    ///
    /// If a primitive makes no sense, as for [`Self::new`].
    pub fn with_mesh(
        primitives: Vec<Primitive>,
        mesh: Arc<TracedMesh>,
    ) -> Result<Self, GeometryError> {
        Ok(Self {
            primitives: Arc::new(checked(primitives)?),
            scene: None,
            mesh: Some(mesh),
        })
    }

    /// Which backend traces the mesh, or without one the primitives.
    pub fn backend(&self) -> BackendKind {
        match (&self.mesh, &self.scene) {
            (Some(mesh), _) => mesh.backend(),
            (None, None) => BackendKind::Native,
            (None, Some(_)) => BackendKind::Embree,
        }
    }

    /// The primitives, in the order of their ids.
    pub fn primitives(&self) -> &[Primitive] {
        &self.primitives.0
    }

    /// The nearest hit at a positive, finite distance. `from` is never hit: name the planar
    /// primitive that the ray leaves and no offset is needed.
    pub fn intersect(&self, ray: &Ray, from: Option<PrimitiveId>) -> Option<Hit> {
        if !ray.is_unit() {
            return None;
        }
        let from = from.unwrap_or(PrimitiveId::NONE);
        let nearest = match &self.scene {
            None => native::intersect(&*self.primitives, ray, from, f64::MAX),
            Some(scene) => scene.intersect(ray, from, f64::MAX),
        };
        let Some(mesh) = &self.mesh else {
            return nearest;
        };
        let distance_max = nearest.map_or(f64::MAX, |hit| hit.distance);
        let of_mesh = mesh.intersect(ray, from, distance_max);
        // At the same distance the lower id stands.
        of_mesh
            .filter(|hit| nearest.is_none() || hit.distance < distance_max)
            .or(nearest)
    }

    /// Whether anything but `from` and `target` is found at a distance in (0, `distance_max`).
    /// `distance_max` may be infinite; nothing is found below one that is zero, negative or NaN. `target`
    /// is no triangle.
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
        let by_primitives = match &self.scene {
            None => native::occluded(&*self.primitives, ray, from, target, distance_max),
            Some(scene) => scene.occluded(ray, from, target, distance_max),
        };
        let mesh = self.mesh.as_ref();
        by_primitives || mesh.is_some_and(|mesh| mesh.occluded(ray, from, distance_max))
    }
}

/// Embree's hierarchy over some shapes, unless they are to be tested one after another.
fn hierarchy<S: Shapes>(
    shapes: &Arc<S>,
    choice: BackendChoice,
) -> Result<Option<Scene<S>>, GeometryError> {
    let shapes = Arc::clone(shapes);
    Ok(match choice {
        BackendChoice::Native => None,
        BackendChoice::Embree => Some(Scene::new(shapes, None)?),
        BackendChoice::EmbreeOn(isa) => Some(Scene::new(shapes, Some(isa))?),
        BackendChoice::Auto if shapes.count() < EMBREE_PRIMITIVES_MIN => {
            embree::check_named()?;
            None
        }
        BackendChoice::Auto => match Scene::new(shapes, None) {
            Ok(scene) => Some(scene),
            Err(error @ EmbreeError::Named { .. }) => return Err(error.into()),
            Err(error) => {
                warn_once(&error);
                None
            }
        },
    })
}

fn checked(primitives: Vec<Primitive>) -> Result<PrimitiveList, GeometryError> {
    let count = primitives.len();
    if count > PRIMITIVES_MAX {
        return Err(GeometryError::TooMany { count });
    }
    for (index, primitive) in primitives.iter().enumerate() {
        primitive
            .check()
            .map_err(|reason| GeometryError::Primitive { index, reason })?;
    }
    Ok(PrimitiveList(primitives.into()))
}

/// A farm renders thousands of views with one answer to whether Embree loads: say it once.
fn warn_once(error: &EmbreeError) {
    static WARNED: Once = Once::new();
    WARNED.call_once(|| {
        tracing::warn!("tracing without Embree, which is slower for this scene: {error}");
    });
}

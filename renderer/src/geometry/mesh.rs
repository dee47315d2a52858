//! A mesh of triangles that rays can meet, shared by the scenes of all views.

use std::sync::Arc;

use super::backend::{BackendChoice, BackendKind};
use super::embree::Scene;
use super::primitive::{Hit, PrimitiveId, Ray};
use super::triangles::Triangles;
use super::{GeometryError, PRIMITIVES_MAX, hierarchy, native};

/// The id of a mesh's first triangle: above those of primitives.
pub const FIRST_TRIANGLE: PrimitiveId = PrimitiveId(PRIMITIVES_MAX as u32);

/// A mesh ready to be traced, from any number of threads at once.
#[derive(Debug)]
pub struct TracedMesh {
    triangles: Arc<Triangles>,
    // None: native.
    scene: Option<Scene<Triangles>>,
}

impl TracedMesh {
    /// Builds the backend. The id of triangle k is k above [`FIRST_TRIANGLE`].
    ///
    /// # Errors
    /// If there are more than [`PRIMITIVES_MAX`]; as for [`super::Geometry::new`] if Embree was asked for
    /// and cannot be used.
    pub fn new(triangles: Triangles, choice: BackendChoice) -> Result<Self, GeometryError> {
        let count = triangles.count();
        if count > PRIMITIVES_MAX {
            return Err(GeometryError::TooMany { count });
        }
        let triangles = Arc::new(triangles);
        let scene = hierarchy(&triangles, choice)?;
        Ok(Self { triangles, scene })
    }

    /// Its triangles.
    pub fn triangles(&self) -> &Triangles {
        &self.triangles
    }

    /// Which backend traces.
    pub fn backend(&self) -> BackendKind {
        match self.scene {
            None => BackendKind::Native,
            Some(_) => BackendKind::Embree,
        }
    }

    pub(super) fn intersect(&self, ray: &Ray, from: PrimitiveId, distance_max: f64) -> Option<Hit> {
        let from = within(from);
        let hit = match &self.scene {
            None => native::intersect(&*self.triangles, ray, from, distance_max),
            Some(scene) => scene.intersect(ray, from, distance_max),
        }?;
        let primitive = PrimitiveId(FIRST_TRIANGLE.0 + hit.primitive.0);
        Some(Hit { primitive, ..hit })
    }

    pub(super) fn occluded(&self, ray: &Ray, from: PrimitiveId, distance_max: f64) -> bool {
        let (from, target) = (within(from), PrimitiveId::NONE);
        match &self.scene {
            None => native::occluded(&*self.triangles, ray, from, target, distance_max),
            Some(scene) => scene.occluded(ray, from, target, distance_max),
        }
    }
}

/// The index of a triangle by its id in the geometry; none for that of another primitive.
fn within(id: PrimitiveId) -> PrimitiveId {
    if id == PrimitiveId::NONE {
        return id;
    }
    let index = id.0.checked_sub(FIRST_TRIANGLE.0);
    index.map_or(PrimitiveId::NONE, PrimitiveId)
}

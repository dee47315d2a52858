//! The sample: where its surface is, and how it lies there.

use super::Surface;
use super::mesh_surface::MeshSurface;
use super::smooth_surface::{MirrorPoint, SmoothSurface};
use crate::geometry::{BackendChoice, GeometryError, Sphere};
use crate::vector::Vec3;
use dataset::specification::Sample;

/// The surface of the sample.
#[derive(Clone, Debug)]
pub enum SampleSurface {
    /// One that a formula gives.
    Smooth(SmoothSurface),
    /// A mesh, below z = 0, which it touches.
    Mesh(MeshSurface),
}

impl SampleSurface {
    /// The surface of a specification's sample. The backend is for a mesh.
    ///
    /// # Errors
    /// Where a mesh is not loaded, or its backend cannot be had.
    pub fn new(sample: &Sample, backend: BackendChoice) -> Result<Self, GeometryError> {
        Ok(match SmoothSurface::new(sample) {
            Some(smooth) => Self::Smooth(smooth),
            None => Self::Mesh(MeshSurface::new(sample, backend)?),
        })
    }

    /// The mesh, where it is one: its parts may shade each other.
    pub fn mesh(&self) -> Option<&MeshSurface> {
        match self {
            Self::Smooth(_) => None,
            Self::Mesh(mesh) => Some(mesh),
        }
    }

    /// A ball that holds it.
    pub fn ball(&self) -> Sphere {
        match self {
            Self::Smooth(smooth) => smooth.ball(),
            Self::Mesh(mesh) => mesh.ball(),
        }
    }

    /// Where a point of it is: as [`SmoothSurface::uv`], and on a mesh the texture coordinates, or 0 where
    /// it has none.
    pub fn uv(&self, surface: &Surface) -> [f64; 2] {
        match self {
            Self::Smooth(smooth) => smooth.uv(surface.position),
            Self::Mesh(mesh) => {
                let at = surface.on_triangle;
                at.and_then(|at| mesh.uv(at)).unwrap_or_default()
            }
        }
    }

    /// Where a smooth surface turns light of one point to another, as [`SmoothSurface::mirror_point`].
    pub fn mirror_point(&self, eye: Vec3, source: Vec3) -> Option<MirrorPoint> {
        match self {
            Self::Smooth(smooth) => Some(smooth.mirror_point(eye, source)),
            Self::Mesh(_) => None,
        }
    }
}

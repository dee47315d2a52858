//! What turns a material and a view into an image, as the worker sees it.

use dataset::{ErrorStatistics, PixelStatistics, SampledMaterial, Specification};
use renderer::{RenderError, Renderer, geometry::BackendChoice};
use thiserror::Error;

/// An image as an EXR file, and what is known of how it was made.
#[derive(Clone, Debug)]
pub struct RenderedView {
    /// The file.
    pub exr: Vec<u8>,
    /// The measured error and the cost.
    pub statistics: ErrorStatistics,
    /// How bright it is.
    pub pixels: PixelStatistics,
}

/// Why a view could not be rendered. The sentence is kept with the job.
#[derive(Clone, Debug, Error)]
#[error("{0}")]
pub struct RenderFailure(pub String);

/// Renders views; farm tests have another implementation, which makes cheap images.
pub trait Render: Send + Sync + 'static {
    /// Renders one view of a sampled material, on the current rayon pool.
    fn render(&self, material: &SampledMaterial, view: u32) -> Result<RenderedView, RenderFailure>;
}

/// The project's renderer.
pub struct RendererBackend {
    renderer: Renderer,
}

impl RendererBackend {
    /// Prepares the scenes of a specification.
    ///
    /// # Errors
    /// When the geometry backend asked for is not to be had.
    pub fn new(specification: &Specification, backend: BackendChoice) -> Result<Self, RenderError> {
        let renderer = Renderer::new(specification, backend)?;
        Ok(Self { renderer })
    }
}

impl Render for RendererBackend {
    fn render(&self, material: &SampledMaterial, view: u32) -> Result<RenderedView, RenderFailure> {
        let rendering = self
            .renderer
            .render(&material.material, Some(material.index), view)
            .map_err(|error| RenderFailure(error.to_string()))?;
        Ok(RenderedView {
            exr: rendering.exr,
            statistics: rendering.statistics,
            pixels: rendering.pixels,
        })
    }
}

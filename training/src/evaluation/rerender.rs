//! Images of materials, small and at a tolerance that suffices to compare them.

use crate::error::TrainingError;
use crate::pixels::encoding::Encoding;
use dataset::{Material, Specification};
use renderer::Renderer;
use renderer::geometry::BackendChoice;

/// Pixels a side of the images that estimates are judged by.
pub const SIDE: u32 = 32;

/// Their tolerance, relative to a pixel's value.
pub const RELATIVE_ACCURACY: f64 = 3e-3;

/// Renders the views of a specification on a smaller film.
#[derive(Debug)]
pub struct Rerenderer {
    renderer: Renderer,
    views: u32,
}

/// One view's codes, three a pixel.
#[derive(Clone, Debug, PartialEq)]
pub struct Codes {
    srgb: Vec<f32>,
    log: Vec<f32>,
}

/// How far two images are apart: mean squared differences of codes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImageError {
    /// Of sRGB codes, 0 to 1, clipped at white. (Of linear pixels one highlight would decide.)
    pub srgb: f64,
    /// Of logarithmic codes, which see beyond white.
    pub log: f64,
}

/// The same views on a film of [`SIDE`] pixels a side, at a tolerance of [`RELATIVE_ACCURACY`].
pub(crate) fn small(specification: &Specification) -> Specification {
    let mut small = specification.clone();
    (small.image.width, small.image.height) = (SIDE, SIDE);
    small.accuracy.relative = RELATIVE_ACCURACY;
    small.accuracy.absolute = small.accuracy.absolute.max(RELATIVE_ACCURACY * 1e-2);
    small
}

impl Rerenderer {
    /// For the views of a specification.
    ///
    /// # Errors
    /// When the renderer cannot be made.
    pub fn new(specification: &Specification) -> Result<Self, TrainingError> {
        let small = small(specification);
        let renderer = Renderer::new(&small, BackendChoice::Native)
            .map_err(|error| TrainingError::Render(error.to_string()))?;
        Ok(Self {
            renderer,
            views: small.views.len() as u32,
        })
    }

    /// All views of a material.
    ///
    /// # Errors
    /// When a parameter lies outside the model.
    pub fn images(&self, material: &Material) -> Result<Vec<Codes>, TrainingError> {
        (0..self.views)
            .map(|view| {
                let rendering = self
                    .renderer
                    .render(material, None, view)
                    .map_err(|error| TrainingError::Render(error.to_string()))?;
                let channels = || rendering.film.pixels.iter().flat_map(|pixel| pixel.value);
                let codes =
                    |encoding: Encoding| channels().map(|v| encoding.encode(v) as f32).collect();
                Ok(Codes {
                    srgb: codes(Encoding::Srgb),
                    log: codes(Encoding::Log),
                })
            })
            .collect()
    }
}

impl Codes {
    /// How far another image of the same view is.
    pub fn error(&self, other: &Self) -> ImageError {
        ImageError {
            srgb: mean_square(&self.srgb, &other.srgb),
            log: mean_square(&self.log, &other.log),
        }
    }
}

fn mean_square(one: &[f32], other: &[f32]) -> f64 {
    let squares = one.iter().zip(other).map(|(&a, &b)| {
        let difference = f64::from(a) - f64::from(b);
        difference * difference
    });
    squares.sum::<f64>() / one.len() as f64
}

//! One view of a material: paths over the film, their error, and the file.

use crate::exr_file::{self, ExrError};
use crate::film::{Film, FilmPixel};
use crate::geometry::{BackendChoice, BackendKind, GeometryError};
use crate::path;
use crate::reflectance::Reflectance;
use crate::sampler::{Dimension, Sampler};
use crate::scene::Scene;
use dataset::{
    Digest, ErrorStatistics, ImageHeader, Material, MaterialError, RENDERER_VERSION, Specification,
    specification::View,
};
use rayon::prelude::*;

/// Independent scrambles a pixel is rendered in; their spread measures its error.
const REPLICATES: u32 = 8;

/// The 0.975 quantile of Student's t with `REPLICATES - 1` degrees of freedom.
const T_QUANTILE: f64 = 2.364_624_251_592_784_5;

/// Renders views of materials under one specification. The scenes of all views are built once.
#[derive(Debug)]
pub struct Renderer {
    specification: Specification,
    specification_hash: Digest,
    scenes: Vec<Scene>,
}

/// A rendered view.
#[derive(Clone, Debug)]
pub struct Rendering {
    /// The pixels in full precision.
    pub film: Film,
    /// The EXR file.
    pub exr: Vec<u8>,
    /// The error and the cost.
    pub statistics: ErrorStatistics,
}

/// Why a view could not be rendered.
#[derive(Debug, thiserror::Error)]
pub enum RenderError {
    /// The view's index is too large.
    #[error("there is no view {view}: the specification has {count}, counted from 0")]
    NoSuchView {
        /// The index asked for.
        view: u32,
        /// How many there are.
        count: usize,
    },
    /// A parameter lies outside the model.
    #[error("the material's {0}")]
    Material(#[from] MaterialError),
    /// The geometry could not be built.
    #[error(transparent)]
    Geometry(#[from] GeometryError),
    /// A pixel came out negative or not finite: a fault of the renderer.
    #[error(
        "pixel ({column}, {row}) of view {view} came out as {value:?}: please report this material"
    )]
    InvalidPixel {
        /// Counted from the left.
        column: usize,
        /// Counted from the top.
        row: usize,
        /// The view.
        view: u32,
        /// What came out.
        value: [f64; 3],
    },
    /// The file could not be encoded.
    #[error(transparent)]
    Exr(#[from] ExrError),
}

impl Renderer {
    /// Builds the scenes of every view of `specification`.
    ///
    /// # Errors
    /// When the chosen backend is not to be had.
    pub fn new(specification: &Specification, backend: BackendChoice) -> Result<Self, RenderError> {
        let scenes = (0..specification.views.len())
            .filter_map(|view| Scene::new(specification, view, backend))
            .collect::<Result<_, _>>()?;
        Ok(Self {
            specification: specification.clone(),
            specification_hash: specification.hash(),
            scenes,
        })
    }

    /// The backend that intersects rays, for the user's information: all give the same bytes.
    pub fn backend(&self) -> Option<BackendKind> {
        self.scenes.first().map(|scene| scene.geometry.backend())
    }

    /// Renders view `view` of `material`, whose index in the set is `material_index` if it is
    /// part of one, on the current rayon pool. The result does not depend on the pool.
    ///
    /// # Errors
    /// When the view does not exist or a parameter lies outside the model.
    pub fn render(
        &self,
        material: &Material,
        material_index: Option<u32>,
        view: u32,
    ) -> Result<Rendering, RenderError> {
        material.check()?;
        let (Some(scene), Some(view_specification)) = (
            self.scenes.get(view as usize),
            self.specification.views.get(view as usize),
        ) else {
            return Err(RenderError::NoSuchView {
                view,
                count: self.scenes.len(),
            });
        };
        let header = ImageHeader {
            specification: self.specification_hash.to_string(),
            seed: self.specification.seed,
            material: material_index,
            view,
            parameters: *material,
            tint: self.specification.tint,
            renderer_version: RENDERER_VERSION.to_owned(),
        };
        let film = self.trace(scene, view_specification, material, sampler_key(&header))?;
        check_pixels(&film, view)?;
        let samples = u64::from(film.width)
            * u64::from(film.height)
            * u64::from(self.specification.integrator.samples_per_pixel);
        Ok(Rendering {
            exr: exr_file::encode(&film, self.specification.image.pixel, &header, self.white())?,
            statistics: film.statistics(&self.specification.accuracy, samples),
            film,
        })
    }

    /// The luminance in cd/m^2 of a pixel of value 1: that of a white diffuser at the origin which
    /// faces the bulb.
    fn white(&self) -> f64 {
        let light = &self.specification.light;
        let flux_lm = light.power_w * light.efficacy_lm_per_w;
        let sphere_m2 = 4.0 * std::f64::consts::PI * light.distance_m * light.distance_m;
        flux_lm / sphere_m2 / std::f64::consts::PI
    }

    fn trace(
        &self,
        scene: &Scene,
        view: &View,
        material: &Material,
        key: u64,
    ) -> Result<Film, RenderError> {
        let image = &self.specification.image;
        let integrator = &self.specification.integrator;
        let reflectance = Reflectance::new(material, view.rotation_deg, self.specification.tint);
        let count = integrator.samples_per_pixel / REPLICATES;
        let pixel = |column: u32, row: u32| {
            let mut means = [[0.0; 3]; REPLICATES as usize];
            for (replicate, mean) in (0..).zip(&mut means) {
                let sampler = Sampler::new(key, row * image.width + column, replicate);
                for index in 0..count {
                    let [x, y] = sampler.point(Dimension::Film, index);
                    let ray = scene.camera.ray(f64::from(column) + x, f64::from(row) + y);
                    let radiance = path::radiance(
                        scene,
                        &reflectance,
                        ray,
                        &sampler,
                        index,
                        integrator.max_bounces,
                    );
                    for (mean, channel) in mean.iter_mut().zip(radiance) {
                        *mean += channel / f64::from(count);
                    }
                }
            }
            estimate(&means)
        };
        let mut pixels = vec![FilmPixel::default(); image.width as usize * image.height as usize];
        pixels
            .par_chunks_mut(image.width as usize)
            .zip(0..image.height)
            .for_each(|(line, row)| {
                for (place, column) in line.iter_mut().zip(0..) {
                    *place = pixel(column, row);
                }
            });
        Ok(Film {
            width: image.width,
            height: image.height,
            pixels,
        })
    }
}

/// A pixel from the means of its independent replicates, with the t-interval of the worst channel.
fn estimate(means: &[[f64; 3]; REPLICATES as usize]) -> FilmPixel {
    let count = f64::from(REPLICATES);
    let mut pixel = FilmPixel::default();
    for channel in 0..3 {
        let mean = means.iter().map(|mean| mean[channel]).sum::<f64>() / count;
        let squares: f64 = means
            .iter()
            .map(|replicate| (replicate[channel] - mean) * (replicate[channel] - mean))
            .sum();
        pixel.value[channel] = mean;
        let standard_error = (squares / (count - 1.0) / count).sqrt();
        pixel.error = pixel.error.max(T_QUANTILE * standard_error);
    }
    pixel
}

/// The key of an image's samplers: of what names the image, not of the material's numbers, so that
/// a small change of a parameter changes an image smoothly.
fn sampler_key(header: &ImageHeader) -> u64 {
    let mut hasher = blake3::Hasher::new_derive_key("brdfarm 2026 light path sampler");
    hasher.update(&header.seed.to_le_bytes());
    hasher.update(&header.material.map_or(u64::MAX, u64::from).to_le_bytes());
    hasher.update(&header.view.to_le_bytes());
    let mut key = [0; 8];
    hasher.finalize_xof().fill(&mut key);
    u64::from_le_bytes(key)
}

fn check_pixels(film: &Film, view: u32) -> Result<(), RenderError> {
    let valid = |channel: &f64| channel.is_finite() && *channel >= 0.0;
    match film
        .pixels
        .iter()
        .position(|pixel| !pixel.value.iter().all(valid))
    {
        None => Ok(()),
        Some(index) => Err(RenderError::InvalidPixel {
            column: index % film.width as usize,
            row: index / film.width as usize,
            view,
            value: film.pixels[index].value,
        }),
    }
}

//! One view of a material: the film with its error, and the file.

use crate::aov;
use crate::exr_file::{self, ExrError};
use crate::film::Film;
use crate::geometry::{BackendChoice, BackendKind, GeometryError};
use crate::hybrid::interreflection::cache::InterreflectionCache;
use crate::hybrid::{PreparedView, Unresolved};
use crate::numerics::instructions::Instructions;
use crate::path;
use crate::phase_time::{PhaseTime, timed};
use crate::reflectance::Reflectance;
use crate::scene::{SampleSurface, Scene};
use dataset::{
    Digest, ErrorStatistics, ImageHeader, Material, MaterialError, PixelStatistics,
    RENDERER_VERSION, Specification, specification::IntegratorKind,
};

/// Renders views of materials under one specification. The scenes of all views are built once.
#[derive(Debug)]
pub struct Renderer {
    specification: Specification,
    specification_hash: Digest,
    views: Vec<ViewToRender>,
    interreflections: InterreflectionCache,
    instructions: Instructions,
}

/// A view's scene and, where the hybrid integrator is asked for and can render it, the view prepared
/// for it.
#[derive(Debug)]
struct ViewToRender {
    scene: Scene,
    prepared: Option<PreparedView>,
}

/// A film, its light paths and evaluations, and what each phase took.
type Work = (Film, u64, u64, Vec<PhaseTime>);

/// A rendered view.
#[derive(Clone, Debug)]
pub struct Rendering {
    /// What identifies the image: its file's header.
    pub header: ImageHeader,
    /// The integrator that rendered the view: the path tracer also where the specification asks for
    /// the hybrid integrator and that cannot render a view of a square.
    pub integrator: IntegratorKind,
    /// The pixels in full precision.
    pub film: Film,
    /// The EXR file.
    pub exr: Vec<u8>,
    /// The error and the cost.
    pub statistics: ErrorStatistics,
    /// How bright it is.
    pub pixels: PixelStatistics,
    /// What each phase took, in the order in which they ran.
    pub phases: Vec<PhaseTime>,
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
    /// When the chosen backend is not to be had, or the sample is a mesh that is not loaded.
    pub fn new(specification: &Specification, backend: BackendChoice) -> Result<Self, RenderError> {
        let sample = SampleSurface::new(&specification.sample, backend)?;
        let views = (0..specification.views.len())
            .filter_map(|view| Scene::with_sample(specification, view, &sample, backend))
            .map(|scene| {
                let scene = scene?;
                let prepared = match specification.integrator.kind {
                    IntegratorKind::Hybrid => PreparedView::new(&scene, specification),
                    IntegratorKind::Path => None,
                };
                Ok(ViewToRender { scene, prepared })
            })
            .collect::<Result<_, RenderError>>()?;
        Ok(Self {
            specification: specification.clone(),
            specification_hash: specification.hash(),
            views,
            interreflections: InterreflectionCache::default(),
            instructions: Instructions::widest(),
        })
    }

    /// The same with the hybrid integrator's kernels on this instruction set: the same bytes, sooner
    /// or later.
    #[must_use]
    pub fn with_instructions(mut self, instructions: Instructions) -> Self {
        self.instructions = instructions;
        for view in &mut self.views {
            view.prepared = view
                .prepared
                .take()
                .map(|prepared| prepared.with_instructions(instructions));
        }
        self
    }

    /// The backend that intersects rays, for the user's information: all give the same bytes.
    pub fn backend(&self) -> Option<BackendKind> {
        self.views.first().map(|view| view.scene.geometry.backend())
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
        let (Some(view_to_render), Some(view_specification)) = (
            self.views.get(view as usize),
            self.specification.views.get(view as usize),
        ) else {
            return Err(RenderError::NoSuchView {
                view,
                count: self.views.len(),
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
        let key = sampler_key(&header);
        let rotation_deg = view_specification.rotation_deg;
        let reflectance = Reflectance::new(material, rotation_deg, self.specification.tint);
        let angles_deg = [rotation_deg, view_specification.light_elevation_deg];
        let worked_out = view_to_render.prepared.as_ref().and_then(|prepared| {
            self.work_out(prepared, material, &reflectance, angles_deg)
                .ok()
        });
        let integrator = match worked_out {
            None if !self.is_traced_to_accuracy() => IntegratorKind::Path,
            _ => IntegratorKind::Hybrid,
        };
        let (film, samples, evaluations, mut phases) =
            worked_out.unwrap_or_else(|| self.trace(&view_to_render.scene, &reflectance, key));
        check_pixels(&film, view)?;
        let exr = timed(&mut phases, "encode", || {
            exr_file::encode(
                &film,
                self.specification.image.pixel,
                &header,
                self.specification.white_luminance(),
            )
        })?;
        Ok(Rendering {
            header,
            integrator,
            exr,
            pixels: self.brightness(&film, view),
            statistics: film.statistics(&self.specification.accuracy, samples, evaluations),
            film,
            phases,
        })
    }

    /// Whether the hybrid integrator is asked for and traces what it cannot work out.
    fn is_traced_to_accuracy(&self) -> bool {
        let is_square = self.specification.sample.shape.is_square();
        self.specification.integrator.kind == IntegratorKind::Hybrid && !is_square
    }

    /// Renders a view by paths: the film, samples, evaluations and phases.
    fn trace(&self, scene: &Scene, reflectance: &Reflectance, key: u64) -> Work {
        let specification = &self.specification;
        let mut phases = Vec::new();
        let traced = timed(&mut phases, "trace", || {
            if self.is_traced_to_accuracy() {
                let instructions = self.instructions;
                path::render_to_accuracy(scene, reflectance, specification, key, instructions)
            } else {
                path::render(scene, reflectance, specification, key)
            }
        });
        (traced.film, traced.paths, traced.evaluations, phases)
    }

    /// How bright a film is, with the pixels that its file has.
    fn brightness(&self, film: &Film, view: u32) -> PixelStatistics {
        let stored = exr_file::stored_pixels(film, self.specification.image.pixel);
        let Some(found) = PixelStatistics::of(&self.specification, view, stored) else {
            unreachable!("the film is of a view of the specification");
        };
        found
    }

    /// Renders a view with the hybrid integrator: the film, samples, evaluations and phases.
    fn work_out(
        &self,
        prepared: &PreparedView,
        material: &Material,
        reflectance: &Reflectance,
        angles_deg: [f64; 2],
    ) -> Result<Work, Unresolved> {
        let mut phases = Vec::new();
        let interreflection = timed(&mut phases, "interreflection", || {
            self.interreflections.get(material, angles_deg, || {
                prepared.interreflection(reflectance).transpose()
            })
        })
        .transpose()?;
        let (film, evaluations, others) =
            prepared.render(reflectance, interreflection.as_deref())?;
        phases.extend(others);
        Ok((film, 0, evaluations, phases))
    }

    /// Encodes what the middle of each pixel of `rendering`, which this renderer made, sees, as an EXR
    /// file of 32-bit floats: the layers `depth` (Z, along the camera's axis, metres), `normal` and
    /// `tangent` (X, Y, Z, in the world; the tangent is the x axis of the material's frame), `uv` (U, V)
    /// and `mask` (sample, chart, bulb).
    ///
    /// # Errors
    /// When the library refuses, or the rendering is of no view of this renderer.
    pub fn encode_aov(&self, rendering: &Rendering) -> Result<Vec<u8>, RenderError> {
        let view = rendering.header.view;
        let (Some(made), Some(of_view)) = (
            self.views.get(view as usize),
            self.specification.views.get(view as usize),
        ) else {
            let count = self.views.len();
            return Err(RenderError::NoSuchView { view, count });
        };
        let image = &self.specification.image;
        let size = [image.width, image.height];
        let channels = aov::channels(&made.scene, size, of_view.rotation_deg);
        let white = self.specification.white_luminance();
        let (film, header) = (&rendering.film, &rendering.header);
        Ok(exr_file::encode_channels(
            film,
            header,
            white,
            aov::NAMES,
            channels,
        )?)
    }

    /// Encodes the stated error of each pixel of `rendering`, which this renderer made, as an EXR
    /// file of one channel, `error`, in units of white. Where pixels are stored with 16 bits, their
    /// rounding is not part of it.
    ///
    /// # Errors
    /// When the library refuses.
    pub fn encode_error(&self, rendering: &Rendering) -> Result<Vec<u8>, ExrError> {
        exr_file::encode_error(
            &rendering.film,
            &rendering.header,
            self.specification.white_luminance(),
        )
    }
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

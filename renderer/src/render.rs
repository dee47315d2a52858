//! One view of a material: the film with its error, and the file.

use crate::aov;
use crate::exr_file::{self, ExrError};
use crate::film::{Film, FilmPixel};
use crate::geometry::{BackendChoice, BackendKind, GeometryError};
use crate::hybrid::interreflection::cache::{InterreflectionCache, Key};
use crate::hybrid::{Interreflection, PreparedView, Unresolved};
use crate::numerics::instructions::Instructions;
use crate::path;
use crate::phase_time::{PhaseTime, timed};
use crate::reflectance::Reflectance;
use crate::scene::{SampleSurface, Scene};
use dataset::{
    Digest, ErrorStatistics, ImageHeader, Material, MaterialError, PixelStatistics,
    RENDERER_VERSION, Specification,
    specification::{IntegratorKind, View},
};
use std::sync::Arc;

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

/// How a view of a material is worked out, for films of materials beside it: [`Renderer::film_like`].
#[derive(Clone, Debug)]
pub struct Discretization {
    view: u32,
    material: Material,
    reflectance: Reflectance,
    /// `None` without chart, and where it is not worked out.
    interreflection: Option<Arc<Interreflection>>,
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
        let header = ImageHeader {
            specification: self.specification_hash.to_string(),
            seed: self.specification.seed,
            material: material_index,
            view,
            parameters: *material,
            tint: self.specification.tint,
            renderer_version: RENDERER_VERSION.to_owned(),
        };
        let key = sampler_key(header.seed, material_index, view);
        let (integrator, work) = self.film(material, view, key, None)?;
        let (film, samples, evaluations, mut phases) = work;
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

    /// How a view of `material` is worked out.
    ///
    /// # Errors
    /// When the view does not exist or a parameter lies outside the model.
    pub fn discretization(
        &self,
        material: &Material,
        view: u32,
    ) -> Result<Discretization, RenderError> {
        material.check()?;
        let (to_render, of_view) = self.view(view)?;
        let reflectance = Reflectance::new(material, of_view.rotation_deg, self.specification.tint);
        let interreflection = to_render.prepared.as_ref().and_then(|prepared| {
            let found = self.interreflection(prepared, (material, &reflectance), of_view, None);
            found.ok().flatten()
        });
        Ok(Discretization {
            view,
            material: *material,
            reflectance,
            interreflection,
        })
    }

    /// The film of the view of a discretization, for a material beside the one that it is of.
    ///
    /// A material's own tiles and rules of interreflection are chosen by what they are found to miss. From one
    /// material to the next the choice, and so the film, jumps within the tolerance. Here the choice is the
    /// other material's, and interreflection changes as smoothly as the rules do. The stated error is a bound
    /// as far as the choice suits both. `like` has to be of this renderer: another's may name a view that this one
    /// has not, or tiles for another tolerance.
    ///
    /// # Errors
    /// When the view does not exist or a parameter lies outside the model.
    pub fn film_like(
        &self,
        material: &Material,
        like: &Discretization,
    ) -> Result<Film, RenderError> {
        material.check()?;
        let key = sampler_key(self.specification.seed, None, like.view);
        let (_, (film, ..)) = self.film(material, like.view, key, Some(like))?;
        Ok(film)
    }

    fn view(&self, view: u32) -> Result<(&ViewToRender, &View), RenderError> {
        let index = view as usize;
        let found = self
            .views
            .get(index)
            .zip(self.specification.views.get(index));
        found.ok_or(RenderError::NoSuchView {
            view,
            count: self.views.len(),
        })
    }

    /// The film of a view, and which integrator rendered it.
    fn film(
        &self,
        material: &Material,
        view: u32,
        key: u64,
        like: Option<&Discretization>,
    ) -> Result<(IntegratorKind, Work), RenderError> {
        let (to_render, of_view) = self.view(view)?;
        let reflectance = Reflectance::new(material, of_view.rotation_deg, self.specification.tint);
        let worked_out = to_render.prepared.as_ref().and_then(|prepared| {
            self.work_out(prepared, (material, &reflectance), of_view, like)
                .ok()
        });
        let integrator = match worked_out {
            None if !self.is_traced_to_accuracy() => IntegratorKind::Path,
            _ => IntegratorKind::Hybrid,
        };
        let work = worked_out.unwrap_or_else(|| self.trace(&to_render.scene, &reflectance, key));
        check_pixels(&work.0, view)?;
        Ok((integrator, work))
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
        let pixel = self.specification.image.pixel;
        let stored = |of: &FilmPixel| exr_file::stored(of, pixel);
        let pixels = film.pixels.iter();
        let found = PixelStatistics::of_stored(&self.specification, view, pixels, stored);
        let Some(found) = found else {
            unreachable!("the film is of a view of the specification");
        };
        found
    }

    /// Renders a view with the hybrid integrator: the film, samples, evaluations and phases.
    fn work_out(
        &self,
        prepared: &PreparedView,
        (material, reflectance): (&Material, &Reflectance),
        view: &View,
        like: Option<&Discretization>,
    ) -> Result<Work, Unresolved> {
        let mut phases = Vec::new();
        let interreflection = timed(&mut phases, "interreflection", || {
            self.interreflection(prepared, (material, reflectance), view, like)
        })?;
        let (film, evaluations, others) =
            prepared.render(reflectance, interreflection.as_deref())?;
        phases.extend(others);
        Ok((film, 0, evaluations, phases))
    }

    /// What sample and chart send each other in a view; `None` for one without chart.
    fn interreflection(
        &self,
        prepared: &PreparedView,
        (material, reflectance): (&Material, &Reflectance),
        view: &View,
        like: Option<&Discretization>,
    ) -> Result<Option<Arc<Interreflection>>, Unresolved> {
        let like = like.and_then(|like| Some((like, like.interreflection.as_deref()?)));
        let key = Key {
            material: *material,
            like: like.map(|(like, _)| like.material),
            angles_deg: [view.rotation_deg, view.light_elevation_deg],
        };
        let made = self.interreflections.get(&key, || {
            let made = match like {
                Some((like, interreflection)) => {
                    prepared.interreflection_like((interreflection, &like.reflectance), reflectance)
                }
                None => prepared.interreflection(reflectance),
            };
            made.transpose()
        });
        made.transpose()
    }

    /// Encodes what the middle of each pixel of `rendering`, which this renderer made, sees, as an EXR
    /// file of 32-bit floats: the layers `depth` (Z, along the camera's axis, metres), `normal` and
    /// `tangent` (X, Y, Z, in the world; the tangent is the x axis of the material's frame), `uv` (U, V)
    /// and `mask` (sample, chart, bulb).
    ///
    /// # Errors
    /// When the library refuses, or the rendering is of no view of this renderer.
    pub fn encode_aov(&self, rendering: &Rendering) -> Result<Vec<u8>, RenderError> {
        let (made, of_view) = self.view(rendering.header.view)?;
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
fn sampler_key(seed: u64, material_index: Option<u32>, view: u32) -> u64 {
    let mut hasher = blake3::Hasher::new_derive_key("brdfarm 2026 light path sampler");
    hasher.update(&seed.to_le_bytes());
    hasher.update(&material_index.map_or(u64::MAX, u64::from).to_le_bytes());
    hasher.update(&view.to_le_bytes());
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

//! One view of one material.

use crate::{
    error::{failed, invalid},
    interruptible,
    reflectance::Parameters,
    specification::Specification,
};
use dataset::{Digest, specification::IntegratorKind};
use numpy::{IntoPyArray, PyArray2, PyArray3, PyArrayMethods};
use pyo3::{prelude::*, types::PyBytes};
use renderer::{RenderError, Renderer, geometry::BackendChoice};
use std::{
    process,
    sync::{Arc, Mutex, PoisonError},
    thread,
    time::Instant,
};

/// A rendered view.
#[pyclass(frozen, module = "brdfarm._native")]
pub struct Rendering {
    renderer: Arc<Renderer>,
    rendering: renderer::Rendering,
    seconds: f64,
}

#[pymethods]
impl Rendering {
    /// (height, width, 3): linear Rec.709 in units of white, in full precision.
    fn pixels<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<f64>>> {
        let film = &self.rendering.film;
        let values = film.pixels.iter().flat_map(|pixel| pixel.value);
        let values: Vec<f64> = values.collect();
        let shape = [film.height as usize, film.width as usize, 3];
        values.into_pyarray(py).reshape(shape)
    }

    /// (height, width): the stated error.
    fn error<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let film = &self.rendering.film;
        let errors: Vec<f64> = film.pixels.iter().map(|pixel| pixel.error).collect();
        let shape = [film.height as usize, film.width as usize];
        errors.into_pyarray(py).reshape(shape)
    }

    /// The EXR file.
    fn exr<'py>(&self, py: Python<'py>) -> Bound<'py, PyBytes> {
        PyBytes::new(py, &self.rendering.exr)
    }

    /// The EXR file of the stated errors.
    fn error_exr<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        let encoded = py.detach(|| self.renderer.encode_error(&self.rendering));
        Ok(PyBytes::new(py, &encoded.map_err(failed)?))
    }

    /// The BLAKE3 digest of the EXR file.
    fn digest(&self) -> String {
        Digest::of(&self.rendering.exr).to_string()
    }

    /// The integrator that rendered it: "path" also where the specification asks for "hybrid" and
    /// that cannot render the view.
    fn integrator(&self) -> &'static str {
        match self.rendering.integrator {
            IntegratorKind::Hybrid => "hybrid",
            IntegratorKind::Path => "path",
        }
    }

    fn seconds(&self) -> f64 {
        self.seconds
    }

    /// Mean, 95th percentile and largest error, share of pixels within target, samples and
    /// evaluations.
    fn statistics(&self) -> (f64, f64, f64, f64, u64, u64) {
        let statistics = self.rendering.statistics;
        (
            statistics.mean,
            statistics.p95,
            statistics.max,
            statistics.within_target,
            statistics.samples,
            statistics.evaluations,
        )
    }
}

/// Renders view `view` of a material, whose index in the set is `index` if it is one of the set.
#[pyfunction]
#[pyo3(signature = (specification, parameters, index, view, backend, threads))]
pub fn render(
    py: Python<'_>,
    specification: &Specification,
    parameters: Parameters,
    index: Option<u32>,
    view: u32,
    backend: &str,
    threads: usize,
) -> PyResult<Rendering> {
    let material = parameters.material()?;
    let backend = backend.parse::<BackendChoice>().map_err(invalid)?;
    specification.check_mesh()?;
    let renderer = kept_renderer(&specification.0, backend)?;
    let began = Instant::now();
    let working = Arc::clone(&renderer);
    let rendered = interruptible::run(py, move || {
        let render = || working.render(&material, index, view);
        match pool(threads) {
            Some(pool) => pool.install(render),
            None => render(),
        }
    })?;
    let rendering = rendered.map_err(|error| match error {
        RenderError::NoSuchView { .. } => invalid(error),
        error => failed(error),
    })?;
    Ok(Rendering {
        renderer,
        rendering,
        seconds: began.elapsed().as_secs_f64(),
    })
}

/// Threads for one call: they end with it, so that no thread is missing in a process that forked.
pub(crate) fn pool(threads: usize) -> Option<rayon::ThreadPool> {
    let cores = || thread::available_parallelism().map_or(1, usize::from);
    let threads = match threads {
        0 => cores(),
        threads => threads,
    };
    let built = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    // A system that gives no more threads still has this one.
    built.ok()
}

/// A renderer with what it is for.
struct Kept {
    process: u32,
    specification: dataset::Specification,
    backend: BackendChoice,
    renderer: Arc<Renderer>,
}

/// The renderer used last: many calls in a row are about one specification.
static KEPT: Mutex<Option<Kept>> = Mutex::new(None);

/// The renderer of a specification. It is only ever locked by who holds the interpreter's lock, so
/// it is free in a process that forked; but what it guards may not be, and is made anew there.
fn kept_renderer(
    specification: &dataset::Specification,
    backend: BackendChoice,
) -> PyResult<Arc<Renderer>> {
    let mut kept = KEPT.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(kept) = kept.as_ref()
        && kept.process == process::id()
        && kept.backend == backend
        && kept.specification == *specification
    {
        return Ok(Arc::clone(&kept.renderer));
    }
    let renderer = Renderer::new(specification, backend).map_err(failed)?;
    let renderer = Arc::new(renderer);
    let before = kept.replace(Kept {
        process: process::id(),
        specification: specification.clone(),
        backend,
        renderer: Arc::clone(&renderer),
    });
    // Of another process, its locks may be held by threads that are not here.
    if before
        .as_ref()
        .is_some_and(|before| before.process != process::id())
    {
        std::mem::forget(before);
    }
    Ok(renderer)
}

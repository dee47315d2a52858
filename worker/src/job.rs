//! One job: a material that this worker holds the lease of.

use crate::render::{Render, RenderFailure, RenderedView};
use dataset::{Digest, SampledMaterial};
use std::{
    collections::BTreeMap,
    panic::{self, AssertUnwindSafe},
    sync::{
        Arc, Mutex, PoisonError,
        atomic::{AtomicBool, AtomicU32, Ordering},
    },
    time::{Duration, Instant},
};

/// A leased material.
#[derive(Debug)]
pub(crate) struct Job {
    pub token: Vec<u8>,
    pub material: u32,
    pub views_done: AtomicU32,
    /// The lease is lost, so nobody waits for the images.
    pub lost: AtomicBool,
}

/// A material's images, ready to be delivered.
pub(crate) struct RenderedJob {
    pub views: Vec<(Digest, RenderedView)>,
    pub time: Duration,
}

/// Why a job ended without images.
pub(crate) enum Unrendered {
    /// The lease was lost, or the worker stops.
    Interrupted,
    /// A view could not be rendered.
    Failed(RenderFailure),
    /// The job took longer than any may, and still does.
    Wedged,
}

/// The jobs that a worker holds, which the renewals have to know.
#[derive(Default)]
pub(crate) struct Held {
    jobs: Mutex<BTreeMap<u32, Arc<Job>>>,
}

impl Held {
    pub fn add(&self, job: Arc<Job>) {
        let mut jobs = self.jobs.lock().unwrap_or_else(PoisonError::into_inner);
        jobs.insert(job.material, job);
    }

    /// Forgets a job, unless the material is held anew under another token.
    pub fn remove(&self, job: &Job) {
        let mut jobs = self.jobs.lock().unwrap_or_else(PoisonError::into_inner);
        if jobs
            .get(&job.material)
            .is_some_and(|held| held.token == job.token)
        {
            jobs.remove(&job.material);
        }
    }

    pub fn all(&self) -> Vec<Arc<Job>> {
        let jobs = self.jobs.lock().unwrap_or_else(PoisonError::into_inner);
        jobs.values().cloned().collect()
    }
}

/// Renders every view of a job, in order, on the current rayon pool. Looks up between views whether
/// anybody still wants them.
pub(crate) fn render_views(
    render: &dyn Render,
    job: &Job,
    material: &SampledMaterial,
    views: u32,
    stopping: impl Fn() -> bool,
) -> Result<RenderedJob, Unrendered> {
    let started = Instant::now();
    let mut rendered = Vec::with_capacity(views as usize);
    for view in 0..views {
        if job.lost.load(Ordering::Relaxed) || stopping() {
            return Err(Unrendered::Interrupted);
        }
        // A panic is the job's failure, not the worker's end.
        let image = panic::catch_unwind(AssertUnwindSafe(|| render.render(material, view)))
            .unwrap_or_else(|_| Err(RenderFailure("the renderer panicked".to_owned())))
            .map_err(|RenderFailure(reason)| {
                Unrendered::Failed(RenderFailure(format!("view {view}: {reason}")))
            })?;
        rendered.push((Digest::of(&image.exr), image));
        job.views_done.store(view + 1, Ordering::Relaxed);
    }
    Ok(RenderedJob {
        views: rendered,
        time: started.elapsed(),
    })
}

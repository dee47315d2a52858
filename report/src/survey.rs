//! Renders what a plan asks for, and measures each rendering.

use crate::ReportError;
use crate::comparison::{Comparison, compare};
use crate::plan::{Plan, Setting};
use dataset::{ErrorStatistics, Material, specification::Accuracy};
use rayon::ThreadPool;
use renderer::{PhaseTime, RenderError, Renderer, Rendering, film::Film, geometry::BackendChoice};
use rustix::time::{ClockId, clock_gettime};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;
use std::time::Instant;

/// A view that takes less is rendered again, up to [`REPEATS_MAX`] times, and the median counts.
const STEADY_SECONDS: f64 = 0.03;

/// See [`STEADY_SECONDS`].
const REPEATS_MAX: usize = 5;

/// The reference's sampling points: others than those of what is compared with it.
const REFERENCE_SEED_OFFSET: u64 = 1;

/// One rendering, measured.
#[derive(Clone, Debug)]
pub struct Measurement {
    /// Index of the material in the plan.
    pub material: usize,
    /// The preset's view.
    pub view: u32,
    /// What was asked for.
    pub setting: Setting,
    /// What it took on one thread.
    pub cost: Cost,
    /// What the rendering says of itself.
    pub stated: ErrorStatistics,
    /// How far it is from the reference.
    pub comparison: Comparison,
    /// What each phase took, in wall-clock seconds.
    pub phases: Vec<PhaseTime>,
}

/// Seconds of one rendering on one thread.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cost {
    /// By the clock on the wall.
    pub wall_seconds: f64,
    /// Of the processor, as the system accounts for the thread.
    pub cpu_seconds: f64,
}

/// Renders and measures everything in `plan`, ordered by material, view and setting. `advance` is
/// called after each rendering.
///
/// # Errors
/// When a view cannot be rendered or a thread cannot be started.
pub fn survey(plan: &Plan, advance: &(dyn Fn() + Sync)) -> Result<Vec<Measurement>, ReportError> {
    let renderers = plan
        .settings
        .iter()
        .map(|setting| {
            let specification = setting.specification(plan.size_pixels);
            // A path tracer has no accuracy of its own: it is held to the preset's.
            let accuracy = specification.accuracy.clone();
            let renderer = Renderer::new(&specification, BackendChoice::Auto)?;
            Ok((*setting, accuracy, renderer))
        })
        .collect::<Result<Vec<_>, RenderError>>()?;
    let mut finest = Setting::Accuracy(plan.reference_relative).specification(plan.size_pixels);
    finest.seed += REFERENCE_SEED_OFFSET;
    let reference = Renderer::new(&finest, BackendChoice::Auto)?;

    let cells: Vec<(usize, u32)> = (0..plan.materials.len())
        .flat_map(|material| plan.views.iter().map(move |&view| (material, view)))
        .collect();
    let next = AtomicUsize::new(0);
    let work = || -> Result<Vec<Measurement>, ReportError> {
        let thread = lone_thread()?;
        let mut measured = Vec::new();
        while let Some(&(index, view)) = cells.get(next.fetch_add(1, Ordering::Relaxed)) {
            let material = &plan.materials[index].material;
            let view_of = |renderer: &Renderer| {
                // Its place in the plan names an image, so that no two share sampling points.
                render(&thread, renderer, material, index as u32, view)
            };
            let (expected, _) = view_of(&reference)?;
            advance();
            for (setting, accuracy, renderer) in &renderers {
                let (rendering, cost) = steady(|| view_of(renderer))?;
                measured.push(measurement(
                    (index, view, *setting),
                    rendering,
                    cost,
                    &expected.film,
                    accuracy,
                ));
                advance();
            }
        }
        Ok(measured)
    };
    let outcomes: Vec<_> = thread::scope(|scope| {
        let workers: Vec<_> = (0..plan.threads.max(1))
            .map(|_| scope.spawn(work))
            .collect();
        workers
            .into_iter()
            .map(|worker| {
                worker
                    .join()
                    .unwrap_or_else(|panic| std::panic::resume_unwind(panic))
            })
            .collect()
    });
    let mut measured = Vec::new();
    for outcome in outcomes {
        measured.extend(outcome?);
    }
    // Stable, so settings stay in the order of the plan.
    measured.sort_by_key(|one: &Measurement| {
        let place = plan.views.iter().position(|&view| view == one.view);
        (one.material, place)
    });
    Ok(measured)
}

/// A pool of one thread, on which the processor's time can be told.
pub fn lone_thread() -> Result<ThreadPool, ReportError> {
    Ok(rayon::ThreadPoolBuilder::new().num_threads(1).build()?)
}

/// Renders a view on `thread`, and says what it took.
pub fn render(
    thread: &ThreadPool,
    renderer: &Renderer,
    material: &Material,
    index: u32,
    view: u32,
) -> Result<(Rendering, Cost), RenderError> {
    thread.install(|| {
        let (start, cpu_start) = (Instant::now(), thread_cpu_seconds());
        let rendering = renderer.render(material, Some(index), view)?;
        let cost = Cost {
            wall_seconds: start.elapsed().as_secs_f64(),
            cpu_seconds: thread_cpu_seconds() - cpu_start,
        };
        Ok((rendering, cost))
    })
}

/// Renders again while that is quick, and takes the run of median processor time.
pub fn steady(
    render: impl Fn() -> Result<(Rendering, Cost), RenderError>,
) -> Result<(Rendering, Cost), RenderError> {
    let mut runs = vec![render()?];
    let mut spent = runs[0].1.wall_seconds;
    while spent < STEADY_SECONDS && runs.len() < REPEATS_MAX {
        let run = render()?;
        spent += run.1.wall_seconds;
        runs.push(run);
    }
    runs.sort_by(|(_, a), (_, b)| a.cpu_seconds.total_cmp(&b.cpu_seconds));
    Ok(runs.swap_remove(runs.len() / 2))
}

/// What the processor has spent on the calling thread.
fn thread_cpu_seconds() -> f64 {
    let time = clock_gettime(ClockId::ThreadCPUTime);
    time.tv_sec as f64 + 1e-9 * time.tv_nsec as f64
}

fn measurement(
    (material, view, setting): (usize, u32, Setting),
    rendering: Rendering,
    cost: Cost,
    reference: &Film,
    accuracy: &Accuracy,
) -> Measurement {
    Measurement {
        material,
        view,
        setting,
        cost,
        stated: rendering.statistics,
        comparison: compare(&rendering.film, reference, accuracy),
        phases: rendering.phases,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::NamedMaterial;

    fn plan(threads: usize) -> Plan {
        let mut plan = Plan::full(threads);
        plan.materials = NamedMaterial::hard().skip(5).take(2).collect();
        plan.views = vec![9, 6];
        plan.size_pixels = 8;
        plan.settings = vec![Setting::Accuracy(1e-2), Setting::Samples(16)];
        plan.reference_relative = 1e-3;
        // Shapes are measured elsewhere.
        plan.shape_accuracies.clear();
        plan
    }

    #[test]
    fn every_rendering_is_measured_once_in_order_whatever_the_threads() {
        let count = AtomicUsize::new(0);
        let advance = || {
            count.fetch_add(1, Ordering::Relaxed);
        };
        let alone = survey(&plan(1), &advance).unwrap();
        assert_eq!(count.load(Ordering::Relaxed) as u64, plan(1).renderings());
        let places: Vec<_> = alone
            .iter()
            .map(|one| (one.material, one.view, one.setting.value()))
            .collect();
        let mut expected = Vec::new();
        for material in 0..2 {
            for view in [9, 6] {
                expected.extend([(material, view, 1e-2), (material, view, 16.0)]);
            }
        }
        assert_eq!(places, expected);
        let together = survey(&plan(3), &|| ()).unwrap();
        for (one, other) in alone.iter().zip(&together) {
            assert_eq!(one.comparison, other.comparison);
            assert_eq!(one.stated, other.stated);
            assert!(one.cost.wall_seconds > 0.0 && one.cost.cpu_seconds > 0.0);
            let staged: f64 = one.phases.iter().map(|stage| stage.seconds).sum();
            assert!(staged <= one.cost.wall_seconds);
        }
    }
}

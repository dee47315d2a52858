//! Speed against error of traced samples, a sphere and a mesh, beside the square's.

use crate::ReportError;
use crate::comparison::{Comparison, RELATIVE_FLOOR, compare};
use crate::plan::{Plan, SHAPE_VIEWS};
use crate::survey::{Cost, lone_thread, render};
use dataset::{
    HARD_CASES, Specification,
    specification::{Accuracy, IntegratorKind, SampleMesh, Shape},
};
use mesh::{Mesh, MeshError};
use renderer::{Renderer, geometry::BackendChoice};
use std::f64::consts::PI;

/// The hard case that is rendered: the ordinary one.
pub const MATERIAL: usize = 0;

/// The largest film, in pixels a side. A traced image takes seconds on one of 128.
pub const SIZE_PIXELS_MAX: u32 = 32;

/// The reference is so many times as exact as the finest accuracy that is compared, as far as its limit
/// on paths lets it.
const REFERENCE_FINER: f64 = 5.0;

/// The samples a pixel that say how many paths a reference may take.
const REFERENCE_SAMPLES: u32 = 512;

/// The quadrilaterals of the mesh, a torus, around its axis and around its tube.
const TORUS: [u32; 2] = [240, 120];

/// What a rendering of a shape took, and how far it is from its reference.
#[derive(Clone, Debug)]
pub struct ShapeMeasurement {
    /// The shape.
    pub shape: Shape,
    /// The preset's view.
    pub view: u32,
    /// The relative accuracy that was asked for.
    pub relative: f64,
    /// What it took on one thread.
    pub cost: Cost,
    /// The share of pixels that state that they meet the accuracy.
    pub within_target: f64,
    /// How far it is from its reference.
    pub comparison: Comparison,
}

/// Renders square, sphere and mesh in two views, with and without the chart, at the plan's accuracies for
/// shapes.
///
/// # Errors
/// When a view cannot be rendered or no thread can be started.
pub fn compare_shapes(
    plan: &Plan,
    advance: &(dyn Fn() + Sync),
) -> Result<Vec<ShapeMeasurement>, ReportError> {
    let thread = lone_thread()?;
    let material = &HARD_CASES[MATERIAL].material;
    let torus = torus()?;
    let mut measured = Vec::new();
    let Some(finest) = plan.shape_accuracies.iter().copied().reduce(f64::min) else {
        return Ok(measured);
    };
    for shape in [Shape::Square, Shape::Sphere, Shape::Mesh] {
        let renderer = |relative: f64, samples: Option<u32>| {
            let mesh = (shape == Shape::Mesh).then(|| torus.clone());
            let mut specification = specification(plan, shape, mesh, relative);
            if let Some(samples) = samples {
                specification.integrator.samples_per_pixel = samples;
                specification.seed += 1;
            }
            let accuracy = specification.accuracy.clone();
            Renderer::new(&specification, BackendChoice::Auto).map(|made| (made, accuracy))
        };
        let (reference, _) = renderer(finest / REFERENCE_FINER, Some(REFERENCE_SAMPLES))?;
        for view in SHAPE_VIEWS {
            let of_view = |renderer: &Renderer| render(&thread, renderer, material, 0, view);
            let (expected, _) = of_view(&reference)?;
            advance();
            for &relative in &plan.shape_accuracies {
                let (renderer, accuracy) = renderer(relative, None)?;
                let (rendering, cost) = of_view(&renderer)?;
                advance();
                measured.push(ShapeMeasurement {
                    shape,
                    view,
                    relative,
                    cost,
                    within_target: rendering.statistics.within_target,
                    comparison: compare(&rendering.film, &expected.film, &accuracy),
                });
            }
        }
    }
    Ok(measured)
}

fn specification(
    plan: &Plan,
    shape: Shape,
    mesh: Option<SampleMesh>,
    relative: f64,
) -> Specification {
    let mut specification = Specification::preset();
    let size = plan.size_pixels.min(SIZE_PIXELS_MAX);
    (specification.image.width, specification.image.height) = (size, size);
    specification.integrator.kind = IntegratorKind::Hybrid;
    (specification.sample.shape, specification.sample.mesh) = (shape, mesh);
    specification.accuracy = Accuracy {
        relative,
        absolute: RELATIVE_FLOOR * relative,
    };
    specification
}

/// A torus that lies in the plane of the sample.
fn torus() -> Result<SampleMesh, MeshError> {
    let [columns, rows] = TORUS;
    let place = |k: u32, count: u32| libm::sincos(2.0 * PI * f64::from(k) / f64::from(count));
    let cells = || (0..rows).flat_map(|j| (0..columns).map(move |i| [i, j]));
    let of_cells = |at: &dyn Fn([f64; 4]) -> [f64; 3]| -> Vec<[f64; 3]> {
        cells()
            .map(|[i, j]| {
                let ((sin_i, cos_i), (sin_j, cos_j)) = (place(i, columns), place(j, rows));
                at([sin_i, cos_i, sin_j, cos_j])
            })
            .collect()
    };
    let positions = of_cells(&|[sin_i, cos_i, sin_j, cos_j]| {
        let outward = 1.0 + 0.4 * cos_j;
        [outward * cos_i, outward * sin_i, 0.4 * sin_j]
    });
    let normals = of_cells(&|[sin_i, cos_i, sin_j, cos_j]| [cos_j * cos_i, cos_j * sin_i, sin_j]);
    let vertex = |i: u32, j: u32| (j % rows) * columns + i % columns;
    let triangles = cells()
        .flat_map(|[i, j]| {
            let [a, b] = [vertex(i, j), vertex(i + 1, j)];
            let [c, d] = [vertex(i + 1, j + 1), vertex(i, j + 1)];
            [[a, b, c], [a, c, d]]
        })
        .collect();
    let mesh = Mesh::new(positions, triangles, Some(normals), None, None)?;
    SampleMesh::of_bytes(mesh.to_ply())
}

/// What a shape is called on the page.
pub fn name(shape: Shape) -> String {
    let [columns, rows] = TORUS;
    match shape {
        Shape::Mesh => format!("mesh: a torus of {} triangles", 2 * columns * rows),
        other => other.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicUsize, Ordering};

    #[test]
    fn every_shape_is_measured_at_every_accuracy() {
        let mut plan = Plan::full(1);
        plan.size_pixels = 10;
        plan.shape_accuracies = vec![0.2, 0.05];
        let count = AtomicUsize::new(0);
        let advance = || {
            count.fetch_add(1, Ordering::Relaxed);
        };
        let measured = compare_shapes(&plan, &advance).expect("renderings");
        assert_eq!(count.load(Ordering::Relaxed), plan.shape_renderings());
        assert_eq!(measured.len(), 12);
        for one in &measured {
            assert!(one.comparison.pixels > 5, "{one:?}");
            assert!(one.comparison.within_bound > 0.9, "{one:?}");
            assert!(one.cost.cpu_seconds > 0.0);
        }
        plan.shape_accuracies.clear();
        assert!(compare_shapes(&plan, &advance).expect("nothing").is_empty());
        assert_eq!(plan.shape_renderings(), 0);
    }
}

//! What the parts of a view cost. `cargo bench -p renderer`; README.md has a table.

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use dataset::{
    HARD_CASES, ImageHeader, Material, RENDERER_VERSION, Specification,
    specification::{IntegratorKind, Tint},
};
use renderer::{
    Renderer, encode_exr,
    geometry::{BackendChoice, Isa, Ray},
    hybrid::PreparedView,
    path::Tracer,
    reflectance::Reflectance,
    sampler::{Dimension, Sampler},
    scene::Scene,
    vector::Vec3,
};
use std::hint::black_box;

/// Directions, rays or paths that one iteration goes through.
const BATCH: u32 = 1024;

/// Camera at 30 degrees, chart.
const WITH_CHART: usize = 5;

/// Camera at 30 degrees, light overhead, no chart.
const WITHOUT_CHART: usize = 10;

fn ordinary() -> Material {
    HARD_CASES[0].material
}

fn scene(view: usize, backend: BackendChoice) -> Option<Scene> {
    Scene::new(&Specification::preset(), view, backend)
        .expect("a view of the preset")
        .ok()
}

fn points(batch: u32) -> impl Iterator<Item = [f64; 2]> {
    let sampler = Sampler::new(1, 0, 0);
    (0..batch).map(move |index| sampler.point(Dimension::Film, index))
}

/// A direction above the surface from a point of the unit square.
fn direction([x, y]: [f64; 2]) -> Vec3 {
    Vec3::new(2.0 * x - 1.0, 2.0 * y - 1.0, 1.0).normalized()
}

fn reflectance(criterion: &mut Criterion) {
    let reflectance = Reflectance::new(&ordinary(), 0.0, Tint::Hue);
    let wo = Vec3::new(0.3, -0.4, 0.8).normalized();
    let directions: Vec<Vec3> = points(BATCH).map(direction).collect();
    let mut group = criterion.benchmark_group("reflectance");
    group.throughput(Throughput::Elements(u64::from(BATCH)));
    group.bench_function("evaluate", |bencher| {
        bencher.iter(|| {
            directions
                .iter()
                .map(|&wi| reflectance.evaluate(black_box(wi), wo)[0])
                .sum::<f64>()
        });
    });
    group.bench_function("sample", |bencher| {
        bencher.iter(|| {
            points(BATCH)
                .filter_map(|point| reflectance.sample(black_box(wo), point))
                .map(|sample| sample.weight[0])
                .sum::<f64>()
        });
    });
    group.finish();
}

/// The bulb's light at the points of a view that sees but a spot of the sample: tiles of 8 by 8
/// points, so the cost of a point is that of cubature and not of the film.
fn cubature(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("cubature");
    for name in ["ordinary", "mirror", "brushed-mirror"] {
        let case = HARD_CASES
            .iter()
            .find(|case| case.name == name)
            .expect("a hard case");
        let mut specification = Specification::preset();
        specification.image.width = 1;
        specification.image.height = 1;
        specification.camera.film_half_width = 0.001;
        // The camera at 45 degrees with the light there sees the bulb in a mirror.
        specification.views = vec![specification.views[6].clone()];
        specification.views[0].checker = false;
        let scene = Scene::new(&specification, 0, BackendChoice::Native)
            .expect("a view")
            .expect("native geometry");
        let prepared =
            PreparedView::new(&scene, &specification).expect("a view that can be worked out");
        let reflectance = Reflectance::new(&case.material, 0.0, Tint::Hue);
        let (_, evaluations, _) = prepared.render(&reflectance, None).expect("resolved");
        group.throughput(Throughput::Elements(evaluations));
        group.bench_function(BenchmarkId::new("pixel", name), |bencher| {
            bencher.iter(|| prepared.render(black_box(&reflectance), None));
        });
    }
    group.finish();
}

fn path_sample(criterion: &mut Criterion) {
    let reflectance = Reflectance::new(&ordinary(), 0.0, Tint::Hue);
    let mut group = criterion.benchmark_group("path");
    group.throughput(Throughput::Elements(u64::from(BATCH)));
    for (name, view) in [("with chart", WITH_CHART), ("without chart", WITHOUT_CHART)] {
        let scene = scene(view, BackendChoice::Native).expect("native geometry");
        let tracer = Tracer::new(&scene, &reflectance, 4);
        let footprints: Vec<_> = (0..16 * 16)
            .map(|pixel| tracer.footprint(4 + 8 * (pixel % 16), 4 + 8 * (pixel / 16)))
            .collect();
        group.bench_function(BenchmarkId::new("sample", name), |bencher| {
            bencher.iter(|| {
                (0..BATCH)
                    .zip(footprints.iter().cycle())
                    .map(|(index, footprint)| {
                        let sampler = Sampler::new(black_box(1), index, 0);
                        tracer.replicate(footprint, &sampler, 1)[0]
                    })
                    .sum::<f64>()
            });
        });
    }
    group.finish();
}

/// Rays of the camera over the whole film, on every backend that this machine has.
fn intersection(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("intersect");
    group.throughput(Throughput::Elements(u64::from(BATCH)));
    let backends = [BackendChoice::Native, BackendChoice::Embree]
        .into_iter()
        .chain(Isa::ALL.map(BackendChoice::EmbreeOn));
    for backend in backends {
        let Some(scene) = scene(WITH_CHART, backend) else {
            continue;
        };
        let rays: Vec<Ray> = points(BATCH)
            .map(|[x, y]| scene.camera.ray(128.0 * x, 128.0 * y))
            .collect();
        group.bench_function(BenchmarkId::new("ray", backend), |bencher| {
            bencher.iter(|| {
                rays.iter()
                    .filter(|ray| scene.geometry.intersect(black_box(ray), None).is_some())
                    .count()
            });
        });
    }
    group.finish();
}

/// The preset's images: 128 by 128 pixels of 16-bit floats.
fn whole_views(criterion: &mut Criterion) {
    let specification = Specification::preset();
    let renderer = Renderer::new(&specification, BackendChoice::Native).expect("a renderer");
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(1)
        .build()
        .expect("a pool");
    let mut group = criterion.benchmark_group("view");
    group.sample_size(10);
    for (name, view) in [("with chart", WITH_CHART), ("without chart", WITHOUT_CHART)] {
        group.bench_function(BenchmarkId::new("hybrid", name), |bencher| {
            pool.install(|| {
                bencher.iter(|| renderer.render(&ordinary(), Some(0), black_box(view as u32)));
            });
        });
    }
    let mut traced = specification.clone();
    traced.integrator.kind = IntegratorKind::Path;
    let renderer = Renderer::new(&traced, BackendChoice::Native).expect("a renderer");
    group.bench_function("path/64 samples with chart", |bencher| {
        pool.install(|| {
            bencher.iter(|| renderer.render(&ordinary(), Some(0), black_box(WITH_CHART as u32)));
        });
    });
    group.finish();
}

fn encoding(criterion: &mut Criterion) {
    let specification = Specification::preset();
    let renderer = Renderer::new(&specification, BackendChoice::Native).expect("a renderer");
    let view = WITH_CHART as u32;
    let rendering = renderer
        .render(&ordinary(), Some(0), view)
        .expect("an image");
    let header = ImageHeader {
        specification: specification.hash().to_string(),
        seed: specification.seed,
        material: Some(0),
        view,
        parameters: ordinary(),
        tint: specification.tint,
        renderer_version: RENDERER_VERSION.to_owned(),
    };
    criterion.bench_function("exr/encode", |bencher| {
        bencher.iter(|| {
            encode_exr(
                black_box(&rendering.film),
                specification.image.pixel,
                &header,
                1.0,
            )
        });
    });
}

criterion_group!(
    kernels,
    reflectance,
    cubature,
    path_sample,
    intersection,
    encoding,
    whole_views
);
criterion_main!(kernels);

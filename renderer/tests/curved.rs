//! Samples that are not flat: spheres and cylinders.

mod plain_path;

use dataset::{
    Material, PixelStatistics, Specification,
    specification::{IntegratorKind, Shape, View},
};
use rayon::prelude::*;
use renderer::{
    Instructions, RenderError, Renderer, Rendering,
    film::FilmPixel,
    geometry::BackendChoice,
    reflectance::Reflectance,
    scene::{Encounter, Scene, Thing},
};

const SHAPES: [Shape; 2] = [Shape::Sphere, Shape::Cylinder];

fn specification(shape: Shape, side: u32) -> Specification {
    let mut specification = Specification::preset();
    specification.sample.shape = shape;
    (specification.image.width, specification.image.height) = (side, side);
    specification
}

fn renderer(specification: &Specification) -> Renderer {
    Renderer::new(specification, BackendChoice::Native).expect("a renderer")
}

fn render(renderer: &Renderer, material: &Material, view: u32) -> Rendering {
    renderer.render(material, Some(1), view).expect("an image")
}

/// Wide enough that a path that knows nothing finds the bulb.
fn rough() -> Material {
    Material {
        roughness: 80.0,
        anisotropy: 0.7,
        angle_deg: 25.0,
        ior: 1.7,
        rgb0: [0.8, 0.3, 0.1],
        rgb90: [0.9, 0.8, 0.7],
    }
}

fn lambertian() -> Material {
    Material {
        roughness: 97.0,
        ..rough()
    }
}

fn smooth() -> Material {
    Material {
        roughness: 12.0,
        anisotropy: 0.4,
        ..rough()
    }
}

/// The narrowest lobe there is.
fn mirror() -> Material {
    Material {
        roughness: 0.0,
        ..smooth()
    }
}

/// Both integrators of curved samples, in views with and without the chart, against paths that share
/// the model, the scene and the geometry with them and nothing else. Of 24 images of 100 pixels, whose
/// channels are correlated, one is off by more than this with a probability of 1e-3.
#[test]
fn curved_samples_agree_with_plain_paths() {
    const T_LIMIT: f64 = 6.5;
    let cases: Vec<(Shape, Material, u32, IntegratorKind)> = SHAPES
        .into_iter()
        .flat_map(|shape| [rough(), lambertian()].map(|material| (shape, material)))
        .flat_map(|(shape, material)| [0, 5, 9].map(|view| (shape, material, view)))
        .flat_map(|(shape, material, view)| {
            [IntegratorKind::Hybrid, IntegratorKind::Path].map(|kind| (shape, material, view, kind))
        })
        .collect();
    cases.par_iter().for_each(|(shape, material, view, kind)| {
        let mut specification = specification(*shape, 10);
        specification.integrator.kind = *kind;
        specification.integrator.samples_per_pixel = 1024;
        let image = render(&renderer(&specification), material, *view);
        assert_eq!(image.integrator, *kind);
        let scene = Scene::new(&specification, *view as usize, BackendChoice::Native)
            .expect("a view")
            .expect("a scene");
        let rotation = specification.views[*view as usize].rotation_deg;
        let reflectance = Reflectance::new(material, rotation, specification.tint);
        let mut shown = 0;
        for (index, pixel) in (0u32..).zip(&image.film.pixels) {
            let at = [index % 10, index / 10];
            let plain = plain_path::pixel(&scene, &reflectance, at, [99, 512]);
            for (value, [mean, error]) in pixel.value.into_iter().zip(plain) {
                // A stated error is half of a 95 percent interval.
                let own = pixel.error / 1.96;
                let limit = T_LIMIT * libm::hypot(own, error) + 1e-9;
                assert!(
                    (value - mean).abs() <= limit,
                    "{shape:?}, view {view}, {kind:?}, pixel {at:?}: {value} against {mean}, limit {limit}"
                );
            }
            shown += usize::from(pixel.value[0] > 1e-3 && pixel.error < 0.05 * pixel.value[0]);
        }
        assert!(shown > 15, "{shape:?}, view {view}: {shown} pixels tell anything");
    });
}

/// Stated errors hold in every image: against the same at an eighth of the tolerance, as far as its limit
/// goes. Where 97 percent of the pixels hold, an image of 100 fails with a probability of 1e-5.
#[test]
fn stated_errors_of_curved_samples_hold() {
    let cases: Vec<(Shape, Material, u32)> = SHAPES
        .into_iter()
        .flat_map(|shape| {
            [rough(), lambertian(), smooth(), mirror()].map(|material| (shape, material))
        })
        .flat_map(|(shape, material)| [0, 5, 8, 12].map(|view| (shape, material, view)))
        .collect();
    cases.par_iter().for_each(|(shape, material, view)| {
        let mut specification = specification(*shape, 10);
        specification.accuracy.relative = 1e-2;
        specification.accuracy.absolute = 1e-3;
        let image = render(&renderer(&specification), material, *view);
        specification.accuracy.relative /= 8.0;
        specification.accuracy.absolute /= 8.0;
        specification.integrator.samples_per_pixel = 1024;
        // Another seed, so that no pixel has the same paths.
        specification.seed += 1;
        let finer = render(&renderer(&specification), material, *view);
        let pairs = image.film.pixels.iter().zip(&finer.film.pixels);
        let holds = |(pixel, finer): &(&FilmPixel, &FilmPixel)| {
            let off = (0..3).map(|channel| (pixel.value[channel] - finer.value[channel]).abs());
            off.fold(0.0, f64::max) <= pixel.error + finer.error + 1e-12
        };
        let shown: Vec<_> = pairs
            .filter(|(pixel, finer)| pixel.error > 0.0 || finer.error > 0.0)
            .collect();
        let held = shown.iter().filter(|pair| holds(pair)).count();
        let count = shown.len() as f64;
        let needed = 0.94 * count - 3.5 * (0.94 * 0.06 * count).sqrt();
        assert!(
            held as f64 >= needed,
            "{shape:?}, R = {}, view {view}: {held} of {count} pixels hold",
            material.roughness
        );
    });
}

/// At the origin a sphere and a cylinder have the square's frame. A tiny pixel there sees what it sees of
/// the square, but for the curvature over a hundredth of a millimetre.
#[test]
fn at_the_origin_curved_samples_are_as_bright_as_the_square() {
    for view in [1, 8, 10] {
        let value = |shape| {
            let mut specification = specification(shape, 1);
            specification.camera.film_half_width = 1e-5;
            specification.sample.side_m = 10.0;
            specification.checker.lower_edge_y_m = 5.0;
            specification.accuracy.relative = 1e-3;
            render(&renderer(&specification), &rough(), view)
                .film
                .pixels[0]
        };
        let square = value(Shape::Square);
        for shape in SHAPES {
            let curved = value(shape);
            for channel in 0..3 {
                let off = (curved.value[channel] - square.value[channel]).abs();
                let allowed = curved.error + square.error + 1e-3 * square.value[channel];
                assert!(
                    off <= allowed,
                    "{shape:?}, view {view}: {curved:?} {square:?}"
                );
            }
        }
    }
}

/// Brightness is of the pixels whose middle sees the sample.
#[test]
fn the_pixels_of_a_curved_sample_are_those_that_see_it() {
    for shape in SHAPES {
        let specification = specification(shape, 64);
        for view in 0..14 {
            let scene = Scene::new(&specification, view, BackendChoice::Native)
                .expect("a view")
                .expect("a scene");
            let mask = PixelStatistics::mask(&specification, view as u32).expect("a view");
            for (index, is_sample) in (0u32..).zip(mask) {
                let [x, y] = [index % 64, index / 64].map(|at| f64::from(at) + 0.5);
                let sees = match scene.encounter(&scene.camera.ray(x, y), None) {
                    Some(Encounter::Surface(surface)) => surface.thing == Thing::Sample,
                    _ => false,
                };
                assert_eq!(is_sample, sees, "{shape:?}, view {view}, ({x}, {y})");
            }
        }
    }
}

#[test]
fn bytes_of_curved_samples_depend_on_nothing_but_the_specification() {
    for (shape, view) in [(Shape::Sphere, 5), (Shape::Cylinder, 11)] {
        let specification = specification(shape, 12);
        let expected = render(&renderer(&specification), &smooth(), view).exr;
        let others = Instructions::available();
        for instructions in others {
            let renderer = renderer(&specification).with_instructions(instructions);
            assert!(
                render(&renderer, &smooth(), view).exr == expected,
                "{instructions:?}"
            );
        }
        for threads in [1, 3] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
            let pool = pool.expect("a pool");
            let exr = pool.install(|| render(&renderer(&specification), &smooth(), view).exr);
            assert!(exr == expected, "{threads} threads");
        }
        // Where Embree is installed.
        match Renderer::new(&specification, BackendChoice::Embree) {
            Ok(renderer) => assert!(render(&renderer, &smooth(), view).exr == expected, "Embree"),
            Err(RenderError::Geometry(_)) => {}
            Err(error) => panic!("{error}"),
        }
    }
}

/// Of charts with few patches each is sampled by itself, and those with many are sampled as a whole.
#[test]
fn a_pixel_may_see_all_of_a_chart() {
    for patches in [8, 64] {
        one_pixel_of_a_chart(patches);
    }
}

fn one_pixel_of_a_chart(patches: u32) {
    let mut specification = specification(Shape::Sphere, 1);
    let chart = &mut specification.checker;
    (chart.columns, chart.rows) = (patches, patches);
    chart.pitch_m = 0.192 / f64::from(patches);
    chart.patches_srgb8 = (0..patches * patches)
        .map(|patch| [(patch % 251) as u8, (patch % 7 * 36) as u8, 200])
        .collect();
    specification.camera.film_half_width = 1.0;
    specification.accuracy.relative = 1e-2;
    let hybrid = render(&renderer(&specification), &lambertian(), 4);
    specification.integrator.kind = IntegratorKind::Path;
    specification.integrator.samples_per_pixel = 1 << 16;
    let path = render(&renderer(&specification), &lambertian(), 4);
    let [found, expected] = [&hybrid, &path].map(|image| image.film.pixels[0]);
    for channel in 0..3 {
        let off = (found.value[channel] - expected.value[channel]).abs();
        assert!(
            off <= found.error + expected.error,
            "{found:?} {expected:?}"
        );
    }
    assert!(found.error < 0.1 * found.value[2], "{found:?}");
}

/// However fine the accuracy, an image stops at its limit, and says what it could not reach.
#[test]
fn an_accuracy_that_no_path_reaches_ends_at_the_limit() {
    let mut specification = specification(Shape::Sphere, 8);
    specification.accuracy.relative = 1e-7;
    specification.accuracy.absolute = 1e-9;
    specification.views = vec![View {
        camera_elevation_deg: 45.0,
        light_elevation_deg: 45.0,
        rotation_deg: 0.0,
        checker: true,
    }];
    let image = render(&renderer(&specification), &rough(), 0);
    // A chart's edges make two and three things to see of a pixel.
    let paths = image.statistics.samples as f64 / 64.0;
    assert!(paths <= 3.0 * 24.0 * 64.0, "{paths} paths a pixel");
    assert!(
        image.statistics.within_target < 0.9,
        "{:?}",
        image.statistics
    );
}

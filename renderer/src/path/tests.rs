//! Highlights of the bulb on a sample that few pixels see.

use super::{Tracer, render, render_to_accuracy};
use crate::film::FilmPixel;
use crate::geometry::BackendChoice;
use crate::hybrid::PreparedView;
use crate::numerics::instructions::Instructions;
use crate::reflectance::Reflectance;
use crate::scene::Scene;
use dataset::specification::{Shape, Tint, View};
use dataset::{Material, Specification};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use std::f64::consts::PI;

/// Scenes of each class. Were 95 of 100 stated errors kept in each, 7.5 of 100 would be broken once in 30 seeds.
const DRAWS: u32 = 240;

/// The camera sees a highlight if some pixel is so bright.
const LIT: f64 = 1e-3;

/// Stated errors hold in 95 of 100 pixels, so many times as much in all but 1 in 5,000.
const SLACK: f64 = 3.0;

/// Numbers drawn at random.
struct Random(ChaCha8Rng);

impl Random {
    fn uniform(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * f64::from(self.0.next_u32()) / f64::from(u32::MAX)
    }

    /// Evenly between powers of ten.
    fn power(&mut self, low: f64, high: f64) -> f64 {
        libm::exp10(self.uniform(low, high))
    }

    /// One or the other, as often.
    fn chance(&mut self) -> bool {
        self.uniform(0.0, 2.0) < 1.0
    }
}

/// The preset without chart, in one view on a film of so many pixels a side, and a material without colour.
fn scene(random: &mut Random, side: u32, elevation: [f64; 2]) -> (Specification, Material) {
    let mut specification = Specification::preset();
    (specification.image.width, specification.image.height) = (side, side);
    specification.integrator.max_bounces = 1;
    specification.views.truncate(1);
    let [low, high] = elevation;
    let view = &mut specification.views[0];
    view.checker = false;
    view.rotation_deg = 0.0;
    view.light_elevation_deg = random.uniform(low, high);
    view.camera_elevation_deg = match random.chance() {
        true => view.light_elevation_deg,
        false => random.uniform(low, high),
    };
    let material = Material {
        roughness: random.uniform(0.0, 3.0),
        anisotropy: random.uniform(0.0, 0.3),
        angle_deg: random.uniform(0.0, 180.0),
        ior: random.uniform(1.0, 2.0),
        rgb0: [1.0; 3],
        rgb90: [1.0; 3],
    };
    (specification, material)
}

/// A bulb near the horizon, a lobe from a mirror's to a wide one, and a film that sees most of the sample.
fn near_the_horizon(random: &mut Random) -> (Specification, Material) {
    let side = random.uniform(1.0, 4.0) as u32;
    let (mut specification, mut material) = scene(random, side, [2.0, 25.0]);
    specification.light.distance_m = random.power(0.0, 0.7);
    specification.light.radius_m = random.power(-4.0, -1.3);
    specification.camera.distance_m = random.power(-2.0, 1.0);
    specification.camera.film_half_width = random.power(-1.5, 1.5);
    specification.sample.side_m = random.power(-1.3, 0.2);
    if random.chance() {
        material.roughness = random.uniform(3.0, 30.0);
    }
    (specification, material)
}

/// A large bulb that a smooth sample shows on its edge, from so far that a pixel sees all of it.
fn on_the_edge(random: &mut Random) -> (Specification, Material) {
    let (mut specification, mut material) = scene(random, 1, [30.0, 80.0]);
    specification.light.radius_m = random.power(-1.3, -0.7);
    specification.camera.film_half_width = random.power(-1.0, -0.3);
    material.roughness = random.uniform(0.0, 0.5);
    (specification, material)
}

/// What was found of some pixels.
#[derive(Debug, Default)]
struct Found {
    pixels: u32,
    /// Off by more than the 95 percent interval.
    beyond: u32,
    /// Off by half of the light and more.
    far: u32,
}

/// Traces [`DRAWS`] scenes of a class in which the camera sees a highlight that has no outline, by 64 paths a pixel.
fn traced(drawn: fn(&mut Random) -> (Specification, Material)) -> Found {
    let mut random = Random(ChaCha8Rng::seed_from_u64(20_261_136));
    let (mut scenes, mut found) = (0, Found::default());
    while scenes < DRAWS {
        let (specification, material) = drawn(&mut random);
        let scene = Scene::new(&specification, 0, BackendChoice::Native);
        let scene = scene.expect("such a view").expect("a scene");
        let reflectance = Reflectance::new(&material, 0.0, Tint::Hue);
        let tracer = Tracer::new(&scene, &reflectance, 1);
        if tracer.highlight.within.is_some() {
            continue;
        }
        let Some(prepared) = PreparedView::new(&scene, &specification) else {
            continue;
        };
        let (expected, ..) = prepared.render(&reflectance, None).expect("no chart");
        if expected.pixels.iter().all(|pixel| pixel.value[0] < LIT) {
            continue;
        }
        let pixels = render(&scene, &reflectance, &specification, u64::from(scenes))
            .film
            .pixels;
        scenes += 1;
        for (pixel, expected) in pixels.iter().zip(&expected.pixels) {
            let FilmPixel {
                value: [right, ..],
                error,
            } = *expected;
            let off = (pixel.value[0] - right).abs() - error;
            found.pixels += 1;
            found.beyond += u32::from(off > pixel.error);
            found.far += u32::from(off > 0.5 * right);
        }
    }
    found
}

/// Without cells 64 paths miss more than half of the light of most such pixels, and many a pixel says nothing of it
/// (draws 1474 of seed 20261136 and 278 of seed 20261138 of the search).
#[test]
fn a_highlight_without_outline_is_met() {
    let found = traced(near_the_horizon);
    assert!(found.pixels > DRAWS, "{found:?}");
    assert!(found.beyond * 40 <= 3 * found.pixels, "{found:?}");
    assert!(found.far * 20 <= found.pixels, "{found:?}");
}

/// Where only a sliver of the bulb's image lies on the sample, paths into all of the image mostly miss it.
#[test]
fn a_highlight_on_the_edge_of_the_sample_is_met() {
    let found = traced(on_the_edge);
    assert!(found.beyond * 40 <= 3 * found.pixels, "{found:?}");
    assert!(found.far * 20 <= found.pixels, "{found:?}");
}

/// How bright a smooth mirror's image of a small bulb is, in units of white times pixels: the solid angle that it fills
/// for the camera, times the bulb's radiance and what the mirror reflects. A bundle of rays from the camera widens on
/// its way to the bulb (Coddington's equations). The tints are white.
fn image_of_bulb(scene: &Scene, ior: f64) -> f64 {
    let (eye, bulb) = (scene.camera.position, &scene.bulb);
    let mirror = scene.sample.mirror_point(eye, bulb.centre).expect("smooth");
    let [near, far] = [eye, bulb.centre].map(|at| (at - mirror.position).length());
    let cos = mirror.frame.z.dot(eye - mirror.position) / near;
    let [across, along] = mirror.curvature;
    let wide = near + far * (1.0 + 2.0 * near * across * cos);
    let high = near + far * (1.0 + 2.0 * near * along / cos);
    let solid_angle = PI * bulb.radius * bulb.radius / (wide * high);
    let [column, row] = scene.camera.project(mirror.position).expect("in front");
    let direction = |x: f64, y: f64| scene.camera.ray(column + x, row + y).direction;
    let step = 1e-4;
    let by_column = (direction(step, 0.0) - direction(-step, 0.0)) * (0.5 / step);
    let by_row = (direction(0.0, step) - direction(0.0, -step)) * (0.5 / step);
    let of_pixel = by_column.cross(by_row).length();
    let upright = ((ior - 1.0) / (ior + 1.0)) * ((ior - 1.0) / (ior + 1.0));
    let reflected = upright + (1.0 - upright) * libm::pow(1.0 - cos, 5.0);
    bulb.radiance * reflected * solid_angle / of_pixel
}

/// A curved mirror shows a small bulb in a hundred thousandth of a pixel or less, on a film with a side of even length
/// on the border of two. No path finds it by chance. The image's light is known in closed form.
#[test]
fn a_curved_mirror_shows_all_of_the_bulb() {
    let (mut looked_at, mut beyond) = (0, 0);
    for (shape, side) in [Shape::Sphere, Shape::Cylinder]
        .into_iter()
        .flat_map(|shape| [1, 2, 3, 12].map(|side| (shape, side)))
    {
        for (view, radius_m) in [(0, 1e-4), (3, 1e-3), (5, 1e-4), (9, 1e-3), (12, 1e-4)] {
            let mut specification = Specification::preset();
            (specification.image.width, specification.image.height) = (side, side);
            specification.integrator.samples_per_pixel = 256;
            specification.sample.shape = shape;
            specification.light.radius_m = radius_m;
            specification.views = vec![View {
                checker: false,
                ..specification.views[view].clone()
            }];
            let material = Material {
                roughness: 0.0,
                anisotropy: 0.0,
                angle_deg: 0.0,
                ior: 10.0,
                rgb0: [1.0; 3],
                rgb90: [1.0; 3],
            };
            let scene = Scene::new(&specification, 0, BackendChoice::Native);
            let scene = scene.expect("such a view").expect("a scene");
            let expected = image_of_bulb(&scene, material.ior);
            let reflectance = Reflectance::new(&material, 0.0, Tint::Hue);
            let of_path = render(&scene, &reflectance, &specification, 7);
            let (key, widest) = (7, Instructions::widest());
            let to_accuracy = render_to_accuracy(&scene, &reflectance, &specification, key, widest);
            for traced in [of_path, to_accuracy] {
                let pixels = &traced.film.pixels;
                let found: f64 = pixels.iter().map(|pixel| pixel.value[0]).sum();
                let stated: f64 = pixels.iter().map(|pixel| pixel.error).sum();
                // The bulb is no point.
                let off = (found - expected).abs() - 2e-3 * expected;
                assert!(
                    off <= SLACK * stated && stated < 0.5 * expected,
                    "{shape:?}, {side} pixels a side, view {view}: {found} +- {stated}, not {expected}"
                );
                beyond += usize::from(off > stated);
                looked_at += 1;
            }
        }
    }
    assert!(
        looked_at == 2 * 4 * 5 * 2 && beyond * 10 <= looked_at,
        "{beyond} of {looked_at}"
    );
}

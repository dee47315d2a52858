//! Glossy samples on coarse films, whose pixels hold whole patches of the chart: they meet their target, and are the
//! means of what finer films show.

use dataset::{Material, Specification, specification::Pixel};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use rayon::prelude::*;
use renderer::{
    Renderer,
    film::{FilmPixel, target},
    geometry::BackendChoice,
};

/// How many images are drawn.
const DRAWS: u32 = 60;

/// By how much the film is finer that an image is compared with.
const TIMES: u32 = 5;

/// An image: pixels along a side, a view, and a material.
struct Draw {
    side: u32,
    view: u32,
    material: Material,
}

/// What is found of an image.
struct Found {
    name: String,
    pixels: u32,
    /// Pixels that state more than their target.
    missing: u32,
    /// The largest difference from the finer film's mean, in what both state; and how many are beyond that.
    worst: f64,
    beyond: u32,
}

/// Mirrors, then brushed ones, then lobes of up to five degrees.
fn draws() -> Vec<Draw> {
    let mut random = ChaCha8Rng::seed_from_u64(20_261_201);
    let mut between = |low: f64, high: f64| {
        let uniform = (random.next_u64() >> 11) as f64 / (1u64 << 53) as f64;
        low + uniform * (high - low)
    };
    let specification = Specification::preset();
    (0..DRAWS)
        .map(|number| {
            let (roughness, anisotropy) = match number % 3 {
                0 => (between(0.0, 0.3), 0.0),
                1 => (between(0.0, 2.0), between(0.0, 1.0)),
                _ => (between(0.0, 8.0), between(0.0, 0.6)),
            };
            Draw {
                side: between(6.0, 40.0) as u32,
                // Those with the chart, seen at a slant and from above.
                view: [4, 5, 5, 8, 0][number as usize % 5],
                material: Material {
                    roughness,
                    anisotropy,
                    angle_deg: between(0.0, 180.0),
                    ..specification.material(number).material
                },
            }
        })
        .collect()
}

impl Draw {
    fn render(&self, finer: u32) -> (Specification, Vec<FilmPixel>) {
        let mut specification = Specification::preset();
        specification.image.width = self.side * finer;
        specification.image.height = self.side * finer;
        specification.image.pixel = Pixel::Float;
        let renderer = Renderer::new(&specification, BackendChoice::Native).expect("views");
        let rendering = renderer.render(&self.material, None, self.view);
        (specification, rendering.expect("a rendering").film.pixels)
    }

    fn examine(&self) -> Found {
        let (specification, pixels) = self.render(1);
        let (_, fine) = self.render(TIMES);
        let mut found = Found {
            name: format!(
                "roughness {} anisotropy {} angle {} view {} side {}",
                self.material.roughness,
                self.material.anisotropy,
                self.material.angle_deg,
                self.view,
                self.side
            ),
            pixels: self.side * self.side,
            missing: 0,
            worst: 0.0,
            beyond: 0,
        };
        for (index, pixel) in (0..).zip(&pixels) {
            let (mean, error) = self.mean(&fine, [index % self.side, index / self.side]);
            let off = (0..3).map(|channel| (pixel.value[channel] - mean[channel]).abs());
            let ratio = off.fold(0.0, f64::max) / (pixel.error + error + 1e-12);
            found.worst = found.worst.max(ratio);
            found.beyond += u32::from(ratio > 1.0);
            let allowed = target(&specification.accuracy, pixel.value);
            found.missing += u32::from(pixel.error > allowed);
        }
        found
    }

    /// Of the pixels of the finer film that one of this film covers: their value, and their error.
    fn mean(&self, fine: &[FilmPixel], [column, row]: [u32; 2]) -> ([f64; 3], f64) {
        let share = 1.0 / f64::from(TIMES * TIMES);
        let (mut mean, mut error) = ([0.0; 3], 0.0);
        for y in row * TIMES..(row + 1) * TIMES {
            for x in column * TIMES..(column + 1) * TIMES {
                let part = &fine[(y * self.side * TIMES + x) as usize];
                error += share * part.error;
                for (mean, value) in mean.iter_mut().zip(part.value) {
                    *mean += share * value;
                }
            }
        }
        (mean, error)
    }
}

#[test]
fn glossy_samples_meet_their_target_on_coarse_films() {
    let found: Vec<Found> = draws().par_iter().map(Draw::examine).collect();
    for found in &found {
        let Found { name, worst, .. } = found;
        assert_eq!(found.beyond, 0, "{name}: off by {worst} of what is stated");
        assert!(
            100 * found.missing <= found.pixels,
            "{name}: {} of {} pixels miss the target",
            found.missing,
            found.pixels
        );
    }
}

/// A limit on work goes with the pixels, and a film of 8 x 8 may take a finer one of a hundred thousand. Without a limit
/// of its own that took 136 million evaluations for this chart.
#[test]
fn a_finer_film_takes_no_more_work_than_an_image_may() {
    let mut random = ChaCha8Rng::seed_from_u64(20_261_202);
    let mut specification = Specification::preset();
    (specification.image.width, specification.image.height) = (8, 8);
    let checker = &mut specification.checker;
    (checker.columns, checker.rows, checker.pitch_m) = (24, 16, 0.05);
    let colour = |_| random.next_u32().to_le_bytes().first_chunk().copied();
    let colours = (0..24 * 16).map(colour).collect::<Option<_>>();
    checker.patches_srgb8 = colours.expect("four bytes");
    let material = Material {
        roughness: 0.1,
        anisotropy: 0.5,
        angle_deg: 40.0,
        ior: 2.0,
        rgb0: [0.8, 0.5, 0.3],
        rgb90: [0.9; 3],
    };
    let renderer = Renderer::new(&specification, BackendChoice::Native).expect("views");
    let rendering = renderer.render(&material, None, 5).expect("a rendering");
    let evaluations = rendering.statistics.evaluations;
    assert!(
        (100_000_000..130_000_000).contains(&evaluations),
        "{evaluations}"
    );
}

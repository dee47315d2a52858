//! The scenes and draws that tests share.

use dataset::{Material, Specification};
use inverse::{Encoding, Observation, ObservedView, Theta};
use rand_chacha::{
    ChaCha8Rng,
    rand_core::{Rng, SeedableRng},
};
use renderer::{Renderer, geometry::BackendChoice};
use std::str::FromStr;

/// The backend of every test.
pub const BACKEND: BackendChoice = BackendChoice::Native;

/// The preset with a square film and a relative accuracy; the absolute one is a tenth of it.
pub fn preset(side: u32, accuracy: f64) -> Specification {
    let mut specification = Specification::preset();
    (specification.image.width, specification.image.height) = (side, side);
    specification.accuracy.relative = accuracy;
    specification.accuracy.absolute = 0.1 * accuracy;
    specification
}

/// Linear images of `views` of a material.
pub fn films(renderer: &Renderer, material: &Material, views: &[u32]) -> Vec<Vec<[f64; 3]>> {
    let film = |&view: &u32| {
        let rendering = renderer.render(material, None, view).expect("a rendering");
        rendering
            .film
            .pixels
            .iter()
            .map(|pixel| pixel.value)
            .collect()
    };
    views.iter().map(film).collect()
}

/// A number that a long command sets.
pub fn from_environment<T: FromStr>(name: &str) -> T {
    let set = std::env::var(name).ok();
    let number = set.and_then(|text| text.parse().ok());
    number.unwrap_or_else(|| panic!("{name} is not what it is to be: tests/inverse.sh sets it"))
}

/// Draws by seed.
pub struct Draws(ChaCha8Rng);

impl Draws {
    pub fn new(seed: u64) -> Self {
        Self(ChaCha8Rng::seed_from_u64(seed))
    }

    /// Uniform in (0, 1).
    pub fn uniform(&mut self) -> f64 {
        ((self.0.next_u64() >> 11) as f64 + 0.5) / (1u64 << 53) as f64
    }

    /// Standard normal (Box and Muller 1958).
    pub fn normal(&mut self) -> f64 {
        let radius = (-2.0 * libm::log(self.uniform())).sqrt();
        radius * libm::cos(std::f64::consts::TAU * self.uniform())
    }
}

/// What a camera stores: codes of `encoding` with Gaussian noise, for sRGB clipped and rounded to 8
/// bits where `eight_bits`.
pub fn observe(
    specification: &Specification,
    films: &[Vec<[f64; 3]>],
    views: &[u32],
    encoding: Encoding,
    mut noise: impl FnMut(f64) -> f64,
) -> Observation {
    let observed = views.iter().zip(films).map(|(&view, film)| {
        let encode = |pixel: &[f64; 3]| pixel.map(|value| noise(encoding.value(value)));
        let pixels = film.iter().map(encode).collect();
        ObservedView::film(view, pixels)
    });
    Observation::new(specification, encoding, observed.collect()).expect("finite images")
}

/// A code with noise of this standard deviation in steps of 8 bits, rounded to 8 bits.
pub fn eight_bits(code: f64, sd: f64, draws: &mut Draws) -> f64 {
    let noisy = 255.0 * code + sd * draws.normal();
    noisy.round().clamp(0.0, 255.0) / 255.0
}

/// The material in the middle of all ranges.
pub fn median_material() -> Material {
    Theta([0.5; 10]).material()
}

/// A material with each parameter moved by up to `most` of its range.
pub fn perturbed(material: &Material, most: f64, draws: &mut Draws) -> Material {
    let mut theta = Theta::of(material);
    for value in &mut theta.0 {
        *value += most * (2.0 * draws.uniform() - 1.0);
    }
    theta.material()
}

/// The mean squared difference of sRGB codes, clipped at white, over all pixels of all images.
pub fn code_error(a: &[Vec<[f64; 3]>], b: &[Vec<[f64; 3]>]) -> f64 {
    let codes = |films: &[Vec<[f64; 3]>]| -> Vec<f64> {
        let channels = films.iter().flatten().flatten();
        channels.map(|&value| Encoding::Srgb.value(value)).collect()
    };
    let (a, b) = (codes(a), codes(b));
    let squares = a.iter().zip(&b).map(|(a, b)| (a - b) * (a - b));
    squares.sum::<f64>() / a.len() as f64
}

/// The middle one of some numbers.
pub fn median(numbers: &[f64]) -> f64 {
    let mut sorted = numbers.to_vec();
    sorted.sort_unstable_by(f64::total_cmp);
    sorted[sorted.len() / 2]
}

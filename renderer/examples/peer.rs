//! The work of `bench/python/measure.py`, in Rust alone: prints a JSON list with the seconds of
//! each round.
//!
//!   peer evaluate DIRECTIONS ROUNDS
//!   peer render ROUNDS

#![allow(clippy::print_stdout, reason = "the figures are what this is for")]

use dataset::{Material, Specification, specification::Tint};
use renderer::{Renderer, geometry::BackendChoice, query, reflectance::Reflectance};
use std::{env, error::Error, hint::black_box, time::Instant};

const MATERIAL: Material = Material {
    roughness: 12.0,
    anisotropy: 0.4,
    angle_deg: 30.0,
    ior: 1.6,
    rgb0: [0.8, 0.4, 0.2],
    rgb90: [1.0, 1.0, 1.0],
};

/// Materials of the preset that are rendered, from the first on.
const MATERIALS: u32 = 8;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = env::args().skip(1).collect();
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    let seconds = match arguments[..] {
        ["evaluate", directions, rounds] => evaluate(directions.parse()?, rounds.parse()?)?,
        ["render", rounds] => render(rounds.parse()?)?,
        _ => return Err("usage: peer evaluate DIRECTIONS ROUNDS | peer render ROUNDS".into()),
    };
    println!("{seconds:?}");
    Ok(())
}

/// Directions over the hemisphere, by the golden ratio.
fn directions(count: usize, phase: f64) -> Vec<[f64; 3]> {
    let place = |index: usize| {
        let z = (index as f64 + 0.5) / count as f64;
        let angle = phase + index as f64 * 2.399_963_229_728_653;
        let radius = (1.0 - z * z).sqrt();
        let (sin, cos) = libm::sincos(angle);
        [radius * cos, radius * sin, z]
    };
    (0..count).map(place).collect()
}

fn evaluate(count: usize, rounds: usize) -> Result<Vec<f64>, Box<dyn Error>> {
    let reflectance = Reflectance::new(&MATERIAL, 0.0, Tint::Hue);
    let (wi, wo) = (directions(count, 0.0), directions(count, 1.0));
    let mut seconds = Vec::new();
    for _ in 0..rounds {
        let began = Instant::now();
        let mut values = Vec::with_capacity(3 * count);
        for (wi, wo) in wi.iter().zip(&wo) {
            let (wi, wo) = (query::direction("wi", *wi)?, query::direction("wo", *wo)?);
            values.extend(reflectance.evaluate(wi, wo));
        }
        black_box(values);
        seconds.push(began.elapsed().as_secs_f64());
    }
    Ok(seconds)
}

fn render(rounds: usize) -> Result<Vec<f64>, Box<dyn Error>> {
    let specification = Specification::preset();
    let renderer = Renderer::new(&specification, BackendChoice::Auto)?;
    let mut seconds = Vec::new();
    for _ in 0..rounds {
        let began = Instant::now();
        for index in 0..MATERIALS {
            let material = specification.material(index).material;
            black_box(renderer.render(&material, Some(index), 5)?);
        }
        seconds.push(began.elapsed().as_secs_f64());
    }
    Ok(seconds)
}

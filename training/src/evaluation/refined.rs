//! Refining: the renderer itself decides, by least squares on the pixels of both photographs.
//!
//! It sees the whole films, as a camera that stands where the specification says it does would; the
//! networks see the rectified sample alone.

use super::Estimates;
use super::rerender::small;
use crate::data::Pairs;
use crate::error::TrainingError;
use crate::estimation::fitting::RENDERINGS_MAX;
use crate::keystream::{Purpose, keystream};
use crate::pixels::noise::{CODE_STEPS, NOISE_CODES_MAX};
use dataset::{Material, Specification};
use inverse::{Encoding, Nuisances, Observation, ObservedView, Refiner, Settings};
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;
use renderer::Renderer;
use renderer::geometry::BackendChoice;
use std::sync::atomic::{AtomicU64, Ordering};

/// What the photographs are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Film {
    /// sRGB codes in full precision.
    Exact,
    /// 8-bit sRGB codes with Gaussian noise of a standard deviation of four steps.
    Noisy,
    /// 8-bit sRGB codes with noise of two steps; cameras and light stand a degree lower than the fit
    /// is told, and the light 5 percent further away.
    Off {
        /// Whether the fit looks for that too.
        fitted: bool,
    },
}

/// What [`Film::Off`] is off by.
const OFF_DEG: f64 = 1.0;
const OFF_DISTANCE: f64 = 1.05;

/// How well light and cameras are known to a fit that looks for them: standard deviations.
const NUISANCES: Nuisances = Nuisances {
    light_elevation_deg: Some(OFF_DEG),
    light_distance: Some(OFF_DISTANCE - 1.0),
    camera_elevation_deg: Some(OFF_DEG),
    gain: None,
};

impl Film {
    /// The estimator's name.
    fn name(self) -> &'static str {
        match self {
            Self::Exact => "refine",
            Self::Noisy => "refine-noisy",
            Self::Off { fitted: false } => "refine-off",
            Self::Off { fitted: true } => "refine-off-fitted",
        }
    }

    /// The standard deviation of the noise in steps of a code; `None` for exact pixels.
    fn noise(self) -> Option<f64> {
        match self {
            Self::Exact => None,
            Self::Noisy => Some(f64::from(NOISE_CODES_MAX)),
            Self::Off { .. } => Some(0.5 * f64::from(NOISE_CODES_MAX)),
        }
    }

    /// The scene that the photographs show.
    fn scene(self, specification: &Specification) -> Specification {
        let mut scene = specification.clone();
        if let Self::Off { .. } = self {
            scene.light.distance_m *= OFF_DISTANCE;
            for view in &mut scene.views {
                view.camera_elevation_deg -= OFF_DEG;
                view.light_elevation_deg -= OFF_DEG;
            }
        }
        scene
    }

    fn settings(self) -> Settings {
        match self {
            Self::Off { fitted: true } => Settings {
                nuisances: NUISANCES,
                renderings_max: RENDERINGS_MAX,
                ..Settings::default()
            },
            _ => Settings::default(),
        }
    }
}

/// Refines every material from each of its starts, and keeps the best. `starts` has one row a
/// material, in the order of `positions`.
///
/// # Errors
/// When a rendering fails.
pub fn refine(
    pairs: &Pairs,
    positions: &[usize],
    starts: &[Vec<Material>],
    film: Film,
    tell: &(dyn Fn(u64) + Sync),
) -> Result<Estimates, TrainingError> {
    let specification = small(&pairs.specification);
    let failed = |error: &dyn std::fmt::Display| TrainingError::Render(error.to_string());
    let backend = BackendChoice::Native;
    let scene = film.scene(&specification);
    let renderer = Renderer::new(&scene, backend).map_err(|error| failed(&error))?;
    let refiner =
        Refiner::new(&specification, backend, film.settings()).map_err(|error| failed(&error))?;
    let done = AtomicU64::new(0);
    let materials = positions
        .par_iter()
        .zip(starts)
        .map(|(&position, starts)| {
            let label = &pairs.labels[position];
            let views = pairs.identity.views.map(|view| {
                let rendering = renderer.render(&label.material, None, view);
                let film_of = rendering.map_err(|error| failed(&error))?.film;
                let values = film_of.pixels.iter().map(|pixel| pixel.value);
                let stream = u64::from(label.index) << 8 | u64::from(view);
                let codes = photograph(values, film, stream);
                Ok::<_, TrainingError>(ObservedView::film(view, codes))
            });
            let [oblique, above] = views;
            let observation = observe(&specification, vec![oblique?, above?])?;
            let found = refiner
                .refine(&observation, starts)
                .map_err(|error| failed(&error))?;
            tell(done.fetch_add(1, Ordering::Relaxed) + 1);
            let best = found.first().map(|refined| refined.material);
            best.ok_or_else(|| TrainingError::Input("a refinement has no start".to_owned()))
        })
        .collect::<Result<Vec<Material>, TrainingError>>()?;
    Ok(Estimates {
        name: film.name().to_owned(),
        materials,
    })
}

fn observe(
    specification: &Specification,
    views: Vec<ObservedView>,
) -> Result<Observation, TrainingError> {
    Observation::new(specification, Encoding::Srgb, views)
        .map_err(|error| TrainingError::Render(error.to_string()))
}

/// The codes of a photograph.
fn photograph(values: impl Iterator<Item = [f64; 3]>, film: Film, stream: u64) -> Vec<[f64; 3]> {
    let mut rng = keystream(0, Purpose::Photograph, stream);
    let steps = f64::from(CODE_STEPS);
    let code = |value: f64| {
        let code = Encoding::Srgb.value(value);
        let Some(noise_sd) = film.noise() else {
            return code;
        };
        let noise: f64 = StandardNormal.sample(&mut rng);
        let noisy = code * steps + noise_sd * noise;
        noisy.round().clamp(0.0, steps) / steps
    };
    let channels: Vec<f64> = values.flatten().map(code).collect();
    channels
        .chunks_exact(3)
        .map(|pixel| [pixel[0], pixel[1], pixel[2]])
        .collect()
}

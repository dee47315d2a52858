//! The renderer decides: a reading refined by least squares on the pixels of both photographs.

use super::exposure::Gain;
use super::sample::Shot;
use crate::error::TrainingError;
use crate::evaluation::rerender::small;
use dataset::specification::Tint;
use dataset::{Material, Specification};
use inverse::gauge::{Covariance, scaled, scaled_covariance};
use inverse::{
    Encoding, InverseError, Nuisances, Observation, PARAMETERS, Refined, Refiner, Settings, Theta,
};
use rayon::prelude::*;
use renderer::geometry::BackendChoice;

/// How well light, cameras and exposure are known: standard deviations. The light's distance is not
/// fitted: chart or gain tell how bright the scene is, whatever makes it so.
pub const NUISANCES: Nuisances = Nuisances {
    light_elevation_deg: Some(1.0),
    light_distance: None,
    camera_elevation_deg: Some(1.0),
    gain: Some(0.01),
};

/// What rounding to 8 bits leaves of a code. It does not average out where the light is even.
const ROUNDING_SD: f64 = 0.29 / 255.0;

/// The most images rendered from one start: light and cameras make for more and longer valleys than a
/// material alone.
pub(crate) const RENDERINGS_MAX: u32 = 1000;

/// Fits whose costs differ by less than this many variances of the noise explain the photographs
/// equally well.
const AS_GOOD: f64 = 9.0;

/// Fits go on whose cost is up to this many times the best's.
const PROMISING: f64 = 2.0;

/// Standard deviations on either side of an interval that holds 95 percent.
const DEVIATIONS_95: f64 = 1.96;

/// What a refinement found.
#[derive(Clone, Debug, PartialEq)]
pub struct Refinement {
    /// The fit.
    pub fit: Refined,
    /// The material, with the largest channel of both colours 1 where only their hue shows
    /// ([`inverse::gauge`]).
    pub material: Material,
    /// What other fits found that explain the photographs as well; often the same again.
    pub others: Vec<Material>,
    /// The lower and upper end of each parameter over its range, as in [`Theta`]: 95 percent of a
    /// normal distribution, cut off at the ends of the range, and all of it where the photographs
    /// show nothing of the parameter. An angle's may reach beyond 0 and 1, by half a turn at most.
    pub intervals: [[f64; 2]; PARAMETERS],
}

/// Where fits may begin.
#[derive(Clone, Debug)]
pub(super) struct Candidates {
    /// Fits begin here in any case.
    pub certain: Vec<Material>,
    /// And at those of these whose renderings are nearest to the photographs.
    pub drawn: Vec<Material>,
}

/// Fits that begin at drawn materials.
const DRAWN_STARTS: usize = 2;

fn starts(
    refiner: &Refiner,
    observation: &Observation,
    candidates: &Candidates,
) -> Result<Vec<Material>, InverseError> {
    let drawn = candidates.drawn.par_iter().map(|material| {
        let error = refiner.mean_square(observation, material)?;
        Ok((error, *material))
    });
    let mut drawn = drawn.collect::<Result<Vec<_>, InverseError>>()?;
    drawn.sort_by(|(one, _), (other, _)| one.total_cmp(other));
    let nearest = drawn.into_iter().take(DRAWN_STARTS);
    let mut starts = candidates.certain.clone();
    starts.extend(nearest.map(|(_, material)| material));
    Ok(starts)
}

/// Fits a material, and with it light, cameras and exposure within what `nuisances` says, to two
/// photographs of views of a specification.
pub(super) fn fit(
    specification: &Specification,
    views: [u32; 2],
    shots: &[Shot; 2],
    gains: [Gain; 2],
    candidates: &Candidates,
    nuisances: Nuisances,
) -> Result<Refinement, TrainingError> {
    let failed = |error: &dyn std::fmt::Display| TrainingError::Render(error.to_string());
    let specification = small(specification);
    let mut observed = Vec::new();
    for ((shot, view), gain) in shots.iter().zip(views).zip(gains) {
        observed.push(shot.on_film(&specification, view, gain)?);
    }
    let observation = Observation::new(&specification, Encoding::Srgb, observed)
        .map_err(|error| failed(&error))?;
    let first = Settings {
        nuisances,
        noise_sd: ROUNDING_SD,
        noise_least_sd: ROUNDING_SD,
        ..Settings::default()
    };
    let second = Settings {
        renderings_max: RENDERINGS_MAX,
        covariance: true,
        ..first
    };
    let refiner = |settings| Refiner::new(&specification, BackendChoice::Native, settings);
    let found = refiner(first).and_then(|refiner| {
        let starts = starts(&refiner, &observation, candidates)?;
        from_all(&refiner, &observation, &starts)
    });
    let promising = found.map(|found| promising(&found));
    let found = promising.and_then(|starts| from_all(&refiner(second)?, &observation, &starts));
    Ok(decide(
        found.map_err(|error| failed(&error))?,
        specification.tint,
    ))
}

/// Fits from every start, the best first.
fn from_all(
    refiner: &Refiner,
    observation: &Observation,
    starts: &[Material],
) -> Result<Vec<Refined>, InverseError> {
    let found = starts
        .par_iter()
        .map(|start| refiner.refine_from(observation, start));
    let mut found = found.collect::<Result<Vec<_>, InverseError>>()?;
    found.sort_by(|one, other| one.cost.total_cmp(&other.cost));
    Ok(found)
}

/// What the best fit found, and another one that may yet become as good.
fn promising(found: &[Refined]) -> Vec<Material> {
    let least = found.first().map_or(0.0, |best| best.cost);
    let promising = found.iter().filter(|fit| fit.cost <= PROMISING * least);
    promising.take(2).map(|fit| fit.material).collect()
}

/// The best fit, with intervals that reach over every other one that explains the photographs as
/// well.
fn decide(found: Vec<Refined>, tint: Tint) -> Refinement {
    let of_fit = |fit: &Refined| {
        let theta = scaled(&fit.theta, tint);
        let covariance = fit
            .covariance
            .map(|covariance| scaled_covariance(&fit.theta, &covariance, tint));
        (theta, intervals(&theta, covariance.as_ref()))
    };
    let mut found = found.into_iter();
    let Some(fit) = found.next() else {
        unreachable!("there is a start");
    };
    let (theta, mut hull) = of_fit(&fit);
    let noise_sd = fit.residual_sd.max(ROUNDING_SD);
    let as_good = fit.cost + AS_GOOD * noise_sd * noise_sd;
    let mut others = Vec::new();
    for other in found.filter(|other| other.cost <= as_good) {
        others.push(other.material);
        let (other, intervals) = of_fit(&other);
        let to_best = theta.difference(&other);
        for (parameter, (ends, others)) in hull.iter_mut().zip(intervals).enumerate() {
            // The angle goes round: the other's interval is moved to where the best fit lies nearest.
            let turn = theta.0[parameter] - to_best[parameter] - other.0[parameter];
            ends[0] = ends[0].min(others[0] + turn);
            ends[1] = ends[1].max(others[1] + turn);
        }
    }
    Refinement {
        material: theta.material(),
        intervals: hull,
        fit,
        others,
    }
}

fn intervals(theta: &Theta, covariance: Option<&Covariance>) -> [[f64; 2]; PARAMETERS] {
    std::array::from_fn(|parameter| {
        let at = theta.0[parameter];
        let variance = covariance.map_or(f64::INFINITY, |all| all[(parameter, parameter)]);
        let reach = DEVIATIONS_95 * variance.max(0.0).sqrt();
        match parameter {
            inverse::parameters::ANGLE => [at - reach.min(0.5), at + reach.min(0.5)],
            _ => [(at - reach).max(0.0), (at + reach).min(1.0)],
        }
    })
}

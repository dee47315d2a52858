//! Estimating one material from two photographs.
//!
//! | module | what |
//! | --- | --- |
//! | [`photograph`] | a photograph as linear light |
//! | [`corners`] | four corners in it, and the maps that they define |
//! | [`exposure`] | the gain of each channel, from a colour chart |
//! | [`sample`] | the sample in it, as a network and as the renderer sees it |
//! | [`fitting`] | the reading refined by the renderer |
//! | `preview` | a picture to look at |

pub mod corners;
pub mod exposure;
pub mod fitting;
pub mod photograph;
mod preview;
pub mod sample;

use crate::error::TrainingError;
use crate::keystream::{Purpose, keystream};
use crate::labels::PARAMETERS;
use crate::labels::interval::interval;
use crate::labels::reading::Reading;
use crate::model::{Distributions, Model};
use burn::tensor::Device;
use dataset::specification::IntegratorKind;
use dataset::{Material, Specification};
use exposure::{ChartView, Gain};
use fitting::{Candidates, Refinement, fit};
use inverse::{Nuisances, Theta};
use sample::{Shot, planes};

/// Materials that are drawn from what the model says: the renderer tells which of them to begin at.
const DRAWS: usize = 64;

/// The finest absolute accuracy of any rendering here, in units of white.
const ABSOLUTE_ACCURACY_MIN: f64 = 3e-5;

/// The share of a distribution that its interval holds.
const INTERVAL_SHARE: f64 = 0.95;

/// Readings, and refinements, after which gains hardly change: the sample's light on the chart is
/// small.
const ROUNDS: usize = 2;

/// A change of the gains, as a share of them, that calls for no other refinement.
const GAIN_CHANGE: f64 = 2e-3;

/// How bright photographs are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Exposure {
    /// The same known gain in both.
    Known(Gain),
    /// By the chart. A photograph without one was exposed like the other.
    Chart,
}

/// What is to be estimated, from what.
pub struct Task<'a> {
    /// The model that reads.
    pub model: &'a Model,
    /// The oblique photograph, and the one from above.
    pub shots: [Shot; 2],
    /// How bright they are.
    pub exposure: Exposure,
    /// How distributions become values.
    pub reading: Reading,
    /// Whether the renderer refines the reading, and what it fits beside the material.
    pub refine: Option<Nuisances>,
}

/// What was found.
#[derive(Clone, Debug, PartialEq)]
pub struct Estimate {
    /// The material: the refined one, or the reading.
    pub material: Material,
    /// The gains of the photographs.
    pub gains: [Gain; 2],
    /// What the model said.
    pub distributions: Distributions,
    /// The labels that it was read as, in their units.
    pub values: [f64; PARAMETERS],
    /// Of each label the interval that holds 95 percent of the distribution. Of the angle the lower
    /// end may be above the upper: the interval then goes through 0.
    pub intervals: [[f64; 2]; PARAMETERS],
    /// What the renderer found.
    pub refinement: Option<Refinement>,
    /// A picture of photographs and renderings, PNG.
    pub preview: Vec<u8>,
}

/// Estimates a material.
///
/// # Errors
/// When a sample leaves its photograph, is too small or white; when no chart tells the exposure; or
/// when network or renderer fail.
pub fn estimate(task: &Task<'_>, device: &Device) -> Result<Estimate, TrainingError> {
    const NAMES: [&str; 2] = ["the oblique photograph", "the photograph from above"];
    for (shot, name) in task.shots.iter().zip(NAMES) {
        shot.check().map_err(|error| of(name, error))?;
    }
    let mut specification = task.model.options.scene()?;
    // Fits need images without a sampler's noise, and a model file may ask for any number of paths.
    specification.integrator.kind = IntegratorKind::Hybrid;
    let absolute = &mut specification.accuracy.absolute;
    *absolute = absolute.max(ABSOLUTE_ACCURACY_MIN);
    let views = task.model.options.identity.views;
    let charts = charts(task, &specification, views)?;
    let reader = task.model.reader(task.reading);
    let mut material = Theta([0.5; PARAMETERS]).material();
    let mut round = 0;
    let (gains, distributions) = loop {
        let gains = gains(task, &charts, &material)?;
        let distributions = read(task, gains, device)?;
        material = task.model.material(&distributions, &reader);
        round += 1;
        if round == ROUNDS || matches!(task.exposure, Exposure::Known(_)) {
            break (gains, distributions);
        }
    };
    let scene = Scene {
        specification,
        views,
        charts,
    };
    let (gains, refinement) = match task.refine {
        None => (gains, None),
        Some(nuisances) => {
            let mut rng = keystream(0, Purpose::Draws, 0);
            let drawn = (0..DRAWS).map(|_| task.model.draw(&distributions, &mut rng));
            let candidates = Candidates {
                certain: vec![material, Theta([0.5; PARAMETERS]).material()],
                drawn: drawn.collect(),
            };
            let (gains, found) = refine(task, &scene, gains, candidates, nuisances)?;
            (gains, Some(found))
        }
    };
    let material = refinement.as_ref().map_or(material, |found| found.material);
    let axes = task.model.options.training.colours.axes();
    Ok(Estimate {
        material,
        gains,
        values: task.model.values(&distributions, &reader),
        intervals: std::array::from_fn(|parameter| {
            let axis = &axes[parameter];
            let ends = interval(&distributions[parameter], axis.circular, INTERVAL_SHARE);
            ends.map(|end| axis.value(end))
        }),
        distributions,
        refinement,
        preview: preview::picture(&scene.specification, views, &task.shots, gains, &material)?,
    })
}

/// What a model's photographs show.
struct Scene {
    specification: Specification,
    views: [u32; 2],
    charts: [Option<ChartView>; 2],
}

/// Lets the renderer decide. What it finds lights the chart, so the gains follow, and are fitted to
/// again where they changed.
fn refine(
    task: &Task<'_>,
    scene: &Scene,
    mut gains: [Gain; 2],
    mut candidates: Candidates,
    nuisances: Nuisances,
) -> Result<([Gain; 2], Refinement), TrainingError> {
    let mut round = 0;
    loop {
        let Scene {
            specification,
            views,
            charts,
        } = scene;
        let found = fit(
            specification,
            *views,
            &task.shots,
            gains,
            &candidates,
            nuisances,
        )?;
        let material = found.fit.material;
        round += 1;
        let next = self::gains(task, charts, &material)?;
        let ratios = gains.iter().flatten().zip(next.iter().flatten());
        let change = ratios
            .map(|(old, new)| (new / old - 1.0).abs())
            .fold(0.0, f64::max);
        if round == ROUNDS || change < GAIN_CHANGE {
            return Ok((gains, found));
        }
        gains = next;
        candidates = Candidates {
            certain: found.others,
            drawn: Vec::new(),
        };
        candidates.certain.push(material);
    }
}

fn of(name: &str, error: TrainingError) -> TrainingError {
    match error {
        TrainingError::Input(reason) => TrainingError::Input(format!("{name}: {reason}")),
        other => other,
    }
}

/// The charts of the photographs that show one.
fn charts(
    task: &Task<'_>,
    specification: &Specification,
    views: [u32; 2],
) -> Result<[Option<ChartView>; 2], TrainingError> {
    let mut charts = [None, None];
    for ((chart, shot), view) in charts.iter_mut().zip(&task.shots).zip(views) {
        if task.exposure == Exposure::Chart && shot.chart.is_some() {
            let found = ChartView::new(specification, view)?;
            *chart = Some(found.ok_or_else(|| {
                TrainingError::Input(format!(
                    "the camera of view {view} sees no whole chart in the scene that the model was \
                     trained on: give the gain"
                ))
            })?);
        }
    }
    Ok(charts)
}

/// The gains of both photographs, of a sample of `material`.
fn gains(
    task: &Task<'_>,
    charts: &[Option<ChartView>; 2],
    material: &Material,
) -> Result<[Gain; 2], TrainingError> {
    if let Exposure::Known(gain) = task.exposure {
        return Ok([gain; 2]);
    }
    let mut found = [None, None];
    for ((gain, shot), view) in found.iter_mut().zip(&task.shots).zip(charts) {
        if let (Some(view), Some(corners)) = (view, &shot.chart) {
            *gain = Some(view.gain(material, &shot.photograph, corners)?);
        }
    }
    match found {
        [Some(one), Some(other)] => Ok([one, other]),
        [Some(gain), None] | [None, Some(gain)] => Ok([gain; 2]),
        [None, None] => Err(TrainingError::Input(
            "nothing tells the exposure: give the corners of the chart in a photograph, or the gain"
                .to_owned(),
        )),
    }
}

/// What the model says of the photographs at these gains.
fn read(
    task: &Task<'_>,
    gains: [Gain; 2],
    device: &Device,
) -> Result<Distributions, TrainingError> {
    let side = task.model.options.identity.side;
    let [oblique, above] = &task.shots;
    let squares = [
        oblique.square(side, gains[0])?,
        above.square(side, gains[1])?,
    ];
    task.model.read_pair(&planes(&squares), device)
}

//! The targets of all materials.

use super::options::{LossWeights, Options};
use crate::data::{Identity, Label, Pairs};
use crate::error::TrainingError;
use crate::labels::axes::Axis;
use crate::labels::metric::metric;
use crate::labels::observable::weights;
use crate::labels::target::entropy;
use crate::labels::{BINS, PARAMETERS};
use export::observability::{Observed, ObservedMaterial};

/// Targets and their entropies, by the position of a material.
pub struct Targets {
    // Position x parameter x bin.
    values: Vec<f32>,
    entropies: Vec<[f64; PARAMETERS]>,
    weights: Vec<[f32; PARAMETERS]>,
    // Where labels lie, in bins.
    places: Vec<[f64; PARAMETERS]>,
    circular: [bool; PARAMETERS],
    // Empty without a metric loss.
    metrics: Vec<[f32; PARAMETERS * PARAMETERS]>,
}

impl Targets {
    /// Of all pairs. Losses count the same in every material, or as much as its photographs show.
    ///
    /// # Errors
    /// When what photographs show is wanted and not given, is of another dataset, or leaves a material
    /// out.
    pub fn new(
        pairs: &Pairs,
        options: &Options,
        observed: Option<&Observed>,
    ) -> Result<Self, TrainingError> {
        let axes = options.colours.axes();
        let mut values = Vec::with_capacity(pairs.labels.len() * PARAMETERS * BINS);
        let mut entropies = Vec::with_capacity(pairs.labels.len());
        let mut places = Vec::with_capacity(pairs.labels.len());
        for label in &pairs.labels {
            let numbers = options.colours.values(&label.material);
            let mut floors = [0.0; PARAMETERS];
            for (parameter, axis) in axes.iter().enumerate() {
                let centre = centre(axis, numbers[parameter], options.continuous);
                let target = options.smoothing.target(centre, axis.circular);
                floors[parameter] = entropy(&target);
                values.extend(target.map(|weight| weight as f32));
            }
            entropies.push(floors);
            places.push(std::array::from_fn(|p| axes[p].position(numbers[p])));
        }
        let colours = options.colours;
        let weights = match options.weights {
            LossWeights::Paper => vec![[1.0; PARAMETERS]; pairs.labels.len()],
            LossWeights::Observable { .. } => each_observed(pairs, observed, |label, found| {
                let tint = pairs.specification.tint;
                weights(&found.information, &label.material, tint, colours)
                    .map(|weight| weight as f32)
            })?,
        };
        let metrics = match options.metric {
            None => Vec::new(),
            Some(_) => each_observed(pairs, observed, |label, found| {
                metric(&found.information, &label.material, colours).map(|entry| entry as f32)
            })?,
        };
        // A table may hold any finite number.
        if !metrics.as_flattened().iter().all(|entry| entry.is_finite()) {
            return Err(TrainingError::Input(
                "the table of observability has information that 32 bits do not hold".to_owned(),
            ));
        }
        Ok(Self {
            values,
            entropies,
            weights,
            places,
            circular: axes.map(|axis| axis.circular),
            metrics,
        })
    }

    /// How far the middle of each bin lies from the label, as a share of the range, for parameters of
    /// materials, one behind the other.
    pub fn offsets(&self, positions: &[usize], parameters: &[usize]) -> Vec<f32> {
        let mut offsets = Vec::with_capacity(positions.len() * parameters.len() * BINS);
        for &position in positions {
            for &parameter in parameters {
                let place = self.places[position][parameter];
                let offset = |bin: usize| (bin as f64 - place) / BINS as f64;
                offsets.extend((0..BINS).map(|bin| match self.circular[parameter] {
                    // The shorter way round.
                    true => (offset(bin) - libm::round(offset(bin))) as f32,
                    false => offset(bin) as f32,
                }));
            }
        }
        offsets
    }

    /// How much the photographs of materials change with some of the parameters while the others are
    /// true: a matrix for each, one behind the other.
    pub fn metrics(&self, positions: &[usize], parameters: &[usize]) -> Vec<f32> {
        let mut metrics = Vec::with_capacity(positions.len() * parameters.len().pow(2));
        for &position in positions {
            for row in parameters {
                let entries = parameters.iter().map(|column| row * PARAMETERS + column);
                metrics.extend(entries.map(|at| self.metrics[position][at]));
            }
        }
        metrics
    }

    /// How much the loss of a parameter of a material counts, 0.001 to 1.
    pub fn weight(&self, position: usize, parameter: usize) -> f32 {
        self.weights[position][parameter]
    }

    /// The target of one parameter: 100 probabilities.
    pub fn target(&self, position: usize, parameter: usize) -> &[f32] {
        &self.values[(position * PARAMETERS + parameter) * BINS..][..BINS]
    }

    /// The targets of parameters of materials, one behind the other.
    pub fn rows(&self, positions: &[usize], parameters: &[usize]) -> Vec<f32> {
        let pairs = positions
            .iter()
            .flat_map(|&position| parameters.iter().map(move |&p| (position, p)));
        pairs
            .flat_map(|(position, parameter)| self.target(position, parameter))
            .copied()
            .collect()
    }

    /// The least loss of a parameter of a material, in nats.
    pub fn entropy(&self, position: usize, parameter: usize) -> f64 {
        self.entropies[position][parameter]
    }
}

/// What follows from what photographs show of each material, by its position.
fn each_observed<T>(
    pairs: &Pairs,
    observed: Option<&Observed>,
    of: impl Fn(&Label, &ObservedMaterial) -> T,
) -> Result<Vec<T>, TrainingError> {
    let observed = observed.ok_or_else(|| {
        TrainingError::Input(
            "the options want a table of observability, and there is none".to_owned(),
        )
    })?;
    let Identity {
        specification,
        renderer_version,
        ..
    } = &pairs.identity;
    if observed.specification != *specification || observed.renderer_version != *renderer_version {
        return Err(TrainingError::Input(
            "the table of observability is of another specification or renderer than the pairs"
                .to_owned(),
        ));
    }
    let each = pairs.labels.iter().map(|label| {
        let found = observed.materials.get(&label.index);
        let found = found.ok_or_else(|| {
            let index = label.index;
            TrainingError::Input(format!("the table of observability lacks material {index}"))
        })?;
        Ok(of(label, found))
    });
    each.collect()
}

/// Where a label's target is centred, in bins.
pub fn centre(axis: &Axis, value: f64, continuous: bool) -> f64 {
    if continuous {
        axis.position(value)
    } else {
        f64::from(axis.bin(value))
    }
}

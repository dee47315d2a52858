//! The targets of all materials.

use super::options::Options;
use crate::data::{Identity, Pairs};
use crate::error::TrainingError;
use crate::labels::axes::Axis;
use crate::labels::observable::weights;
use crate::labels::target::entropy;
use crate::labels::{BINS, PARAMETERS};
use export::observability::Observed;

/// Targets and their entropies, by the position of a material.
pub struct Targets {
    // Position x parameter x bin.
    values: Vec<f32>,
    entropies: Vec<[f64; PARAMETERS]>,
    weights: Vec<[f32; PARAMETERS]>,
}

impl Targets {
    /// Of all pairs. Losses count the same in every material, or as much as its photographs show.
    ///
    /// # Errors
    /// When what photographs show is of another dataset, or leaves a material out.
    pub fn new(
        pairs: &Pairs,
        options: &Options,
        observed: Option<&Observed>,
    ) -> Result<Self, TrainingError> {
        let axes = options.colours.axes();
        let mut values = Vec::with_capacity(pairs.labels.len() * PARAMETERS * BINS);
        let mut entropies = Vec::with_capacity(pairs.labels.len());
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
        }
        let weights = match observed {
            None => vec![[1.0; PARAMETERS]; pairs.labels.len()],
            Some(observed) => observable_weights(pairs, options, observed)?,
        };
        Ok(Self {
            values,
            entropies,
            weights,
        })
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

/// How much each loss counts, by the position of a material.
fn observable_weights(
    pairs: &Pairs,
    options: &Options,
    observed: &Observed,
) -> Result<Vec<[f32; PARAMETERS]>, TrainingError> {
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
    let weights = pairs.labels.iter().map(|label| {
        let found = observed.materials.get(&label.index);
        let found = found.ok_or_else(|| {
            let index = label.index;
            TrainingError::Input(format!("the table of observability lacks material {index}"))
        })?;
        let (tint, colours) = (pairs.specification.tint, options.colours);
        let weights = weights(&found.information, &label.material, tint, colours);
        Ok(weights.map(|weight| weight as f32))
    });
    weights.collect()
}

/// Where a label's target is centred, in bins.
pub fn centre(axis: &Axis, value: f64, continuous: bool) -> f64 {
    if continuous {
        axis.position(value)
    } else {
        f64::from(axis.bin(value))
    }
}

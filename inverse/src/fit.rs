//! One fit: steps of damped least squares from a start.
//!
//! A start takes the derivatives by differences once. After each accepted step Broyden's update
//! corrects them without a rendering. They are taken anew where a step did less than they promised.

use crate::error::InverseError;
use crate::least_squares::{Quadratic, Region, broyden};
use crate::model::{Evaluation, Model};
use crate::parameters::{PARAMETERS, Theta};
use crate::settings::{MEAN_SQUARE_LEAST, Settings, Stop};
use nalgebra::{DMatrix, DVector};

/// The damping of the first step, as a share of the normal matrix's diagonal.
const DAMPING_FIRST: f64 = 1e-2;

/// Damping below which the step no longer changes.
const DAMPING_LEAST: f64 = 1e-9;

/// Damping above which no step is left.
const DAMPING_MOST: f64 = 1e6;

/// The fit ends when a step promises to lower the cost by less than this share of one channel's, or of
/// the least noise's.
/// Such a step moves no parameter by more than a tenth of its standard deviation.
const PROMISE_LEAST: f64 = 0.01;

/// Derivatives are taken anew after a step that did less than this share of what they promised.
const KEPT_PROMISE: f64 = 0.5;

/// Derivatives are taken anew once this many steps were refused. Damping alone mends most refusals,
/// and costs a tenth.
const REFUSED_MAX: u32 = 2;

/// The largest step of a nuisance parameter, in standard deviations of its prior.
const NUISANCE_STEP_MAX_SD: f64 = 1.0;

/// A fit under way.
pub(crate) struct Fit<'a> {
    pub model: Model<'a>,
    settings: &'a Settings,
    pub state: Evaluation,
    pub jacobian: DMatrix<f64>,
    /// Whether the Jacobian was taken at the state.
    fresh: bool,
    /// Steps refused since the last accepted one or the last Jacobian.
    refused: u32,
    damping: f64,
    bounds: Vec<[f64; 2]>,
    step_max: Vec<f64>,
}

impl<'a> Fit<'a> {
    /// Renders the start and differentiates there.
    pub fn start(
        mut model: Model<'a>,
        settings: &'a Settings,
        start: &Theta,
    ) -> Result<Self, InverseError> {
        let needed = model.renderings_of_jacobian() + model.views.len() as u32;
        let renderings_max = settings.renderings_max;
        if renderings_max < needed {
            return Err(InverseError::TooFewRenderings {
                renderings_max,
                needed,
            });
        }
        let mut variables = vec![0.0; model.variables()];
        variables[..PARAMETERS].copy_from_slice(&start.0);
        let state = model.evaluate(variables)?;
        let jacobian = model.jacobian(&state, settings.difference)?;
        Ok(Self {
            bounds: (0..model.variables()).map(|v| model.bounds(v)).collect(),
            step_max: (0..model.variables())
                .map(|variable| match variable {
                    0..PARAMETERS => settings.step_max,
                    _ => NUISANCE_STEP_MAX_SD,
                })
                .collect(),
            model,
            settings,
            state,
            jacobian,
            fresh: true,
            refused: 0,
            damping: DAMPING_FIRST,
        })
    }

    /// Steps until a rule stops it.
    pub fn run(&mut self) -> Result<Stop, InverseError> {
        loop {
            let channels = self.model.observation.channels() as f64;
            let cost = self.cost(&self.state);
            if cost <= MEAN_SQUARE_LEAST * channels {
                return Ok(Stop::Converged);
            }
            let quadratic = self.quadratic();
            let step = quadratic.step(
                self.damping,
                &Region {
                    at: &self.state.variables,
                    bounds: &self.bounds,
                    step_max: &self.step_max,
                },
            );
            let promised = quadratic.reduction(&step);
            let least = self.settings.noise_least_sd * self.settings.noise_least_sd;
            if promised <= PROMISE_LEAST * (cost / channels).max(least) {
                if self.fresh {
                    return Ok(Stop::Converged);
                }
                if !self.differentiate()? {
                    return Ok(Stop::RenderingsSpent);
                }
                continue;
            }
            if !self.affords(self.model.views.len() as u32) {
                return Ok(Stop::RenderingsSpent);
            }
            let moved = self.state.variables.iter().zip(step.iter());
            let moved = moved.map(|(at, step)| at + step).collect();
            // A light or a camera that the specification does not admit is no better place.
            let trial = match self.model.evaluate(moved) {
                Err(InverseError::Specification(_)) => None,
                evaluated => Some(evaluated?),
            };
            let better = trial.filter(|trial| self.cost(trial) < cost);
            if let Some(trial) = better {
                let lowered = cost - self.cost(&trial);
                self.accept(trial, &step, lowered / promised)?;
            } else if !self.worn_out() || !self.differentiate()? {
                self.refused += 1;
                self.damping *= 5.0;
                if self.damping > DAMPING_MOST {
                    return Ok(Stop::Stuck);
                }
            }
        }
    }

    /// Goes to a better place. `kept` is how much of the promised reduction came about.
    fn accept(
        &mut self,
        trial: Evaluation,
        step: &DVector<f64>,
        kept: f64,
    ) -> Result<(), InverseError> {
        let change = &trial.residual - &self.state.residual;
        broyden(&mut self.jacobian, step, &change);
        self.state = trial;
        self.fresh = false;
        self.refused = 0;
        if kept > 0.75 {
            self.damping = (0.2 * self.damping).max(DAMPING_LEAST);
        } else if kept < 0.25 {
            self.damping *= 4.0;
        }
        if kept < KEPT_PROMISE {
            self.differentiate()?;
        }
        Ok(())
    }

    /// Takes the derivatives anew; false where the renderings do not allow it.
    fn differentiate(&mut self) -> Result<bool, InverseError> {
        let views = self.model.views.len() as u32;
        if !self.affords(self.model.renderings_of_jacobian() + views) {
            return Ok(false);
        }
        self.jacobian = self.model.jacobian(&self.state, self.settings.difference)?;
        self.fresh = true;
        self.refused = 0;
        Ok(true)
    }

    /// Whether old derivatives are to blame for steps that were refused.
    fn worn_out(&self) -> bool {
        !self.fresh && self.refused >= REFUSED_MAX
    }

    fn affords(&self, renderings: u32) -> bool {
        self.model.renderings + renderings <= self.settings.renderings_max
    }

    /// The model of the cost about the state, priors included.
    fn quadratic(&self) -> Quadratic {
        let mut quadratic = Quadratic::new(&self.jacobian, &self.state.residual);
        let variance = self.settings.noise_sd * self.settings.noise_sd;
        for variable in PARAMETERS..self.model.variables() {
            quadratic.normal[(variable, variable)] += variance;
            quadratic.gradient[variable] += variance * self.state.variables[variable];
        }
        quadratic
    }

    /// The residual's sum of squares and the priors' share.
    pub fn cost(&self, at: &Evaluation) -> f64 {
        let variance = self.settings.noise_sd * self.settings.noise_sd;
        let priors = at.variables[PARAMETERS..].iter().map(|z| z * z);
        at.residual.norm_squared() + variance * priors.sum::<f64>()
    }
}

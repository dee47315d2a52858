//! One fit: steps of damped least squares from a start.
//!
//! A start takes the derivatives by differences once. After each accepted step Broyden's update
//! corrects them without a rendering. They are taken anew where a step did less than they promised.
//!
//! Where noise remains, a fit ends by differences to both sides. Parameters that change images alike, such as the
//! roughness and the index of refraction of some materials, leave a direction along which images change a hundredth
//! as fast as along either. Along it differences to one side are off by as much as the change itself, and a fit by
//! them ends anywhere.

use crate::error::InverseError;
use crate::least_squares::{Quadratic, Region, broyden};
use crate::model::{Evaluation, Model, Sides};
use crate::parameters::{PARAMETERS, Theta};
use crate::settings::{MEAN_SQUARE_LEAST, Settings, Stop};
use nalgebra::{DMatrix, DVector};

/// The damping of the first step, as a share of the normal matrix's diagonal.
const DAMPING_FIRST: f64 = 1e-2;

/// Damping below which the step no longer changes.
const DAMPING_LEAST: f64 = 1e-9;

/// Damping above which no step is left.
const DAMPING_MOST: f64 = 1e6;

/// The least and the largest factor of the damping after an accepted step.
const DAMPING_CHANGE: [f64; 2] = [0.2, 4.0];

/// The fit ends when a step promises to lower the cost by less than this share of one channel's, or of
/// the least noise's.
/// Such a step, if it is not damped, moves no parameter by more than a tenth of its standard deviation.
const PROMISE_LEAST: f64 = 0.01;

/// So a fit ends by what a step of this damping promises. It also goes on with it after differences to both sides.
/// Damping that suits the first steps leaves nothing of a step along which images change slowly. Measured on
/// material 690 of the preset: fits that ended by the promise of a damped step spread 0.6 times as far as the
/// Cramer-Rao bound, for they ended where they had started.
const DAMPING_LAST: f64 = 1e-6;

/// Above this mean square of the residual noise remains: a quarter of what rounding to 8 bits leaves. Without noise
/// any derivatives lead to the same end.
const NOISE_FROM: f64 = 3e-7;

/// A fit is near its end where a step promises to lower the cost by less than this many times one channel's: there
/// differences to one side no longer serve. Chosen. Measured on twelve materials with noise of 1/255: 108 renderings
/// a fit, where fits that ended by differences to one side took 152 (on sixteen).
const NEAR_END: f64 = 3.0;

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
    /// By which differences it was taken, before Broyden's updates.
    sides: Sides,
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
        let needed = model.renderings_of_jacobian(Sides::One) + model.views.len() as u32;
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
        let jacobian = model.jacobian(&state, settings.difference, Sides::One)?;
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
            sides: Sides::One,
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
            let (step, promised) = self.step(&quadratic, self.damping);
            if promised <= self.promise_least() {
                if self.is_damped_away(&quadratic) {
                    self.damping *= DAMPING_CHANGE[0];
                } else if let Some(stop) = self.end()? {
                    return Ok(stop);
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
                self.accept(trial, &step, lowered / promised);
                if lowered < KEPT_PROMISE * promised && self.sides == Sides::One {
                    self.differentiate(self.wanted(promised))?;
                }
            } else if !self.worn_out(promised) || !self.differentiate(self.wanted(promised))? {
                self.refused += 1;
                self.damping *= 5.0;
                if self.damping > DAMPING_MOST {
                    return Ok(Stop::Stuck);
                }
            }
        }
    }

    /// A step of this damping, and by how much it promises to lower the cost.
    fn step(&self, quadratic: &Quadratic, damping: f64) -> (DVector<f64>, f64) {
        let inside = Region {
            at: &self.state.variables,
            bounds: &self.bounds,
            step_max: &self.step_max,
        };
        let step = quadratic.step(damping, &inside);
        let promised = quadratic.reduction(&step);
        (step, promised)
    }

    /// What a step has to promise to be worth a rendering.
    fn promise_least(&self) -> f64 {
        let least = self.settings.noise_least_sd * self.settings.noise_least_sd;
        PROMISE_LEAST * self.mean_square().max(least)
    }

    /// The cost of a channel.
    fn mean_square(&self) -> f64 {
        self.cost(&self.state) / self.model.observation.channels() as f64
    }

    /// Whether it is the damping alone that leaves nothing worth a step. Where steps were refused it is there for a
    /// reason.
    fn is_damped_away(&self, quadratic: &Quadratic) -> bool {
        let (_, promised) = self.step(quadratic, self.damping.min(DAMPING_LAST));
        self.refused == 0 && promised > self.promise_least()
    }

    /// Why the fit ends here; `None` where better derivatives may yet promise more.
    fn end(&mut self) -> Result<Option<Stop>, InverseError> {
        let (is_sure, sides) = match self.is_noisy() {
            true => (self.sides == Sides::Both, Sides::Both),
            false => (self.fresh, Sides::One),
        };
        if is_sure {
            return Ok(Some(Stop::Converged));
        }
        let affordable = self.differentiate(sides)?;
        Ok((!affordable).then_some(Stop::RenderingsSpent))
    }

    /// Goes to a better place. `kept` is how much of the promised reduction came about; it changes the damping
    /// (Nielsen 1999).
    fn accept(&mut self, trial: Evaluation, step: &DVector<f64>, kept: f64) {
        let change = &trial.residual - &self.state.residual;
        broyden(&mut self.jacobian, step, &change);
        self.state = trial;
        self.fresh = false;
        self.refused = 0;
        let off = 2.0 * kept - 1.0;
        let factor = (1.0 - off * off * off).clamp(DAMPING_CHANGE[0], DAMPING_CHANGE[1]);
        self.damping = (self.damping * factor).max(DAMPING_LEAST);
    }

    /// Takes the derivatives anew; false where the renderings do not allow it.
    fn differentiate(&mut self, sides: Sides) -> Result<bool, InverseError> {
        let views = self.model.views.len() as u32;
        if !self.affords(self.model.renderings_of_jacobian(sides) + views) {
            return Ok(false);
        }
        let difference = self.settings.difference;
        self.jacobian = self.model.jacobian(&self.state, difference, sides)?;
        (self.fresh, self.sides, self.refused) = (true, sides, 0);
        if sides == Sides::Both {
            // Damping that suited other derivatives would hide what these tell of slow directions.
            self.damping = self.damping.min(DAMPING_LAST);
        }
        Ok(true)
    }

    /// Whether the derivatives may be to blame for steps that were refused.
    fn worn_out(&self, promised: f64) -> bool {
        let is_best = self.fresh && self.wanted(promised) == self.sides;
        self.refused >= REFUSED_MAX && !is_best
    }

    /// By which differences derivatives are taken anew where a step promised so much.
    fn wanted(&self, promised: f64) -> Sides {
        let is_near_end = promised <= NEAR_END * self.mean_square();
        match self.is_noisy() && is_near_end {
            true => Sides::Both,
            false => self.sides,
        }
    }

    fn is_noisy(&self) -> bool {
        self.mean_square() > NOISE_FROM
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

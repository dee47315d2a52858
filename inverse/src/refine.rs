//! Levenberg and Marquardt's method over the renderer: the material whose images differ least from
//! observed ones. `fit.rs` holds the iteration.

use crate::derivatives::Differentiator;
use crate::error::{InverseError, check_positive};
use crate::fit::Fit;
use crate::gauge::Covariance;
use crate::information::Information;
use crate::model::{Model, theta};
use crate::nuisance::NuisanceValues;
use crate::observation::Observation;
use crate::parameters::{PARAMETERS, Theta};
use crate::settings::{Settings, Stop};
use dataset::specification::limits;
use dataset::{Material, Specification};
use nalgebra::DVector;
use renderer::{Renderer, geometry::BackendChoice};

/// The accuracy of the renderings for a covariance, over that of the fit's: what derivatives
/// are off by would else count as not observed. (At 3e-3, a third of it brought the deviation of a
/// material's roughness from 4.3 to 0.3 percent, a thirtieth changed it no more.)
const DEVIATIONS_ACCURACY: f64 = 0.3;

/// A material that was found from one start.
#[derive(Clone, Debug, PartialEq)]
pub struct Refined {
    /// The material.
    pub material: Material,
    /// Its parameters over their ranges.
    pub theta: Theta,
    /// Light, camera and exposure.
    pub nuisances: NuisanceValues,
    /// What was minimised: the residual's sum of squares, and of nuisance parameters the squared
    /// distance from their priors times the noise's variance.
    pub cost: f64,
    /// The mean square of the residual in encoded channels.
    pub mean_square: f64,
    /// The standard deviation of the residual in encoded channels: the noise, if the model is true.
    pub residual_sd: f64,
    /// The covariance of the parameters over their ranges at the solution, for noise of
    /// `residual_sd` and parameters that were uniform over their ranges before, nuisance parameters
    /// being unknown too: [`Information::posterior_covariance`]. Where what is left of neighbouring
    /// pixels is alike, as where the model is not quite true, there are fewer independent pixels than
    /// pixels, and the noise counts for more.
    pub covariance: Option<Covariance>,
    /// Images rendered, those for `covariance` not counted.
    pub renderings: u32,
    /// Why it ended.
    pub stop: Stop,
}

/// Finds materials from images under one specification, whose accuracy the renderings have.
#[derive(Debug)]
pub struct Refiner {
    specification: Specification,
    backend: BackendChoice,
    renderer: Renderer,
    settings: Settings,
}

impl Refiner {
    /// Prepares all views of `specification`.
    ///
    /// # Errors
    /// When a setting makes no sense or the backend is not to be had.
    pub fn new(
        specification: &Specification,
        backend: BackendChoice,
        settings: Settings,
    ) -> Result<Self, InverseError> {
        check_positive("difference", settings.difference)?;
        check_positive("step_max", settings.step_max)?;
        check_positive("noise_sd", settings.noise_sd)?;
        check_positive("noise_least_sd", settings.noise_least_sd)?;
        if settings.difference > 0.5 {
            let (name, value, rule) = ("difference", settings.difference, "at most 0.5");
            return Err(InverseError::Setting { name, value, rule });
        }
        Ok(Self {
            renderer: Renderer::new(specification, backend)?,
            specification: specification.clone(),
            backend,
            settings,
        })
    }

    /// Fits from every start, and gives what was found, the least cost first.
    ///
    /// # Errors
    /// When there is no start, one lies outside the model, the observation does not fit the
    /// specification, or a rendering fails.
    pub fn refine(
        &self,
        observation: &Observation,
        starts: &[Material],
    ) -> Result<Vec<Refined>, InverseError> {
        if starts.is_empty() {
            return Err(InverseError::NoStarts);
        }
        let mut found = starts
            .iter()
            .map(|start| self.refine_from(observation, start))
            .collect::<Result<Vec<_>, _>>()?;
        found.sort_by(|a, b| a.cost.total_cmp(&b.cost));
        Ok(found)
    }

    /// The mean square of the residual of a material as it is, light, cameras and exposure being as
    /// the specification and the observation say. It takes a rendering of each view.
    ///
    /// # Errors
    /// When the material lies outside the model, the observation does not fit the specification, or a
    /// rendering fails.
    pub fn mean_square(
        &self,
        observation: &Observation,
        material: &Material,
    ) -> Result<f64, InverseError> {
        material.check()?;
        let mut model = self.model(observation)?;
        let mut variables = vec![0.0; model.variables()];
        variables[..PARAMETERS].copy_from_slice(&Theta::of(material).0);
        let found = model.evaluate(variables)?;
        Ok(found.residual.norm_squared() / observation.channels() as f64)
    }

    fn model<'a>(&'a self, observation: &'a Observation) -> Result<Model<'a>, InverseError> {
        observation.check(&self.specification)?;
        let views: Vec<u32> = observation.views().iter().map(|view| view.view).collect();
        let nuisances = self.settings.nuisances;
        Ok(Model {
            specification: &self.specification,
            backend: self.backend,
            renderer: &self.renderer,
            observation,
            nuisances: nuisances.variables(&self.specification, &views)?,
            views,
            renderings: 0,
        })
    }

    /// Fits from one start.
    ///
    /// # Errors
    /// As [`Refiner::refine`].
    pub fn refine_from(
        &self,
        observation: &Observation,
        start: &Material,
    ) -> Result<Refined, InverseError> {
        start.check()?;
        let model = self.model(observation)?;
        let mut fit = Fit::start(model, &self.settings, &Theta::of(start))?;
        let stop = fit.run()?;
        self.result(&fit, stop)
    }

    fn result(&self, fit: &Fit<'_>, stop: Stop) -> Result<Refined, InverseError> {
        let residual = &fit.state.residual;
        let theta = theta(&fit.state.variables).normalized();
        let squares = residual.norm_squared();
        let channels = fit.model.observation.channels();
        let freedom = channels.saturating_sub(fit.model.variables()).max(1);
        let residual_sd = (squares / freedom as f64).sqrt();
        let covariance = match self.settings.covariance {
            true => Some(self.covariance(fit, residual_sd)?),
            false => None,
        };
        Ok(Refined {
            material: theta.material(),
            theta,
            nuisances: fit.model.nuisance_values(&fit.state.variables),
            cost: fit.cost(&fit.state),
            mean_square: squares / channels as f64,
            residual_sd,
            covariance,
            renderings: fit.model.renderings,
            stop,
        })
    }

    /// The covariance at the solution: derivatives by the parameters with stated errors, those by
    /// nuisance parameters as the fit has them.
    fn covariance(&self, fit: &Fit<'_>, residual_sd: f64) -> Result<Covariance, InverseError> {
        let (model, variables) = (&fit.model, &fit.state.variables);
        let nuisances = model.nuisance_values(variables);
        let mut specification = nuisances.apply(&self.specification, &model.views)?;
        // The limit of an accuracy is below any that a fit would ask for.
        let accuracy = &mut specification.accuracy;
        accuracy.relative *= DEVIATIONS_ACCURACY;
        accuracy.absolute =
            (accuracy.absolute * DEVIATIONS_ACCURACY).max(*limits::ACCURACY_ABSOLUTE.start());
        let differentiator = Differentiator::new(&specification, self.backend)?;
        let material = theta(variables).material();
        let mut derivatives = differentiator.views(&material, &model.views)?;
        let observed = model.observation.views().iter();
        for ((derivatives, gain), observed) in
            derivatives.iter_mut().zip(nuisances.gain).zip(observed)
        {
            let known = observed.gain;
            derivatives.expose(std::array::from_fn(|channel| {
                gain[channel] * known[channel]
            }));
            derivatives.blacken(&observed.counts);
        }
        let encoding = model.observation.encoding();
        let others = (PARAMETERS..model.variables()).map(|variable| fit.jacobian.column(variable));
        let others: Vec<DVector<f64>> = others.map(|column| column.into_owned()).collect();
        let information = Information::of_fit(&derivatives, encoding, &others);
        let alike = model.alike(&fit.state.residual);
        let noise_sd = residual_sd.max(self.settings.noise_least_sd) * alike.sqrt();
        let covariance = information.posterior_covariance(noise_sd)?;
        let of_parameters = covariance.fixed_view::<PARAMETERS, PARAMETERS>(0, 0);
        Ok(of_parameters.into_owned())
    }
}

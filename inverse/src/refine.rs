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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::least_squares::{Quadratic, Region};
    use crate::model::Sides;
    use crate::{Encoding, ObservedView};
    use nalgebra::{DMatrix, SymmetricEigen};
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::{Rng, SeedableRng};

    const BACKEND: BackendChoice = BackendChoice::Native;

    /// The paper's pair.
    const VIEWS: [u32; 2] = [5, 8];

    /// The noise of every channel's code.
    const NOISE_SD: f64 = 1.0 / 255.0;

    fn preset() -> Specification {
        let mut specification = Specification::preset();
        (specification.image.width, specification.image.height) = (8, 8);
        specification
    }

    /// The images of a material, with noise.
    fn noisy(specification: &Specification, material: &Material, seed: u64) -> Observation {
        let renderer = Renderer::new(specification, BACKEND).expect("views");
        let mut draws = ChaCha8Rng::seed_from_u64(seed);
        let mut uniform = || draws.next_u32() as f64 / f64::from(u32::MAX);
        // Twelve uniform draws less six have a variance of 1.
        let mut normal = || (0..12).map(|_| uniform()).sum::<f64>() - 6.0;
        let views = VIEWS.map(|view| {
            let film = renderer
                .render(material, None, view)
                .expect("an image")
                .film;
            let mut encode = |value| Encoding::Srgb.value(value) + NOISE_SD * normal();
            let pixels = film.pixels.iter();
            let codes = pixels.map(|pixel| pixel.value.map(&mut encode)).collect();
            ObservedView::film(view, codes)
        });
        Observation::new(specification, Encoding::Srgb, views.into()).expect("images")
    }

    /// The images' derivatives, and the directions along which the noise is less than a tenth of the range.
    struct Slopes {
        jacobian: DMatrix<f64>,
        /// By how much the images change along a direction of length 1, and the direction.
        told: Vec<(f64, DVector<f64>)>,
    }

    impl Slopes {
        fn new(specification: &Specification, material: &Material) -> Self {
            let differentiator = Differentiator::new(specification, BACKEND).expect("views");
            let views = differentiator.views(material, &VIEWS).expect("derivatives");
            let column = |parameter| {
                let pixels = views.iter();
                let channels = pixels.flat_map(|view| view.encoded(parameter, Encoding::Srgb));
                DVector::from_vec(channels.map(|[slope, _]| slope).collect())
            };
            let columns: Vec<DVector<f64>> = (0..PARAMETERS).map(column).collect();
            let jacobian = DMatrix::from_columns(&columns);
            let eigen = SymmetricEigen::new(jacobian.tr_mul(&jacobian));
            let directions = eigen.eigenvectors.column_iter();
            let change = eigen
                .eigenvalues
                .iter()
                .map(|square| square.max(0.0).sqrt());
            let told = change
                .zip(directions.map(|direction| direction.into_owned()))
                .filter(|(change, _)| *change > 10.0 * NOISE_SD)
                .collect();
            Self { jacobian, told }
        }
    }

    /// By how much the best step inside the ranges lowers the cost of a fit, over the noise's variance.
    fn promise(specification: &Specification, fit: &Fit<'_>) -> f64 {
        let at = &fit.state.variables;
        let slopes = Slopes::new(specification, &theta(at).material());
        let quadratic = Quadratic::new(&slopes.jacobian, &fit.state.residual);
        let bounds: Vec<[f64; 2]> = (0..at.len()).map(|v| fit.model.bounds(v)).collect();
        let inside = Region {
            at,
            bounds: &bounds,
            step_max: &vec![0.1; at.len()],
        };
        let step = quadratic.step(1e-7, &inside);
        quadratic.reduction(&step) / (NOISE_SD * NOISE_SD)
    }

    /// Materials whose images change slowly along some direction that noise does not hide.
    const MATERIALS: [u32; 3] = [3, 13, 22];

    #[test]
    fn differences_to_both_sides_tell_slow_directions() {
        let specification = preset();
        let refiner = Refiner::new(&specification, BACKEND, Settings::default()).expect("settings");
        for index in MATERIALS {
            let material = specification.material(index).material;
            let observation = noisy(&specification, &material, 1);
            let mut model = refiner.model(&observation).expect("a model");
            let at = model
                .evaluate(Theta::of(&material).0.to_vec())
                .expect("images");
            let slopes = Slopes::new(&specification, &material);
            let mut worst = |difference, sides| {
                let jacobian = model.jacobian(&at, difference, sides).expect("derivatives");
                let off = slopes.told.iter().map(|(change, direction)| {
                    ((&jacobian - &slopes.jacobian) * direction).norm() / change
                });
                off.fold(0.0, f64::max)
            };
            let [one, both] = [worst(0.01, Sides::One), worst(0.01, Sides::Both)];
            assert!(one > 0.3 && both < 0.1, "material {index}: {one}, {both}");
        }
    }

    /// Fits that end by differences to one side leave up to 4.9 of these (measured).
    #[test]
    fn a_noisy_fit_ends_where_no_step_promises_more() {
        let specification = preset();
        let settings = Settings::default();
        let refiner = Refiner::new(&specification, BACKEND, settings).expect("settings");
        for index in MATERIALS {
            let material = specification.material(index).material;
            let observation = noisy(&specification, &material, 2);
            let model = refiner.model(&observation).expect("a model");
            let mut fit = Fit::start(model, &settings, &Theta::of(&material)).expect("a start");
            let stop = fit.run().expect("a fit");
            let promise = promise(&specification, &fit);
            assert_eq!(stop, Stop::Converged, "material {index}");
            assert!(promise < 0.1, "material {index}: {promise}");
        }
    }

    /// A light as far away as a specification admits can only come nearer.
    #[test]
    fn a_light_at_the_limit_is_moved_to_the_side_that_is_admitted() {
        let mut specification = preset();
        specification.light.distance_m = *limits::DISTANCE_M.end();
        let settings = Settings {
            nuisances: crate::Nuisances {
                light_distance: Some(0.05),
                ..crate::Nuisances::default()
            },
            ..Settings::default()
        };
        let refiner = Refiner::new(&specification, BACKEND, settings).expect("settings");
        let material = specification.material(5).material;
        let observation = noisy(&specification, &material, 3);
        let found = refiner.refine_from(&observation, &material);
        let found = found.expect("no derivative asks for a light that is too far away");
        assert_eq!(found.stop, Stop::Converged);
        assert!(found.nuisances.light_distance <= 1.0);
    }
}

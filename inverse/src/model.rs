//! Encoded images as a function of the fit's variables, and their differences.

use crate::encoding::Encoding;
use crate::error::InverseError;
use crate::nuisance::{self, Kind, Nuisance, NuisanceValues};
use crate::observation::{Observation, ObservedView};
use crate::parameters::{ANGLE, PARAMETERS, Theta};
use crate::steps;
use dataset::{Material, Specification};
use nalgebra::{DMatrix, DVector};
use renderer::{Renderer, geometry::BackendChoice};

/// Nuisance parameters are differentiated over this share of their standard deviation.
const NUISANCE_DIFFERENCE_SD: f64 = 0.2;

/// More alike than this neighbouring pixels do not count as.
const CORRELATION_MAX: f64 = 0.95;

/// Renders what an observation shows, for any values of the variables: the ten parameters, then the
/// nuisance parameters in standard deviations. Counts renderings.
pub(crate) struct Model<'a> {
    pub specification: &'a Specification,
    pub backend: BackendChoice,
    /// For the specification itself.
    pub renderer: &'a Renderer,
    pub observation: &'a Observation,
    pub nuisances: Vec<Nuisance>,
    pub views: Vec<u32>,
    pub renderings: u32,
}

/// To which sides of a place a variable is moved for its difference quotient.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Sides {
    /// Away from the nearer end of its range.
    One,
    /// Both, as far as its range goes: what is left out then falls with the square of the difference.
    Both,
}

/// The images at some values of the variables.
#[derive(Clone)]
pub(crate) struct Evaluation {
    pub variables: Vec<f64>,
    /// Linear pixels before gain, view by view.
    films: Vec<Vec<[f64; 3]>>,
    /// Encoded minus observed, each channel of each pixel of each view.
    pub residual: DVector<f64>,
}

impl Model<'_> {
    /// How many variables there are.
    pub fn variables(&self) -> usize {
        PARAMETERS + self.nuisances.len()
    }

    /// The least and the largest value of a variable.
    pub fn bounds(&self, variable: usize) -> [f64; 2] {
        match variable {
            ANGLE => [f64::NEG_INFINITY, f64::INFINITY],
            0..PARAMETERS => [0.0, 1.0],
            _ => self.nuisances[variable - PARAMETERS].bounds,
        }
    }

    /// The nuisance parameters at these variables.
    pub fn nuisance_values(&self, variables: &[f64]) -> NuisanceValues {
        nuisance::values(&self.nuisances, &variables[PARAMETERS..], self.views.len())
    }

    /// Renders all views.
    pub fn evaluate(&mut self, variables: Vec<f64>) -> Result<Evaluation, InverseError> {
        let places: Vec<usize> = (0..self.views.len()).collect();
        let films = self.films(&variables, &places)?;
        let gains = self.nuisance_values(&variables).gain;
        let observed = self.observation.views();
        let mut residual = Vec::with_capacity(self.observation.channels());
        for ((film, gain), observed) in films.iter().zip(gains).zip(observed) {
            residual.extend(self.residual(film, gain, observed));
        }
        Ok(Evaluation {
            variables,
            films,
            residual: DVector::from_vec(residual),
        })
    }

    /// Of pixels that do not count it is 0.
    fn residual(
        &self,
        film: &[[f64; 3]],
        gain: [f64; 3],
        observed: &ObservedView,
    ) -> impl Iterator<Item = f64> {
        let encoding: Encoding = self.observation.encoding();
        let base = observed.gain;
        let pixels = film.iter().zip(&observed.pixels).zip(&observed.counts);
        pixels.flat_map(move |((pixel, codes), counts)| {
            std::array::from_fn::<f64, 3, _>(|channel| match counts {
                true => {
                    encoding.value(gain[channel] * base[channel] * pixel[channel]) - codes[channel]
                }
                false => 0.0,
            })
        })
    }

    /// Renders the views at these places of the observation.
    fn films(
        &mut self,
        variables: &[f64],
        places: &[usize],
    ) -> Result<Vec<Vec<[f64; 3]>>, InverseError> {
        let material = theta(variables).material();
        let changed = self
            .nuisance_values(variables)
            .apply(self.specification, &self.views)?;
        if changed == *self.specification {
            let renderer = self.renderer;
            return self.rendered(renderer, &material, places);
        }
        let renderer = Renderer::new(&changed, self.backend)?;
        self.rendered(&renderer, &material, places)
    }

    fn rendered(
        &mut self,
        renderer: &Renderer,
        material: &Material,
        places: &[usize],
    ) -> Result<Vec<Vec<[f64; 3]>>, InverseError> {
        let mut films = Vec::new();
        for &place in places {
            let film = renderer.render(material, None, self.views[place])?.film;
            self.renderings += 1;
            films.push(film.pixels.into_iter().map(|pixel| pixel.value).collect());
        }
        Ok(films)
    }

    /// The derivatives of the residual by all variables: a row for each channel, a column for each
    /// variable. To one side parameters are moved by `difference`.
    pub fn jacobian(
        &mut self,
        at: &Evaluation,
        difference: f64,
        sides: Sides,
    ) -> Result<DMatrix<f64>, InverseError> {
        let all: Vec<usize> = (0..self.views.len()).collect();
        let mut jacobian = DMatrix::zeros(at.residual.len(), self.variables());
        for variable in 0..self.variables() {
            let nuisance = variable.checked_sub(PARAMETERS);
            let kind = nuisance.map(|index| self.nuisances[index].kind);
            let by_nuisance = NUISANCE_DIFFERENCE_SD;
            let column = match (kind, sides) {
                (Some(Kind::Gain(place, channel)), _) => self.by_gain(at, variable, place, channel),
                (Some(Kind::CameraElevation(place)), _) => {
                    self.quotient(at, variable, by_nuisance, sides, &[place])?
                }
                (Some(_), _) => self.quotient(at, variable, by_nuisance, sides, &all)?,
                (None, Sides::One) => self.quotient(at, variable, difference, sides, &all)?,
                (None, Sides::Both) => self.by_parameter(at, variable, &all)?,
            };
            jacobian.set_column(variable, &column);
        }
        Ok(jacobian)
    }

    /// How many renderings [`Model::jacobian`] takes at most.
    pub fn renderings_of_jacobian(&self, sides: Sides) -> u32 {
        let views = self.views.len() as u32;
        let nuisances = self.nuisances.iter().map(|nuisance| match nuisance.kind {
            Kind::Gain(..) => 0,
            Kind::CameraElevation(_) => 1,
            Kind::LightElevation | Kind::LightDistance => views,
        });
        let points = match sides {
            Sides::One => 1,
            Sides::Both => 2,
        };
        points * (PARAMETERS as u32 * views + nuisances.sum::<u32>())
    }

    /// The difference quotient of the residual by a variable that changes the views at `places`: 0 for one that
    /// cannot move.
    fn quotient(
        &mut self,
        at: &Evaluation,
        variable: usize,
        difference: f64,
        sides: Sides,
        places: &[usize],
    ) -> Result<DVector<f64>, InverseError> {
        let [low, high] = self.bounds(variable);
        let value = at.variables[variable];
        let by = match high - value >= value - low {
            true => difference,
            false => -difference,
        };
        let first = self.change(at, variable, by, places)?;
        let second = match (sides, &first) {
            (Sides::One, Some(_)) => None,
            _ => self.change(at, variable, -by, places)?,
        };
        Ok(match (first, second) {
            // The slope of the parabola through all three.
            (Some((there, way)), Some((back, way_back))) => {
                let per_length = 1.0 / (way_back - way);
                there * (way_back / way * per_length) - back * (way / way_back * per_length)
            }
            (Some((change, way)), None) | (None, Some((change, way))) => change / way,
            (None, None) => DVector::zeros(at.residual.len()),
        })
    }

    /// What the residual changes by if a variable moves `by` so much, and how far it does: no farther than to its
    /// bound. `None` where it cannot, or where the specification does not admit what it leads to.
    fn change(
        &mut self,
        at: &Evaluation,
        variable: usize,
        by: f64,
        places: &[usize],
    ) -> Result<Option<(DVector<f64>, f64)>, InverseError> {
        let mut moved = at.variables.clone();
        let [low, high] = self.bounds(variable);
        moved[variable] = (at.variables[variable] + by).clamp(low, high);
        let way = moved[variable] - at.variables[variable];
        if way == 0.0 {
            return Ok(None);
        }
        let films = match self.films(&moved, places) {
            Err(InverseError::Specification(_)) => return Ok(None),
            films => films?,
        };
        let gains = self.nuisance_values(&moved).gain;
        let stride = self.stride();
        let mut change = DVector::zeros(at.residual.len());
        for (&place, film) in places.iter().zip(&films) {
            let observed = &self.observation.views()[place];
            let residual = self.residual(film, gains[place], observed);
            for (row, residual) in (place * stride..).zip(residual) {
                change[row] = residual - at.residual[row];
            }
        }
        Ok(Some((change, way)))
    }

    /// The derivative by a parameter from differences to both sides, where ranges and kinks of the model allow
    /// it: those of linear pixels, over half of [`crate::Differentiator`]'s steps, times the encoding's slope. 0
    /// where there is no derivative.
    fn by_parameter(
        &mut self,
        at: &Evaluation,
        parameter: usize,
        places: &[usize],
    ) -> Result<DVector<f64>, InverseError> {
        let mut column = DVector::zeros(at.residual.len());
        let Specification { tint, accuracy, .. } = self.specification;
        let cosines = steps::cosines(self.specification, &self.views);
        let share = steps::share(accuracy);
        let here = theta(&at.variables);
        let Some(stencil) = steps::stencil(&here, parameter, &cosines, *tint, share) else {
            return Ok(column);
        };
        for point in stencil.points.iter().filter(|point| point.fine != 0.0) {
            let films = match point.is_base {
                true => at.films.clone(),
                false => {
                    let mut moved = at.variables.clone();
                    moved[..PARAMETERS].copy_from_slice(&point.theta.0);
                    self.films(&moved, places)?
                }
            };
            for (&place, film) in places.iter().zip(&films) {
                let slopes = self.slopes(at, place);
                let first = place * self.stride();
                for (row, (value, slope)) in film.as_flattened().iter().zip(slopes).enumerate() {
                    column[first + row] += point.fine * slope * value;
                }
            }
        }
        Ok(column)
    }

    /// The slope of each code of an image by the linear value before gain; 0 of pixels that do not count.
    fn slopes(&self, at: &Evaluation, place: usize) -> impl Iterator<Item = f64> {
        let observed = &self.observation.views()[place];
        let gain = self.nuisance_values(&at.variables).gain[place];
        let gain: [f64; 3] = std::array::from_fn(|channel| gain[channel] * observed.gain[channel]);
        let encoding = self.observation.encoding();
        let pixels = at.films[place].iter().zip(&observed.counts);
        pixels.flat_map(move |(pixel, counts)| {
            std::array::from_fn::<f64, 3, _>(|channel| match counts {
                true => gain[channel] * encoding.derivative(gain[channel] * pixel[channel]),
                false => 0.0,
            })
        })
    }

    fn by_gain(
        &self,
        at: &Evaluation,
        variable: usize,
        place: usize,
        channel: usize,
    ) -> DVector<f64> {
        let sd = self.nuisances[variable - PARAMETERS].sd();
        let observed = &self.observation.views()[place];
        let gain = self.nuisance_values(&at.variables).gain[place][channel];
        let gain = gain * observed.gain[channel];
        let encoding = self.observation.encoding();
        let mut column = DVector::zeros(at.residual.len());
        let pixels = at.films[place].iter().zip(&observed.counts);
        for (pixel, (film, counts)) in pixels.enumerate() {
            let value = gain * film[channel];
            if *counts {
                let row = place * self.stride() + 3 * pixel + channel;
                column[row] = encoding.derivative(value) * value * sd;
            }
        }
        column
    }

    /// How many pixels tell as much as one that is independent: 1 for a residual whose neighbouring
    /// pixels have nothing in common. For a first-order process with correlation r between neighbours it
    /// is (1 + r)/(1 - r) in each direction.
    pub fn alike(&self, residual: &DVector<f64>) -> f64 {
        let width = self.specification.image.width as usize;
        let directions = [1, width].map(|step| {
            let (mut products, mut squares) = (0.0, 0.0);
            for (place, observed) in self.observation.views().iter().enumerate() {
                let first = place * self.stride();
                for pixel in step..observed.counts.len() {
                    // The pixel before the first of a row is the last of another.
                    let beside = step == width || pixel % width != 0;
                    if beside && observed.counts[pixel] && observed.counts[pixel - step] {
                        for channel in 0..3 {
                            let [one, other] =
                                [pixel, pixel - step].map(|at| residual[first + 3 * at + channel]);
                            products += one * other;
                            squares += 0.5 * (one * one + other * other);
                        }
                    }
                }
            }
            let correlation = if squares > 0.0 {
                products / squares
            } else {
                0.0
            };
            let correlation = correlation.clamp(0.0, CORRELATION_MAX);
            (1.0 + correlation) / (1.0 - correlation)
        });
        directions[0] * directions[1]
    }

    /// Channels of a view.
    fn stride(&self) -> usize {
        let image = &self.specification.image;
        3 * image.width as usize * image.height as usize
    }
}

/// The ten parameters among the variables.
pub(crate) fn theta(variables: &[f64]) -> Theta {
    Theta(std::array::from_fn(|index| variables[index]))
}

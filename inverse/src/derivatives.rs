//! Derivatives of every pixel of a view by the ten parameters, with stated errors.
//!
//! They are difference quotients over two steps, the first twice the second, and Richardson's
//! extrapolation of both. At the ends of ranges, and at R = 90 where the model has a kink, they are
//! taken to one side. Interreflection is worked out on the tiles and by the rules of the material itself.
//! Otherwise the renderer is adaptive, so its error is not a smooth function of the material:
//! `steps.rs` says how steps are chosen.
//!
//! Images bend where the tint meets its knee, and a step over the bend misses the derivative on
//! either side. Where many derivatives of an image are not sure, they are taken again over shorter
//! steps, and each keeps the surest. The quotients of one step may agree by chance. So at tight accuracies,
//! where there are more steps, a derivative is as sure as a neighbouring step confirms it.

use crate::encoding::Encoding;
use crate::error::InverseError;
use crate::observation::check_views;
use crate::parameters::{ANGLE, ANISOTROPY, PARAMETERS, Theta};
use crate::steps::{self, Point};
use dataset::specification::Accuracy;
use dataset::{Material, Specification};
use renderer::{Discretization, Renderer, film::FilmPixel, geometry::BackendChoice};

/// Derivatives of this many units of white over a parameter's range are notable.
const NOTABLE: f64 = 1e-4;

/// What a notable derivative may be unsure by, as a share of it.
const UNSURE: f64 = 0.01;

/// The same for accuracies of at most [`TIGHT_ACCURACY`], at which steps are so short that quotients of smooth images
/// differ by less. Where an image bends within the steps they may differ by far less than they miss: derivatives by
/// the tint of material 2103 of the preset did by 0.2 percent and missed 2.2.
const UNSURE_TIGHT: f64 = 0.001;

/// The share of an image's notable derivatives that may be unsure before they are taken again, at the preset's
/// accuracy. Chosen: some are unsure in every image, by the renderings' error. At tighter accuracies fewer are: the
/// share goes with the accuracy.
const UNSURE_SHARE_MAX: f64 = 0.05;
const PRESET_ACCURACY: f64 = 1e-3;

/// The steps of derivatives that are taken again, as shares of the first. At the first of them the error of renderings
/// at the preset's accuracy moves derivatives by about 1e-4 of white over a length of 1/2.
const SHORTER: [f64; 3] = [1.0 / 8.0, 1.0 / 64.0, 1.0 / 512.0];

/// Those after the first are for accuracies of at most this, at which the second moves them by about as much.
const TIGHT_ACCURACY: f64 = 1e-4;

/// How many renderings of each view [`Differentiator::views`] takes at most.
pub const RENDERINGS_MAX: usize = steps::RENDERINGS_MAX;

/// One value for each channel of each pixel: height x width, row by row, row 0 at the top.
pub type ImageOfChannels = Vec<[f64; 3]>;

/// Differentiates images of materials under one specification.
#[derive(Debug)]
pub struct Differentiator {
    specification: Specification,
    renderer: Renderer,
}

/// A view of the material that is differentiated.
struct Base {
    pixels: Vec<FilmPixel>,
    discretization: Discretization,
}

/// The derivatives of one view.
#[derive(Clone, Debug, PartialEq)]
pub struct ViewDerivatives {
    /// The view's index.
    pub view: u32,
    /// Pixels a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// The pixels themselves, linear, in units of white.
    pub pixels: ImageOfChannels,
    /// The derivatives by each parameter over its range, in units of white.
    pub by: [ParameterDerivative; PARAMETERS],
}

/// The derivatives of a view's pixels by one parameter.
#[derive(Clone, Debug, PartialEq)]
pub struct ParameterDerivative {
    /// The derivatives.
    pub values: ImageOfChannels,
    /// By how much the quotients of the two steps differ, or derivatives over two neighbouring steps where they were
    /// taken again. Over an image its norm estimates the derivatives' error: both what differences leave out and what
    /// the renderings are off by.
    pub disagreements: ImageOfChannels,
    /// Bounds of the error: the disagreement, and the renderings' stated errors over the step.
    /// Renderings are off by a fiftieth of what they state in the mean, so these are wide. Infinite
    /// where the derivative does not exist: by the colours at black under `hue`.
    pub errors: ImageOfChannels,
}

impl Differentiator {
    /// Prepares all views of `specification`, whose accuracy the renderings have. The preset's
    /// suits information and weights. Where views show the colour chart, a tenth of it takes twenty times
    /// as long.
    ///
    /// # Errors
    /// When the backend is not to be had.
    pub fn new(
        specification: &Specification,
        backend: BackendChoice,
    ) -> Result<Self, InverseError> {
        Ok(Self {
            renderer: Renderer::new(specification, backend)?,
            specification: specification.clone(),
        })
    }

    /// The derivatives of these views of `material`. It takes at most [`RENDERINGS_MAX`] renderings
    /// of each view.
    ///
    /// # Errors
    /// When a view does not exist or comes twice, there is none, or a parameter lies outside the
    /// model.
    pub fn views(
        &self,
        material: &Material,
        views: &[u32],
    ) -> Result<Vec<ViewDerivatives>, InverseError> {
        check_views(&self.specification, views)?;
        material.check()?;
        let theta = Theta::of(material);
        let bases = views.iter().map(|&view| {
            let film = self.renderer.render(material, None, view)?.film;
            let discretization = self.renderer.discretization(material, view)?;
            Ok(Base {
                pixels: film.pixels,
                discretization,
            })
        });
        let bases: Vec<Base> = bases.collect::<Result<_, InverseError>>()?;
        let mut columns: Vec<Vec<ParameterDerivative>> = vec![Vec::new(); views.len()];
        let all: Vec<&Base> = bases.iter().collect();
        for parameter in 0..PARAMETERS {
            let by_view = self.by(&theta, parameter, views, &all)?;
            for (column, derivative) in columns.iter_mut().zip(by_view) {
                column.push(derivative);
            }
        }
        let image = &self.specification.image;
        let assembled = views.iter().zip(&bases).zip(columns);
        Ok(assembled
            .map(|((&view, base), column)| ViewDerivatives {
                view,
                width: image.width,
                height: image.height,
                pixels: base.pixels.iter().map(|pixel| pixel.value).collect(),
                by: column
                    .try_into()
                    .unwrap_or_else(|_| unreachable!("the loop has a turn for each parameter")),
            })
            .collect())
    }

    /// The films of a material beside that of `bases`.
    fn beside(&self, theta: &Theta, bases: &[&Base]) -> Result<Vec<Vec<FilmPixel>>, InverseError> {
        let material = theta.material();
        let film = |base: &&Base| {
            let film = self.renderer.film_like(&material, &base.discretization)?;
            Ok(film.pixels)
        };
        bases.iter().map(film).collect()
    }

    /// The derivatives of all views by one parameter.
    fn by(
        &self,
        theta: &Theta,
        parameter: usize,
        views: &[u32],
        bases: &[&Base],
    ) -> Result<Vec<ParameterDerivative>, InverseError> {
        if changes_nothing(theta, parameter) {
            let zero = bases.iter().map(|base| zero(base.pixels.len()));
            return Ok(zero.collect());
        }
        let first = self.quotients(theta, parameter, views, bases, 1.0)?;
        // Of each view by every step so far, and the surest.
        let mut of_steps: Vec<Vec<ParameterDerivative>> =
            first.iter().map(|first| vec![first.clone()]).collect();
        let mut found = first;
        let Accuracy { relative, absolute } = self.specification.accuracy;
        let accuracy = relative.max(absolute);
        let most = UNSURE_SHARE_MAX * (accuracy / PRESET_ACCURACY).min(1.0);
        let (levels, unsure_max) = match accuracy <= TIGHT_ACCURACY {
            true => (SHORTER.len(), UNSURE_TIGHT),
            false => (1, UNSURE),
        };
        let has_more = levels > 1;
        for shorter in &SHORTER[..levels] {
            let is_unsure = |&place: &usize| found[place].is_unsure(unsure_max, most);
            let unsure: Vec<usize> = (0..views.len()).filter(is_unsure).collect();
            if unsure.is_empty() {
                break;
            }
            let views: Vec<u32> = unsure.iter().map(|&place| views[place]).collect();
            let bases: Vec<&Base> = unsure.iter().map(|&place| bases[place]).collect();
            let again = self.quotients(theta, parameter, &views, &bases, *shorter)?;
            for (place, again) in unsure.into_iter().zip(again) {
                of_steps[place].push(again);
                found[place] = surest(&of_steps[place], has_more);
            }
        }
        Ok(found)
    }

    /// The difference quotients of all views by one parameter, over a share of its usual step.
    fn quotients(
        &self,
        theta: &Theta,
        parameter: usize,
        views: &[u32],
        bases: &[&Base],
        shorter: f64,
    ) -> Result<Vec<ParameterDerivative>, InverseError> {
        let cosines = steps::cosines(&self.specification, views);
        let Specification { tint, accuracy, .. } = &self.specification;
        let share = shorter * steps::share(accuracy);
        let Some(stencil) = steps::stencil(theta, parameter, &cosines, *tint, share) else {
            let nothing = bases.iter().map(|base| nonexistent(base.pixels.len()));
            return Ok(nothing.collect());
        };
        let mut sums: Vec<Vec<Sums>> = bases
            .iter()
            .map(|base| vec![Sums::default(); base.pixels.len()])
            .collect();
        for point in &stencil.points {
            let rendered = match point.is_base {
                true => None,
                false => Some(self.beside(&point.theta, bases)?),
            };
            for (place, sums) in sums.iter_mut().enumerate() {
                let base = &bases[place].pixels;
                let film = rendered.as_ref().map_or(base, |films| &films[place]);
                for (sum, pixel) in sums.iter_mut().zip(film) {
                    sum.add(point, pixel);
                }
            }
        }
        Ok(sums.iter().map(|sums| derivative(sums)).collect())
    }
}

/// The sums of one pixel over a stencil.
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    coarse: [f64; 3],
    fine: [f64; 3],
    stated: f64,
}

impl Sums {
    fn add(&mut self, point: &Point, pixel: &FilmPixel) {
        for channel in 0..3 {
            self.coarse[channel] += point.coarse * pixel.value[channel];
            self.fine[channel] += point.fine * pixel.value[channel];
        }
        self.stated += point.weight().abs() * pixel.error;
    }
}

impl ParameterDerivative {
    /// Whether more than a share of the notable derivatives are unsure by more than a share of them.
    fn is_unsure(&self, unsure_max: f64, share_max: f64) -> bool {
        let (mut notable, mut unsure) = (0usize, 0usize);
        let values = self.values.as_flattened().iter();
        for (value, disagreement) in values.zip(self.disagreements.as_flattened()) {
            // Where there is no derivative at all, no shorter step finds one.
            if value.abs() > NOTABLE && disagreement.is_finite() {
                notable += 1;
                unsure += usize::from(*disagreement > unsure_max * value.abs());
            }
        }
        unsure as f64 > share_max * notable as f64
    }

    /// The value, the disagreement and the error of a channel.
    fn at(&self, pixel: usize, channel: usize) -> [f64; 3] {
        [&self.values, &self.disagreements, &self.errors].map(|image| image[pixel][channel])
    }
}

/// Of derivatives over some steps, the first the longest, the surest in each channel. Where a third step can tell
/// which of two is right, two that differ are not sure.
fn surest(of_steps: &[ParameterDerivative], has_more: bool) -> ParameterDerivative {
    let mut surest = of_steps[0].clone();
    for pixel in 0..surest.values.len() {
        for channel in 0..3 {
            let of_channel: Vec<[f64; 3]> = of_steps
                .iter()
                .map(|of_step| of_step.at(pixel, channel))
                .collect();
            let [value, disagreement, error] = match of_channel[..] {
                [long, short] if !has_more => clearly_surer(long, short),
                _ => confirmed(&of_channel),
            };
            surest.values[pixel][channel] = value;
            surest.disagreements[pixel][channel] = disagreement;
            surest.errors[pixel][channel] = error;
        }
    }
    surest
}

/// Of the values, disagreements and errors of a channel over two steps the shorter's if it is clearly surer. Its quotients
/// can also agree by chance.
fn clearly_surer(long: [f64; 3], short: [f64; 3]) -> [f64; 3] {
    if 2.0 * short[1] < long[1] {
        short
    } else {
        long
    }
}

/// Of those over some steps the one that a neighbouring step confirms best, and as sure as it does.
fn confirmed(of_steps: &[[f64; 3]]) -> [f64; 3] {
    let as_confirmed = (0..of_steps.len()).map(|step| {
        let [value, disagreement, error] = of_steps[step];
        let neighbours = [step.checked_sub(1), Some(step + 1)];
        let neighbours = neighbours.into_iter().flatten();
        let apart = neighbours
            .filter_map(|neighbour| of_steps.get(neighbour))
            .map(|[other, ..]| (value - other).abs())
            .fold(f64::INFINITY, f64::min);
        // A single step has nothing to be compared with.
        let apart = if apart.is_finite() { apart } else { 0.0 };
        let more = (apart - disagreement).max(0.0);
        [value, disagreement + more, error + more]
    });
    as_confirmed
        .min_by(|one, other| one[1].total_cmp(&other[1]))
        .unwrap_or_else(|| unreachable!("there is a first step"))
}

fn derivative(sums: &[Sums]) -> ParameterDerivative {
    let image = |channel_of: &dyn Fn(&Sums, usize) -> f64| -> ImageOfChannels {
        let pixel = |sum: &Sums| std::array::from_fn(|channel| channel_of(sum, channel));
        sums.iter().map(pixel).collect()
    };
    let disagreement = |sum: &Sums, channel: usize| (sum.fine[channel] - sum.coarse[channel]).abs();
    ParameterDerivative {
        values: image(&|sum, channel| (4.0 * sum.fine[channel] - sum.coarse[channel]) / 3.0),
        disagreements: image(&disagreement),
        errors: image(&|sum, channel| disagreement(sum, channel) + sum.stated),
    }
}

/// Whether the derivatives by a parameter are 0 whatever the scene. The lobe's wider axis follows A^3, whose slope at
/// A = 0 is 0; and there the lobe is round, so that turning it changes nothing. Differences would find the renderings'
/// errors.
fn changes_nothing(theta: &Theta, parameter: usize) -> bool {
    theta.0[ANISOTROPY] == 0.0 && matches!(parameter, ANISOTROPY | ANGLE)
}

fn zero(pixels: usize) -> ParameterDerivative {
    off_by(0.0, pixels)
}

fn nonexistent(pixels: usize) -> ParameterDerivative {
    off_by(f64::INFINITY, pixels)
}

/// Derivatives of 0 that may be off by this.
fn off_by(error: f64, pixels: usize) -> ParameterDerivative {
    ParameterDerivative {
        values: vec![[0.0; 3]; pixels],
        disagreements: vec![[error; 3]; pixels],
        errors: vec![[error; 3]; pixels],
    }
}

impl ViewDerivatives {
    /// Multiplies pixels and derivatives by a gain for each channel.
    pub(crate) fn expose(&mut self, gain: [f64; 3]) {
        self.each_image(&|_, value| {
            for (channel, gain) in value.iter_mut().zip(gain) {
                *channel *= gain;
            }
        });
    }

    /// Makes pixels that do not count black, so that they depend on nothing.
    pub(crate) fn blacken(&mut self, counts: &[bool]) {
        self.each_image(&|pixel, value| {
            if !counts[pixel] {
                *value = [0.0; 3];
            }
        });
    }

    fn each_image(&mut self, change: &dyn Fn(usize, &mut [f64; 3])) {
        let by = self.by.iter_mut().flat_map(|derivative| {
            [
                &mut derivative.values,
                &mut derivative.disagreements,
                &mut derivative.errors,
            ]
        });
        for image in by.chain([&mut self.pixels]) {
            let pixels = image.iter_mut().enumerate();
            pixels.for_each(|(pixel, value)| change(pixel, value));
        }
    }

    /// The derivatives of the encoded pixels by one parameter, 0 to 9, and how far the two steps'
    /// quotients differ, encoded too: pairs for each channel, pixel by pixel.
    pub fn encoded(
        &self,
        parameter: usize,
        encoding: Encoding,
    ) -> impl Iterator<Item = [f64; 2]> + '_ {
        let ParameterDerivative {
            values,
            disagreements,
            ..
        } = &self.by[parameter];
        let images = self.pixels.iter().zip(values).zip(disagreements);
        images.flat_map(move |((pixel, value), disagreement)| {
            [0, 1, 2].map(|channel| {
                let slope = encoding.derivative(pixel[channel]);
                // A clipped channel does not depend on anything, even where the derivative does not exist.
                let scaled = |number: f64| if slope == 0.0 { 0.0 } else { slope * number };
                [scaled(value[channel]), scaled(disagreement[channel])]
            })
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_derivative_is_as_sure_as_a_neighbouring_step_confirms_it() {
        // The quotients of the longest step agree by chance, those of the shortest are noise.
        let steps = [
            [1.7357, 0.0002, 0.01],
            [1.7701, 0.0012, 0.01],
            [1.7690, 0.0004, 0.02],
            [1.9, 0.2, 0.9],
        ];
        let [value, disagreement, error] = confirmed(&steps);
        assert_eq!(value, 1.7690);
        assert!((disagreement - 0.0011).abs() < 1e-12, "{disagreement}");
        assert!((error - 0.0207).abs() < 1e-12, "{error}");
        // Of two neither is sure.
        let [_, disagreement, _] = confirmed(&steps[..2]);
        assert!((disagreement - 0.0344).abs() < 1e-12, "{disagreement}");
        assert_eq!(confirmed(&steps[..1]), steps[0]);
        // What does not exist stays so.
        let none = [0.0, f64::INFINITY, f64::INFINITY];
        assert_eq!(confirmed(&[none; 3]), none);
    }

    #[test]
    fn a_shorter_step_has_to_be_clearly_surer() {
        let [long, short] = [[1.0, 0.002, 0.01], [1.1, 0.0015, 0.02]];
        assert_eq!(clearly_surer(long, short), long);
        assert_eq!(clearly_surer([1.0, 0.004, 0.01], short), short);
    }
}

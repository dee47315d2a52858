//! Which materials beside one are rendered to differentiate its images.
//!
//! A step is a fixed share of the length over which an image changes by about its own size. The
//! share balances two errors. What differences leave out falls with the fourth power of the step.
//! The renderings' error, which is not smooth, is divided by the step.

use crate::encoding::Encoding;
use crate::parameters::{ANGLE, ANISOTROPY, IOR, PARAMETERS, RGB0, RGB90, ROUGHNESS, Theta};
use dataset::specification::{Accuracy, Tint};
use dataset::{Specification, colour, sin_cos_deg};
use std::f64::consts::PI;

/// The step of every parameter as a share of its length, for renderings of [`ACCURACY`], which are
/// off by 6e-7 of white in the mean (measured: 12 materials, views 5 and 8, 32 x 32 pixels). Chosen
/// so that both errors are then about 1e-5 of white over a length of 1/2.
const SHARE: f64 = 0.08;

/// The accuracy that [`SHARE`] is for.
const ACCURACY: f64 = 1e-3;

/// The share for renderings of another accuracy: the sum of h^4 and e/h is least for an h that goes
/// with the fifth root of e.
pub(crate) fn share(accuracy: &Accuracy) -> f64 {
    let target = accuracy.relative.max(accuracy.absolute);
    SHARE * libm::pow((target / ACCURACY).clamp(1e-6, 10.0), 0.2)
}

/// The largest step of a colour's linear channel. The images of a Lambert term are linear in it.
const COLOUR_STEP_MAX: f64 = 0.05;

/// The least step of a colour's linear channel. Below it the renderings' error drowns the difference.
const COLOUR_STEP_MIN: f64 = 1e-5;

/// R/100 above which the model mixes in a Lambert term: the image has a kink there.
pub(crate) const LAMBERT_FROM: f64 = 0.9;

/// The lobe's base exponent a = 0.001 + 0.999 R/100.
const BASE: [f64; 2] = [0.001, 0.999];

/// The least slope over which an image changes, in slopes of half vectors: about half of the
/// preset's bulb seen from the sample, 0.015.
const FEATURE_SLOPE: f64 = 0.01;

/// Luminance of linear Rec.709.
const LUMINANCE: [f64; 3] = [0.2126, 0.7152, 0.0722];

/// 1 - cos_o of the sample's far parts, seen from straight above: RGB90 shows there only.
const GRAZING_SHARE_MIN: f64 = 0.005;

/// A step of one parameter: the points of its difference quotients and their weights.
#[derive(Clone, Debug)]
pub(crate) struct Stencil {
    /// The points.
    pub points: [Point; 4],
}

/// A material of a stencil and what its image contributes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Point {
    /// Its parameters.
    pub theta: Theta,
    /// Whether it is the material itself.
    pub is_base: bool,
    /// Its weight in the derivative over the whole step.
    pub coarse: f64,
    /// Its weight in the derivative over half of the step.
    pub fine: f64,
}

impl Point {
    /// Its weight in Richardson's extrapolation.
    pub fn weight(&self) -> f64 {
        (4.0 * self.fine - self.coarse) / 3.0
    }
}

/// A parameter's coordinate: the parameter itself, the logarithm of a for the roughness, or the linear
/// channel for a colour. Images are smooth in these; the sRGB curve has a kink.
struct Coordinate {
    at: f64,
    /// The image is smooth between these.
    piece: [f64; 2],
    step: f64,
}

/// The cosines under which the cameras of views see the sample's centre.
pub(crate) fn cosines(specification: &Specification, views: &[u32]) -> Vec<f64> {
    let cosine = |&view: &u32| {
        let view = specification.views.get(view as usize)?;
        Some(sin_cos_deg(view.camera_elevation_deg).0)
    };
    views.iter().filter_map(cosine).collect()
}

/// The stencil of a parameter at `theta`, for views whose cameras see the sample's centre at these
/// cosines. `None` where the derivative does not exist: black has no hue, so its colours are a
/// point of discontinuity.
pub(crate) fn stencil(
    theta: &Theta,
    parameter: usize,
    cosines: &[f64],
    tint: Tint,
    share: f64,
) -> Option<Stencil> {
    let coordinate = match parameter {
        ROUGHNESS => roughness(theta.0[ROUGHNESS], share),
        ANISOTROPY => unit(theta.0[ANISOTROPY], share * anisotropy_length(theta)),
        ANGLE => Coordinate {
            at: theta.0[ANGLE],
            piece: [f64::NEG_INFINITY, f64::INFINITY],
            step: share * angle_length(theta),
        },
        IOR => unit(theta.0[IOR], share * (1.0 / 9.0 + theta.0[IOR])),
        _ => unit(
            colour::linear_from_srgb(theta.0[parameter]),
            colour_step(theta, parameter, cosines, tint, share)?,
        ),
    };
    Some(points(theta, parameter, &coordinate))
}

/// The stencil of a coordinate: symmetric, with less than the whole step where an end is near, or to
/// one side where an end is nearer than half a step.
fn points(theta: &Theta, parameter: usize, coordinate: &Coordinate) -> Stencil {
    let Coordinate { at, piece, .. } = *coordinate;
    let room = [at - piece[0], piece[1] - at];
    let nearer = room[0].min(room[1]);
    let (offsets, coarse, fine, step);
    if nearer >= 0.5 * coordinate.step {
        step = coordinate.step.min(nearer);
        offsets = [-1.0, -0.5, 0.5, 1.0];
        coarse = [-0.5, 0.0, 0.0, 0.5];
        fine = [0.0, -1.0, 1.0, 0.0];
    } else {
        let side = if room[1] >= room[0] { 1.0 } else { -1.0 };
        step = side * coordinate.step.min(0.5 * room[0].max(room[1]));
        offsets = [0.0, 0.5, 1.0, 2.0];
        coarse = [-1.5, 0.0, 2.0, -0.5];
        fine = [-3.0, 4.0, -1.0, 0.0];
    }
    // d/d theta = d/dt / (d theta/dt)
    let per_theta = 1.0 / (step * theta_slope(parameter, at));
    Stencil {
        points: std::array::from_fn(|index| {
            let mut beside = *theta;
            let is_base = offsets[index] == 0.0;
            if !is_base {
                let moved = (at + step * offsets[index]).clamp(piece[0], piece[1]);
                beside.0[parameter] = theta_at(parameter, moved);
            }
            Point {
                theta: beside,
                is_base,
                coarse: coarse[index] * per_theta,
                fine: fine[index] * per_theta,
            }
        }),
    }
}

fn unit(at: f64, step: f64) -> Coordinate {
    let piece = [0.0, 1.0];
    Coordinate { at, piece, step }
}

/// The lobe's widths are powers of a, and its exponents cubes,
/// so the length in its logarithm is chosen as 1/2. At R = 90 and above it is
/// the derivative to the left or to the right.
fn roughness(theta: f64, share: f64) -> Coordinate {
    let base_log = |theta: f64| libm::log(BASE[0] + BASE[1] * theta);
    let [low, high] = if theta <= LAMBERT_FROM {
        [0.0, LAMBERT_FROM]
    } else {
        [LAMBERT_FROM, 1.0]
    };
    Coordinate {
        at: base_log(theta),
        piece: [base_log(low), base_log(high)],
        step: 0.5 * share,
    }
}

fn theta_at(parameter: usize, coordinate: f64) -> f64 {
    match parameter {
        ROUGHNESS => ((libm::exp(coordinate) - BASE[0]) / BASE[1]).clamp(0.0, 1.0),
        RGB0.. => Encoding::Srgb.value(coordinate),
        _ => coordinate,
    }
}

fn theta_slope(parameter: usize, coordinate: f64) -> f64 {
    match parameter {
        ROUGHNESS => libm::exp(coordinate) / BASE[1],
        // The slope at white is the one from below.
        RGB0.. => Encoding::Srgb.derivative(coordinate.min(1.0f64.next_down())),
        _ => 1.0,
    }
}

/// a and a + A^3, whose powers 3/2 are the lobe's widths in slopes.
fn bases(theta: &Theta) -> [f64; 2] {
    let (a, anisotropy) = (BASE[0] + BASE[1] * theta.0[ROUGHNESS], theta.0[ANISOTROPY]);
    [a, a + anisotropy * anisotropy * anisotropy]
}

/// The wider axis follows log(a + A^3), whose derivative by A is 3 A^2 / (a + A^3). Where A is small
/// it is the third power that limits the step: its length is the cube root of a.
fn anisotropy_length(theta: &Theta) -> f64 {
    let [a, b] = bases(theta);
    let sum = theta.0[ANISOTROPY] + libm::cbrt(a);
    b / (sum * sum)
}

/// A rotation by d psi moves the lobe's ridge by d psi times how far out it reaches. That is compared
/// with the ridge's width, or with the bulb's where that is larger.
fn angle_length(theta: &Theta) -> f64 {
    let [narrow, wide] = bases(theta).map(|base| base * base.sqrt());
    let length = narrow.max(FEATURE_SLOPE) / (3.0 * wide).min(1.0);
    length.min(1.0) / PI * 2.0
}

/// Under `hue` a colour counts relative to the luminance of T = RGB90 (1 - cos_o) + RGB0 cos_o and to
/// its largest channel. The smallest step of all views is taken.
fn colour_step(
    theta: &Theta,
    parameter: usize,
    cosines: &[f64],
    tint: Tint,
    share: f64,
) -> Option<f64> {
    if tint == Tint::Product {
        return Some(COLOUR_STEP_MAX);
    }
    let material = theta.material();
    let channel = (parameter - RGB0) % 3;
    let mut step = COLOUR_STEP_MAX;
    for &cosine in cosines {
        let grazing = (1.0 - cosine).max(GRAZING_SHARE_MIN);
        let tint: [f64; 3] = std::array::from_fn(|channel| {
            material.rgb90[channel] * grazing + material.rgb0[channel] * cosine
        });
        let largest = tint[0].max(tint[1]).max(tint[2]);
        if largest <= 0.0 && theta.0[ROUGHNESS] < 1.0 {
            return None;
        }
        let luminance: f64 = (0..3).map(|index| LUMINANCE[index] * tint[index]).sum();
        let part = if parameter < RGB90 { cosine } else { grazing };
        let length = largest.min(luminance / LUMINANCE[channel]) / part;
        step = step.min(share * length);
    }
    Some(step.max(COLOUR_STEP_MIN))
}

/// How many renderings of a view the derivatives by all parameters take at most, over four steps.
pub(crate) const RENDERINGS_MAX: usize = 1 + 4 * 4 * PARAMETERS;

#[cfg(test)]
mod tests {
    use super::*;
    use dataset::HARD_CASES;

    /// Weights applied to powers of the coordinate's distance.
    #[test]
    fn stencils_differentiate_parabolas_and_stay_inside() {
        let preset = Specification::preset();
        let drawn = (0..100).map(|index| preset.material(index).material);
        for material in drawn.chain(HARD_CASES.map(|case| case.material)) {
            let theta = Theta::of(&material);
            for parameter in 0..PARAMETERS {
                let Some(stencil) = stencil(&theta, parameter, &[0.5, 1.0], Tint::Hue, SHARE)
                else {
                    assert!(parameter >= RGB0, "{material:?}");
                    continue;
                };
                let at = theta.0[parameter];
                let below = at <= LAMBERT_FROM;
                let (mut sum, mut slope) = (0.0, 0.0);
                for point in &stencil.points {
                    let there = point.theta.0[parameter];
                    if parameter == ROUGHNESS {
                        let same = there <= LAMBERT_FROM + 1e-12;
                        assert!(same == below || (there - LAMBERT_FROM).abs() < 1e-12);
                    }
                    assert!(parameter == ANGLE || (0.0..=1.0).contains(&there));
                    sum += point.weight();
                    let along = if parameter < RGB0 {
                        there - at
                    } else {
                        let [there, at] = [there, at].map(colour::linear_from_srgb);
                        (there - at) * theta_slope(parameter, at)
                    };
                    slope += point.weight() * along;
                }
                let size = stencil.points[3].weight().abs();
                assert!(sum.abs() <= 1e-9 * size, "{sum}");
                // The roughness is an exponential of its coordinate.
                assert!(
                    (slope - 1.0).abs() < 1e-3,
                    "{parameter} of {material:?}: {slope}"
                );
            }
        }
    }

    #[test]
    fn black_has_no_derivative_by_its_hue() {
        let mut theta = Theta([0.5, 0.5, 0.5, 0.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
        let by_red = |theta: &Theta, tint| stencil(theta, RGB0, &[1.0], tint, SHARE).is_some();
        assert!(!by_red(&theta, Tint::Hue));
        assert!(by_red(&theta, Tint::Product));
        theta.0[ROUGHNESS] = 1.0;
        assert!(by_red(&theta, Tint::Hue));
    }
}

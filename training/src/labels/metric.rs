//! How much the photographs change with the labels: the metric of the metric loss.

use super::PARAMETERS;
use super::axes::Colours;
use dataset::Material;
use dataset::colour::{linear_from_lab, srgb_from_linear};
use inverse::gauge::Covariance;
use inverse::information::WEIGHT_NOISE_SD;
use inverse::parameters::{RGB0, RGB90};

/// The step of difference quotients in CIELAB.
const LAB_STEP: f64 = 1e-4;

/// The step of difference quotients of sRGB codes, in linear light.
const LINEAR_STEP: f64 = 1e-6;

/// M = D' (J'J / s^2) D, row by row: with labels off by e, as shares of their ranges, e' M e is to
/// second order the squared change of the photographs in standard deviations of the noise s, two
/// steps of 8 bits. `information` is J'J, row by row, for noise of unit variance; D is the derivative
/// of the parameters by the labels.
pub fn metric(
    information: &[f64; PARAMETERS * PARAMETERS],
    material: &Material,
    colours: Colours,
) -> [f64; PARAMETERS * PARAMETERS] {
    let derivative = derivative(material, colours);
    let information = Covariance::from_row_slice(information);
    let metric = derivative.transpose() * information * derivative;
    let metric = metric / (WEIGHT_NOISE_SD * WEIGHT_NOISE_SD);
    std::array::from_fn(|at| metric[(at / PARAMETERS, at % PARAMETERS)])
}

/// The derivative of the parameters over their ranges by the labels over theirs. R, A, psi and N_d
/// are labels themselves, and sRGB codes are. The factor that scaled colours leave out is held: images
/// do not depend on it.
fn derivative(material: &Material, colours: Colours) -> Covariance {
    let mut derivative = Covariance::identity();
    if colours == Colours::Rgb {
        return derivative;
    }
    let labels = colours.values(material);
    let axes = colours.axes();
    let lab = |first: usize| [labels[first], labels[first + 1], labels[first + 2]];
    let brightest =
        |colours: [[f64; 3]; 2]| colours.as_flattened().iter().copied().fold(0.0, f64::max);
    let told = brightest([RGB0, RGB90].map(|first| linear_from_lab(lab(first))));
    let factor = match told > 0.0 {
        true => brightest([material.rgb0, material.rgb90]) / told,
        false => 1.0,
    };
    for (first, colour) in [(RGB0, material.rgb0), (RGB90, material.rgb90)] {
        for (label, axis) in axes.iter().enumerate().skip(first).take(3) {
            let at = |step: f64| {
                let mut lab = lab(first);
                lab[label - first] += step;
                linear_from_lab(lab)
            };
            let (below, above) = (at(-LAB_STEP), at(LAB_STEP));
            let [low, high] = axis.range;
            for channel in 0..3 {
                let slope = (above[channel] - below[channel]) / (2.0 * LAB_STEP);
                derivative[(first + channel, label)] =
                    code_slope(colour[channel]) * factor * slope * (high - low);
            }
        }
    }
    derivative
}

/// The derivative of the sRGB code by the linear value.
fn code_slope(linear: f64) -> f64 {
    let linear = linear.max(LINEAR_STEP);
    let [below, above] = [linear - LINEAR_STEP, linear + LINEAR_STEP].map(srgb_from_linear);
    (above - below) / (2.0 * LINEAR_STEP)
}

#[cfg(test)]
mod tests {
    use super::*;
    use dataset::{HARD_CASES, Specification};
    use inverse::Theta;

    /// J'J of some number of pixels whose values are linear in the parameters.
    fn information(seed: u64) -> [f64; PARAMETERS * PARAMETERS] {
        let mut state = seed;
        let mut draw = || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1);
            (state >> 40) as f64 / f64::from(1 << 24) - 0.5
        };
        let jacobian: Vec<[f64; PARAMETERS]> =
            (0..30).map(|_| std::array::from_fn(|_| draw())).collect();
        std::array::from_fn(|at| {
            let rows = jacobian.iter();
            rows.map(|row| row[at / PARAMETERS] * row[at % PARAMETERS])
                .sum()
        })
    }

    fn quadratic(matrix: &[f64; PARAMETERS * PARAMETERS], [e, f]: [&[f64; PARAMETERS]; 2]) -> f64 {
        let terms = matrix.iter().enumerate();
        terms
            .map(|(at, value)| value * e[at / PARAMETERS] * f[at % PARAMETERS])
            .sum()
    }

    /// The parameters that labels describe, with `factor` times the light of scaled colours; colours
    /// may lie outside the gamut.
    fn theta(labels: &[f64; PARAMETERS], colours: Colours, factor: f64) -> Theta {
        let mut theta = Theta::of(&colours.material(labels));
        for first in [RGB0, RGB90] {
            let colour = [labels[first], labels[first + 1], labels[first + 2]];
            let codes = match colours {
                Colours::Rgb => colour,
                _ => linear_from_lab(colour).map(|channel| srgb_from_linear(channel * factor)),
            };
            theta.0[first..first + 3].copy_from_slice(&codes);
        }
        theta
    }

    #[test]
    fn a_change_of_labels_is_the_change_of_parameters_that_it_makes() {
        let preset = Specification::preset();
        let variance = WEIGHT_NOISE_SD * WEIGHT_NOISE_SD;
        for index in 0..60 {
            let material = preset.material(index).material;
            let brightest = material.rgb0.iter().chain(&material.rgb90);
            let brightest = brightest.copied().fold(0.0, f64::max);
            for colours in [Colours::Lab, Colours::Rgb, Colours::Scaled] {
                let scaled = colours == Colours::Scaled && material.roughness <= 90.0;
                let factor = if scaled { brightest } else { 1.0 };
                let labels = colours.values(&material);
                let is = theta(&labels, colours, factor);
                let off = is.difference(&Theta::of(&material)).map(f64::abs);
                assert!(off.into_iter().all(|off| off < 1e-9), "{off:?}");
                let information = information(u64::from(index));
                let metric = metric(&information, &material, colours);
                for label in 0..PARAMETERS {
                    let [low, high] = colours.axes()[label].range;
                    let by = |share: f64| {
                        let mut changed = labels;
                        changed[label] += share * (high - low);
                        theta(&changed, colours, factor)
                    };
                    const STEP: f64 = 1e-5;
                    let slope = by(STEP).difference(&by(-STEP)).map(|d| d / (2.0 * STEP));
                    let wanted = quadratic(&information, [&slope; 2]) / variance;
                    let found = metric[label * PARAMETERS + label];
                    assert!(
                        (found - wanted).abs() <= 1e-4 * wanted,
                        "{index} {colours:?} {label}: {found:e} {wanted:e}"
                    );
                }
            }
        }
    }

    #[test]
    fn the_metric_is_finite_and_no_change_is_negative() {
        let preset = Specification::preset();
        let drawn = (0..200).map(|index| preset.material(index).material);
        for (index, material) in drawn
            .chain(HARD_CASES.map(|case| case.material))
            .enumerate()
        {
            for colours in [Colours::Lab, Colours::Rgb, Colours::Scaled] {
                let metric = metric(&information(index as u64), &material, colours);
                assert!(metric.iter().all(|entry| entry.is_finite()), "{material:?}");
                let error = std::array::from_fn(|at| (at as f64 - 4.5) * 0.1);
                let change = quadratic(&metric, [&error; 2]);
                assert!(change >= -1e-9, "{material:?}: {change:e}");
            }
        }
    }
}

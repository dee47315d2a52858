//! How much a material's photographs tell of each label.

use super::PARAMETERS;
use super::axes::Colours;
use dataset::Material;
use dataset::specification::Tint;
use inverse::Theta;
use inverse::gauge::{Covariance, scaled_covariance};
use inverse::information::WEIGHT_NOISE_SD;
use inverse::parameters::{RGB0, RGB90};

/// One over the variance of a parameter that is uniform over its range.
const UNIFORM_PRECISION: f64 = 12.0;

/// The least weight: a batch whose labels show nowhere must not weigh nothing.
const WEIGHT_MIN: f64 = 1e-3;

/// For each label the share of the variance of a uniform prior that photographs with noise of two
/// steps of 8 bits remove, 0.001 to 1: w = 1 - 12 [(J'J/s^2 + 12 I)^-1]_ii. `information` is J'J, row
/// by row, for noise of unit variance.
///
/// CIELAB mixes channels, so its labels have the mean of their colour's. Labels that are scaled where
/// only the hue of colours shows have the weight of scaled colours.
pub fn weights(
    information: &[f64; PARAMETERS * PARAMETERS],
    material: &Material,
    tint: Tint,
    colours: Colours,
) -> [f64; PARAMETERS] {
    let precision = Covariance::from_row_slice(information) / (WEIGHT_NOISE_SD * WEIGHT_NOISE_SD)
        + Covariance::identity() * UNIFORM_PRECISION;
    // Only numbers that are not those of a matrix J'J have none.
    let Some(factors) = precision.cholesky() else {
        return [WEIGHT_MIN; PARAMETERS];
    };
    let mut covariance = factors.inverse();
    if colours == Colours::Scaled {
        covariance = scaled_covariance(&Theta::of(material), &covariance, tint);
    }
    let weight = |parameter: usize| 1.0 - UNIFORM_PRECISION * covariance[(parameter, parameter)];
    let mean = |first: usize| (first..first + 3).map(weight).sum::<f64>() / 3.0;
    std::array::from_fn(|parameter| {
        let weight = match parameter {
            ..RGB0 => weight(parameter),
            _ if colours == Colours::Rgb => weight(parameter),
            RGB0..RGB90 => mean(RGB0),
            _ => mean(RGB90),
        };
        weight.clamp(WEIGHT_MIN, 1.0)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use dataset::Specification;

    fn diagonal(precisions: [f64; PARAMETERS]) -> [f64; PARAMETERS * PARAMETERS] {
        let variance = WEIGHT_NOISE_SD * WEIGHT_NOISE_SD;
        std::array::from_fn(|at| match at % (PARAMETERS + 1) {
            0 => variance * precisions[at / (PARAMETERS + 1)],
            _ => 0.0,
        })
    }

    #[test]
    fn weights_are_shares_of_the_prior_s_variance() {
        let preset = Specification::preset();
        let material = preset.material(2).material;
        let nothing = diagonal([0.0; PARAMETERS]);
        let found = weights(&nothing, &material, preset.tint, Colours::Rgb);
        assert_eq!(found, [WEIGHT_MIN; PARAMETERS]);
        let mut precisions = [12.0; PARAMETERS];
        precisions[4] = 1e9;
        let found = weights(&diagonal(precisions), &material, preset.tint, Colours::Rgb);
        assert!((found[0] - 0.5).abs() < 1e-9 && found[4] > 0.999);
        let found = weights(&diagonal(precisions), &material, preset.tint, Colours::Lab);
        assert!((found[4] - 2.0 / 3.0).abs() < 1e-6 && found[4] == found[6]);
        assert!((found[7] - 0.5).abs() < 1e-9);
    }
}

//! Colours where only their hue shows.
//!
//! Up to R = 90 under the tint `hue` a common factor of both colours changes no image, to the bit.
//! Nothing can tell it, so colours are stated with the factor that makes the largest of the six
//! channels 1.

use crate::parameters::{PARAMETERS, RGB0, ROUGHNESS, Theta};
use crate::steps::LAMBERT_FROM;
use dataset::colour::{linear_from_srgb, srgb_from_linear};
use dataset::specification::Tint;
use nalgebra::SMatrix;

/// Variances and covariances of the ten parameters over their ranges.
pub type Covariance = SMatrix<f64, PARAMETERS, PARAMETERS>;

/// Whether only the hue of a material's colours shows, and there is one.
fn hue_alone(theta: &Theta, tint: Tint) -> bool {
    let bright = theta.0[RGB0..].iter().any(|code| *code > 0.0);
    tint == Tint::Hue && theta.0[ROUGHNESS] <= LAMBERT_FROM && bright
}

/// The parameters with the largest channel 1 where only the hue shows; as they are elsewhere.
#[must_use]
pub fn scaled(theta: &Theta, tint: Tint) -> Theta {
    if !hue_alone(theta, tint) {
        return *theta;
    }
    let largest = linear_from_srgb(theta.0[brightest(theta)]);
    Theta(std::array::from_fn(|index| match index {
        RGB0.. => srgb_from_linear(linear_from_srgb(theta.0[index]) / largest),
        _ => theta.0[index],
    }))
}

/// The covariance of [`scaled`] parameters, from that of `theta`.
pub fn scaled_covariance(theta: &Theta, covariance: &Covariance, tint: Tint) -> Covariance {
    if !hue_alone(theta, tint) {
        return *covariance;
    }
    let brightest = brightest(theta);
    let codes = scaled(theta, tint).0;
    // d ln linear / d code of a channel before and after: a code changes with the logarithm of the
    // ratio of its channel to the brightest.
    let mut jacobian = Covariance::identity();
    for index in RGB0..PARAMETERS {
        let out = 1.0 / log_slope(codes[index]);
        jacobian[(index, index)] = out * log_slope(theta.0[index]);
        jacobian[(index, brightest)] -= out * log_slope(theta.0[brightest]);
    }
    jacobian * covariance * jacobian.transpose()
}

/// The index of the largest channel.
fn brightest(theta: &Theta) -> usize {
    (RGB0..PARAMETERS).fold(RGB0, |best, index| {
        if theta.0[index] > theta.0[best] {
            index
        } else {
            best
        }
    })
}

/// The derivative of ln(linear) by the sRGB code; at black that of a code just above it.
fn log_slope(code: f64) -> f64 {
    let code = code.max(1e-6);
    let linear = linear_from_srgb(code);
    let step = 1e-4 * code;
    (linear_from_srgb(code + step) - linear_from_srgb(code - step)) / (2.0 * step * linear)
}

#[cfg(test)]
mod tests {
    use super::*;

    const THETA: Theta = Theta([0.4, 0.3, 0.2, 0.6, 0.5, 0.2, 0.7, 0.1, 0.0, 0.3]);

    #[test]
    fn a_common_factor_makes_no_difference() {
        let dimmed = Theta(std::array::from_fn(|index| match index {
            RGB0.. => srgb_from_linear(0.3 * linear_from_srgb(THETA.0[index])),
            _ => THETA.0[index],
        }));
        let [one, other] = [THETA, dimmed].map(|theta| scaled(&theta, Tint::Hue).0);
        for index in 0..PARAMETERS {
            assert!((one[index] - other[index]).abs() < 1e-12);
        }
        assert!((one[6] - 1.0).abs() < 1e-12 && one[0] == 0.4);
        assert_eq!(scaled(&THETA, Tint::Product), THETA);
        let black = Theta([0.0; PARAMETERS]);
        assert_eq!(scaled(&black, Tint::Hue), black);
        let mut diffuse = THETA;
        diffuse.0[ROUGHNESS] = 0.95;
        assert_eq!(scaled(&diffuse, Tint::Hue), diffuse);
    }

    #[test]
    fn what_is_not_known_of_a_common_factor_does_not_count() {
        // All uncertainty is along the factor.
        let mut covariance = Covariance::zeros();
        let along: [f64; PARAMETERS] = std::array::from_fn(|index| match index {
            RGB0.. => 1.0 / log_slope(THETA.0[index]),
            _ => 0.0,
        });
        for i in 0..PARAMETERS {
            for j in 0..PARAMETERS {
                covariance[(i, j)] = 0.04 * along[i] * along[j];
            }
        }
        let left = scaled_covariance(&THETA, &covariance, Tint::Hue);
        assert!(left.abs().max() < 1e-12, "{left}");
        // And what is known of a channel alone is scaled with it.
        let mut one = Covariance::zeros();
        one[(4, 4)] = 1e-6;
        let left = scaled_covariance(&THETA, &one, Tint::Hue);
        let moved = |code: f64| {
            let mut theta = THETA;
            theta.0[4] = code;
            scaled(&theta, Tint::Hue).0[4]
        };
        let slope = (moved(0.501) - moved(0.499)) / 0.002;
        assert!((left[(4, 4)].sqrt() - 1e-3 * slope).abs() < 1e-7);
        assert_eq!(scaled_covariance(&THETA, &one, Tint::Product), one);
    }
}

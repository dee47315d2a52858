//! The specular part of the model as every kernel evaluates it: without branches, so that the compiler
//! turns a loop over points into vector instructions.
//!
//! With h the half vector, t the squared tangent of its polar angle, e the lobe's exponent in its
//! direction, N the lobe's normalization and F Fresnel's reflectance (Vidaurre et al. 2019, equations
//! 1 to 5),
//!
//! ```text
//! f cos_i = N / (4 pi)  tint(F)  (1+t)^(-e/2)  cos_i / (|wi + wo| max(cos_i, cos_o)).
//! ```
//!
//! In the slope plane, where h = (p, q, 1)/|.|, the Jacobian of wi -> (p, q) cancels the denominator:
//!
//! ```text
//! f cos_i dwi = N / (2 pi)  tint(F)  (1+t)^(-e/2)  min(1, cos_i/cos_o)  (1+t)^(-3/2)  dp dq.
//! ```
//!
//! The tint is linear in F and in what F exceeds the tint's knee by: see
//! [`TintResponse`](super::TintResponse).

use super::fresnel;
use crate::numerics::elementary::{Log1p, exp};
use crate::vector::Vec3;

/// Minus the logarithm of the lobe's power, (1+t)^(-e/2): for a half vector whose components along the
/// lobe's axes have these squares, up to a common factor, and whose t is `tangent2`.
#[inline(always)]
pub fn depth(exponents: [f64; 2], [u2, v2]: [f64; 2], tangent2: f64) -> f64 {
    let Log1p { k, ratio: [n, d] } = Log1p::of(tangent2);
    // At the normal the quotient is 0/0 and the product 0. Divisions are what takes longest: one serves both
    // quotients.
    let across2 = u2 + v2 + f64::MIN_POSITIVE;
    let inverse = 1.0 / (across2 * d);
    let exponent = (exponents[0] * u2 + exponents[1] * v2) * (d * inverse);
    0.5 * exponent * Log1p::value(k, n * (across2 * inverse))
}

/// `scale` times power cos_i / (|h| `larger`), for a half vector of any length whose components' squares
/// along the lobe's axes and the normal are `half2`. `larger` is max(cos_i, cos_o).
#[inline(always)]
pub fn at_half_vector(
    scale: f64,
    exponents: [f64; 2],
    half2: [f64; 3],
    cos_i: f64,
    larger: f64,
) -> f64 {
    let [u2, v2, z2] = half2;
    let tangential = u2 + v2;
    let length = (tangential + z2).sqrt();
    let Log1p { k, ratio: [n, d] } = Log1p::of(tangential / z2);
    // As in `depth`; and the last quotient by the same division.
    let (across2, divisor) = (tangential + NORMAL_BELOW, length * larger);
    let inverse = 1.0 / (across2 * d * divisor);
    let exponent = (exponents[0] * u2 + exponents[1] * v2) * (d * divisor * inverse);
    let depth = 0.5 * exponent * Log1p::value(k, n * (across2 * divisor * inverse));
    scale * exp(-depth) * cos_i * (across2 * d * inverse)
}

/// A half vector whose square across the normal is no more is at the normal. No product of it and other divisors
/// is 0.
const NORMAL_BELOW: f64 = 1e-200;

/// Farther out no slope's square counts.
const TANGENT2_MAX: f64 = 1e100;

/// The power (1+t)^(-3/2) at slopes (p, q), the power times exp(`shift`); and the cosine of the direction to
/// the light for a viewer `wo` in the lobe's frame.
#[inline(always)]
pub fn at_slopes(exponents: [f64; 2], wo: &Vec3, [p, q]: [f64; 2], shift: f64) -> [f64; 2] {
    let (p2, q2) = (p * p, q * q);
    let t = p2 + q2;
    let t = if t < TANGENT2_MAX { t } else { TANGENT2_MAX };
    let Log1p { k, ratio: [n, d] } = Log1p::of(t);
    // As in `depth`, one division serves all quotients.
    let (across2, length2) = (t + f64::MIN_POSITIVE, 1.0 + t);
    let inverse = 1.0 / (across2 * (d * length2));
    let exponent = (exponents[0] * p2 + exponents[1] * q2) * (d * length2 * inverse);
    let depth = 0.5 * exponent * Log1p::value(k, n * (across2 * length2 * inverse));
    let per_length2 = across2 * d * inverse;
    let power = exp(shift - depth);
    let cos_i = 2.0 * (wo.x * p + wo.y * q + wo.z) * per_length2 - wo.z;
    [power * per_length2 * per_length2.sqrt(), cos_i]
}

/// The cosine of the direction to the light for slopes (p, q) and a viewer `wo` in the lobe's frame.
#[inline(always)]
pub fn cos_i(wo: &Vec3, [p, q]: [f64; 2]) -> f64 {
    let inverse = 1.0 / (1.0 + (p * p + q * q));
    2.0 * (wo.x * p + wo.y * q + wo.z) * inverse - wo.z
}

/// Fresnel's reflectance, and what it exceeds the tint's knee by.
#[inline(always)]
pub fn fresnel_moments(cos_i: f64, ior: f64, knee: f64) -> [f64; 2] {
    let fresnel = fresnel::reflectance(cos_i, ior);
    let beyond = fresnel - knee;
    [fresnel, if beyond > 0.0 { beyond } else { 0.0 }]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reflectance::Reflectance;
    use dataset::{Material, specification::Tint};
    use proptest::prelude::*;
    use std::f64::consts::{FRAC_1_PI, PI};

    /// There the exponent is 0/0, and divisors that share a division are as small as numbers get.
    #[test]
    fn about_the_normal_and_the_horizon_it_is_finite() {
        let sizes = [0.0, 1e-308, 1e-210, 1e-200, 1e-190, 1e-100, 1e-30, 1e-8];
        for (u2, v2) in sizes.iter().flat_map(|u2| sizes.map(|v2| (*u2, v2))) {
            for larger in [1e-16, 1e-8, 0.3, 1.0] {
                for exponents in [[2.0, 2.0], [1e16, 2.0], [1e16, 1e16]] {
                    let found = at_half_vector(3.0, exponents, [u2, v2, 2.0], larger, larger);
                    let depth = 0.5 * (exponents[0] * u2 + exponents[1] * v2) / 2.0;
                    let expected = 3.0 * libm::exp(-depth) / 2f64.sqrt();
                    let off = (found - expected).abs();
                    assert!(
                        off < 1e-6 * expected + 1e-300,
                        "{u2} {v2} {larger}: {found}"
                    );
                }
            }
        }
    }

    proptest! {
        #[test]
        fn both_forms_are_the_model(
            roughness in 20.0..90.0f64, anisotropy in 0.0..1.0f64, ior in 1.0..10.0f64,
            rgb0 in prop::array::uniform3(0.0..1.0f64), rgb90 in prop::array::uniform3(0.0..1.0f64),
            i in prop::array::uniform2(-2.0..2.0f64), o in prop::array::uniform2(-2.0..2.0f64),
        ) {
            let material = Material { roughness, anisotropy, angle_deg: 0.0, ior, rgb0, rgb90 };
            let [wi, wo] = [i, o].map(|[x, y]| Vec3::new(x, y, 1.0).normalized());
            let reflectance = Reflectance::new(&material, 0.0, Tint::Hue);
            let lobe = &reflectance.lobe;
            let (exponents, half) = ([lobe.n_u, lobe.n_v], wi + wo);
            let response = reflectance.tint_response(wo.z);
            let [fresnel, excess] = fresnel_moments(wi.z, ior, response.knee);
            let tint = response.at_moments(fresnel, excess);

            let half2 = [half.x * half.x, half.y * half.y, half.z * half.z];
            let scale = 0.25 * FRAC_1_PI * lobe.normalization;
            let direct = at_half_vector(scale, exponents, half2, wi.z, wi.z.max(wo.z));

            let slopes = [half.x / half.z, half.y / half.z];
            prop_assert!((cos_i(&wo, slopes) - wi.z).abs() < 1e-12);
            // dwi = 4 (wo.h) (1+t)^(-3/2) dp dq
            let along = half.dot(wo) / half.length();
            let scale = 0.5 / PI * lobe.normalization * (wi.z / wo.z).min(1.0);
            let t = slopes[0] * slopes[0] + slopes[1] * slopes[1];
            let jacobian = 4.0 * along / ((1.0 + t) * (1.0 + t).sqrt());
            let [value, cosine] = at_slopes(exponents, &wo, slopes, 0.0);
            prop_assert!((cosine - wi.z).abs() < 1e-12);
            let in_plane = scale * value / jacobian;

            let expected = reflectance.evaluate(wi, wo);
            for channel in 0..3 {
                let model = expected[channel] * wi.z;
                for found in [direct, in_plane] {
                    let off = (found * tint[channel] - model).abs();
                    prop_assert!(off < 1e-10 * (1.0 + model), "{} {}", found, model);
                }
            }
        }
    }
}

//! exp and log1p without branches or tables, for kernels: the compiler turns a loop of them into
//! vector instructions. Within three units of the last place of `libm`'s.

use std::f64::consts::LN_2;

/// 1.5 * 2^52: added to a number below 2^51 it leaves its integer part in the low bits.
pub const ROUND: f64 = 6_755_399_441_055_744.0;

/// The high part of ln 2, with zeros enough that a multiple of up to 2^11 is exact.
const LN_2_HIGH: f64 = f64::from_bits(0x3fe6_2e42_fee0_0000);
/// The rest.
const LN_2_LOW: f64 = 1.908_214_929_270_587_7e-10;

/// Below this exp is taken for that of it, 1e-304.
const EXP_MIN: f64 = -700.0;

/// c0 + c1 x + c2 x^2 + c3 x^3, by pairs: Horner's order is one chain of operations that wait for each other, and the
/// processor waits with them (Estrin 1960).
#[inline(always)]
fn cubic([c0, c1, c2, c3]: [f64; 4], x: f64, x2: f64) -> f64 {
    (c0 + c1 * x) + (c2 + c3 * x) * x2
}

/// exp(x) for x of at most 700.
#[inline(always)]
pub fn exp(x: f64) -> f64 {
    let x = if x < EXP_MIN { EXP_MIN } else { x };
    let shifted = x * (1.0 / LN_2) + ROUND;
    let k = shifted - ROUND;
    let r = (x - k * LN_2_HIGH) - k * LN_2_LOW;
    // Taylor's series: |r| < 0.35.
    let r2 = r * r;
    let r4 = r2 * r2;
    let low = cubic([0.5, 1.0 / 6.0, 1.0 / 24.0, 1.0 / 120.0], r, r2);
    let middle = [1.0 / 720.0, 1.0 / 5_040.0, 1.0 / 40_320.0, 1.0 / 362_880.0];
    let high = [
        1.0 / 3_628_800.0,
        1.0 / 39_916_800.0,
        1.0 / 479_001_600.0,
        1.0 / 6_227_020_800.0,
    ];
    let sum = low + (cubic(middle, r, r2) + cubic(high, r, r2) * r4) * r4;
    let value = 1.0 + (r + r2 * sum);
    f64::from_bits(value.to_bits().wrapping_add(shifted.to_bits() << 52))
}

/// ln(1 + t) for t of 0 to 1e300.
#[inline(always)]
pub fn log1p(t: f64) -> f64 {
    let Log1p { k, ratio: [n, d] } = Log1p::of(t);
    Log1p::value(k, n / d)
}

/// ln(1 + t) as k ln 2 + 2 artanh(n / d), for callers that divide by other numbers at once.
pub struct Log1p {
    /// A whole number.
    pub k: f64,
    /// n and d; d is between 1.7 and 2.5.
    pub ratio: [f64; 2],
}

impl Log1p {
    /// For t of 0 to 1e300.
    #[inline(always)]
    pub fn of(t: f64) -> Self {
        // 1 + t = m 2^k with m between sqrt(1/2) and sqrt(2).
        const HALF_ROOT: u64 = 0x3fe6_a09e_667f_3bcd;
        const ONE: u64 = 1.0f64.to_bits();
        let u = 1.0 + t;
        let bits = u.to_bits().wrapping_add(ONE - HALF_ROOT);
        let m = f64::from_bits((bits & ((1 << 52) - 1)) + HALF_ROOT);
        // The biased exponent fills the low bits of ROUND's successor of 2^52.
        let k = f64::from_bits((bits >> 52) | 0x4330_0000_0000_0000)
            - (4_503_599_627_370_496.0 + 1023.0);
        // Of a small t no digit is lost in 1 + t.
        let small = t < 0.4;
        let numerator = if small { t } else { m - 1.0 };
        let denominator = if small { 2.0 + t } else { m + 1.0 };
        let k = if small { 0.0 } else { k };
        Self {
            k,
            ratio: [numerator, denominator],
        }
    }

    /// The logarithm, where n / d is `s`.
    #[inline(always)]
    pub fn value(k: f64, s: f64) -> f64 {
        // 2 artanh(s) by its series: s^2 < 0.0295, and what is left out is 1e-17 of it.
        let z = s * s;
        let z2 = z * z;
        let z4 = z2 * z2;
        let low = cubic([2.0 / 3.0, 2.0 / 5.0, 2.0 / 7.0, 2.0 / 9.0], z, z2);
        let high = cubic([2.0 / 11.0, 2.0 / 13.0, 2.0 / 15.0, 2.0 / 17.0], z, z2);
        let sum = low + (high + (2.0 / 19.0) * z4) * z4;
        k * LN_2_HIGH + (k * LN_2_LOW + (s * z * sum + 2.0 * s))
    }
}

/// The inverse of sinh, for |x| up to 1e150.
#[inline(always)]
pub fn asinh(x: f64) -> f64 {
    let size = x.abs();
    let value = log1p(size + x * x / (1.0 + (1.0 + x * x).sqrt()));
    if x < 0.0 { -value } else { value }
}

/// ln(x) of a positive normal x within 0.007: for counts of points.
#[inline(always)]
pub fn about_ln(x: f64) -> f64 {
    const ONE: u64 = 1.0f64.to_bits();
    let bits = x.to_bits();
    let exponent = (bits >> 52) as f64 - 1023.0;
    let m = f64::from_bits((bits & ((1 << 52) - 1)) | ONE);
    // The logarithm of base 2 between 1 and 2, by the parabola that is right at both and at 1.5.
    let parabola = (m - 1.0) * (1.339_85 - 0.339_85 * (m - 1.0));
    LN_2 * (exponent + parabola)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numerics::batch::LANES;
    use crate::numerics::instructions::{Instructions, kernel};
    use dataset::Digest;
    use proptest::prelude::*;

    fn off(found: f64, expected: f64) -> f64 {
        (found - expected).abs() / expected.abs().max(f64::MIN_POSITIVE)
    }

    #[test]
    fn ends_are_exact() {
        assert_eq!(exp(0.0), 1.0);
        assert_eq!(log1p(0.0), 0.0);
        assert!(exp(-1e9) < 1e-303 && exp(f64::NEG_INFINITY) < 1e-303);
        assert_eq!(log1p(1e-300), 1e-300);
    }

    kernel! {
        pub fn exp_log1p_asinh(arguments: &[[f64; LANES]], values: &mut [[[f64; LANES]; 3]]) {
            for (x, values) in arguments.iter().zip(values) {
                for i in 0..LANES {
                    values[0][i] = exp(-x[i]);
                    values[1][i] = log1p(x[i]);
                    values[2][i] = asinh(-x[i]);
                }
            }
        }
    }

    /// The digest was written down on x86-64. Other processors must find the same bits, and so must
    /// every instruction set.
    #[test]
    fn the_bits_are_those_written_down_on_every_instruction_set() {
        const WRITTEN_DOWN: &str =
            "48ea9e6133bf50cb49c7971191af168e07086e0684c502a4a930849bf0e3721b";
        // 0, a denormal, then 80,000 numbers from 1e-40 to 1e5 whose digits are irregular.
        let mut argument = 1e-40;
        let mut arguments = vec![[0.0; LANES], [f64::MIN_POSITIVE / 3.0; LANES]];
        for _ in 0..10_000 {
            arguments.push(std::array::from_fn(|_| {
                argument *= 1.001_3;
                argument
            }));
        }
        assert!((1e5..1e6).contains(&argument), "{argument:e}");
        for instructions in Instructions::available() {
            let mut values = vec![[[0.0; LANES]; 3]; arguments.len()];
            exp_log1p_asinh(instructions, &arguments, &mut values);
            let numbers = values.as_flattened().as_flattened();
            let bytes: Vec<u8> = numbers.iter().flat_map(|v| v.to_le_bytes()).collect();
            assert_eq!(
                Digest::of(&bytes).to_string(),
                WRITTEN_DOWN,
                "{instructions}"
            );
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(100_000))]
        #[test]
        fn exp_is_that_of_the_library(x in -690.0..0.0f64) {
            prop_assert!(off(exp(x), libm::exp(x)) < 4e-16);
        }

        #[test]
        fn asinh_is_that_of_the_library(digits in -18.0..100.0f64, near in -4.0..4.0f64) {
            for x in [libm::exp10(digits), near] {
                prop_assert!(off(asinh(x), libm::asinh(x)) < 1e-15, "{}", x);
            }
        }

        #[test]
        fn about_ln_is_about_ln(digits in -300.0..300.0f64) {
            let x = libm::exp10(digits);
            prop_assert!((about_ln(x) - libm::log(x)).abs() < 7e-3, "{}", x);
        }

        #[test]
        fn log1p_is_that_of_the_library(digits in -18.0..300.0f64, near in 0.0..4.0f64) {
            for t in [libm::exp10(digits), near] {
                prop_assert!(off(log1p(t), libm::log1p(t)) < 7e-16, "{}", t);
            }
        }
    }
}

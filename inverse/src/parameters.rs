//! A material as ten numbers in 0 to 1.

use dataset::{Material, colour, specification::limits};

/// How many parameters a material has.
pub const PARAMETERS: usize = 10;

/// The index of the roughness R.
pub const ROUGHNESS: usize = 0;
/// The index of the anisotropy A.
pub const ANISOTROPY: usize = 1;
/// The index of the anisotropy angle psi, which is periodic.
pub const ANGLE: usize = 2;
/// The index of the index of refraction N_d.
pub const IOR: usize = 3;
/// The index of the red channel at 0 degrees; green and blue follow.
pub const RGB0: usize = 4;
/// The index of the red channel at 90 degrees; green and blue follow.
pub const RGB90: usize = 7;

/// The names of the parameters in order.
pub const NAMES: [&str; PARAMETERS] = [
    "roughness",
    "anisotropy",
    "angle",
    "ior",
    "red0",
    "green0",
    "blue0",
    "red90",
    "green90",
    "blue90",
];

/// The ten parameters theta as fractions of their ranges: R/100, A, psi/180, (N_d - 1)/9, RGB0 and
/// RGB90.
///
/// Colours are sRGB codes, not linear values. Datasets sample codes uniformly, so every
/// coordinate but those of a narrowed range has a uniform prior of variance 1/12, and equal steps
/// of a code are about equally visible. psi/180 has period 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Theta(pub [f64; PARAMETERS]);

impl Theta {
    /// The parameters of `material`. A linear channel comes back from [`Theta::material`] within
    /// 1e-8.
    pub fn of(material: &Material) -> Self {
        let [r0, g0, b0] = material.rgb0.map(colour::srgb_from_linear);
        let [r90, g90, b90] = material.rgb90.map(colour::srgb_from_linear);
        let ior = (material.ior - limits::IOR.start()) / range(&limits::IOR);
        Self([
            material.roughness / range(&limits::ROUGHNESS_PERCENT),
            material.anisotropy,
            material.angle_deg / range(&limits::ANGLE_DEG),
            ior,
            r0,
            g0,
            b0,
            r90,
            g90,
            b90,
        ])
    }

    /// The material of these parameters. The angle is taken modulo its period; every other
    /// parameter outside 0 to 1 is moved to the nearer end.
    pub fn material(&self) -> Material {
        let t = self.normalized().0;
        let channel = |index: usize| colour::linear_from_srgb(t[index]).clamp(0.0, 1.0);
        let colour = |first: usize| [channel(first), channel(first + 1), channel(first + 2)];
        let ior = limits::IOR.start() + range(&limits::IOR) * t[IOR];
        Material {
            roughness: range(&limits::ROUGHNESS_PERCENT) * t[ROUGHNESS],
            anisotropy: t[ANISOTROPY],
            angle_deg: range(&limits::ANGLE_DEG) * t[ANGLE],
            ior: ior.clamp(*limits::IOR.start(), *limits::IOR.end()),
            rgb0: colour(RGB0),
            rgb90: colour(RGB90),
        }
    }

    /// The same with the angle in `[0, 1)` and every other parameter in 0 to 1. NaN becomes 0.
    #[must_use]
    pub fn normalized(&self) -> Self {
        Self(std::array::from_fn(|index| {
            let value = self.0[index];
            match index {
                _ if value.is_nan() => 0.0,
                ANGLE => {
                    let turn = value - value.floor();
                    // The difference rounds to 1 for a tiny negative value.
                    if turn < 1.0 { turn } else { 0.0 }
                }
                _ => value.clamp(0.0, 1.0),
            }
        }))
    }

    /// `self - other`, the angle the shorter way round: -1/2 to 1/2.
    pub fn difference(&self, other: &Self) -> [f64; PARAMETERS] {
        std::array::from_fn(|index| {
            let difference = self.0[index] - other.0[index];
            match index {
                ANGLE => difference - (difference + 0.5).floor(),
                _ => difference,
            }
        })
    }
}

fn range(limits: &std::ops::RangeInclusive<f64>) -> f64 {
    limits.end() - limits.start()
}

#[cfg(test)]
mod tests {
    use super::*;
    use dataset::{HARD_CASES, Specification};

    #[test]
    fn materials_come_back() {
        let preset = Specification::preset();
        let drawn = (0..200).map(|index| preset.material(index).material);
        for material in drawn.chain(HARD_CASES.map(|case| case.material)) {
            let theta = Theta::of(&material);
            let back = theta.material();
            assert_eq!(back.check(), Ok(()));
            let turn_deg = (back.angle_deg - material.angle_deg).rem_euclid(180.0);
            assert!(turn_deg.min(180.0 - turn_deg) < 1e-12);
            assert!((back.roughness - material.roughness).abs() < 1e-12);
            assert_eq!(back.anisotropy, material.anisotropy);
            assert!((back.ior - material.ior).abs() < 1e-14);
            for (a, b) in [(back.rgb0, material.rgb0), (back.rgb90, material.rgb90)] {
                for channel in 0..3 {
                    assert!((a[channel] - b[channel]).abs() < 1e-8);
                }
            }
        }
    }

    #[test]
    fn colours_are_the_codes_that_were_sampled() {
        let sampled = Specification::preset().material(17);
        let theta = Theta::of(&sampled.material).0;
        let codes = sampled.srgb0.into_iter().chain(sampled.srgb90);
        for (found, code) in theta[RGB0..].iter().zip(codes) {
            assert!((found - code).abs() < 1e-7, "{found} is not {code}");
        }
    }

    #[test]
    fn the_angle_is_periodic_and_the_rest_is_clamped() {
        let theta = Theta([1.2, -0.1, -0.25, f64::NAN, 0.5, 2.0, 0.0, 1.0, 0.5, 0.5]);
        let normalized = theta.normalized().0;
        assert_eq!(normalized[..6], [1.0, 0.0, 0.75, 0.0, 0.5, 1.0]);
        assert_eq!(theta.material().check(), Ok(()));
        assert_eq!(Theta([-1e-300; 10]).normalized().0[ANGLE], 0.0);
        let (mut a, mut b) = (normalized, normalized);
        (a[ANGLE], b[ANGLE]) = (0.95, 0.05);
        let way = Theta(a).difference(&Theta(b))[ANGLE];
        assert!((way + 0.1).abs() < 1e-15, "{way}");
    }
}

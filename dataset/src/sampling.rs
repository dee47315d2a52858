//! Materials drawn from the parameter space.

use crate::{
    Material, colour,
    sobol::{self, DIMENSIONS},
    specification::{Parameters, Specification},
};

/// A material of a set, with the values that its colours were sampled as.
#[derive(Clone, Debug, PartialEq)]
pub struct SampledMaterial {
    /// The index in the set.
    pub index: u32,
    /// Reflectance at 0 degrees, sRGB-encoded, each channel in `[0, 1)`.
    pub srgb0: [f64; 3],
    /// Reflectance at 90 degrees, sRGB-encoded, each channel in `[0, 1)`.
    pub srgb90: [f64; 3],
    /// The ten parameters; colours are linear.
    pub material: Material,
}

impl SampledMaterial {
    /// The reflectance at 0 degrees as CIELAB under D65: L* 0 to 100, a*, b*.
    pub fn lab0(&self) -> [f64; 3] {
        colour::lab_from_linear(self.material.rgb0)
    }

    /// The reflectance at 90 degrees as CIELAB under D65: L* 0 to 100, a*, b*.
    pub fn lab90(&self) -> [f64; 3] {
        colour::lab_from_linear(self.material.rgb90)
    }

    /// The bins, 0 to 99, that the parameters fall into, in the order of
    /// [`colour::BIN_RANGES`].
    pub fn bins(&self) -> [u8; DIMENSIONS] {
        let [l0, a0, b0] = self.lab0();
        let [l90, a90, b90] = self.lab90();
        let Material {
            roughness,
            anisotropy,
            angle_deg,
            ior,
            ..
        } = self.material;
        let values = [
            roughness, anisotropy, angle_deg, ior, l0, a0, b0, l90, a90, b90,
        ];
        std::array::from_fn(|parameter| colour::bin(values[parameter], parameter_range(parameter)))
    }
}

fn parameter_range(parameter: usize) -> [f64; 2] {
    colour::BIN_RANGES[parameter].1
}

impl Specification {
    /// Material `index`: a pure function of the index, the seed and the ranges of the parameters,
    /// defined for every index, whatever `materials` says. So the first n materials of a set are
    /// the set of n.
    pub fn material(&self, index: u32) -> SampledMaterial {
        sample(self.seed, &self.parameters, index)
    }
}

/// Material `index` of the set that a seed and ranges make. The sequence's dimensions are, in
/// order, roughness, anisotropy, angle, index of refraction, red, green and blue at 0 degrees, and
/// red, green and blue at 90.
fn sample(seed: u64, ranges: &Parameters, index: u32) -> SampledMaterial {
    let [u_r, u_a, u_psi, u_n, r0, g0, b0, r90, g90, b90] = sobol::point(seed, index);
    let (srgb0, srgb90) = ([r0, g0, b0], [r90, g90, b90]);
    SampledMaterial {
        index,
        srgb0,
        srgb90,
        material: Material {
            roughness: between(ranges.roughness, u_r),
            anisotropy: between(ranges.anisotropy, u_a),
            angle_deg: between(ranges.angle_deg, u_psi),
            ior: between(ranges.ior, u_n),
            rgb0: srgb0.map(colour::linear_from_srgb),
            rgb90: srgb90.map(colour::linear_from_srgb),
        },
    }
}

/// The point a fraction `u` of `[0, 1)` along `[low, high)`, or `low` where both are equal.
fn between([low, high]: [f64; 2], u: f64) -> f64 {
    let value = low + (high - low) * u;
    // The sum can round up to `high`, which the range leaves out.
    if value < high {
        value
    } else {
        low.max(high.next_down())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_are_half_open_and_may_be_a_point() {
        let last = 1.0 - f64::EPSILON / 2.0;
        assert_eq!(between([1.0, 10.0], 0.0), 1.0);
        assert!(between([1.0, 10.0], last) < 10.0);
        assert!(between([1.0, 1.0 + f64::EPSILON], last) == 1.0);
        assert_eq!(between([30.0, 30.0], 0.5), 30.0);
        assert_eq!(between([0.0, 0.0], last), 0.0);
        assert_eq!(
            between([179.999, 180.0], 0.5),
            179.999 + (180.0 - 179.999) * 0.5
        );
    }
}

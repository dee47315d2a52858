//! The ten parameters as labels: each is one number in a range, and a position in bins.

use super::{BINS, PARAMETERS};
use dataset::colour::{
    BIN_RANGES, bin, lab_from_linear, linear_from_lab, linear_from_srgb, srgb_from_linear,
};
use dataset::{HUE_ALONE_TO_PERCENT, Material};
use serde::{Deserialize, Serialize};

/// The index of psi, which alone has a period: a half turn of the sample's axes changes nothing.
pub const PSI: usize = 2;

/// Roughness in percent above which the diffuse part is mixed in and the colours' scale shows. Below
/// it only their hue does: (rgb0, rgb90) and half of both give the same image to the bit.
pub const SCALE_SHOWS_PERCENT: f64 = HUE_ALONE_TO_PERCENT;

/// How the two colours are written in labels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Colours {
    /// CIELAB under D65, in the manifest's bins.
    Lab,
    /// sRGB codes, 0 to 1.
    Rgb,
    /// CIELAB of both colours divided by the largest of their six channels, where only their hue
    /// shows ([`SCALE_SHOWS_PERCENT`]); elsewhere as [`Self::Lab`].
    Scaled,
}

/// One parameter as a label.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Axis {
    /// Its name in tables.
    pub name: &'static str,
    /// The range that the bins divide, in the label's unit.
    pub range: [f64; 2],
    /// Whether both ends are the same.
    pub circular: bool,
}

impl Axis {
    /// The bin of a value, 0 to 99.
    pub fn bin(&self, value: f64) -> u8 {
        bin(value, self.range)
    }

    /// The position of a value in bins: -0.5 at the lower end of the range, 99.5 at the upper.
    pub fn position(&self, value: f64) -> f64 {
        let [low, high] = self.range;
        BINS as f64 * (value - low) / (high - low) - 0.5
    }

    /// The value at a position, held within the range; on a circle brought into it.
    pub fn value(&self, position: f64) -> f64 {
        let [low, high] = self.range;
        let fraction = (position + 0.5) / BINS as f64;
        if self.circular {
            low + (high - low) * (fraction - libm::floor(fraction))
        } else {
            low + (high - low) * fraction.clamp(0.0, 1.0)
        }
    }

    /// How far two values are apart, in the label's unit; on a circle the shorter way.
    pub fn distance(&self, one: f64, other: f64) -> f64 {
        let [low, high] = self.range;
        let distance = (one - other).abs();
        if self.circular {
            distance.min(high - low - distance)
        } else {
            distance
        }
    }
}

impl Colours {
    /// Its name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Lab => "lab",
            Self::Rgb => "rgb",
            Self::Scaled => "scaled",
        }
    }

    /// The ten axes in the order of theta: R, A, psi, N_d, three of RGB0, three of RGB90.
    pub fn axes(self) -> [Axis; PARAMETERS] {
        const CODES: [&str; 6] = ["r0", "g0", "b0", "r90", "g90", "b90"];
        std::array::from_fn(|index| {
            let (mut name, mut range) = BIN_RANGES[index];
            if self == Self::Rgb && index >= 4 {
                (name, range) = (CODES[index - 4], [0.0, 1.0]);
            }
            Axis {
                name,
                range,
                circular: index == PSI,
            }
        })
    }

    /// A material's labels.
    pub fn values(self, material: &Material) -> [f64; PARAMETERS] {
        let encode = |colour: [f64; 3], scale: f64| match self {
            Self::Rgb => colour.map(srgb_from_linear),
            Self::Lab | Self::Scaled => lab_from_linear(colour.map(|channel| channel * scale)),
        };
        let channels = material.rgb0.iter().chain(&material.rgb90);
        let largest = channels.copied().fold(0.0, f64::max);
        let hue_alone = material.roughness <= SCALE_SHOWS_PERCENT;
        let scale = if self == Self::Scaled && hue_alone && largest > 0.0 {
            1.0 / largest
        } else {
            1.0
        };
        let [l0, a0, b0] = encode(material.rgb0, scale);
        let [l90, a90, b90] = encode(material.rgb90, scale);
        let Material {
            roughness,
            anisotropy,
            angle_deg,
            ior,
            ..
        } = *material;
        [
            roughness, anisotropy, angle_deg, ior, l0, a0, b0, l90, a90, b90,
        ]
    }

    /// The material that labels describe. Colours outside the sRGB gamut become the nearest channel
    /// by channel.
    pub fn material(self, values: &[f64; PARAMETERS]) -> Material {
        let decode = |colour: [f64; 3]| match self {
            Self::Rgb => colour.map(|code| linear_from_srgb(code.clamp(0.0, 1.0))),
            Self::Lab | Self::Scaled => {
                linear_from_lab(colour).map(|channel| channel.clamp(0.0, 1.0))
            }
        };
        let [
            roughness,
            anisotropy,
            angle_deg,
            ior,
            l0,
            a0,
            b0,
            l90,
            a90,
            b90,
        ] = *values;
        Material {
            roughness,
            anisotropy,
            angle_deg,
            ior,
            rgb0: decode([l0, a0, b0]),
            rgb90: decode([l90, a90, b90]),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use dataset::Specification;

    fn drawn() -> impl Iterator<Item = dataset::SampledMaterial> {
        let preset = Specification::preset();
        (0..300).map(move |index| preset.material(index))
    }

    #[test]
    fn bins_of_cielab_are_the_manifest_s() {
        for sampled in drawn() {
            let values = Colours::Lab.values(&sampled.material);
            let bins: Vec<u8> = Colours::Lab
                .axes()
                .iter()
                .zip(values)
                .map(|(axis, value)| axis.bin(value))
                .collect();
            assert_eq!(bins, sampled.bins());
        }
    }

    #[test]
    fn materials_come_back_from_their_labels() {
        for sampled in drawn() {
            for colours in [Colours::Lab, Colours::Rgb] {
                let back = colours.material(&colours.values(&sampled.material));
                let pairs = [
                    (back.rgb0, sampled.material.rgb0),
                    (back.rgb90, sampled.material.rgb90),
                ];
                for (one, other) in pairs {
                    for channel in 0..3 {
                        assert!((one[channel] - other[channel]).abs() < 1e-8);
                    }
                }
                assert_eq!(back.roughness, sampled.material.roughness);
            }
        }
    }

    #[test]
    fn colours_at_half_the_scale_have_the_same_scaled_bins_where_only_their_hue_shows() {
        for sampled in drawn() {
            let mut halved = sampled.material;
            for channel in halved.rgb0.iter_mut().chain(&mut halved.rgb90) {
                *channel /= 2.0;
            }
            let bins = |colours: Colours, material: &Material| {
                let values = colours.values(material);
                let axes = colours.axes();
                let pairs = axes.iter().zip(values);
                let bins: Vec<u8> = pairs.map(|(axis, value)| axis.bin(value)).collect();
                bins
            };
            let same = bins(Colours::Scaled, &halved) == bins(Colours::Scaled, &sampled.material);
            assert_eq!(same, sampled.material.roughness <= SCALE_SHOWS_PERCENT);
            assert_ne!(
                bins(Colours::Lab, &halved),
                bins(Colours::Lab, &sampled.material)
            );
        }
    }

    #[test]
    fn black_has_labels() {
        let mut black = Specification::preset().material(0).material;
        (black.rgb0, black.rgb90) = ([0.0; 3], [0.0; 3]);
        assert!(
            Colours::Scaled
                .values(&black)
                .iter()
                .all(|value| value.is_finite())
        );
    }

    #[test]
    fn positions_are_bins_and_psi_is_a_circle() {
        let axes = Colours::Lab.axes();
        for axis in axes {
            for bin in 0..BINS {
                let value = axis.value(bin as f64);
                assert_eq!(usize::from(axis.bin(value)), bin, "{}", axis.name);
                assert!((axis.position(value) - bin as f64).abs() < 1e-9);
            }
        }
        let [roughness, _, psi, ..] = axes;
        assert!((psi.value(99.6) - psi.value(-0.4)).abs() < 1e-9);
        assert!((psi.distance(179.0, 1.0) - 2.0).abs() < 1e-12);
        assert_eq!(roughness.distance(99.0, 1.0), 98.0);
        assert_eq!(
            (roughness.value(-3.0), roughness.value(120.0)),
            (0.0, 100.0)
        );
    }
}

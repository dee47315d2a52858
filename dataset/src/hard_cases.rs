//! The materials on which a renderer goes wrong.

use crate::Material;

/// A material with what makes it hard.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HardCase {
    /// A name without spaces.
    pub name: &'static str,
    /// What makes it hard.
    pub reason: &'static str,
    /// Its ten numbers.
    pub material: Material,
}

const BASE: Material = Material {
    roughness: 30.0,
    anisotropy: 0.5,
    angle_deg: 40.0,
    ior: 2.0,
    rgb0: [0.8, 0.5, 0.3],
    rgb90: [0.9, 0.9, 0.9],
};

const fn lobe(roughness: f64, anisotropy: f64) -> Material {
    Material {
        roughness,
        anisotropy,
        ..BASE
    }
}

/// Every hard case, an ordinary material first.
pub const HARD_CASES: [HardCase; 12] = [
    HardCase {
        name: "ordinary",
        reason: "nothing: the one the others differ from",
        material: BASE,
    },
    HardCase {
        name: "mirror",
        reason: "exponent 1e9",
        material: lobe(0.0, 0.0),
    },
    HardCase {
        name: "brushed-mirror",
        reason: "exponents 1e9 and 1",
        material: lobe(0.0, 1.0),
    },
    HardCase {
        name: "just-specular",
        reason: "roughness 90, where Lambert begins",
        material: lobe(90.0, 0.3),
    },
    HardCase {
        name: "first-lambert",
        reason: "a share of 1e-7 of Lambert",
        material: lobe(90.000_001, 0.3),
    },
    HardCase {
        name: "half-lambert",
        reason: "both parts alike",
        material: lobe(95.0, 0.3),
    },
    HardCase {
        name: "all-lambert",
        reason: "no specular part",
        material: lobe(100.0, 0.3),
    },
    HardCase {
        name: "index-1",
        reason: "no reflection at the normal",
        material: Material { ior: 1.0, ..BASE },
    },
    HardCase {
        name: "index-10",
        reason: "the most reflective, and smooth",
        material: Material {
            ior: 10.0,
            ..lobe(5.0, 0.0)
        },
    },
    HardCase {
        name: "black",
        reason: "colours without a hue",
        material: Material {
            rgb0: [0.0; 3],
            rgb90: [0.0; 3],
            ..BASE
        },
    },
    HardCase {
        name: "blue-to-yellow",
        reason: "pure primaries, which desaturate",
        material: Material {
            rgb0: [0.0, 0.0, 1.0],
            rgb90: [1.0, 1.0, 0.0],
            ior: 8.0,
            ..BASE
        },
    },
    HardCase {
        name: "angle-180",
        reason: "the angle at the end of its period",
        material: Material {
            angle_deg: 180.0,
            ..BASE
        },
    },
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_lie_inside_the_model_under_names_of_their_own() {
        for (index, case) in HARD_CASES.iter().enumerate() {
            assert_eq!(case.material.check(), Ok(()), "{}", case.name);
            assert!(
                HARD_CASES[..index]
                    .iter()
                    .all(|other| other.name != case.name && other.material != case.material),
                "{}",
                case.name
            );
        }
    }
}

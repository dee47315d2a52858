//! Colour spaces of labels, and the bins that parameters are classified into.

use crate::sobol::DIMENSIONS;

/// Decodes one sRGB-encoded channel (IEC 61966-2-1, 0 to 1) to linear.
pub fn linear_from_srgb(encoded: f64) -> f64 {
    if encoded <= 0.04045 {
        encoded / 12.92
    } else {
        libm::pow((encoded + 0.055) / 1.055, 2.4)
    }
}

/// Encodes one linear channel (0 to 1) as sRGB (IEC 61966-2-1).
pub fn srgb_from_linear(linear: f64) -> f64 {
    if linear <= 0.003_130_8 {
        12.92 * linear
    } else {
        1.055 * libm::pow(linear, 1.0 / 2.4) - 0.055
    }
}

/// Rows X, Y, Z: CIE 1931 tristimulus values of linear Rec.709, where white has Y = 1. From the
/// chromaticities of ITU-R BT.709: red (0.64, 0.33), green (0.30, 0.60), blue (0.15, 0.06), and
/// D65 (0.3127, 0.3290).
const XYZ_FROM_LINEAR: [[f64; 3]; 3] = [
    [
        0.412_390_799_265_959_5,
        0.357_584_339_383_877_96,
        0.180_480_788_401_834_3,
    ],
    [
        0.212_639_005_871_510_36,
        0.715_168_678_767_755_9,
        0.072_192_315_360_733_71,
    ],
    [
        0.019_330_818_715_591_85,
        0.119_194_779_794_625_99,
        0.950_532_152_249_660_6,
    ],
];

/// The inverse of [`XYZ_FROM_LINEAR`].
const LINEAR_FROM_XYZ: [[f64; 3]; 3] = [
    [
        3.240_969_941_904_521_3,
        -1.537_383_177_570_093_2,
        -0.498_610_760_293_003_3,
    ],
    [
        -0.969_243_636_280_879_7,
        1.875_967_501_507_720_6,
        0.041_555_057_407_175_605,
    ],
    [
        0.055_630_079_696_993_615,
        -0.203_976_958_888_976_57,
        1.056_971_514_242_878_6,
    ],
];

/// CIE XYZ of linear Rec.709; white, (1, 1, 1), is D65 with Y = 1.
pub fn xyz_from_linear([r, g, b]: [f64; 3]) -> [f64; 3] {
    XYZ_FROM_LINEAR.map(|[x, y, z]| x * r + y * g + z * b)
}

/// Where the cube root of CIELAB's response begins: (6/29)^3 of white. Below, it goes on as its
/// tangent.
const KNEE: f64 = 6.0 / 29.0;

/// CIELAB (L*, a*, b*) of linear Rec.709 relative to D65 (CIE 15:2004, section 8.2.1). White is
/// (100, 0, 0), black (0, 0, 0).
pub fn lab_from_linear(rgb: [f64; 3]) -> [f64; 3] {
    fn response(ratio: f64) -> f64 {
        if ratio > KNEE * KNEE * KNEE {
            libm::cbrt(ratio)
        } else {
            ratio / (3.0 * KNEE * KNEE) + 4.0 / 29.0
        }
    }
    let (white, colour) = (xyz_from_linear([1.0; 3]), xyz_from_linear(rgb));
    let [x, y, z] = std::array::from_fn(|axis| response(colour[axis] / white[axis]));
    [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
}

/// Linear Rec.709 of CIELAB relative to D65: the inverse of [`lab_from_linear`]. Colours outside
/// the gamut have channels below 0 or above 1.
pub fn linear_from_lab([lightness, a, b]: [f64; 3]) -> [f64; 3] {
    fn ratio(response: f64) -> f64 {
        if response > KNEE {
            response * response * response
        } else {
            (response - 4.0 / 29.0) * (3.0 * KNEE * KNEE)
        }
    }
    let white = xyz_from_linear([1.0; 3]);
    let y = (lightness + 16.0) / 116.0;
    let responses = [y + a / 500.0, y, y - b / 200.0];
    let xyz: [f64; 3] = std::array::from_fn(|axis| ratio(responses[axis]) * white[axis]);
    LINEAR_FROM_XYZ.map(|[x, y, z]| x * xyz[0] + y * xyz[1] + z * xyz[2])
}

/// Uniform bins that each parameter is classified into.
pub const BINS: u8 = 100;

/// L* of every colour.
const L_RANGE: [f64; 2] = [0.0, 100.0];

/// a* of the sRGB gamut runs from -86.18 (green) to 98.25 (magenta): the whole numbers around it.
const A_RANGE: [f64; 2] = [-87.0, 99.0];

/// b* of the sRGB gamut runs from -107.86 (blue) to 94.48 (yellow): the whole numbers around it.
const B_RANGE: [f64; 2] = [-108.0, 95.0];

/// The binned parameters in order, each with the range that [`BINS`] bins divide.
///
/// The ranges are the model's, not a specification's, so a bin means the same in every dataset.
pub const BIN_RANGES: [(&str, [f64; 2]); DIMENSIONS] = [
    ("roughness", [0.0, 100.0]),
    ("anisotropy", [0.0, 1.0]),
    ("angle", [0.0, 180.0]),
    ("ior", [1.0, 10.0]),
    ("l0", L_RANGE),
    ("a0", A_RANGE),
    ("b0", B_RANGE),
    ("l90", L_RANGE),
    ("a90", A_RANGE),
    ("b90", B_RANGE),
];

/// The bin, 0 to 99, of a value within a range. Bins are half open, but the range's upper end
/// falls into the last; values outside fall into the nearest.
pub fn bin(value: f64, [low, high]: [f64; 2]) -> u8 {
    // A conversion to an integer saturates.
    (((value - low) / (high - low) * f64::from(BINS)) as u8).min(BINS - 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn assert_near(actual: [f64; 3], expected: [f64; 3], tolerance: f64) {
        for axis in 0..3 {
            assert!(
                (actual[axis] - expected[axis]).abs() <= tolerance,
                "{actual:?} is not {expected:?}"
            );
        }
    }

    #[test]
    fn grey_has_no_chroma_and_white_is_exact() {
        assert_eq!(lab_from_linear([1.0; 3]), [100.0, 0.0, 0.0]);
        assert_near(lab_from_linear([0.0; 3]), [0.0; 3], 1e-13);
        // L* of 18 percent grey: 116 cbrt(0.18) - 16.
        assert_near(lab_from_linear([0.18; 3]), [49.496_108, 0.0, 0.0], 1e-6);
    }

    #[test]
    fn lab_decodes_as_it_was_encoded() {
        for red in 0..=20 {
            for green in 0..=20 {
                for blue in 0..=20 {
                    // Cubes, so that dark colours below the knee are among them.
                    let rgb = [red, green, blue].map(|step| {
                        let fraction = f64::from(step) / 20.0;
                        fraction * fraction * fraction
                    });
                    assert_near(linear_from_lab(lab_from_linear(rgb)), rgb, 1e-14);
                }
            }
        }
    }

    #[test]
    fn primaries_have_their_published_lab() {
        // Lindbloom's colour calculator, sRGB under D65 without adaptation, to its four decimals;
        // it rounds the matrix, so only two are asked for.
        let published = [
            ([1.0, 0.0, 0.0], [53.24, 80.09, 67.20]),
            ([0.0, 1.0, 0.0], [87.73, -86.18, 83.18]),
            ([0.0, 0.0, 1.0], [32.30, 79.19, -107.86]),
            ([1.0, 1.0, 0.0], [97.14, -21.55, 94.48]),
            ([0.0, 1.0, 1.0], [91.11, -48.09, -14.13]),
            ([1.0, 0.0, 1.0], [60.32, 98.23, -60.82]),
        ];
        for (rgb, lab) in published {
            assert_near(lab_from_linear(rgb), lab, 0.03);
        }
    }

    #[test]
    fn the_matrix_is_that_of_the_chromaticities() {
        // Columns have the primaries' chromaticities and sum to the white point.
        let primaries = [[0.64, 0.33], [0.30, 0.60], [0.15, 0.06]];
        for (channel, [x, y]) in primaries.into_iter().enumerate() {
            let column = XYZ_FROM_LINEAR.map(|row| row[channel]);
            let sum: f64 = column.iter().sum();
            assert_near(column.map(|value| value / sum), [x, y, 1.0 - x - y], 1e-15);
        }
        let white = [0.3127 / 0.329, 1.0, (1.0 - 0.3127 - 0.329) / 0.329];
        assert_near(xyz_from_linear([1.0; 3]), white, 1e-15);
    }

    #[test]
    fn srgb_decodes_as_the_chart_was_and_encodes_back() {
        // Dark skin of the colour chart, worked out independently.
        let dark_skin = [115.0, 82.0, 68.0].map(|code: f64| linear_from_srgb(code / 255.0));
        let expected = [
            0.171_441_100_732_822_6,
            0.084_376_211_544_148_82,
            0.057_805_430_191_067_23,
        ];
        assert_near(dark_skin, expected, 1e-15);
        for code in 0..=1000 {
            let encoded = f64::from(code) / 1000.0;
            let back = srgb_from_linear(linear_from_srgb(encoded));
            assert!(
                (back - encoded).abs() < 1e-7,
                "{encoded} came back as {back}"
            );
        }
        assert_eq!((linear_from_srgb(0.0), linear_from_srgb(1.0)), (0.0, 1.0));
    }

    #[test]
    fn bin_ranges_hold_the_gamut_tightly() {
        // A lightness, a* or b* is extreme on the gamut's surface; a grid of 86 steps an edge
        // contains its corners.
        let mut extent = [[f64::INFINITY, f64::NEG_INFINITY]; 3];
        let steps = 85;
        for i in 0..=steps {
            for j in 0..=steps {
                let (s, t) = (
                    f64::from(i) / f64::from(steps),
                    f64::from(j) / f64::from(steps),
                );
                for face in [0.0, 1.0] {
                    for rgb in [[face, s, t], [s, face, t], [s, t, face]] {
                        let lab = lab_from_linear(rgb.map(linear_from_srgb));
                        for axis in 0..3 {
                            extent[axis][0] = extent[axis][0].min(lab[axis]);
                            extent[axis][1] = extent[axis][1].max(lab[axis]);
                        }
                    }
                }
            }
        }
        for ([least, most], [low, high]) in extent.into_iter().zip([L_RANGE, A_RANGE, B_RANGE]) {
            assert!(
                low <= least + 1e-12 && least < low + 1.0,
                "{low} bounds {least}"
            );
            assert!(high - 1.0 < most && most <= high, "{high} bounds {most}");
        }
    }

    #[test]
    fn bins_are_half_open_but_for_the_last() {
        assert_eq!(bin(0.0, [0.0, 1.0]), 0);
        assert_eq!(bin(0.01, [0.0, 1.0]), 1);
        assert_eq!(bin(0.009_999, [0.0, 1.0]), 0);
        assert_eq!(bin(1.0, [0.0, 1.0]), 99);
        assert_eq!(bin(5.5, [1.0, 10.0]), 50);
        assert_eq!((bin(-3.0, [0.0, 1.0]), bin(3.0, [0.0, 1.0])), (0, 99));
    }
}

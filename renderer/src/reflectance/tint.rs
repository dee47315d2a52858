//! The colour of a reflection: Fresnel's luminance and the reflectance colour, combined.

use dataset::specification::Tint;

/// Luminance weights of linear Rec.709.
const LUMINANCE: [f64; 3] = [0.2126, 0.7152, 0.0722];

/// The tint of a reflection of Fresnel reflectance `fresnel` (0 to 1) by the colour `colour`
/// (linear Rec.709, channels 0 to 1). Every channel of the result lies in 0 to 1.
pub fn tint(kind: Tint, fresnel: f64, colour: [f64; 3]) -> [f64; 3] {
    match kind {
        Tint::Hue => hue(fresnel, colour),
        Tint::Product => colour.map(|channel| fresnel * channel),
    }
}

/// The colour with luminance `fresnel` and the chromaticity of `colour`. What does not fit the
/// unit cube is moved toward the grey of equal luminance until its largest channel is 1. Black has
/// no hue and gives that grey.
fn hue(fresnel: f64, colour: [f64; 3]) -> [f64; 3] {
    let largest = colour[0].max(colour[1]).max(colour[2]);
    if largest <= 0.0 {
        return [fresnel; 3];
    }
    // Scaled first, so that the luminance of a tiny colour does not underflow.
    let chromaticity = colour.map(|channel| channel / largest);
    let luminance = LUMINANCE[0] * chromaticity[0]
        + LUMINANCE[1] * chromaticity[1]
        + LUMINANCE[2] * chromaticity[2];
    let brightest = fresnel / luminance;
    if brightest <= 1.0 {
        return chromaticity.map(|channel| channel * brightest);
    }
    let saturation = (1.0 - fresnel) / (brightest - fresnel);
    chromaticity.map(|channel| fresnel + saturation * (channel * brightest - fresnel))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn luminance(colour: [f64; 3]) -> f64 {
        (0..3).map(|i| LUMINANCE[i] * colour[i]).sum()
    }

    #[test]
    fn black_reflects_grey() {
        assert_eq!(tint(Tint::Hue, 0.3, [0.0; 3]), [0.3; 3]);
        assert_eq!(tint(Tint::Product, 0.3, [0.0; 3]), [0.0; 3]);
    }

    #[test]
    fn a_pure_primary_is_desaturated_to_the_cube() {
        let blue = tint(Tint::Hue, 0.5, [0.0, 0.0, 1.0]);
        assert!((blue[2] - 1.0).abs() < 1e-15);
        assert!(blue[0] > 0.0 && blue[0] == blue[1]);
        assert!((luminance(blue) - 0.5).abs() < 1e-15);
    }

    proptest! {
        #[test]
        fn hue_keeps_luminance_and_ignores_a_common_factor(
            fresnel in 0.0..=1.0f64,
            r in 0.0..=1.0f64, g in 0.0..=1.0f64, b in 0.0..=1.0f64,
            exponent in -1020i32..=0,
        ) {
            let colour = [r, g, b];
            let tinted = tint(Tint::Hue, fresnel, colour);
            prop_assert!((luminance(tinted) - fresnel).abs() <= 4e-16);
            prop_assert!(tinted.iter().all(|&c| (0.0..=1.0 + 1e-15).contains(&c)));
            let scale = libm::exp2(f64::from(exponent));
            if colour.iter().all(|&c| c == 0.0 || c * scale >= f64::MIN_POSITIVE) {
                let scaled = tint(Tint::Hue, fresnel, colour.map(|c| c * scale));
                prop_assert_eq!(tinted, scaled);
            }
        }
    }
}

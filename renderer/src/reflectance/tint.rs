//! The colour of a reflection: Fresnel's luminance and the reflectance colour, combined.

use dataset::specification::Tint;

/// Luminance weights of linear Rec.709.
pub const LUMINANCE: [f64; 3] = [0.2126, 0.7152, 0.0722];

/// The tint of a reflection of Fresnel reflectance `fresnel` (0 to 1) by the colour `colour`
/// (linear Rec.709, channels 0 to 1). Every channel of the result lies in 0 to 1.
pub fn tint(kind: Tint, fresnel: f64, colour: [f64; 3]) -> [f64; 3] {
    match kind {
        Tint::Hue => hue(fresnel, colour),
        Tint::Product => colour.map(|channel| fresnel * channel),
    }
}

fn luminance(colour: [f64; 3]) -> f64 {
    LUMINANCE[0] * colour[0] + LUMINANCE[1] * colour[1] + LUMINANCE[2] * colour[2]
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
    let brightest = fresnel / luminance(chromaticity);
    if brightest <= 1.0 {
        return chromaticity.map(|channel| channel * brightest);
    }
    let saturation = (1.0 - fresnel) / (brightest - fresnel);
    chromaticity.map(|channel| fresnel + saturation * (channel * brightest - fresnel))
}

/// The tint of one colour as a function of Fresnel's reflectance F: `slope F + bend max(0, F -
/// knee)` in each channel. Both kinds of tint are of this form, so integrals of F and of what it
/// exceeds the knee by are all that a tinted integral takes.
#[derive(Clone, Copy, Debug)]
pub struct TintResponse {
    /// Below the knee.
    pub slope: [f64; 3],
    /// What is added to it beyond.
    pub bend: [f64; 3],
    /// Where desaturation begins; above 1 where it never does.
    pub knee: f64,
}

impl TintResponse {
    /// The response of `colour`.
    pub fn new(kind: Tint, colour: [f64; 3]) -> Self {
        let largest = colour[0].max(colour[1]).max(colour[2]);
        let slope = match kind {
            Tint::Product => colour,
            Tint::Hue if largest <= 0.0 => [1.0; 3],
            Tint::Hue => {
                let chromaticity = colour.map(|channel| channel / largest);
                let luminance = luminance(chromaticity);
                chromaticity.map(|channel| channel / luminance)
            }
        };
        let steepest = slope[0].max(slope[1]).max(slope[2]);
        if steepest <= 1.0 {
            return Self {
                slope,
                bend: [0.0; 3],
                knee: 2.0,
            };
        }
        // Beyond the knee a channel runs on a line to white at F = 1.
        let rest = slope.map(|slope| (slope - 1.0) / (steepest - 1.0));
        Self {
            slope,
            bend: std::array::from_fn(|channel| 1.0 - rest[channel] - slope[channel]),
            knee: 1.0 / steepest,
        }
    }

    /// The tint for integrals of F and of its excess over the knee.
    pub fn at_moments(&self, fresnel: f64, excess: f64) -> [f64; 3] {
        std::array::from_fn(|channel| {
            // Rounding can leave a channel that cancels below zero.
            (self.slope[channel] * fresnel + self.bend[channel] * excess).max(0.0)
        })
    }

    /// The tint at Fresnel's reflectance `fresnel`.
    pub fn at(&self, fresnel: f64) -> [f64; 3] {
        self.at_moments(fresnel, (fresnel - self.knee).max(0.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

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
        fn the_response_is_the_tint(
            fresnel in 0.0..=1.0f64,
            r in 0.0..=1.0f64, g in 0.0..=1.0f64, b in 0.0..=1.0f64,
        ) {
            for kind in [Tint::Hue, Tint::Product] {
                let expected = tint(kind, fresnel, [r, g, b]);
                let found = TintResponse::new(kind, [r, g, b]).at(fresnel);
                for channel in 0..3 {
                    prop_assert!((found[channel] - expected[channel]).abs() < 1e-13);
                }
            }
        }

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

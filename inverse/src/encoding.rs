//! How pixels are encoded before they are compared.

use dataset::colour;

/// How much a logarithmic code stretches the dark: its slope at 0 over that of a linear code whose
/// white is 1 is `LOG_SCALE / ln(1 + LOG_SCALE)`, 145.
const LOG_SCALE: f64 = 1000.0;

/// The encoding of a pixel's channel `v`, in units of white.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Encoding {
    /// `v` itself. One highlight of several hundred decides a sum of squares.
    Linear,
    /// `ln(1 + 1000 v) / ln 1001`: 1 at white, 1.9 at the brightest highlights.
    Log,
    /// The sRGB code (IEC 61966-2-1) in 0 to 1, clipped at white: what photographs hold.
    Srgb,
}

impl Encoding {
    /// All encodings.
    pub const ALL: [Self; 3] = [Self::Linear, Self::Log, Self::Srgb];

    /// Its name: `linear`, `log` or `srgb`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Linear => "linear",
            Self::Log => "log",
            Self::Srgb => "srgb",
        }
    }

    /// The code of a channel. Negative values count as 0 but for [`Encoding::Linear`].
    pub fn value(self, v: f64) -> f64 {
        match self {
            Self::Linear => v,
            Self::Log => libm::log1p(LOG_SCALE * v.max(0.0)) / libm::log1p(LOG_SCALE),
            // The curve itself rounds to less than 1 at white.
            Self::Srgb if v >= 1.0 => 1.0,
            Self::Srgb => colour::srgb_from_linear(v.max(0.0)),
        }
    }

    /// The derivative of the code by the channel's value. Where the code is clipped it is 0, at
    /// white itself too. At 0 it is the one from above.
    pub fn derivative(self, v: f64) -> f64 {
        match self {
            Self::Linear => 1.0,
            Self::Log if v < 0.0 => 0.0,
            Self::Log => LOG_SCALE / ((1.0 + LOG_SCALE * v) * libm::log1p(LOG_SCALE)),
            Self::Srgb if !(0.0..1.0).contains(&v) => 0.0,
            // The two pieces of the code meet here.
            Self::Srgb if v <= 0.003_130_8 => 12.92,
            Self::Srgb => 1.055 / 2.4 * libm::pow(v, 1.0 / 2.4 - 1.0),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn white_and_black_have_their_codes() {
        for encoding in [Encoding::Linear, Encoding::Log, Encoding::Srgb] {
            assert_eq!(encoding.value(0.0), 0.0);
            assert!((encoding.value(1.0) - 1.0).abs() < 1e-15);
        }
        assert_eq!(Encoding::Srgb.value(85.0), 1.0);
        assert!((Encoding::Log.value(582.0) - 1.9214).abs() < 1e-4);
        assert!((Encoding::Srgb.value(0.214_041_140_482_232_6) - 0.5).abs() < 1e-12);
    }

    #[test]
    fn derivatives_are_those_of_the_values() {
        for encoding in [Encoding::Linear, Encoding::Log, Encoding::Srgb] {
            for v in [1e-6, 1e-4, 0.003, 0.0032, 0.01, 0.2, 0.7, 0.999, 1.5, 85.0] {
                let h = 1e-4 * v;
                let slope = (encoding.value(v + h) - encoding.value(v - h)) / (2.0 * h);
                let derivative = encoding.derivative(v);
                assert!(
                    (slope - derivative).abs() <= 1e-7 * derivative.max(1e-3),
                    "{encoding:?} at {v}: {derivative}, by differences {slope}"
                );
            }
        }
        assert_eq!(Encoding::Srgb.derivative(1.0), 0.0);
        assert_eq!(Encoding::Srgb.derivative(0.0), 12.92);
        assert_eq!(Encoding::Log.derivative(-1.0), 0.0);
    }
}

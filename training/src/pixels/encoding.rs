//! Linear light as codes, as a camera or a person would write it.

use half::f16;
use inverse::Encoding as PixelEncoding;
use serde::{Deserialize, Serialize};

/// How linear light becomes a network's input. White, 1, is 1 in both.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Encoding {
    /// sRGB codes, 0 to 1, clipped at white: what a photograph holds.
    Srgb,
    /// ln(1 + 1000 v) / ln 1001: highlights beyond white keep their shape (1.92 at 582).
    Log,
}

impl Encoding {
    /// Its name on the command line and in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Srgb => PixelEncoding::Srgb.name(),
            Self::Log => PixelEncoding::Log.name(),
        }
    }

    /// The code of a linear value of 0 or more, in units of white.
    pub fn encode(self, linear: f64) -> f64 {
        match self {
            Self::Srgb => PixelEncoding::Srgb.value(linear),
            Self::Log => PixelEncoding::Log.value(linear),
        }
    }

    /// The largest code.
    pub fn code_max(self) -> f32 {
        match self {
            Self::Srgb => 1.0,
            Self::Log => f32::MAX,
        }
    }

    /// The codes of all 16-bit floats, by their bits.
    pub fn table(self) -> Vec<f32> {
        (0..=u16::MAX)
            .map(|bits| self.encode(f16::from_bits(bits).to_f64()) as f32)
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_hold_the_code_of_every_half_float() {
        for encoding in [Encoding::Srgb, Encoding::Log] {
            let table = encoding.table();
            let code = |value: f32| table[usize::from(f16::from_f32(value).to_bits())];
            assert_eq!((code(0.0), code(-0.0)), (0.0, 0.0));
            assert!((code(1.0) - 1.0).abs() < 1e-6);
            for value in [1e-4, 0.003, 0.18, 0.73, 1.5, 85.0] {
                let half = f16::from_f32(value);
                assert_eq!(code(value), encoding.encode(half.to_f64()) as f32);
            }
        }
        assert_eq!(Encoding::Srgb.encode(85.0), 1.0);
        assert!((Encoding::Log.encode(582.0) - 1.9214).abs() < 1e-4);
    }
}

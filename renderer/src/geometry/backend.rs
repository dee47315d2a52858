//! Which of the two backends traces the rays.

use std::fmt::{Display, Formatter, Result as FormatResult};
use std::str::FromStr;

use super::embree::Isa;

/// What a specification or a user asks for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum BackendChoice {
    /// The faster for the scene; native where Embree is wanted and cannot be loaded, unless
    /// `EMBREE_LIBRARY` names it.
    #[default]
    Auto,
    /// Plain Rust, one primitive after another.
    Native,
    /// Embree on the widest instruction set that the machine has, or an error.
    Embree,
    /// Embree held to one instruction set, or an error: for comparing them.
    EmbreeOn(Isa),
}

/// What traces the rays. Both give the same bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum BackendKind {
    /// Plain Rust, one primitive after another.
    Native,
    /// Embree's hierarchy over the same primitives.
    Embree,
}

/// A name that is no backend's.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "no geometry backend is called {0:?}: write auto, native, embree, or embree: and an \
     instruction set (sse2, sse4.2, avx, avx2, avx512)"
)]
pub struct UnknownBackend(String);

impl FromStr for BackendChoice {
    type Err = UnknownBackend;

    fn from_str(name: &str) -> Result<Self, UnknownBackend> {
        match name {
            "auto" => Ok(Self::Auto),
            "native" => Ok(Self::Native),
            "embree" => Ok(Self::Embree),
            _ => name
                .strip_prefix("embree:")
                .and_then(|isa| isa.parse().ok())
                .map(Self::EmbreeOn)
                .ok_or_else(|| UnknownBackend(name.to_owned())),
        }
    }
}

impl Display for BackendChoice {
    fn fmt(&self, formatter: &mut Formatter<'_>) -> FormatResult {
        match self {
            Self::Auto => formatter.write_str("auto"),
            Self::Native => formatter.write_str("native"),
            Self::Embree => formatter.write_str("embree"),
            Self::EmbreeOn(isa) => write!(formatter, "embree:{isa}"),
        }
    }
}

impl Display for BackendKind {
    fn fmt(&self, formatter: &mut Formatter<'_>) -> FormatResult {
        formatter.write_str(match self {
            Self::Native => "native",
            Self::Embree => "embree",
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_read_back() {
        for choice in [
            BackendChoice::Auto,
            BackendChoice::Native,
            BackendChoice::Embree,
            BackendChoice::EmbreeOn(Isa::Sse42),
        ] {
            assert_eq!(choice.to_string().parse(), Ok(choice));
        }
        for name in ["gpu", "embree:sse5"] {
            let error = name.parse::<BackendChoice>().unwrap_err();
            assert!(error.to_string().contains(name), "{error}");
        }
    }
}

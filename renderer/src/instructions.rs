//! Kernels compiled for several instruction sets, chosen at run time.
//!
//! A kernel is a plain loop over slices of + - * / sqrt, comparisons and bit operations on 64-bit
//! numbers. The compiler vectorises it for each set; no operation is fused or reordered, so every
//! set gives the same bits.

use std::fmt;

/// An instruction set that this processor has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Instructions(Set);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Set {
    Baseline,
    #[cfg(target_arch = "x86_64")]
    Avx2,
    #[cfg(target_arch = "x86_64")]
    Avx512,
}

impl Instructions {
    /// What every processor of this architecture has: SSE2 on x86-64.
    pub const BASELINE: Self = Self(Set::Baseline);

    /// All that this processor has, the widest last.
    pub fn available() -> Vec<Self> {
        let mut sets = vec![Self::BASELINE];
        #[cfg(target_arch = "x86_64")]
        {
            if std::is_x86_feature_detected!("avx2") {
                sets.push(Self(Set::Avx2));
            }
            if std::is_x86_feature_detected!("avx512f")
                && std::is_x86_feature_detected!("avx512dq")
                && std::is_x86_feature_detected!("avx512vl")
            {
                sets.push(Self(Set::Avx512));
            }
        }
        sets
    }

    /// The widest that this processor has.
    pub fn widest() -> Self {
        Self::available().pop().unwrap_or(Self::BASELINE)
    }

    pub(crate) fn set(self) -> Set {
        self.0
    }
}

impl fmt::Display for Instructions {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self.0 {
            Set::Baseline if cfg!(target_arch = "x86_64") => "sse2",
            Set::Baseline => "scalar",
            #[cfg(target_arch = "x86_64")]
            Set::Avx2 => "avx2",
            #[cfg(target_arch = "x86_64")]
            Set::Avx512 => "avx512",
        })
    }
}

/// Defines a function once and compiles it for every instruction set. Its first argument chooses.
macro_rules! kernel {
    (
        $(#[$meta:meta])*
        pub fn $name:ident($($argument:ident: $type:ty),* $(,)?) $(-> $result:ty)? $body:block
    ) => {
        $(#[$meta])*
        pub fn $name(
            instructions: $crate::instructions::Instructions,
            $($argument: $type),*
        ) $(-> $result)? {
            #[inline(always)]
            fn portable($($argument: $type),*) $(-> $result)? $body

            #[cfg(target_arch = "x86_64")]
            #[target_feature(enable = "avx2")]
            fn avx2($($argument: $type),*) $(-> $result)? {
                portable($($argument),*)
            }

            #[cfg(target_arch = "x86_64")]
            #[target_feature(enable = "avx512f,avx512dq,avx512vl")]
            fn avx512($($argument: $type),*) $(-> $result)? {
                portable($($argument),*)
            }

            // SAFETY: an `Instructions` is made only of a set that this processor has.
            #[allow(unsafe_code)]
            match instructions.set() {
                $crate::instructions::Set::Baseline => portable($($argument),*),
                #[cfg(target_arch = "x86_64")]
                $crate::instructions::Set::Avx2 => unsafe { avx2($($argument),*) },
                #[cfg(target_arch = "x86_64")]
                $crate::instructions::Set::Avx512 => unsafe { avx512($($argument),*) },
            }
        }
    };
}
pub(crate) use kernel;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_baseline_is_always_there_and_the_widest_is_the_last() {
        let available = Instructions::available();
        assert_eq!(available[0], Instructions::BASELINE);
        assert_eq!(available.last(), Some(&Instructions::widest()));
    }
}

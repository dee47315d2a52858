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
        let sets = [
            (Set::Baseline, true),
            #[cfg(target_arch = "x86_64")]
            (Set::Avx2, std::is_x86_feature_detected!("avx2")),
            #[cfg(target_arch = "x86_64")]
            (
                Set::Avx512,
                std::is_x86_feature_detected!("avx512f")
                    && std::is_x86_feature_detected!("avx512dq")
                    && std::is_x86_feature_detected!("avx512vl"),
            ),
        ];
        let there = sets.into_iter().filter(|(_, there)| *there);
        there.map(|(set, _)| Self(set)).collect()
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
        pub fn $name:ident $(<const $count:ident: usize>)? (
            $($argument:ident: $type:ty),* $(,)?
        ) $(-> $result:ty)? $body:block
    ) => {
        $(#[$meta])*
        pub fn $name $(<const $count: usize>)? (
            instructions: $crate::numerics::instructions::Instructions,
            $($argument: $type),*
        ) $(-> $result)? {
            #[inline(always)]
            fn portable $(<const $count: usize>)? ($($argument: $type),*) $(-> $result)? $body

            #[cfg(target_arch = "x86_64")]
            #[target_feature(enable = "avx2")]
            fn avx2 $(<const $count: usize>)? ($($argument: $type),*) $(-> $result)? {
                portable($($argument),*)
            }

            #[cfg(target_arch = "x86_64")]
            #[target_feature(enable = "avx512f,avx512dq,avx512vl")]
            fn avx512 $(<const $count: usize>)? ($($argument: $type),*) $(-> $result)? {
                portable($($argument),*)
            }

            // SAFETY: an `Instructions` is made only of a set that this processor has.
            #[allow(unsafe_code)]
            match instructions.set() {
                $crate::numerics::instructions::Set::Baseline => portable($($argument),*),
                #[cfg(target_arch = "x86_64")]
                $crate::numerics::instructions::Set::Avx2 => unsafe { avx2($($argument),*) },
                #[cfg(target_arch = "x86_64")]
                $crate::numerics::instructions::Set::Avx512 => unsafe { avx512($($argument),*) },
            }
        }
    };
}
pub(crate) use kernel;

#[cfg(test)]
mod tests {
    use super::*;
    use std::hint::black_box;

    const LANES: usize = 8;
    const RESULTS: usize = 9;

    /// The operations that kernels are made of.
    #[inline(always)]
    fn operations(a: f64, b: f64) -> [f64; RESULTS] {
        [
            a + b,
            a - b,
            a * b,
            a / b,
            a.abs().sqrt(),
            // A fused multiplication and addition would round once, not twice.
            a * b + a,
            if a < b { a } else { b },
            if a >= b { a } else { -b },
            f64::from_bits(a.to_bits() ^ (b.to_bits() >> 1)),
        ]
    }

    kernel! {
        pub fn all_operations(
            operands: &[[[f64; LANES]; 2]],
            results: &mut [[[f64; LANES]; RESULTS]],
        ) {
            for ([a, b], results) in operands.iter().zip(results) {
                for i in 0..LANES {
                    let lane = operations(a[i], b[i]);
                    for (result, value) in results.iter_mut().zip(lane) {
                        result[i] = value;
                    }
                }
            }
        }
    }

    /// Every pair of special numbers, then pairs of any bits and pairs of like size.
    fn operands() -> Vec<[f64; 2]> {
        let tiny = f64::from_bits(1);
        let special = [
            0.0,
            tiny,
            f64::MIN_POSITIVE - tiny,
            f64::MIN_POSITIVE,
            f64::EPSILON,
            1.0,
            3.0,
            1e200,
            f64::MAX,
            f64::INFINITY,
            f64::NAN,
        ];
        let signed: Vec<f64> = special.into_iter().flat_map(|x| [x, -x]).collect();
        let mut operands: Vec<[f64; 2]> = signed
            .iter()
            .flat_map(|&a| signed.iter().map(move |&b| [a, b]))
            .collect();
        let mut bits = 1u64;
        let mut draw = || {
            // Knuth's linear congruential generator: its high bits are the random ones.
            bits = bits
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            bits.rotate_left(32)
        };
        for _ in 0..50_000 {
            operands.push([draw(), draw()].map(f64::from_bits));
            operands.push([draw(), draw()].map(|bits| bits as f64 / 1e19 - 0.5));
        }
        operands
    }

    /// The last bits of a NaN are the processor's own choice.
    fn same(found: f64, expected: f64) -> bool {
        found.to_bits() == expected.to_bits() || (found.is_nan() && expected.is_nan())
    }

    #[test]
    fn every_instruction_set_computes_the_bits_of_one_operation_at_a_time() {
        let operands = operands();
        let blocks: Vec<[[f64; LANES]; 2]> = operands
            .as_chunks::<LANES>()
            .0
            .iter()
            .map(|pairs| [0, 1].map(|operand| pairs.map(|pair| pair[operand])))
            .collect();
        for instructions in Instructions::available() {
            let mut results = vec![[[0.0; LANES]; RESULTS]; blocks.len()];
            all_operations(instructions, &blocks, &mut results);
            for (block, found) in results.iter().enumerate() {
                for lane in 0..LANES {
                    let [a, b] = operands[block * LANES + lane];
                    let expected = operations(black_box(a), black_box(b));
                    for (number, expected) in expected.into_iter().enumerate() {
                        let found = found[number][lane];
                        assert!(
                            same(found, expected),
                            "{instructions}, operation {number} of {a:e} and {b:e}: \
                             {found:e}, not {expected:e}"
                        );
                    }
                }
            }
        }
    }
}

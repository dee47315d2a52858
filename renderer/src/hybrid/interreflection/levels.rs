//! How fine the rules over the sample are, level by level, and what they cost at most.

use crate::numerics::tolerance::Tolerance;

/// Terms of the series for order 1, and for the higher orders.
pub const ORDER_1_TERMS: usize = 8;
pub const HIGHER_TERMS: usize = 8;

/// Of an error that is allowed, the share that the rules over the sample may miss; the rest is left
/// to the series.
pub const RULE_SHARE: f64 = 0.4;

/// Decimal digits of the rules over the sample, from coarse to fine. The finest is only for
/// comparison.
pub const DIGITS: [f64; 7] = [2.0, 2.7, 3.5, 4.5, 6.0, 8.0, 10.0];

/// Evaluations of the reflectance for order 1, and for the higher ones: about a tenth of a second.
pub const EVALUATIONS_MAX: u64 = 6_000_000;

/// The tolerance of a level's rules.
pub fn rule_tolerance(level: usize) -> Tolerance {
    Tolerance::new(libm::exp10(-DIGITS[level.min(DIGITS.len() - 1)]))
}

/// The levels of [`DIGITS`] that have a finer one to compare with.
pub const LEVEL_MAX: usize = DIGITS.len() - 2;

/// The nodes of a square grid at which rules are compared with finer ones: its corners and its
/// middle.
pub fn compared(terms: usize) -> [usize; 5] {
    let (middle, last) = (terms / 2, terms - 1);
    let at = |column: usize, row: usize| row * terms + column;
    [
        at(0, 0),
        at(last, 0),
        at(0, last),
        at(last, last),
        at(middle, middle),
    ]
}

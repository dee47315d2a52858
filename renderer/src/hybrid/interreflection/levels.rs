//! Series and rules, level by level.

use crate::hybrid::budget::interreflection::DIGITS;
use crate::numerics::tolerance::Tolerance;

/// Terms of a tile's series along either side.
pub const TERMS: usize = 8;

/// The tolerance of a level's rules.
pub fn rule_tolerance(level: usize) -> Tolerance {
    Tolerance::new(libm::exp10(-DIGITS[level.min(DIGITS.len() - 1)]))
}

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

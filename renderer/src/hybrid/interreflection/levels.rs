//! Series and rules, level by level.

use crate::hybrid::budget::interreflection::DIGITS;
use crate::numerics::chebyshev::{Basis, Fit, Tile};
use crate::numerics::polygon::Rectangle;
use crate::numerics::tolerance::Tolerance;

/// The most terms of a tile's series along either side.
pub const TERMS: usize = 8;

/// Terms along either side of each series, from coarse to fine.
const COUNTS: [usize; 3] = [4, 6, TERMS];

/// Products of Chebyshev polynomials on a tile: an index into [`COUNTS`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Series(usize);

impl Series {
    /// The one with the fewest terms.
    pub const FIRST: Self = Self(0);

    /// The one with the most terms.
    pub const LAST: Self = Self(COUNTS.len() - 1);

    /// The one with the next more terms; `None` if there is none.
    pub fn finer(self) -> Option<Self> {
        (self.0 + 1 < COUNTS.len()).then_some(Self(self.0 + 1))
    }

    /// Terms along either side.
    pub fn terms(self) -> usize {
        COUNTS[self.0]
    }

    /// The nodes of a rectangle, row by row.
    pub fn nodes(self, rectangle: &Rectangle) -> Vec<[f64; 2]> {
        match self.0 {
            0 => Basis::<{ COUNTS[0] }>::new().nodes(rectangle).collect(),
            1 => Basis::<{ COUNTS[1] }>::new().nodes(rectangle).collect(),
            _ => Basis::<{ COUNTS[2] }>::new().nodes(rectangle).collect(),
        }
    }

    /// Interpolates a function of these values at [`Series::nodes`].
    pub fn fit(
        self,
        rectangle: Rectangle,
        at_nodes: impl Iterator<Item = [f64; 3]>,
    ) -> (Tile<TERMS>, Fit) {
        fn widened<const COUNT: usize>((tile, fit): (Tile<COUNT>, Fit)) -> (Tile<TERMS>, Fit) {
            (tile.widened(), fit)
        }
        match self.0 {
            0 => widened(Basis::<{ COUNTS[0] }>::new().fit(rectangle, at_nodes)),
            1 => widened(Basis::<{ COUNTS[1] }>::new().fit(rectangle, at_nodes)),
            _ => widened(Basis::<{ COUNTS[2] }>::new().fit(rectangle, at_nodes)),
        }
    }
}

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

//! What a function of the film asks of its tiling.

use super::tile_nodes::{FEW, MANY, layout};
use crate::numerics::instructions::Instructions;
use crate::numerics::polygon::Rectangle;
use crate::numerics::tolerance::Tolerance;
use dataset::specification::Accuracy;

/// How a tiling divides what a tile may miss, and what a tile states beyond what it shows.
#[derive(Clone, Copy, Debug)]
pub struct Shares {
    /// The share of what a tile may miss that the rule at its middle may miss. What that is more than
    /// `beside`, the tile's series has to be better by.
    pub rule: f64,
    /// A tile may state `doubt` and this times what it may miss.
    pub beside: f64,
    /// What series along one row and one column of nodes leave out at a point counts by this share, before the
    /// other nodes are worked out.
    pub cross: f64,
    /// A pixel's mean is taken to be off by at least this share of what the series of its tile leave out at a
    /// point.
    pub point: f64,
    /// Of what a tile may miss, the share that it may miss of parts of pixels by the values at their centroids.
    pub centroids: f64,
    /// Factor on the steps between a tile's nodes, as far as they remain in means over pixels.
    pub step: f64,
    /// The same where the outline cuts the tile: of a pixel that it cuts, too, a step may be a larger share.
    pub step_at_outline: f64,
    /// Factor on a tile's deviation at its rim and between its nodes, as far as it remains in means over
    /// pixels.
    pub apart: f64,
    /// A tile states this many times what it shows to be off by.
    pub doubt: f64,
    /// A rule states this many times its difference from the next finer one, where no work is left for
    /// the rule that the tolerance asks for.
    pub unmet: f64,
}

impl Shares {
    /// Whether a tile states no more than it may. Its series is off by `fit` and the rule at its middle by
    /// `rule`. Of that no more than its share counts: halving the tile mends none of the rest.
    pub(super) fn is_met(&self, fit: f64, rule: f64, allowed: f64) -> bool {
        let rule = rule.min(self.rule * allowed);
        self.doubt * fit + rule <= (self.doubt + self.beside) * allowed
    }
}

/// How many terms the series of a tile have along each side.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Terms {
    /// Eight: few tiles and little to be left out.
    Many,
    /// Five: for less than half of the nodes they leave out more, up to a thousandth of the light in the preset.
    Few,
}

impl Terms {
    /// How many times farther apart the nodes of a tile lie than those of one with [`Terms::Many`].
    pub fn spread(self) -> f64 {
        match self {
            Self::Many => 1.0,
            Self::Few => layout(FEW).widest_gap / layout(MANY).widest_gap,
        }
    }
}

/// What a function may be off by that no rule shows: the smaller of the two, or the one that is a number.
#[derive(Clone, Copy, Debug, Default)]
pub struct FunctionError {
    /// In units of white.
    pub absolute: f64,
    /// As a share of the function's largest channel.
    pub relative: f64,
}

impl FunctionError {
    /// Over an area on which the integral of the function is `value`.
    pub fn over(&self, area: f64, value: [f64; 3]) -> f64 {
        let [r, g, b] = value;
        let largest = r.max(g).max(b).max(0.0);
        (self.absolute * area).min(self.relative * largest)
    }
}

/// What a function asks of its tiling.
pub struct Demand<'a> {
    /// The target for what is added to a pixel.
    pub accuracy: &'a Accuracy,
    /// What is too faint to matter: its target after half of all evaluations are spent.
    pub faint: f64,
    /// Of a tile's series.
    pub terms: Terms,
    /// The side in pixels of a tile whose nodes cannot miss a detail of the function, unless all of the
    /// function is smaller: see `feature`. It is that of a tile with [`Terms::Many`]; others are as much shorter as
    /// their nodes lie farther apart.
    pub side_max: f64,
    /// Where the function is lit, if it may be dark elsewhere. Tiles are cut along its sides.
    pub feature: Option<Rectangle>,
    /// Evaluations after which nothing is refined any more.
    pub evaluations_max: u64,
    /// How fine the function is worked out.
    pub tolerance: Tolerance,
    /// How the error allowed is divided.
    pub shares: Shares,
    /// What kernels are worked out with.
    pub instructions: Instructions,
}

//! Where pieces of the lobe's wide axis end.

use super::near_axis::{find_corners, find_passages};
use super::passages::{End, Found};
use super::point::Point;
use crate::hybrid::budget::glossy::CORNER_DIGITS;

impl Point<'_> {
    /// Finds where edges of patches pass through the lobe between two q, and where pieces may end.
    pub fn find_ends(&self, [low, high]: [f64; 2], found: &mut Found) {
        found.clear();
        find_passages(self.glossy.instructions, self, [low, high], found);
        self.find_kinks([low, high], &mut found.ends);
        found.ends.retain(|end| end.q > low && end.q < high);
        found.ends.extend([low, high].map(End::kink));
    }

    /// Finds where the integral over p has a kink.
    fn find_kinks(&self, [low, high]: [f64; 2], ends: &mut Vec<End>) {
        let reach = 0.5 * self.tolerance.reach_widths(-CORNER_DIGITS);
        let levels = self
            .branches
            .levels()
            .flat_map(|level| level.on_axis().zeros());
        ends.extend(levels.filter(|&q| q > low && q < high).map(End::kink));
        find_corners(self.glossy.instructions, self, [low, high], reach, ends);
    }
}

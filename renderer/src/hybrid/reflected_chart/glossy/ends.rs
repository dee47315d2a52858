//! Where pieces of the lobe's wide axis end.

use super::near_axis::{find_corners, find_passages};
use super::passages::{End, Passage, count_covering};
use super::point::Point;
use crate::hybrid::budget::glossy::CORNER_DIGITS;

impl Point<'_> {
    /// Finds where edges of patches pass through the lobe between two q, and where pieces may end, in rising
    /// order.
    pub fn find_ends(&self, extent: [f64; 2], passages: &mut Vec<Passage>, ends: &mut Vec<End>) {
        passages.clear();
        ends.clear();
        find_passages(self.glossy.instructions, self, extent, passages, ends);
        self.find_kinks(extent, ends);
        let [low, high] = extent;
        ends.retain(|end| end.q > low && end.q < high);
        ends.extend(extent.map(End::kink));
        ends.sort_unstable_by(|a, b| a.q.total_cmp(&b.q));
        self.take_steps(passages, ends);
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

    /// Takes passages for steps where that misses little and no line beside them lies in them. Leaves to
    /// those that share no q with another passage the rule of three lines.
    fn take_steps(&self, passages: &[Passage], ends: &mut [End]) {
        for at in 0..ends.len() {
            let Some(index) = ends[at].passage else {
                continue;
            };
            let passage = passages[index];
            let is_alone = |ends: &[End]| {
                let next = ends.get(at + 1).and_then(|end| end.passage);
                next == Some(index) && count_covering(passage.middle, passages) == 1
            };
            if at == 0 || !is_alone(ends) {
                continue;
            }
            let Passage { middle, half, .. } = passage;
            let clear = |piece: [f64; 2]| self.keeps_clear(piece, half);
            let is_clear =
                |[before, after]: [f64; 2]| clear([before, middle]) && clear([middle, after]);
            let beside = ends.get(at + 2).map(|after| [ends[at - 1].q, after.q]);
            if passage.is_step(self) && beside.is_some_and(is_clear) {
                ends[at..at + 2].fill(End::kink(passage.middle));
            }
        }
    }
}

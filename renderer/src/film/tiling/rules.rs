//! How fine a function has to be worked out on a tile, and what the rule by which it is then misses.

use super::shade::{Counted, Shade};
use super::{Candidate, Effort, Tiling};
use crate::numerics::channels::largest_difference;
use crate::numerics::polygon::Rectangle;
use crate::numerics::tolerance::Tolerance;

/// A little finer rule that still misses this share of what the coarser one missed does not converge by
/// digits. The next level follows at once. Chosen.
const STUCK: f64 = 0.5;

/// How fine a function is worked out on a tile.
pub struct Rule {
    pub tolerance: Tolerance,
    /// What is stated to be missed in the tile's middle.
    pub missed: f64,
    /// The part of it that the rule's difference from the next finer one shows.
    pub own: f64,
    /// How many times its difference from the next finer one the rule states.
    pub times: f64,
}

impl<S: Shade> Tiling<'_, S> {
    /// How fine the function has to be worked out on a rectangle, and what the rule then misses.
    pub(super) fn rule(&self, candidate: &Candidate<'_>, function: &mut Counted<'_, S>) -> Rule {
        let Candidate {
            rectangle,
            before,
            effort,
        } = *candidate;
        let middle = rectangle.point([0.0; 2]);
        let mut tolerance = self.demand.tolerance;
        let light_error = function.light_error(middle, tolerance);
        let mut evaluate = |tolerance: Tolerance| function.at(middle, tolerance);
        // What a rule misses shows against a finer one. The finest itself is stated to miss what it
        // was found to mend.
        let (mut check, mut before_missed) = (tolerance.finer(), f64::INFINITY);
        let mut fine = evaluate(check);
        loop {
            let missed = largest_difference(evaluate(tolerance), fine);
            let stated = missed + light_error;
            let brightness = before + self.gain * fine[0].max(fine[1]).max(fine[2]);
            let met = missed <= self.demand.shares.rule * self.allowed(brightness, effort);
            if met || effort == Effort::None {
                let times = if met { 1.0 } else { self.demand.shares.unmet };
                return Rule {
                    tolerance,
                    missed: stated + (times - 1.0) * missed,
                    own: missed,
                    times,
                };
            }
            let next = if missed > STUCK * before_missed {
                check
            } else {
                tolerance.little_finer(check)
            };
            if next.level() == check.level() {
                if check.level() == self.shade.finest_level() {
                    let times = self.demand.shares.unmet;
                    return Rule {
                        tolerance: check,
                        missed: stated + (times - 1.0) * missed,
                        own: missed,
                        times,
                    };
                }
                check = check.finer();
                fine = evaluate(check);
            }
            (tolerance, before_missed) = (next, missed);
        }
    }

    /// What a rule misses, if it is uneven, at the corners of what the outline has of a tile.
    pub(super) fn missed_at_corners(
        &self,
        rectangle: &Rectangle,
        tolerance: Tolerance,
        function: &mut Counted<'_, S>,
    ) -> f64 {
        if !self.shade.is_uneven() {
            return 0.0;
        }
        let covered = self.outline.clipped(rectangle);
        let missed = covered.corners().iter().map(|&at| {
            let value = function.at(at, tolerance);
            self.missed_at(&[at], &[value], tolerance, function)
        });
        missed.fold(0.0, f64::max)
    }

    /// What a rule misses at some points of a tile where it gives these values. It was looked at in the
    /// middle: elsewhere it may miss more.
    pub(super) fn missed_at(
        &self,
        points: &[[f64; 2]],
        values: &[[f64; 3]],
        tolerance: Tolerance,
        function: &mut Counted<'_, S>,
    ) -> f64 {
        if tolerance.level() >= self.shade.finest_level() {
            return 0.0;
        }
        let off = |(at, value): (&[f64; 2], &[f64; 3])| {
            largest_difference(*value, function.at(*at, tolerance.finer()))
        };
        points.iter().zip(values).map(off).fold(0.0, f64::max)
    }
}

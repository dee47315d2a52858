//! How fine a function has to be worked out on a tile, and what the rule by which it is then misses.

use super::shade::{Counted, Shade};
use super::{Candidate, Effort, Tiling};
use crate::numerics::channels::largest_difference;
use crate::numerics::polygon::Rectangle;
use crate::numerics::tolerance::Tolerance;

/// A little finer rule that still misses this share of what the coarser one missed does not converge by
/// digits. The next level follows at once. Chosen.
const STUCK: f64 = 0.5;

/// An uneven rule that converges slowly may miss this many times what it differs from the next finer one by. Measured:
/// 4.5 times next to the chart on the sample of material 5400 of the preset, where 1.3 percent of the pixels of view 5
/// were off by more than they stated; with this two pixels are.
const SLOW: f64 = 6.0;

/// The finest rule tells what another misses if the one before it differs by no more than this share of that. Where the
/// camera grazes the sample, the rules of wide lobes have not converged, and those along the lobe's narrow axis are the
/// better ones (draw 2406 of seed 20261130 of the search).
const CONVERGED: f64 = 0.1;

/// Two kinds of rules that disagree: the finest is right if the one before it differs from it by no more than this share
/// of what the kinds are apart. Else it states that it may be off by so much. Chosen: two rules of wide lobes agreed by
/// chance to 8 percent of what they were off by (draw 1783 of seed 20261151 of the search).
const SURE: f64 = 0.01;

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

/// The last rule of a kind that can be compared with a finer one of its kind, in a tile's middle.
struct LastOfKind {
    tolerance: Tolerance,
    /// By how much it differs from that finer one.
    missed: f64,
}

impl LastOfKind {
    /// How far a rule of another kind may be off that differs from the next finer one by `missed`, which is little
    /// enough, and from this one by `apart`: 0 where what this one shows to miss explains that, or where the two are
    /// sure. Else they may agree by chance.
    fn doubts(&self, missed: f64, apart: f64) -> f64 {
        if missed > SURE * apart && apart > SLOW * self.missed {
            apart + 2.0 * self.missed
        } else {
            0.0
        }
    }

    /// This rule, if it has converged and the `finest` has not; else the finest. The finest is of another kind, from
    /// which this one is so far `apart`. It differs from the rule before it by `missed`.
    ///
    /// Also returns what the rule differs from its neighbour by, and how far it may be off by what the other kind tells:
    /// 0 where the finest is sure.
    fn or_finest(self, finest: Tolerance, missed: f64, apart: f64) -> (Tolerance, f64, f64) {
        if self.missed <= CONVERGED * missed && missed > CONVERGED * apart {
            (self.tolerance, self.missed, apart)
        } else if missed > SURE * apart {
            // Twice, as the neighbour of the other kind's rule misses something, too.
            (finest, missed, apart + 2.0 * self.missed)
        } else {
            (finest, missed, 0.0)
        }
    }
}

/// What a rule misses at the corners of a tile.
#[derive(Default)]
pub struct AtCorners {
    /// The most.
    pub missed: f64,
    /// The mean, times what the most was found to be more than it showed.
    mean: f64,
    /// The axis along which it misses more at one end than at the other.
    pub worse_along: usize,
}

impl<S: Shade, const TERMS: usize> Tiling<'_, S, TERMS> {
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
        let stated = |tolerance, times, missed, apart: f64| Rule {
            tolerance,
            missed: apart.max(times * missed) + light_error,
            own: missed,
            times,
        };
        // What a rule misses shows against a finer one. The finest itself is stated to miss what it
        // was found to mend.
        let (mut check, mut before_missed) = (tolerance.finer(), f64::INFINITY);
        let mut fine = function.at(middle, check);
        let (kind_changes_at, mut last_of_kind) = (self.shade.kind_changes_at(), None);
        loop {
            let value = function.at(middle, tolerance);
            let shown = largest_difference(value, fine);
            let brightness = before + self.gain * fine[0].max(fine[1]).max(fine[2]);
            let may_miss = self.demand.shares.rule * self.allowed(brightness, effort);
            let counts = |missed| missed > may_miss && effort != Effort::None;
            let is_refined = before_missed.is_finite();
            let missed = self.missed_if_slow(
                (middle, value),
                (shown, is_refined),
                counts,
                tolerance,
                function,
            );
            if missed <= may_miss {
                let doubt = last_of_kind.map_or(0.0, |(last, value): (LastOfKind, _)| {
                    last.doubts(missed, largest_difference(value, fine))
                });
                return stated(tolerance, 1.0, missed, doubt);
            }
            if effort == Effort::None {
                return stated(tolerance, self.times_unmet(tolerance), missed, 0.0);
            }
            if kind_changes_at == Some(check.level() + 1) {
                last_of_kind = Some((LastOfKind { tolerance, missed }, value));
            }
            let next = if missed > STUCK * before_missed {
                check
            } else {
                tolerance.little_finer(check)
            };
            if next.level() == check.level() {
                if check.level() == self.shade.finest_level() {
                    let (tolerance, missed, apart) = match last_of_kind {
                        Some((last, value)) => {
                            last.or_finest(check, missed, largest_difference(value, fine))
                        }
                        None => (check, missed, 0.0),
                    };
                    return stated(tolerance, self.times_unmet(tolerance), missed, apart);
                }
                check = check.finer();
                fine = function.at(middle, check);
            }
            (tolerance, before_missed) = (next, missed);
        }
    }

    /// How many times what a rule differs from its neighbour by is stated where no rule is fine enough. Two rules of a
    /// kind may agree by chance: next to the chart polynomials of degree 6 missed five times what they differed from
    /// degree 4 by (draw 1929 of seed 20261132 of the search).
    fn times_unmet(&self, tolerance: Tolerance) -> f64 {
        let unmet = self.demand.shares.unmet;
        match self.shade.kind_changes_at() {
            Some(wide) if tolerance.level() < wide => unmet.max(SLOW),
            _ => unmet,
        }
    }

    /// What a rule misses at a point where it gives `value`. It differs by `shown` from the next finer one, which may
    /// be a fraction of what it misses. The finest rule of its kind tells if more would count, and for a rule that
    /// `is_refined`: the one before it missed too much. Two that follow each other may agree by chance: polynomials of
    /// degree 4 and 6 did to 1e-5 where both missed 9e-4 (draw 1683 of seed 20261131 of the search), and two rules to
    /// 1e-9 where both missed 1.4e-4 (draw 2790 of seed 20261136). Of an uneven rule the finest of all tells, too,
    /// where it has converged.
    fn missed_if_slow(
        &self,
        (at, value): ([f64; 2], [f64; 3]),
        (shown, is_refined): (f64, bool),
        counts: impl Fn(f64) -> bool,
        tolerance: Tolerance,
        function: &mut Counted<'_, S>,
    ) -> f64 {
        let is_slow = counts(SLOW * shown);
        if counts(shown) || !(is_slow || is_refined) {
            return shown;
        }
        let mut finer_by = |levels: u32| {
            let finer = (0..levels).fold(tolerance, |rule, _| rule.finer());
            function.at(at, finer)
        };
        let level = tolerance.level();
        let mut missed = shown;
        let of_its_kind = self.shade.kind_changes_at().unwrap_or(0);
        if level + 2 < of_its_kind {
            let finest = finer_by(of_its_kind - 1 - level);
            missed = missed.max(largest_difference(value, finest));
        }
        let above = self.shade.finest_level().saturating_sub(level);
        if above < 2 || !self.shade.is_uneven() || !is_slow || counts(missed) {
            return missed;
        }
        let [last, finest] = [above - 1, above].map(finer_by);
        let off = largest_difference(value, finest);
        if largest_difference(last, finest) <= CONVERGED * off {
            missed.max(off)
        } else {
            missed
        }
    }

    /// What a rule misses at the corners of what the outline has of a tile. `counts` tells whether so much is too much.
    pub(super) fn missed_at_corners(
        &self,
        rectangle: &Rectangle,
        counts: impl Fn(f64) -> bool,
        tolerance: Tolerance,
        function: &mut Counted<'_, S>,
    ) -> AtCorners {
        let covered = self.outline.polygon().clipped(rectangle);
        let (mut missed, mut worst, mut sum) = (0.0, None, 0.0);
        // The most at either end along each axis.
        let mut ends = [[0.0f64; 2]; 2];
        for &at in covered.corners() {
            let value = function.at(at, tolerance);
            let shown = self.missed_at(&[at], &[value], tolerance, function);
            for (axis, ends) in ends.iter_mut().enumerate() {
                let end = usize::from(rectangle.local(axis, at[axis]) > 0.0);
                ends[end] = ends[end].max(shown);
            }
            sum += shown;
            if shown > missed {
                (missed, worst) = (shown, Some((at, value)));
            }
        }
        let mut mean = sum / covered.corners().len().max(1) as f64;
        if let Some(point) = worst {
            mean /= missed;
            missed = self.missed_if_slow(point, (missed, false), counts, tolerance, function);
            mean *= missed;
        }
        let [columns, rows] = ends.map(|[low, high]| (high - low).abs());
        AtCorners {
            missed,
            mean,
            worse_along: usize::from(rows > columns),
        }
    }

    /// How fine a function has to be worked out on a part of a pixel, by its corners, and what is then stated to be
    /// missed. An edge lies on it, and beyond the edge even a function that is not uneven may ask for more, if it has
    /// rules of several kinds: for a mirror along one axis they were off by 3 percent in a corner, and by nothing in
    /// the middle (draw 1663 of seed 20261150 of the search). Where the second kind would be too dear, what the corners
    /// show in the mean is stated, and no finer rule is asked: with one the dearest images took up to 60 percent more
    /// work and came to their limit (materials 32, 416 and 608 of the preset). Other functions are judged in the
    /// middle: what the bulb's highlight misses in a far corner says nothing of the highlight.
    pub(super) fn rule_of_pixel(
        &self,
        candidate: &Candidate<'_>,
        rule: &Rule,
        allowed: f64,
        function: &mut Counted<'_, S>,
    ) -> (Tolerance, f64) {
        let (is_uneven, changes_at) = (self.shade.is_uneven(), self.shade.kind_changes_at());
        if !is_uneven && changes_at.is_none() {
            return (rule.tolerance, rule.missed);
        }
        let finest = self.shade.finest_level();
        let is_refined = is_uneven || changes_at.is_some_and(|level| level <= finest);
        let counts = |missed: f64| {
            candidate.effort != Effort::None && missed > self.demand.shares.rule * allowed
        };
        let mut tolerance = rule.tolerance;
        loop {
            let corners = self.missed_at_corners(candidate.rectangle, counts, tolerance, function);
            if !is_refined {
                return (tolerance, rule.missed.max(rule.times * corners.mean));
            }
            let missed = rule.missed.max(rule.times * corners.missed);
            if !counts(corners.missed) {
                let doubt = self.doubt_at_corners(candidate.rectangle, tolerance, function);
                return (tolerance, missed.max(doubt));
            }
            tolerance = tolerance.finer();
            // The finest is stated to miss what it was found to mend.
            if tolerance.level() >= self.shade.finest_level() {
                let (tolerance, own, apart) =
                    self.of_kinds_at_corners(candidate.rectangle, corners.missed, function);
                let missed = self.times_unmet(tolerance) * own;
                return (tolerance, rule.missed.max(missed).max(apart));
            }
        }
    }

    /// The rule for a part of a pixel for which none is fine enough, where the finest differs from the one before it by
    /// `missed`: as [`LastOfKind::or_finest`].
    fn of_kinds_at_corners(
        &self,
        rectangle: &Rectangle,
        missed: f64,
        function: &mut Counted<'_, S>,
    ) -> (Tolerance, f64, f64) {
        let finest = self.rule_of_level(self.shade.finest_level());
        match self.last_of_kind_at_corners(rectangle, finest, function) {
            Some((last, apart)) => last.or_finest(finest, missed, apart),
            None => (finest, missed, 0.0),
        }
    }

    /// How far a rule for a part of a pixel may be off that misses little enough: as [`LastOfKind::doubts`].
    fn doubt_at_corners(
        &self,
        rectangle: &Rectangle,
        tolerance: Tolerance,
        function: &mut Counted<'_, S>,
    ) -> f64 {
        // The finest is compared with the one before it.
        let finer = (tolerance.level() + 1).min(self.shade.finest_level());
        let is_first = |changes_at| finer <= changes_at;
        if self.shade.kind_changes_at().is_none_or(is_first) {
            return 0.0;
        }
        let [rule, finer] = [finer - 1, finer].map(|level| self.rule_of_level(level));
        let missed = self.most_apart_at_corners(rectangle, [rule, finer], function);
        self.last_of_kind_at_corners(rectangle, finer, function)
            .map_or(0.0, |(last, apart)| last.doubts(missed, apart))
    }

    /// The last rule of the first kind that can be compared with a finer one, on a part of a pixel, and how far it is
    /// from a rule of the second.
    fn last_of_kind_at_corners(
        &self,
        rectangle: &Rectangle,
        other: Tolerance,
        function: &mut Counted<'_, S>,
    ) -> Option<(LastOfKind, f64)> {
        let level = self.shade.kind_changes_at()?.checked_sub(2)?;
        let tolerance = self.rule_of_level(level);
        let mut apart_from =
            |other| self.most_apart_at_corners(rectangle, [tolerance, other], function);
        let missed = apart_from(tolerance.finer());
        Some((LastOfKind { tolerance, missed }, apart_from(other)))
    }

    /// How far two rules are apart at the corners of what the outline has of a rectangle, at most.
    fn most_apart_at_corners(
        &self,
        rectangle: &Rectangle,
        rules: [Tolerance; 2],
        function: &mut Counted<'_, S>,
    ) -> f64 {
        let covered = self.outline.polygon().clipped(rectangle);
        let apart = |&at: &[f64; 2]| {
            let [one, other] = rules.map(|rule| function.at(at, rule));
            largest_difference(one, other)
        };
        covered.corners().iter().map(apart).fold(0.0, f64::max)
    }

    fn rule_of_level(&self, level: u32) -> Tolerance {
        (0..level).fold(self.demand.tolerance, |rule, _| rule.finer())
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

//! The rule along the lobe's wide axis, in pieces between which the integral over the narrow one is
//! smooth.

use super::lanes::Cuts;
use super::line::Lines;
use super::passages::{End, Passage, count_covering};
use super::point::Point;
use crate::hybrid::budget::glossy::{FALL_SHARE, TAIL_DIGITS};
use crate::numerics::elementary::about_ln;
use crate::numerics::gauss::GaussRule;

/// Buffers.
#[derive(Default)]
pub struct Scratch {
    /// The lines of the rule.
    pub lines: Lines,
    /// Where they are cut.
    pub cuts: Cuts,
    passages: Vec<Passage>,
    ends: Vec<End>,
}

impl Scratch {
    /// Ends of pieces that were looked at.
    pub fn ends(&self) -> usize {
        self.ends.len()
    }
}

/// A piece of the wide axis.
#[derive(Clone, Copy, Debug)]
struct Piece {
    from: f64,
    to: f64,
    /// The fastest change on it, in widths a unit of q.
    rate: f64,
    /// Whether it is one passage with nothing else in it, for which three lines do.
    is_passage: bool,
    /// How many lines it takes.
    lines: usize,
}

impl Piece {
    /// A piece for a Gauss rule.
    fn new(point: &Point<'_>, [from, to]: [f64; 2], rate: f64) -> Self {
        Self {
            from,
            to,
            rate,
            is_passage: false,
            lines: point.gauss_points([from, to], rate),
        }
    }

    /// A passage.
    fn passage([from, to]: [f64; 2], rate: f64) -> Self {
        Self {
            from,
            to,
            rate,
            is_passage: true,
            lines: Passage::RULE.len(),
        }
    }

    /// The piece that covers both, if it takes no more lines than they do.
    fn merged(&self, next: &Self, point: &Point<'_>) -> Option<Self> {
        let both = Self::new(point, [self.from, next.to], self.rate.max(next.rate));
        (both.lines <= self.lines.saturating_add(next.lines)).then_some(both)
    }
}

impl Point<'_> {
    /// Gathers the lines of the rule.
    pub fn gather(&self, scratch: &mut Scratch) {
        scratch.lines.clear();
        // What the point before left would count as work of this one.
        scratch.ends.clear();
        let [low, high] = self.extent();
        if low >= high {
            return;
        }
        let mut passages = std::mem::take(&mut scratch.passages);
        let mut ends = std::mem::take(&mut scratch.ends);
        self.find_ends([low, high], &mut passages, &mut ends);
        let mut piece: Option<Piece> = None;
        for pair in ends.windows(2) {
            let (from, to) = (pair[0].q, pair[1].q);
            if from >= to {
                continue;
            }
            let middle = 0.5 * (from + to);
            let rate = self.rate(middle, &passages);
            let [begins, is_over] = [pair[0].passage, pair[1].passage];
            let is_passage = begins.is_some() && begins == is_over;
            let next = if is_passage && count_covering(middle, &passages) == 1 {
                Piece::passage([from, to], rate)
            } else {
                Piece::new(self, [from, to], rate)
            };
            let before = piece.take();
            let merged = before.filter(|_| !pair[0].kink);
            let merged = merged.and_then(|before| before.merged(&next, self));
            if let (Some(before), None) = (before, merged) {
                self.add_lines(&before, scratch);
            }
            piece = Some(merged.unwrap_or(next));
        }
        if let Some(piece) = piece {
            self.add_lines(&piece, scratch);
        }
        (scratch.passages, scratch.ends) = (passages, ends);
    }

    /// Adds the lines of a piece of the wide axis.
    fn add_lines(&self, piece: &Piece, scratch: &mut Scratch) {
        if piece.is_passage {
            let middle = 0.5 * (piece.from + piece.to);
            for [off, weight] in Passage::RULE {
                let line = [middle + off / piece.rate, weight / piece.rate];
                scratch.lines.push(line);
            }
            return;
        }
        let rule = GaussRule::of(piece.lines);
        // q = 2x/(1 - x^2): a lobe that is wide along q runs to infinity.
        for (x, weight) in rule.on(half_tangent(piece.from), half_tangent(piece.to)) {
            let per = 1.0 / (1.0 - x * x);
            let slope = 2.0 * (1.0 + x * x) * per * per;
            scratch.lines.push([2.0 * x * per, weight * slope]);
        }
    }

    /// Gauss points for a piece on which the integral over p changes at this rate. Digits below the last one
    /// of the whole lobe do not count on a piece that is a small part of it, or on which the lobe is low.
    fn gauss_points(&self, [from, to]: [f64; 2], rate: f64) -> usize {
        let nearest = from.max(-to).max(0.0);
        let low = 0.5 * self.glossy.reflectance.lobe.n_v * about_ln(1.0 + nearest * nearest);
        let widths = (to - from) * self.per_wide_width;
        let short = -about_ln(widths.clamp(f64::MIN_POSITIVE, 1.0));
        let tolerance = self.tolerance.after_fall(FALL_SHARE * low + short);
        tolerance.points((to - from) * rate, 0.0)
    }

    /// Whether the lines of a piece without passages lie farther than this from both of its ends.
    pub fn keeps_clear(&self, [from, to]: [f64; 2], distance: f64) -> bool {
        let shares = |points| (to - from) * first_gauss_point(points) > distance;
        // Few pieces take one line; two are quickly ruled out.
        shares(2) && shares(self.gauss_points([from, to], self.per_wide_width))
    }

    /// How fast the integral over p changes at q: widths of the lobe or of an edge's passage a unit.
    fn rate(&self, q: f64, passages: &[Passage]) -> f64 {
        let covering = passages.iter().filter(|passage| passage.covers(q));
        covering.fold(self.per_wide_width, |rate, passage| rate.max(passage.rate))
    }

    /// The q between which the lobe is integrated: it reaches no farther, or light stands below the
    /// horizon beyond.
    ///
    /// Light is above the horizon in a disc of the slope plane about wo's tangents, which holds the
    /// origin. Over the p that the lobe reaches it is widest nearest its middle.
    pub(super) fn extent(&self) -> [f64; 2] {
        let lobe = &self.glossy.reflectance.lobe;
        let reach = self.tolerance.reach(lobe.n_v, TAIL_DIGITS);
        let per_height = 1.0 / self.wo.z;
        let [p, q] = [self.wo.x * per_height, self.wo.y * per_height];
        let farthest = reach.min(q.abs() + per_height);
        let widest = self.reach / self.widths_per_slope(farthest);
        let off = p - p.clamp(-widest, widest);
        let half = (per_height * per_height - off * off).max(0.0).sqrt();
        [(q - half).clamp(-reach, 0.0), (q + half).clamp(0.0, reach)]
    }
}

/// A little less than the first of Gauss's points between 0 and 1, which is about sin^2(j/(2 n + 1)) with
/// j = 2.405 the first zero of the Bessel function J_0.
fn first_gauss_point(points: usize) -> f64 {
    let root = 2.36 / (2 * points + 1) as f64;
    let square = root * root;
    square * (1.0 - square * (1.0 / 3.0))
}

/// tan(atan(q)/2), which stays finite as q does not.
fn half_tangent(q: f64) -> f64 {
    q / (1.0 + (1.0 + q * q).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gauss_points_keep_their_distance() {
        for points in 1..40 {
            let (first, _) = GaussRule::of(points).on(0.0, 1.0).next().expect("a point");
            let bound = first_gauss_point(points);
            assert!(
                bound <= first && first < 1.1 * bound,
                "{points}: {first} {bound}"
            );
        }
    }
}

//! The rule along the lobe's wide axis, in pieces between which the integral over the narrow one is
//! smooth.

use super::lanes::Cuts;
use super::line::Lines;
use super::passages::{Found, Passage};
use super::places::{Places, find_places};
use super::point::Point;
use crate::hybrid::budget::glossy::TAIL_DIGITS;
use crate::numerics::gauss::GaussRule;

/// Buffers.
#[derive(Default)]
pub struct Scratch {
    /// The lines of the rule.
    pub lines: Lines,
    /// Where they are cut.
    pub cuts: Cuts,
    found: Found,
    places: Places,
    pieces: Vec<Piece>,
}

impl Scratch {
    /// Ends of pieces that were looked at.
    pub fn ends(&self) -> usize {
        self.found.ends.len()
    }
}

/// A piece of the wide axis.
#[derive(Clone, Copy, Debug)]
struct Piece {
    /// The ends that it goes from and to.
    ends: [usize; 2],
    /// The fastest change on it, in widths a unit of q.
    rate: f64,
    /// Whether it is one passage with nothing else in it, for which three lines do.
    is_passage: bool,
    /// How many lines it takes.
    lines: usize,
}

impl Piece {
    /// A piece for a Gauss rule.
    fn new(point: &Point<'_>, places: &Places, ends: [usize; 2], rate: f64) -> Self {
        Self {
            ends,
            rate,
            is_passage: false,
            lines: point.gauss_points(places, ends, rate),
        }
    }

    /// A passage.
    fn passage(ends: [usize; 2], rate: f64) -> Self {
        Self {
            ends,
            rate,
            is_passage: true,
            lines: Passage::RULE.len(),
        }
    }

    /// The piece that covers both, if it takes no more lines than they do.
    fn merged(&self, next: &Self, point: &Point<'_>, places: &Places) -> Option<Self> {
        let ends = [self.ends[0], next.ends[1]];
        let both = Self::new(point, places, ends, self.rate.max(next.rate));
        (both.lines <= self.lines.saturating_add(next.lines)).then_some(both)
    }

    /// Whether its lines lie farther than this from both of its ends.
    fn keeps_clear(&self, places: &Places, distance: f64) -> bool {
        let [from, to] = self.ends.map(|end| places.q[end]);
        (to - from) * first_gauss_point(self.lines) > distance
    }

    /// Adds its lines.
    fn add_lines(&self, places: &Places, lines: &mut Lines) {
        let [from, to] = self.ends;
        if places.q[from] >= places.q[to] {
            return;
        }
        if self.is_passage {
            let middle = 0.5 * (places.q[from] + places.q[to]);
            for [off, weight] in Passage::RULE {
                lines.push([middle + off / self.rate, weight / self.rate]);
            }
            return;
        }
        let rule = GaussRule::of(self.lines);
        // q = 2x/(1 - x^2): a lobe that is wide along q runs to infinity.
        for (x, weight) in rule.on(places.half_tangent[from], places.half_tangent[to]) {
            let per = 1.0 / (1.0 - x * x);
            let slope = 2.0 * (1.0 + x * x) * per * per;
            lines.push([2.0 * x * per, weight * slope]);
        }
    }
}

impl Point<'_> {
    /// Gathers the lines of the rule.
    pub fn gather(&self, scratch: &mut Scratch) {
        let Scratch {
            lines,
            found,
            places,
            pieces,
            ..
        } = scratch;
        lines.clear();
        // What the point before left would count as work of this one.
        found.clear();
        let [low, high] = self.extent();
        if low >= high {
            return;
        }
        self.find_ends([low, high], found);
        loop {
            found.ends.sort_unstable_by(|a, b| a.q.total_cmp(&b.q));
            find_places(self.glossy.instructions, self, &found.ends, places);
            self.find_pieces(found, places, pieces);
            if !self.widen_steps(found, places, pieces) {
                break;
            }
            found.ends.retain(|end| low <= end.q && end.q <= high);
        }
        for piece in &*pieces {
            piece.add_lines(places, lines);
        }
    }

    /// Finds the pieces between the ends.
    fn find_pieces(&self, found: &Found, places: &Places, pieces: &mut Vec<Piece>) {
        pieces.clear();
        for at in 1..found.ends.len() {
            let next = self.piece([at - 1, at], found, places);
            let before = pieces.last().filter(|_| !found.ends[at - 1].kink);
            let merged = before.and_then(|before| before.merged(&next, self, places));
            if let (Some(merged), Some(last)) = (merged, pieces.last_mut()) {
                *last = merged;
            } else {
                pieces.push(next);
            }
        }
    }

    /// Gives steps the two ends of their passages where a line beside them lies in the passage, or another passage goes
    /// on there. Returns whether there are such.
    fn widen_steps(&self, found: &mut Found, places: &Places, pieces: &[Piece]) -> bool {
        let count = found.ends.len();
        for piece in pieces {
            for end in piece.ends {
                let Some(index) = found.ends[end].step else {
                    continue;
                };
                let passage = found.steps[index];
                let is_alone = found.count_covering(passage.step) == 0;
                if !is_alone || !piece.keeps_clear(places, passage.half) {
                    found.widen_step(end, self);
                }
            }
        }
        found.ends.len() > count
    }

    /// The piece between two ends that follow each other.
    fn piece(&self, ends: [usize; 2], found: &Found, places: &Places) -> Piece {
        let [begin, end] = ends.map(|end| &found.ends[end]);
        let middle = 0.5 * (begin.q + end.q);
        let rate = self.rate(middle, &found.passages);
        let is_passage = begin.passage.is_some() && begin.passage == end.passage;
        if is_passage && found.count_covering(middle) == 1 {
            Piece::passage(ends, rate)
        } else {
            Piece::new(self, places, ends, rate)
        }
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

//! The rule along the lobe's wide axis, in pieces between which the integral over the narrow one is
//! smooth.

use super::lanes::Cuts;
use super::line::Lines;
use super::point::Point;
use crate::hybrid::budget::glossy::{CORNER_DIGITS, FALL_SHARE, PASSAGE, STEP, TAIL_DIGITS};
use crate::numerics::elementary::log1p;
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

/// An edge of patches that passes through the lobe along the wide axis.
#[derive(Clone, Copy, Debug)]
struct Passage {
    /// The q at which it crosses p = 0.
    middle: f64,
    /// Widths of the lobe along p that it passes a unit of q.
    rate: f64,
}

/// Where a piece of the wide axis may end.
#[derive(Clone, Copy, Debug)]
struct End {
    q: f64,
    /// Whether the integral over p bends here, so that a piece has to end.
    kink: bool,
}

/// A piece of the wide axis.
#[derive(Clone, Copy, Debug)]
struct Piece {
    from: f64,
    to: f64,
    /// The fastest change on it, in widths a unit of q.
    rate: f64,
}

impl Piece {
    /// Gauss points. Digits below the last one of the whole lobe do not count on a piece that is a small
    /// part of it, or on which the lobe is low.
    fn points(&self, point: &Point<'_>) -> usize {
        let n_v = point.glossy.reflectance.lobe.n_v;
        let nearest = self.from.max(-self.to).max(0.0);
        let low = 0.5 * n_v * log1p(nearest * nearest);
        let widths = (self.to - self.from) * n_v.sqrt();
        let short = log1p((1.0 / widths - 1.0).max(0.0));
        let tolerance = point.tolerance.after_fall(FALL_SHARE * low + short);
        tolerance.points((self.to - self.from) * self.rate, 0.0)
    }

    /// The piece that covers both.
    fn with(&self, next: &Self) -> Self {
        Self {
            from: self.from,
            to: next.to,
            rate: self.rate.max(next.rate),
        }
    }

    fn is_cheaper_with(&self, next: &Self, point: &Point<'_>) -> bool {
        self.with(next).points(point) <= self.points(point) + next.points(point)
    }
}

impl Point<'_> {
    /// Gathers the lines of the rule.
    pub fn gather(&self, scratch: &mut Scratch) {
        scratch.lines.clear();
        let [low, high] = self.extent();
        if low >= high {
            return;
        }
        let mut passages = std::mem::take(&mut scratch.passages);
        let mut ends = std::mem::take(&mut scratch.ends);
        self.find_passages([low, high], &mut passages, &mut ends);
        self.find_kinks([low, high], &mut ends);
        let mut piece: Option<Piece> = None;
        for pair in ends.windows(2) {
            let (from, to) = (pair[0].q, pair[1].q);
            if from >= to {
                continue;
            }
            let next = Piece {
                from,
                to,
                rate: self.rate(0.5 * (from + to), &passages),
            };
            piece = match piece {
                Some(piece) if !pair[0].kink && piece.is_cheaper_with(&next, self) => {
                    Some(piece.with(&next))
                }
                Some(done) => {
                    self.add_lines(&done, scratch);
                    Some(next)
                }
                None => Some(next),
            };
        }
        if let Some(piece) = piece {
            self.add_lines(&piece, scratch);
        }
        (scratch.passages, scratch.ends) = (passages, ends);
    }

    /// Adds the lines of a piece of the wide axis.
    fn add_lines(&self, piece: &Piece, scratch: &mut Scratch) {
        let rule = GaussRule::of(piece.points(self));
        // q = 2x/(1 - x^2): a lobe that is wide along q runs to infinity.
        for (x, weight) in rule.on(half_tangent(piece.from), half_tangent(piece.to)) {
            let per = 1.0 / (1.0 - x * x);
            let slope = 2.0 * (1.0 + x * x) * per * per;
            scratch.lines.push([2.0 * x * per, weight * slope]);
        }
    }

    /// How fast the integral over p changes at q: widths of the lobe or of an edge's passage a unit.
    fn rate(&self, q: f64, passages: &[Passage]) -> f64 {
        let per_width = self.glossy.reflectance.lobe.n_v.sqrt();
        let covering = passages
            .iter()
            .filter(|passage| (q - passage.middle).abs() * passage.rate < PASSAGE);
        covering.fold(per_width, |rate, passage| rate.max(passage.rate))
    }

    /// The q between which the lobe is integrated: it reaches no farther, or light stands below the
    /// horizon beyond.
    ///
    /// Light is above the horizon in a disc of the slope plane about wo's tangents, which holds the
    /// origin. Over the p that the lobe reaches it is widest nearest its middle.
    fn extent(&self) -> [f64; 2] {
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

    /// Finds where edges of patches pass through the lobe, and where pieces may end for them.
    fn find_passages(
        &self,
        [low, high]: [f64; 2],
        passages: &mut Vec<Passage>,
        ends: &mut Vec<End>,
    ) {
        passages.clear();
        ends.clear();
        let plane = &self.glossy.plane;
        let lobe = &self.glossy.reflectance.lobe;
        let (per_width, wide) = (lobe.n_u.sqrt(), 1.0 / lobe.n_v.sqrt());
        let counts = [plane.columns, plane.rows];
        let along = [&self.across, &self.up];
        for axis in 0..2 {
            for line in 0..=counts[axis] {
                let edge = along[axis].less(f64::from(line), &self.depth);
                for middle in edge.on_axis().zeros() {
                    if !(middle > low && middle < high) {
                        continue;
                    }
                    let depth = self.depth.value(0.0, middle);
                    let other = along[1 - axis].value(0.0, middle);
                    let most = f64::from(counts[1 - axis]) + 1.0;
                    if !(depth > 0.0 && other > -depth && other < most * depth) {
                        continue;
                    }
                    let rate = edge.drift(middle) * per_width;
                    let half = PASSAGE / rate;
                    if half < STEP * wide {
                        ends.push(End {
                            q: middle,
                            kink: true,
                        });
                    } else if rate * wide > 1.0 {
                        passages.push(Passage { middle, rate });
                        ends.extend([middle - half, middle + half].map(|q| End { q, kink: false }));
                    }
                }
            }
        }
        ends.retain(|end| end.q > low && end.q < high);
        ends.extend([low, high].map(|q| End { q, kink: true }));
    }

    /// Finds where the integral over p has a kink, and sorts all ends.
    fn find_kinks(&self, [low, high]: [f64; 2], ends: &mut Vec<End>) {
        let reach = 0.5 * self.tolerance.reach_widths(-CORNER_DIGITS);
        let levels = self
            .branches
            .levels()
            .flat_map(|level| level.on_axis().zeros());
        let corners = self.glossy.corners.iter().filter_map(|corner| {
            let half = self.wo + (*corner - self.position).normalized();
            let [p, q] = [half.x / half.z, half.y / half.z];
            (p.abs() * self.widths_per_slope(q) < reach).then_some(q)
        });
        let kinks = levels.chain(corners).filter(|&q| q > low && q < high);
        ends.extend(kinks.map(|q| End { q, kink: true }));
        ends.sort_unstable_by(|a, b| a.q.total_cmp(&b.q));
    }
}

/// tan(atan(q)/2), which stays finite as q does not.
fn half_tangent(q: f64) -> f64 {
    q / (1.0 + (1.0 + q * q).sqrt())
}

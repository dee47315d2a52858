//! The middle of a lobe that is narrow along the sample's lines.
//!
//! All is worked out for [`LANES`] points at a time: a rule for one receiver asks for some hundreds.

#![allow(
    clippy::needless_range_loop,
    reason = "loops over lanes of several arrays: the compiler turns no other form into vectors"
)]

use crate::numerics::batch::LANES;
use crate::numerics::elementary::{asinh, log1p};
use crate::numerics::instructions::{Instructions, kernel};
use crate::numerics::tolerance::Tolerance;
use crate::vector::Vec3;

/// Steps of a side of the square among which the lobe's middle is looked for, and halvings.
const STEPS: usize = 8;
const HALVINGS: usize = 20;

/// The square's sides.
const SIDES: usize = 4;

/// Sides whose steps fill a block: one step of each at a time.
const STEPS_A_BLOCK: usize = LANES / SIDES;

/// A number for each lane.
type Lanes = [f64; LANES];

/// The middle of a lobe that is narrow along u, on the sample: the points whose half vector between a
/// source and a receiver has no slope along u. Where it leaves the square, lines lose the lobe.
pub struct Ridge {
    pub receiver: Vec3,
    pub source: Vec3,
    pub n_u: f64,
    /// How many widths of the lobe count on either side.
    pub reach: f64,
    /// The source's radius: 0 for its centre alone.
    pub radius: f64,
    pub instructions: Instructions,
}

/// Parts of the square's sides between which the lobe's middle is `off` widths away.
pub struct Brackets {
    /// Where the sides begin, and how far they go.
    from: [Lanes; 2],
    along: [Lanes; 2],
    off: Lanes,
    /// The widths at the first end, less `off`.
    before: Lanes,
    /// The ends, as shares of the sides.
    low: Lanes,
    high: Lanes,
    count: usize,
}

impl Brackets {
    const NONE: Self = Self {
        from: [[0.0; LANES]; 2],
        along: [[0.0; LANES]; 2],
        off: [0.0; LANES],
        before: [0.0; LANES],
        low: [0.0; LANES],
        high: [0.0; LANES],
        count: 0,
    };
}

/// How many widths of the lobe a point lies off it. Far out along its other axis the lobe is wider
/// along this one. For a source with a radius these are drawn together: `reach` of them are the lobe's and
/// those over which the middle moves from the source's centre to its outline.
#[inline(always)]
fn off(ridge: &Ridge, [u, v]: [f64; 2]) -> f64 {
    let unit = |w: &Vec3| {
        let (x, y, z) = (w.x - u, w.y - v, w.z);
        let inverse = 1.0 / (x * x + y * y + z * z).sqrt();
        ([x * inverse, y * inverse, z * inverse], inverse)
    };
    let ((a, _), (b, per_source)) = (unit(&ridge.receiver), unit(&ridge.source));
    let half = [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
    let [p, q] = [half[0] / half[2], half[1] / half[2]];
    let t = q * q + f64::MIN_POSITIVE;
    let per_width = (ridge.n_u * (log1p(t) / t)).sqrt();
    let outline = ridge.radius * per_source * (1.0 - b[0] * b[0]).sqrt() / half[2];
    p * per_width / (1.0 + outline * per_width / ridge.reach)
}

kernel! {
    /// How many widths of the lobe points lie off it.
    pub fn widths_off(ridge: &Ridge, points: &[Lanes; 2]) -> Lanes {
        let mut widths = [0.0; LANES];
        for i in 0..LANES {
            widths[i] = off(ridge, [points[0][i], points[1][i]]);
        }
        widths
    }
}

kernel! {
    /// Halves brackets.
    pub fn halve(ridge: &Ridge, brackets: &mut Brackets) {
        let Brackets { from, along, off: reach, before, low, high, .. } = brackets;
        for _ in 0..HALVINGS {
            for i in 0..LANES {
                let middle = 0.5 * (low[i] + high[i]);
                let at = [from[0][i] + middle * along[0][i], from[1][i] + middle * along[1][i]];
                let after = off(ridge, at) - reach[i];
                let same = (after > 0.0) == (before[i] > 0.0);
                low[i] = if same { middle } else { low[i] };
                high[i] = if same { high[i] } else { middle };
            }
        }
    }
}

kernel! {
    /// For lines, given by v and their ends, the widths that each passes, and its length in the variable t of
    /// [`super::transfer`].
    pub fn along_lines(ridge: &Ridge, lines: &[Lanes; 3]) -> [Lanes; 2] {
        let [v, low, high] = lines;
        let mut found = [[0.0; LANES]; 2];
        for i in 0..LANES {
            found[0][i] = (off(ridge, [high[i], v[i]]) - off(ridge, [low[i], v[i]])).abs();
        }
        for i in 0..LANES {
            let [from, to] = span_along(&ridge.receiver, [v[i], low[i], high[i]]);
            found[1][i] = to - from;
        }
        found
    }
}

/// The ends of a line from `low` to `high` in the variable t of [`super::transfer`].
#[inline(always)]
pub fn span_along(receiver: &Vec3, [v, low, high]: [f64; 3]) -> [f64; 2] {
    let nearest = if receiver.x < low { low } else { receiver.x };
    let nearest = if nearest > high { high } else { nearest };
    let (off, across) = (receiver.x - nearest, receiver.y - v);
    let reach = (off * off + across * across + receiver.z * receiver.z).sqrt();
    [
        asinh((low - nearest) / reach),
        asinh((high - nearest) / reach),
    ]
}

impl Ridge {
    /// Points along every line: v, its weight, and its least and largest u.
    pub fn points_along(&self, lines: &[[f64; 4]], tolerance: Tolerance) -> usize {
        let mut most = 1;
        for block in lines.chunks(LANES) {
            // The last line again fills up the last block.
            let mut lanes = [[0.0; LANES]; 3];
            for i in 0..LANES {
                let [v, _, low, high] = block[i.min(block.len() - 1)];
                [lanes[0][i], lanes[1][i], lanes[2][i]] = [v, low, high];
            }
            let [widths, lengths] = along_lines(self.instructions, self, &lanes);
            for (widths, length) in widths.into_iter().zip(lengths) {
                most = most.max(tolerance.points(widths, tolerance.more_beside(length)));
            }
        }
        most
    }

    /// Over how many widths the ends of lines move from the first of them to the last, where the lobe
    /// reaches; `None` if it reaches none of them.
    pub fn widths_passed(&self, lines: [[f64; 3]; 3]) -> Option<f64> {
        let mut points = [[0.0; LANES]; 2];
        for (index, [v, low, high]) in lines.into_iter().enumerate() {
            for (lane, u) in [(2 * index, low), (2 * index + 1, high)] {
                [points[0][lane], points[1][lane]] = [u, v];
            }
        }
        let off = widths_off(self.instructions, self, &points);
        let off = [[off[0], off[1]], [off[2], off[3]], [off[4], off[5]]];
        let beyond = |is_beyond: fn(f64, f64) -> bool| {
            let mut ends = off.iter().flatten();
            ends.all(|&off| is_beyond(off, self.reach))
        };
        if beyond(|off, reach| off > reach) || beyond(|off, reach| off < -reach) {
            return None;
        }
        let off = off.map(|ends| ends.map(|off| off.clamp(-self.reach, self.reach)));
        let passed = [0, 1].map(|end| (off[2][end] - off[0][end]).abs());
        Some(passed[0].max(passed[1]))
    }

    /// The v at which the lobe begins to leave the square with these corners, or has left it.
    pub fn crossings(&self, corners: &[[f64; 2]; SIDES], mut found: impl FnMut(f64)) {
        let side = |index: usize| {
            let (from, to) = (corners[index], corners[(index + 1) % SIDES]);
            [from, [to[0] - from[0], to[1] - from[1]]]
        };
        let at = |step: usize| step as f64 / STEPS as f64;
        let mut widths = [[0.0; SIDES]; STEPS + 1];
        for (block, widths) in widths.chunks_mut(STEPS_A_BLOCK).enumerate() {
            let mut points = [[0.0; LANES]; 2];
            for lane in 0..LANES {
                let [from, along] = side(lane % SIDES);
                let share = at(STEPS_A_BLOCK * block + lane / SIDES);
                for axis in 0..2 {
                    points[axis][lane] = from[axis] + share * along[axis];
                }
            }
            let off = widths_off(self.instructions, self, &points);
            widths
                .as_flattened_mut()
                .iter_mut()
                .zip(off)
                .for_each(|(width, off)| *width = off);
        }
        let mut brackets = Brackets::NONE;
        for index in 0..SIDES {
            for off in [-self.reach, self.reach] {
                for step in 1..=STEPS {
                    let [before, after] =
                        [widths[step - 1], widths[step]].map(|at| at[index] - off);
                    if (before > 0.0) != (after > 0.0) {
                        brackets.push(side(index), off, before, [at(step - 1), at(step)]);
                        self.empty_if_full(&mut brackets, LANES, &mut found);
                    }
                }
            }
        }
        self.empty_if_full(&mut brackets, 1, &mut found);
    }

    /// Halves brackets and takes them out, if there are so many.
    fn empty_if_full(&self, brackets: &mut Brackets, full: usize, found: &mut impl FnMut(f64)) {
        if brackets.count < full {
            return;
        }
        halve(self.instructions, self, brackets);
        for i in 0..brackets.count {
            let middle = 0.5 * (brackets.low[i] + brackets.high[i]);
            found(brackets.from[1][i] + middle * brackets.along[1][i]);
        }
        brackets.count = 0;
    }
}

impl Brackets {
    fn push(&mut self, [from, along]: [[f64; 2]; 2], off: f64, before: f64, ends: [f64; 2]) {
        let lane = self.count;
        for axis in 0..2 {
            self.from[axis][lane] = from[axis];
            self.along[axis][lane] = along[axis];
        }
        (self.off[lane], self.before[lane]) = (off, before);
        [self.low[lane], self.high[lane]] = ends;
        self.count += 1;
    }
}

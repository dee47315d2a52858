//! Numbers at the ends of pieces of the wide axis, and how many lines a piece takes.
//!
//! Between two ends the integral over the narrow axis is a smooth function of q. Besides the lobe it holds the light on
//! the chart, where the line looks. That position has the depth for its divisor, and the light follows the logarithm of
//! the height above the sample: next to a piece where one of them changes by much lies a pole or the logarithm's
//! singularity, and a polynomial serves the less the more.

use super::lanes::Lanes;
use super::passages::End;
use super::point::Point;
use crate::hybrid::budget::glossy::{FALL_SHARE, GROWTH_MAX, PASSAGE_DIGITS, PASSAGE_LINES_MIN};
use crate::numerics::batch::LANES;
use crate::numerics::elementary::about_ln;
use crate::numerics::instructions::kernel;
use crate::numerics::tolerance::Tolerance;
use std::f64::consts::LN_10;

/// Numbers at the ends, by their index; beyond the last one, of no meaning.
#[derive(Default)]
pub struct Places {
    pub q: Vec<f64>,
    /// tan(atan(q)/2), which stays finite as q does not.
    pub half_tangent: Vec<f64>,
    /// The logarithm of the depth.
    ln_depth: Vec<f64>,
    /// That of the height above the sample.
    ln_height: Vec<f64>,
    /// That of 1 + q^2.
    ln_spread: Vec<f64>,
    /// Gauss points from this end to the next one, if no edge passes between.
    lines: Vec<f64>,
}

impl Places {
    /// Makes room for the numbers at the ends, whole blocks and the end after them.
    fn take(&mut self, ends: &[End]) {
        let room = ends.len().next_multiple_of(LANES) + 1;
        self.q.clear();
        self.q.extend(ends.iter().map(|end| end.q));
        let last = ends.last().map_or(0.0, |end| end.q);
        self.q.resize(room, last);
        let Self {
            half_tangent,
            ln_depth,
            ln_height,
            ln_spread,
            lines,
            ..
        } = self;
        for numbers in [half_tangent, ln_depth, ln_height, ln_spread, lines] {
            numbers.resize(room, 0.0);
        }
    }
}

kernel! {
    /// Works out the numbers at the ends.
    pub fn find_places(point: &Point<'_>, ends: &[End], places: &mut Places) {
        places.take(ends);
        let gap = point.glossy.gap;
        let blocks = (0..ends.len()).step_by(LANES);
        for first in blocks.clone() {
            let q = block(&places.q, first);
            let depth = point.depth.values_on_axis(&q);
            let up = point.up.values_on_axis(&q);
            let [mut half_tangents, mut ln_depth, mut ln_height, mut ln_spread] = [[0.0; LANES]; 4];
            for i in 0..LANES {
                half_tangents[i] = half_tangent(q[i]);
            }
            for i in 0..LANES {
                ln_depth[i] = about_ln(depth[i].abs());
                ln_height[i] = about_ln((up[i] + gap * depth[i]).abs()) - ln_depth[i];
                ln_spread[i] = about_ln(1.0 + q[i] * q[i]);
            }
            *block_of(&mut places.half_tangent, first) = half_tangents;
            *block_of(&mut places.ln_depth, first) = ln_depth;
            *block_of(&mut places.ln_height, first) = ln_height;
            *block_of(&mut places.ln_spread, first) = ln_spread;
        }
        for first in blocks {
            let (q, to) = (block(&places.q, first), block(&places.q, first + 1));
            let depth = [block(&places.ln_depth, first), block(&places.ln_depth, first + 1)];
            let height = [block(&places.ln_height, first), block(&places.ln_height, first + 1)];
            let spread = [block(&places.ln_spread, first), block(&places.ln_spread, first + 1)];
            let mut lines = [0.0; LANES];
            for i in 0..LANES {
                let piece = Stretch {
                    from: q[i],
                    to: to[i],
                    grown: [depth[1][i] - depth[0][i], height[1][i] - height[0][i]],
                    ln_spreads: [spread[0][i], spread[1][i]],
                };
                lines[i] = piece.lines(point);
            }
            *block_of(&mut places.lines, first) = lines;
        }
    }
}

/// The numbers from an index on, one a lane.
#[inline(always)]
fn block(numbers: &[f64], first: usize) -> Lanes {
    *numbers[first..].first_chunk().expect("a whole block")
}

/// The same, to be written.
#[inline(always)]
fn block_of(numbers: &mut [f64], first: usize) -> &mut Lanes {
    numbers[first..].first_chunk_mut().expect("a whole block")
}

/// A stretch of the wide axis between two ends.
struct Stretch {
    from: f64,
    to: f64,
    /// By how much the logarithms of the depth and of the height grow.
    grown: [f64; 2],
    /// The logarithms of 1 + q^2 at either end.
    ln_spreads: [f64; 2],
}

impl Stretch {
    /// The tolerance on it. Digits below the last one of the whole lobe do not count on a piece that is a small part
    /// of it, or on which the lobe is low.
    #[inline(always)]
    fn tolerance(&self, point: &Point<'_>, spare_digits: f64) -> Tolerance {
        let nearest = if self.from > 0.0 {
            self.ln_spreads[0]
        } else if self.to < 0.0 {
            self.ln_spreads[1]
        } else {
            0.0
        };
        let low = 0.5 * point.glossy.reflectance.lobe.n_v * nearest;
        let widths = (self.to - self.from) * point.per_wide_width;
        let widths = if widths < 1.0 { widths } else { 1.0 };
        let short = if widths > 0.0 { -about_ln(widths) } else { 0.0 };
        point
            .tolerance
            .after_fall(FALL_SHARE * low + short + spare_digits * LN_10)
    }

    /// Gauss points if no edge passes.
    #[inline(always)]
    fn lines(&self, point: &Point<'_>) -> f64 {
        let widths = (self.to - self.from) * point.per_wide_width;
        let growth = self.grown[0].abs() + self.grown[1].abs();
        let growth = if growth < GROWTH_MAX {
            growth
        } else {
            GROWTH_MAX
        };
        self.tolerance(point, 0.0).points_of_growth(widths, growth)
    }

    /// Gauss points where edges pass, and the integral over p changes at this rate.
    fn lines_of_passages(&self, point: &Point<'_>, rate: f64) -> usize {
        let lines = |spare_digits: f64| {
            let tolerance = self.tolerance(point, spare_digits);
            tolerance.points((self.to - self.from) * rate, 0.0)
        };
        let spared = lines(PASSAGE_DIGITS);
        if spared >= PASSAGE_LINES_MIN {
            return spared;
        }
        // Where all digits ask for one line, one does: a chart of many patches has hundreds of such pieces.
        spared.max(lines(0.0).min(PASSAGE_LINES_MIN))
    }
}

impl Point<'_> {
    /// Gauss points for a piece between two ends, on which the integral over p changes at this rate.
    pub fn gauss_points(&self, places: &Places, [from, to]: [usize; 2], rate: f64) -> usize {
        let grown = |ln: &[f64]| ln[to] - ln[from];
        let stretch = Stretch {
            from: places.q[from],
            to: places.q[to],
            grown: [&places.ln_depth, &places.ln_height].map(|ln| grown(ln)),
            ln_spreads: [from, to].map(|end| places.ln_spread[end]),
        };
        if rate > self.per_wide_width {
            stretch.lines_of_passages(self, rate)
        } else if to == from + 1 {
            places.lines[from] as usize
        } else {
            stretch.lines(self) as usize
        }
    }
}

/// tan(atan(q)/2).
#[inline(always)]
fn half_tangent(q: f64) -> f64 {
    q / (1.0 + (1.0 + q * q).sqrt())
}

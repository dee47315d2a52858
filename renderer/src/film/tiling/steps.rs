//! Steps between a tile's nodes.
//!
//! A step may lie anywhere between two neighbouring nodes, and the series has it somewhere between them. By how much it
//! is misplaced neither the last coefficients tell nor a few points between the nodes: there are places of the step at
//! which none of them shows it.

use super::Tiling;
use super::shade::{Counted, Shade};
use crate::numerics::channels::largest_difference;
use crate::numerics::chebyshev::Basis;
use crate::numerics::polygon::Rectangle;
use crate::numerics::tolerance::Tolerance;

/// The values at a tile's nodes, row by row.
pub type Values<const TERMS: usize> = [[[f64; 3]; TERMS]; TERMS];

/// The values on a row or a column of nodes.
struct Line<const TERMS: usize> {
    values: [[f64; 3]; TERMS],
    /// The most by which two of them differ.
    range: f64,
    /// The gap between two nodes with the largest step, and that step times the length of the gap.
    largest: (usize, f64),
    /// The next smaller one.
    second: f64,
}

impl<const TERMS: usize> Line<TERMS> {
    /// From the values, and the lengths of the gaps between the nodes, as [`shares_of_pixels`] tells them.
    fn new(values: [[f64; 3]; TERMS], gaps: &[f64; TERMS]) -> Self {
        let most = |pick: fn(f64, f64) -> f64| {
            values[1..].iter().fold(values[0], |most, value| {
                [0, 1, 2].map(|channel| pick(most[channel], value[channel]))
            })
        };
        let mut line = Self {
            values,
            range: largest_difference(most(f64::max), most(f64::min)),
            largest: (0, 0.0),
            second: 0.0,
        };
        for (index, gap) in gaps[..TERMS - 1].iter().enumerate() {
            let step = gap * line.step(values[index], values[index + 1]);
            if step > line.largest.1 {
                line.second = line.largest.1;
                line.largest = (index, step);
            } else {
                line.second = line.second.max(step);
            }
        }
        line
    }

    /// What is a step of a change between two neighbours. Over one of several gaps nothing smooth changes by half of
    /// all that it changes by.
    fn step(&self, from: [f64; 3], to: [f64; 3]) -> f64 {
        (largest_difference(from, to) - 0.5 * self.range).max(0.0)
    }

    /// The largest step once there is `value` in the middle of its gap. What rises evenly is none.
    fn looked_at(&self, value: [f64; 3], gaps: &[f64; TERMS]) -> f64 {
        let (gap, _) = self.largest;
        let halves = [gap, gap + 1].map(|end| self.step(self.values[end], value));
        self.second.max(gaps[gap] * halves[0].max(halves[1]))
    }
}

/// All lines of nodes along an axis.
struct Lines<const TERMS: usize> {
    axis: usize,
    /// The nodes' coordinates along either axis.
    nodes: [[f64; TERMS]; 2],
    /// The lengths of the gaps between the nodes, as shares of pixels.
    gaps: [f64; TERMS],
    lines: [Line<TERMS>; TERMS],
    /// How many of them a pixel has, or the smallest part of one.
    on_pixel: f64,
}

impl<const TERMS: usize> Lines<TERMS> {
    fn new(
        basis: &Basis<TERMS>,
        rectangle: &Rectangle,
        values: &Values<TERMS>,
        axis: usize,
    ) -> Self {
        let across = 1 - axis;
        let edges = [0, 1].map(|axis| rectangle.pixel_edges(axis));
        let nodes = [0, 1].map(|axis| basis.along(rectangle, axis));
        let gaps = shares_of_pixels(&nodes[axis], &edges[axis]);
        let line = |index: usize| match axis {
            0 => values[index],
            _ => std::array::from_fn(|k| values[k][index]),
        };
        let parts = edges[across].windows(2).map(|part| part[1] - part[0]);
        let shortest = parts.fold(f64::INFINITY, f64::min);
        Self {
            axis,
            nodes,
            gaps,
            lines: std::array::from_fn(|index| Line::new(line(index), &gaps)),
            on_pixel: TERMS as f64 * shortest / rectangle.sides()[across],
        }
    }

    /// What is left of steps on the lines in the mean over a pixel.
    fn in_mean(&self, steps: &[f64; TERMS]) -> f64 {
        let most = steps.iter().copied().fold(0.0, f64::max);
        most.min(steps.iter().sum::<f64>() / self.on_pixel)
    }

    /// By the nodes alone.
    fn shown(&self) -> f64 {
        self.in_mean(&self.lines.each_ref().map(|line| line.largest.1))
    }

    /// By a look into the middle of the gaps with steps, until what was found is not met.
    fn looked_at(
        &self,
        is_met: impl Fn(f64) -> bool,
        mut at: impl FnMut([f64; 2]) -> [f64; 3],
    ) -> f64 {
        let mut steps = [0.0; TERMS];
        for (index, line) in self.lines.iter().enumerate() {
            let (gap, step) = line.largest;
            if step > 0.0 && is_met(self.in_mean(&steps)) {
                let along = &self.nodes[self.axis];
                let mut middle = [self.nodes[1 - self.axis][index]; 2];
                middle[self.axis] = 0.5 * (along[gap] + along[gap + 1]);
                steps[index] = line.looked_at(at(middle), &self.gaps);
            }
        }
        self.in_mean(&steps)
    }
}

impl<S: Shade, const TERMS: usize> Tiling<'_, S, TERMS> {
    /// What steps between a tile's nodes leave open of the mean over a pixel, or over a pixel's part of the tile. Looks
    /// between the nodes where so much is not met.
    pub(super) fn left_open_by_steps(
        &self,
        rectangle: &Rectangle,
        values: &Values<TERMS>,
        is_met: impl Fn(f64) -> bool,
        tolerance: Tolerance,
        function: &mut Counted<'_, S>,
    ) -> f64 {
        let shares = &self.demand.shares;
        let factor = match self.outline.polygon().contains(rectangle) {
            true => shares.step,
            false => shares.step_at_outline,
        };
        let is_met = |step: f64| is_met(factor * step);
        let mut most = 0.0f64;
        for axis in 0..2 {
            let lines = Lines::new(&self.basis, rectangle, values, axis);
            let mut step = lines.shown();
            if !is_met(step) {
                step = lines.looked_at(is_met, |at| function.at(at, tolerance));
            }
            most = most.max(step);
            if !is_met(most) {
                break;
            }
        }
        factor * most
    }
}

/// The lengths of the gaps between neighbouring nodes, each as a share of the shortest of the pixels' parts that it
/// overlaps, and at most 1: one gap less than nodes, and a zero. `edges` are those of these parts.
fn shares_of_pixels<const TERMS: usize>(nodes: &[f64; TERMS], edges: &[f64]) -> [f64; TERMS] {
    let mut shares = [0.0; TERMS];
    for (share, pair) in shares.iter_mut().zip(nodes.windows(2)) {
        let [to, from] = [pair[0], pair[1]];
        let parts = edges.windows(2);
        let parts = parts.filter(|part| part[0] < to && from < part[1]);
        let shortest = parts.fold(f64::INFINITY, |least, part| least.min(part[1] - part[0]));
        *share = ((to - from) / shortest).min(1.0);
    }
    shares
}

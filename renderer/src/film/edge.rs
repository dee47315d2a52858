//! Edges of a function that are known to cross a pixel.

use crate::numerics::polygon::{Polygon, Rectangle};

/// A function changes within so many widths of an edge to either side of it. Chosen: with 2 or 4 images
/// with narrow edges take a twentieth more work.
const EDGE_REACH: f64 = 3.0;

/// An edge is followed where what lies between is no more than this share of the line. Wider ones take fewer points by
/// halving. Chosen.
const EDGE_SHARE: f64 = 0.75;

/// An edge is straight that bends by no more than this many widths over a pixel. Chosen.
const STRAIGHT: f64 = 0.5;

/// An edge is looked for so many pixels beyond a pixel's sides. Chosen: images are at least four pixels
/// across, so there is no other.
const BEYOND: f64 = 1.0;

/// An edge on a line.
#[derive(Clone, Copy, Debug)]
pub struct Edge {
    /// Where the function has changed by half.
    pub at: f64,
    /// Over how much of the line it changes: the standard deviation of its slope.
    pub width: f64,
}

/// A function on a pixel.
pub trait OnPixel {
    /// Its value at (column, row), and evaluations.
    fn at(&mut self, film_point: [f64; 2]) -> ([f64; 3], u64);

    /// An edge that is known to cross the line along `axis` between two places. The other coordinate of the line is
    /// `across`.
    fn edge(&self, _axis: usize, _across: f64, _between: [f64; 2]) -> Option<Edge> {
        None
    }
}

impl<F: FnMut(f64, f64) -> ([f64; 3], u64)> OnPixel for F {
    fn at(&mut self, [column, row]: [f64; 2]) -> ([f64; 3], u64) {
        self(column, row)
    }
}

impl Edge {
    /// Whether it fills little of a line between `from` and `to`.
    pub fn is_narrow(&self, [from, to]: [f64; 2]) -> bool {
        2.0 * EDGE_REACH * self.width <= EDGE_SHARE * (to - from)
    }

    /// Where a line between `from` and `to` is parted about it.
    pub fn parts(self, [from, to]: [f64; 2]) -> impl Iterator<Item = f64> {
        let parts = [-EDGE_REACH, EDGE_REACH].map(|widths| self.at + widths * self.width);
        parts.into_iter().filter(move |&at| from < at && at < to)
    }
}

/// An edge that crosses a pixel, or passes by, as good as straight.
///
/// Along it the function hardly changes, so that lines along it take few points each, and of lines beside it there are
/// few. Lines across it take many points each, and where it ends on a side of the pixel, many lines.
#[derive(Clone, Copy)]
pub struct StraightEdge {
    /// A point on it.
    at: [f64; 2],
    /// Its direction, of length 1.
    along: [f64; 2],
    width: f64,
    /// How far it bends off a straight line.
    bend: f64,
}

impl StraightEdge {
    /// The one that crosses the lines along `axis` over a polygon, if it is narrow.
    pub fn of(function: &impl OnPixel, polygon: &Polygon, axis: usize) -> Option<Self> {
        let Rectangle { low, high } = polygon.bounds();
        let across = 1 - axis;
        let middle = 0.5 * (low[across] + high[across]);
        let between = [low[axis] - BEYOND, high[axis] + BEYOND];
        let edge = |at| function.edge(axis, at, between);
        let (first, mid, last) = (edge(low[across])?, edge(middle)?, edge(high[across])?);
        let (run, rise) = (high[across] - low[across], last.at - first.at);
        let per_length = 1.0 / libm::hypot(run, rise);
        let (mut at, mut along) = ([middle; 2], [run * per_length; 2]);
        at[axis] = mid.at;
        along[axis] = rise * per_length;
        let widest = first.width.max(mid.width).max(last.width);
        let edge = Self {
            at,
            along,
            width: widest * along[across],
            bend: (mid.at - 0.5 * (first.at + last.at)).abs() * along[across],
        };
        let is_straight = edge.bend <= STRAIGHT * edge.width;
        let [from, to] = edge.band();
        let is_narrow = to - from <= EDGE_SHARE * (high[axis] - low[axis]);
        (is_straight && is_narrow).then_some(edge)
    }

    /// The place on lines across it between which the function changes.
    pub fn band(&self) -> [f64; 2] {
        let reach = EDGE_REACH * self.width + self.bend;
        [-reach, reach]
    }

    /// A polygon as seen along the edge: what lies along it, and across.
    pub fn turned(&self, polygon: &Polygon) -> Polygon {
        let [x, y] = self.along;
        polygon.map(|at| {
            let [right, up] = [at[0] - self.at[0], at[1] - self.at[1]];
            [x * right + y * up, x * up - y * right]
        })
    }
}

/// A function as seen along an edge.
pub struct Turned<F> {
    pub function: F,
    pub edge: StraightEdge,
}

impl<F> Turned<F> {
    /// The axis that runs along the edge.
    pub const ALONG: usize = 0;
}

impl<F: OnPixel> OnPixel for Turned<F> {
    fn at(&mut self, [along, across]: [f64; 2]) -> ([f64; 3], u64) {
        let ([x, y], [column, row]) = (self.edge.along, self.edge.at);
        let film_point = [
            column + x * along - y * across,
            row + y * along + x * across,
        ];
        self.function.at(film_point)
    }
}

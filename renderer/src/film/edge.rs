//! Edges of a function that are known to cross a pixel.

/// A line is parted so many widths of an edge to either side of it. Chosen: with 2 or 4 images with narrow edges take a
/// twentieth more work.
const EDGE_REACH: f64 = 3.0;

/// An edge is followed where what lies between is no more than this share of the line. Wider ones take fewer points by
/// halving. Chosen.
const EDGE_SHARE: f64 = 0.75;

/// An edge on a line.
#[derive(Clone, Copy, Debug)]
pub struct Edge {
    /// Where the function has changed by half.
    pub at: f64,
    /// Over how much of the line it changes: the standard deviation of its slope.
    pub width: f64,
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

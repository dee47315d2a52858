//! Where on the chart all normals of a pixel lead.

use crate::hybrid::budget::glossy::BEYOND;
use crate::numerics::batch::LANES;
use crate::scene::ChartPlane;

/// Where on the chart, in patches from its corner, all normals of a pixel lead.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Span {
    low: [f64; 2],
    high: [f64; 2],
}

impl Default for Span {
    fn default() -> Self {
        Self {
            low: [f64::INFINITY; 2],
            high: [f64::NEG_INFINITY; 2],
        }
    }
}

impl Span {
    /// Extends it to the ends along either axis.
    pub fn extend(&mut self, low: [f64; 2], high: [f64; 2]) {
        for axis in 0..2 {
            self.low[axis] = self.low[axis].min(low[axis]);
            self.high[axis] = self.high[axis].max(high[axis]);
        }
    }

    /// What covers both.
    pub fn with(mut self, other: Self) -> Self {
        self.extend(other.low, other.high);
        self
    }

    /// Whether an edge lies just beyond.
    pub fn near_edge(&self, plane: &ChartPlane) -> bool {
        let counts = [plane.columns, plane.rows].map(f64::from);
        let more: [f64; 2] =
            std::array::from_fn(|axis| BEYOND * (self.high[axis] - self.low[axis]));
        let overlaps = (0..2).all(|axis| {
            self.low[axis] - more[axis] < counts[axis] && self.high[axis] + more[axis] > 0.0
        });
        overlaps
            && (0..2).any(|axis| {
                let bound = |at: f64| at.clamp(-1.0, counts[axis] + 1.0).floor();
                bound(self.low[axis]) != bound(self.low[axis] - more[axis])
                    || bound(self.high[axis]) != bound(self.high[axis] + more[axis])
            })
    }
}

/// The spans of pixels side by side.
#[derive(Clone, Copy)]
pub struct Spans {
    low: [[f64; LANES]; 2],
    high: [[f64; LANES]; 2],
}

impl Default for Spans {
    fn default() -> Self {
        Self {
            low: [[f64::INFINITY; LANES]; 2],
            high: [[f64::NEG_INFINITY; LANES]; 2],
        }
    }
}

impl Spans {
    /// Extends them to the ends along an axis.
    #[inline(always)]
    pub fn extend(&mut self, axis: usize, low: &[f64; LANES], high: &[f64; LANES]) {
        let (lows, highs) = (&mut self.low[axis], &mut self.high[axis]);
        for i in 0..LANES {
            lows[i] = lows[i].min(low[i]);
            highs[i] = highs[i].max(high[i]);
        }
    }

    /// That of one pixel.
    pub fn of(&self, lane: usize) -> Span {
        Span {
            low: self.low.map(|lanes| lanes[lane]),
            high: self.high.map(|lanes| lanes[lane]),
        }
    }
}

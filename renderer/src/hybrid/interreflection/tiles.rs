//! Light on all of the chart, in tiles.

use super::frame::Frame;
use super::levels::TERMS;
use crate::hybrid::budget::interreflection::{NEIGHBOURS_DOUBT, SLIVER};
use crate::numerics::chebyshev::Tile;
use crate::numerics::polygon::Rectangle;

/// Irradiance over pi on the chart, in units of white.
#[derive(Debug, Default)]
pub struct Tiles {
    tiles: Vec<Tile<TERMS>>,
    /// What each is off by, but for `everywhere`.
    errors: Vec<f64>,
    /// A bound of what any is off by besides.
    pub everywhere: f64,
}

impl Tiles {
    /// Adds a tile that is off by at most this much.
    pub fn push(&mut self, tile: Tile<TERMS>, error: f64) {
        self.tiles.push(tile);
        self.errors.push(error);
    }

    /// The value at a position on the tiles: 0 where there is none.
    pub fn value(&self, at: [f64; 2]) -> [f64; 3] {
        let holds = |tile: &&Tile<TERMS>| {
            let Rectangle { low, high } = tile.rectangle;
            (0..2).all(|axis| at[axis] >= low[axis] && at[axis] <= high[axis])
        };
        let tile = self.tiles.iter().find(holds);
        tile.map_or([0.0; 3], |tile| tile.value(at))
    }

    /// A bound of what all tiles are off by.
    pub fn error(&self) -> f64 {
        self.everywhere + self.errors.iter().copied().fold(0.0, f64::max)
    }

    /// What the tiles are off by on a part of the chart.
    ///
    /// A rule is compared with a finer one at a few nodes of a tile. Where that shows little although the edge
    /// of the lobe runs through the tile, it shows in a smaller tile beside it. So a tile's error counts as far
    /// beyond it as the tile is long.
    pub fn error_on(&self, part: &Rectangle) -> f64 {
        let counts = |tile: &Tile<TERMS>| {
            let Rectangle { low, high } = tile.rectangle;
            (0..2).all(|axis| {
                let side = high[axis] - low[axis];
                low[axis] - side <= part.high[axis] && part.low[axis] <= high[axis] + side
            })
        };
        let all = self.tiles.iter().zip(&self.errors);
        let counting = all
            .filter(|(tile, _)| counts(tile))
            .map(|(_, error)| *error);
        let error = self.everywhere + NEIGHBOURS_DOUBT * counting.fold(0.0, f64::max);
        error.min(self.error())
    }
}

/// The chart in columns parted where the sample's sides point at it: there light off the sample falls steeply,
/// and the nodes of a tile are dense at its ends.
pub fn columns(frame: &Frame<'_>) -> Vec<Rectangle> {
    let Rectangle { low, high } = frame.bounds();
    let half = frame.view.sample_half;
    let side = |x: f64| (x - frame.chart.plane.corner.x).clamp(low[0], high[0]);
    let ends = [low[0], side(-half), side(half), high[0]];
    ends.windows(2)
        .filter(|pair| pair[1] - pair[0] > SLIVER * (high[0] - low[0]))
        .map(|pair| Rectangle {
            low: [pair[0], low[1]],
            high: [pair[1], high[1]],
        })
        .collect()
}

/// Both halves of a tile across the axis along which its series ends worst.
pub fn halved(rectangle: &Rectangle, tails: [f64; 2]) -> [Rectangle; 2] {
    let steep = usize::from(tails[1] > tails[0]);
    let middle = 0.5 * (rectangle.low[steep] + rectangle.high[steep]);
    let mut halves = [*rectangle; 2];
    halves[0].high[steep] = middle;
    halves[1].low[steep] = middle;
    halves
}

/// Points of a rectangle that lie in no pattern of any nodes: a lattice by the plastic number (Roberts, "The
/// Unreasonable Effectiveness of Quasirandom Sequences", 2018).
pub fn lattice(rectangle: &Rectangle) -> impl Iterator<Item = [f64; 2]> + use<> {
    let Rectangle { low, high } = *rectangle;
    (1..).map(move |step: u32| {
        [(0, 0.754_877_666), (1, 0.569_840_291)].map(|(axis, share)| {
            let at = 0.5 + f64::from(step) * share;
            low[axis] + (at - at.floor()) * (high[axis] - low[axis])
        })
    })
}

//! What a near mirror makes of white light, told over the chart by polynomials.

use super::image::Mirror;
use crate::hybrid::budget::mirror::PARTS_MAX;
use crate::numerics::channels::largest_difference;

/// Points along a cell's side, ends included; a parabola goes through them.
const NODES: usize = 3;

/// About where parabolas miss most, from 0 to 1 along a cell's sides.
const PROBES: [[f64; 2]; 2] = [[0.21, 0.79], [0.79, 0.21]];

/// White light over a patch, cell by cell.
pub struct WhitePatch {
    low: [f64; 2],
    /// Cells along a side, and a unit of the position.
    parts: u32,
    per_unit: [f64; 2],
    /// Row by row.
    cells: Vec<Cell>,
}

impl WhitePatch {
    /// On as few cells between such ends along each axis as tell it: `is_told` says so by how bright it is and what is
    /// missed. `None` where no film point leads to some of it.
    pub fn new(
        mirror: &Mirror<'_>,
        ends: [[f64; 2]; 2],
        is_told: impl Fn(f64, f64) -> bool,
        light: &mut Light<'_>,
    ) -> Option<Self> {
        let mut parts = 1;
        loop {
            let patch = Self::in_parts(mirror, ends, parts, light)?;
            let most = |of: fn(&Cell) -> f64| patch.cells.iter().map(of).fold(0.0, f64::max);
            if parts == PARTS_MAX || is_told(most(Cell::brightest), most(|cell| cell.missed)) {
                return Some(patch);
            }
            parts *= 2;
        }
    }

    fn in_parts(
        mirror: &Mirror<'_>,
        ends: [[f64; 2]; 2],
        parts: u32,
        light: &mut Light<'_>,
    ) -> Option<Self> {
        let end = |axis: usize, index: u32| {
            let [low, high] = ends[axis];
            low + f64::from(index) / f64::from(parts) * (high - low)
        };
        let mut cells = Vec::new();
        for up in 0..parts {
            for across in 0..parts {
                let low = [end(0, across), end(1, up)];
                let high = [end(0, across + 1), end(1, up + 1)];
                cells.push(Cell::new(mirror, low, high, light)?);
            }
        }
        Some(Self {
            low: ends.map(|[low, _]| low),
            parts,
            per_unit: ends.map(|[low, high]| f64::from(parts) / (high - low)),
            cells,
        })
    }

    /// The cell in which a position lies, or that is nearest to it.
    pub fn cell(&self, position: [f64; 2]) -> &Cell {
        let last = f64::from(self.parts - 1);
        let [across, up] = [0, 1].map(|axis| {
            let at = (position[axis] - self.low[axis]) * self.per_unit[axis];
            at.clamp(0.0, last) as usize
        });
        &self.cells[up * self.parts as usize + across]
    }
}

/// White light over a cell of a patch.
#[derive(Clone, Copy, Debug)]
pub struct Cell {
    low: [f64; 2],
    per_side: [f64; 2],
    /// By node up and node across.
    nodes: [[[f64; 3]; NODES]; NODES],
    /// What the polynomial was found to miss, and the light that it was made of.
    pub missed: f64,
}

/// White light at a film point, and what the rule misses of it and the light on the chart, if that is looked at.
pub type Light<'a> = dyn FnMut([f64; 2], bool) -> ([f64; 3], f64) + 'a;

impl Cell {
    /// The cell between two positions on the chart; `None` where no film point leads to it.
    pub fn new(
        mirror: &Mirror<'_>,
        low: [f64; 2],
        high: [f64; 2],
        light: &mut Light<'_>,
    ) -> Option<Self> {
        let at = |local: [f64; 2]| {
            mirror.film_point([0, 1].map(|axis| low[axis] + local[axis] * (high[axis] - low[axis])))
        };
        let mut cell = Self {
            low,
            per_side: [0, 1].map(|axis| 1.0 / (high[axis] - low[axis])),
            nodes: [[[0.0; 3]; NODES]; NODES],
            missed: 0.0,
        };
        for (up, row) in cell.nodes.iter_mut().enumerate() {
            for (across, node) in row.iter_mut().enumerate() {
                (*node, _) = light(at([across, up].map(|index| 0.5 * index as f64))?, false);
            }
        }
        for probe in PROBES {
            let (value, missed) = light(at(probe)?, true);
            let told = cell.local(probe);
            cell.missed = cell.missed.max(largest_difference(value, told) + missed);
        }
        Some(cell)
    }

    /// The largest channel at its nodes.
    pub fn brightest(&self) -> f64 {
        self.nodes
            .as_flattened()
            .as_flattened()
            .iter()
            .copied()
            .fold(0.0, f64::max)
    }

    /// At a position on the chart; beside the cell, too.
    pub fn at(&self, position: [f64; 2]) -> [f64; 3] {
        self.local([0, 1].map(|axis| (position[axis] - self.low[axis]) * self.per_side[axis]))
    }

    fn local(&self, [across, up]: [f64; 2]) -> [f64; 3] {
        let [across, up] = [across, up].map(weights);
        let mut value = [0.0; 3];
        for (row, of_row) in self.nodes.iter().zip(up) {
            for (node, weight) in row.iter().zip(across) {
                for (value, node) in value.iter_mut().zip(node) {
                    *value += of_row * weight * node;
                }
            }
        }
        value
    }
}

/// Of the values at 0, 1/2 and 1 for the parabola through them.
fn weights(at: f64) -> [f64; NODES] {
    [
        (1.0 - 2.0 * at) * (1.0 - at),
        4.0 * at * (1.0 - at),
        (2.0 * at - 1.0) * at,
    ]
}

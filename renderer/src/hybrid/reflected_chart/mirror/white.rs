//! What a near mirror makes of white light, told over the chart by polynomials.

use super::image::Mirror;
use crate::hybrid::budget::mirror::FINER_RULES;
use crate::numerics::channels::largest_difference;
use crate::numerics::tolerance::Tolerance;

/// Points along a cell's side, ends included, through which a polynomial goes; and cells along a patch's side. They are
/// tried one after the other until one tells the light; the last is a limit on work.
const GRIDS: [(usize, u32); 4] = [(3, 1), (5, 1), (5, 2), (5, 4)];

/// The most points along a cell's side.
const NODES_MAX: usize = 5;

/// About where polynomials of either degree miss most, from 0 to 1 along a cell's sides.
const PROBES: [[f64; 2]; 2] = [[0.13, 0.87], [0.87, 0.13]];

/// White light over a patch, cell by cell.
pub struct WhitePatch {
    low: [f64; 2],
    /// How fine the rule is by which it is known.
    pub tolerance: Tolerance,
    /// Cells along a side, and a unit of the position.
    parts: u32,
    per_unit: [f64; 2],
    /// Row by row.
    cells: Vec<Cell>,
}

impl WhitePatch {
    /// On as few cells between such ends along each axis as tell it, and by a rule as coarse as serves: `is_told` says
    /// so by how bright it is and what is missed. `None` where no film point leads to some of it.
    pub fn new(
        mirror: &Mirror<'_>,
        ends: [[f64; 2]; 2],
        coarsest: Tolerance,
        is_told: impl Fn(f64, f64) -> bool,
        light: &mut Light<'_>,
    ) -> Option<Self> {
        let tolerance = Self::rule(mirror, ends, coarsest, &is_told, light)?;
        let mut last = None;
        for grid in GRIDS {
            let patch = Self::on_grid(mirror, ends, grid, tolerance, light)?;
            let most = |of: fn(&Cell) -> f64| patch.cells.iter().map(of).fold(0.0, f64::max);
            let is_told = is_told(most(Cell::brightest), most(|cell| cell.missed));
            last = Some(patch);
            if is_told {
                break;
            }
        }
        last
    }

    /// The coarsest rule that misses little enough at the probes, or the finest that is tried.
    fn rule(
        mirror: &Mirror<'_>,
        ends: [[f64; 2]; 2],
        coarsest: Tolerance,
        is_told: &impl Fn(f64, f64) -> bool,
        light: &mut Light<'_>,
    ) -> Option<Tolerance> {
        let [low, high] = [0, 1].map(|end| ends.map(|ends| ends[end]));
        let mut tolerance = coarsest;
        for probe in PROBES {
            let at = mirror.film_point(between(low, high, probe))?;
            while tolerance.level() < coarsest.level() + FINER_RULES {
                let WhiteLight { value, by_rule, .. } = light(at, tolerance, true);
                if is_told(value.into_iter().fold(0.0, f64::max), by_rule) {
                    break;
                }
                tolerance = tolerance.finer();
            }
        }
        Some(tolerance)
    }

    fn on_grid(
        mirror: &Mirror<'_>,
        ends: [[f64; 2]; 2],
        (nodes, parts): (usize, u32),
        tolerance: Tolerance,
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
                cells.push(Cell::new(mirror, [low, high], nodes, tolerance, light)?);
            }
        }
        Some(Self {
            low: ends.map(|[low, _]| low),
            tolerance,
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
    /// So many across and up.
    count: usize,
    /// By node up and node across.
    nodes: [[[f64; 3]; NODES_MAX]; NODES_MAX],
    /// What the polynomial was found to miss, and the light that it was made of.
    pub missed: f64,
}

/// White light at a film point by a rule, and whether what is missed of it is looked at.
pub type Light<'a> = dyn FnMut([f64; 2], Tolerance, bool) -> WhiteLight + 'a;

/// White light at a film point, and what is missed of it, if that was looked at.
#[derive(Clone, Copy, Debug)]
pub struct WhiteLight {
    pub value: [f64; 3],
    /// By the rule.
    pub by_rule: f64,
    /// By the light on the chart.
    pub of_chart: f64,
}

/// The position so far between two others along each axis.
fn between(low: [f64; 2], high: [f64; 2], local: [f64; 2]) -> [f64; 2] {
    [0, 1].map(|axis| low[axis] + local[axis] * (high[axis] - low[axis]))
}

impl Cell {
    /// The cell between two positions on the chart; `None` where no film point leads to it.
    pub fn new(
        mirror: &Mirror<'_>,
        [low, high]: [[f64; 2]; 2],
        count: usize,
        tolerance: Tolerance,
        light: &mut Light<'_>,
    ) -> Option<Self> {
        let at = |local: [f64; 2]| mirror.film_point(between(low, high, local));
        let mut cell = Self {
            low,
            per_side: [0, 1].map(|axis| 1.0 / (high[axis] - low[axis])),
            count,
            nodes: [[[0.0; 3]; NODES_MAX]; NODES_MAX],
            missed: 0.0,
        };
        for (up, row) in cell.nodes[..count].iter_mut().enumerate() {
            for (across, node) in row[..count].iter_mut().enumerate() {
                let local = [across, up].map(|index| node_at(index, count));
                *node = light(at(local)?, tolerance, false).value;
            }
        }
        for probe in PROBES {
            let WhiteLight {
                value,
                by_rule,
                of_chart,
            } = light(at(probe)?, tolerance, true);
            let by_polynomials = largest_difference(value, cell.local(probe));
            cell.missed = cell.missed.max(by_polynomials + by_rule + of_chart);
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
        let [across, up] = [across, up].map(|at| weights(at, self.count));
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

/// Where a node of so many lies, from 0 to 1.
fn node_at(index: usize, count: usize) -> f64 {
    index as f64 / (count - 1) as f64
}

/// Of the values at so many nodes for the polynomial through them: Lagrange's.
fn weights(at: f64, count: usize) -> [f64; NODES_MAX] {
    let mut weights = [0.0; NODES_MAX];
    for (index, weight) in weights[..count].iter_mut().enumerate() {
        let node = node_at(index, count);
        *weight = (0..count)
            .filter(|&other| other != index)
            .map(|other| node_at(other, count))
            .map(|other| (at - other) / (node - other))
            .product();
    }
    weights
}

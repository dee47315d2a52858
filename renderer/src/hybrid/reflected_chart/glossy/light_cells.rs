//! The light on the chart, cell by cell.
//!
//! A line meets the chart anywhere, so the light at a point of it has to be cheap. Cells are parts of
//! a patch across and of equal lengths up in ln(1 + height / gap), so short that a parabola serves.

use crate::hybrid::budget::glossy::cell_height;
use crate::hybrid::reflected_chart::lit_chart::{LitChart, PARABOLA};

/// Three channels and one that is 0: together a vector.
pub const CHANNELS: usize = 4;

/// Points along a cell's side, ends included; a parabola goes through them.
const NODES: usize = PARABOLA;

/// A polynomial in the position in a cell, 0 to 1 along its sides: irradiance over pi, in units of white. By
/// power up, power across and channel.
pub type Cell = [[[f64; CHANNELS]; NODES]; NODES];

/// The polynomial at a position across and up.
#[inline(always)]
pub fn value(cell: &Cell, [across, up]: [f64; 2]) -> [f64; CHANNELS] {
    let mut powers = [[0.0; CHANNELS]; NODES];
    for power in 0..NODES {
        for channel in 0..CHANNELS {
            let [one, x, x2] = [0, 1, 2].map(|i| cell[i][power][channel]);
            powers[power][channel] = one + up * (x + up * x2);
        }
    }
    let mut value = [0.0; CHANNELS];
    for channel in 0..CHANNELS {
        let [one, x, x2] = powers.map(|power| power[channel]);
        value[channel] = one + across * (x + across * x2);
    }
    value
}

/// The coefficients of the parabola through values at 0, 1/2 and 1.
fn coefficients([a, b, c]: [f64; NODES]) -> [f64; NODES] {
    [a, 4.0 * b - 3.0 * a - c, 2.0 * (a + c) - 4.0 * b]
}

/// The polynomial through values at the nodes, by node up, node across and channel.
fn through(nodes: Cell) -> Cell {
    let mut cell = nodes;
    for channel in 0..CHANNELS {
        for up in 0..NODES {
            let along = coefficients([0, 1, 2].map(|across| cell[up][across][channel]));
            for (across, value) in along.into_iter().enumerate() {
                cell[up][across][channel] = value;
            }
        }
        for across in 0..NODES {
            let along = coefficients([0, 1, 2].map(|up| cell[up][across][channel]));
            for (up, value) in along.into_iter().enumerate() {
                cell[up][across][channel] = value;
            }
        }
    }
    cell
}

/// The cells of a chart.
#[derive(Clone)]
pub struct LightCells {
    /// The lowest row first.
    pub cells: Vec<Cell>,
    /// Columns and rows of cells.
    pub counts: [f64; 2],
    /// Columns of cells a patch.
    pub parts: f64,
    /// The side of a patch over the gap.
    pub pitch_per_gap: f64,
    /// Rows of cells a unit of the logarithm.
    pub per_log: f64,
}

impl LightCells {
    /// Those of a chart.
    pub fn new(chart: &LitChart<PARABOLA>) -> Self {
        let (plane, gap) = (&chart.plane, chart.heights.gap);
        let [_, height] = plane.size();
        let length = libm::log1p(height / gap);
        let rows = (length / cell_height(chart.parts)).ceil() as usize;
        let per_log = rows as f64 / length;
        let columns = plane.columns as usize;
        let mut cells = vec![Cell::default(); columns * rows];
        for (index, cell) in cells.iter_mut().enumerate() {
            let (row, column) = (index / columns, index % columns);
            for (node, across) in cell.iter_mut().enumerate() {
                let position = row as f64 + node as f64 / (NODES - 1) as f64;
                let at = gap * libm::expm1(position / per_log);
                let part = ((at / plane.pitch) as u32).min(plane.rows - 1);
                let light = chart.light_across(column as u32, part, at);
                *across = light.map(|[r, g, b]| [r, g, b, 0.0]);
            }
            *cell = through(*cell);
        }
        let parts = f64::from(chart.parts);
        Self {
            cells,
            counts: [columns as f64, rows as f64],
            parts,
            pitch_per_gap: plane.pitch * parts / gap,
            per_log,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_polynomial_goes_through_its_nodes() {
        let mut nodes = Cell::default();
        for (index, value) in nodes
            .as_flattened_mut()
            .as_flattened_mut()
            .iter_mut()
            .enumerate()
        {
            *value = (7 * index % 13) as f64 - 4.0;
        }
        let cell = through(nodes);
        for (up, line) in nodes.iter().enumerate() {
            for (across, expected) in line.iter().enumerate() {
                let at = [across, up].map(|node| 0.5 * node as f64);
                for (found, expected) in value(&cell, at).iter().zip(expected) {
                    assert!(
                        (found - expected).abs() < 1e-13,
                        "{at:?}: {found} {expected}"
                    );
                }
            }
        }
    }
}

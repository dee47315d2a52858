//! The light on the chart, cell by cell.
//!
//! A line meets the chart anywhere, so the light at a point of it has to be cheap. Cells are parts of
//! a patch across and of equal lengths up in ln(1 + height / gap), so short that a parabola serves.

use crate::hybrid::budget::glossy::CELL_HEIGHT;
use crate::hybrid::reflected_chart::lit_chart::{ACROSS_NODES, LitChart};

/// Three channels and one that is 0: together a vector.
pub const CHANNELS: usize = 4;

/// Points along a cell's side, ends included; a parabola goes through them.
pub const NODES: usize = ACROSS_NODES;

/// By node up, node across and channel: irradiance over pi, in units of white.
pub type Cell = [[[f64; CHANNELS]; NODES]; NODES];

/// The cells of a chart.
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
    pub fn new(chart: &LitChart) -> Self {
        let (plane, gap) = (&chart.plane, chart.heights.gap);
        let [_, height] = plane.size();
        let length = libm::log1p(height / gap);
        let rows = (f64::from(chart.parts) * length / CELL_HEIGHT).ceil() as usize;
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

//! Parts of the film that multiply a function, and what is added to their pixels.

use super::canvas::Canvas;
use super::demand::FunctionError;
use super::tile_nodes::TERMS;
use crate::numerics::chebyshev::Tile;
use crate::numerics::polygon::{Polygon, Rectangle};

/// A part of the outline that multiplies the function.
pub struct Region {
    /// Where.
    pub outline: Polygon,
    /// By what, a channel.
    pub factor: [f64; 3],
}

/// Adds the integrals of a tile over the pixels of the regions. The function is off by `error` on it, and on a
/// part of a pixel by what `function_error` says.
pub fn add_tile(
    canvas: &mut Canvas<'_>,
    tile: &Tile<TERMS>,
    error: f64,
    function_error: impl Fn(&Rectangle) -> FunctionError,
    regions: &[Region],
) {
    let [columns, rows] = [0, 1].map(|axis| tile.rectangle.pixel_edges(axis));
    let integrals = tile.cell_integrals(&columns, &rows);
    let [first_column, first_row] = tile.rectangle.rounded_out().low.map(|low| low as u32);
    for region in regions {
        let Some(shared) = region.outline.bounds().intersection(&tile.rectangle) else {
            continue;
        };
        for (column, row) in shared.pixels() {
            let Some(cell) = Rectangle::pixel(column, row).intersection(&tile.rectangle) else {
                continue;
            };
            let (value, area) = if region.outline.contains(&cell) {
                let at = [column - first_column, row - first_row].map(|index| index as usize);
                (integrals.at(at[0], at[1]), cell.area())
            } else {
                tile.integral_over(&region.outline.clipped(&cell))
            };
            let error = error * area + function_error(&cell).over(area, value);
            add_region(canvas, &cell, region, value, error);
        }
    }
}

/// Adds the integral over a region's part of a pixel, and its error.
pub fn add_region(
    canvas: &mut Canvas<'_>,
    cell: &Rectangle,
    region: &Region,
    value: [f64; 3],
    error: f64,
) {
    let index = (cell.low[0] as u32, cell.low[1] as u32);
    let gain = region.factor.into_iter().fold(0.0, f64::max);
    let scaled = std::array::from_fn(|channel| region.factor[channel] * value[channel]);
    canvas.add(index, scaled, gain * error);
}

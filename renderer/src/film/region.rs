//! Parts of the film that multiply a function, and what is added to their pixels.

use super::FilmPixel;
use super::canvas::Canvas;
use super::demand::FunctionError;
use super::outline::Outline;
use crate::numerics::chebyshev::Tile;
use crate::numerics::instructions::Instructions;
use crate::numerics::polygon::{Polygon, Rectangle};
use std::ops::Range;

/// A part of the outline that multiplies the function.
pub struct Region<'a> {
    /// Where.
    pub outline: Polygon,
    /// The same pixel by pixel, where that is at hand.
    pub by_pixel: Option<&'a Outline>,
    /// By what, a channel.
    pub factor: [f64; 3],
}

/// A function on a tile.
pub struct Series<const TERMS: usize> {
    pub tile: Tile<TERMS>,
    /// What the tile is off by, and its integrals.
    pub error: f64,
    /// Whether parts of pixels are as bright as at their centroids.
    pub by_centroids: bool,
}

/// Adds the integrals of a tile over the pixels of the regions. Beside what the tile is off by, the function is off on
/// a part of a pixel by what `function_error` says.
pub fn add_tile<const TERMS: usize>(
    canvas: &mut Canvas<'_>,
    series: &Series<TERMS>,
    function_error: impl Fn(&Rectangle) -> FunctionError,
    regions: &[Region<'_>],
    instructions: Instructions,
) {
    let Series { tile, error, .. } = series;
    let [columns, rows] = [0, 1].map(|axis| tile.rectangle.pixel_edges(axis));
    let integrals = tile.cell_integrals(&columns, &rows);
    let [first_column, first_row] = tile.rectangle.rounded_out().low.map(|low| low as u32);
    let mut buffer = Vec::new();
    for region in regions {
        let Some(shared) = region.outline.bounds().intersection(&tile.rectangle) else {
            continue;
        };
        let [columns, rows] = shared.pixel_ranges();
        for row in rows {
            let whole = region.whole_cells(tile, &columns, row);
            let indices = [whole.start, whole.end].map(|column| (column - first_column) as usize);
            let of_row = (row - first_row) as usize;
            let indices = indices[0]..indices[1];
            let on_whole = integrals.in_row(instructions, of_row, indices, &mut buffer);
            let pixels = canvas.row(row, whole.clone());
            for ((column, pixel), &value) in whole.clone().zip(pixels).zip(on_whole) {
                let cell = cell_of(tile, column, row);
                let error = error * cell.area() + function_error(&cell).over(cell.area(), value);
                region.add_to(pixel, value, error);
            }
            for column in (columns.start..whole.start).chain(whole.end..columns.end) {
                let cell = cell_of(tile, column, row);
                if let Some((value, area)) =
                    region.integral_of_part(series, &cell, (column, row), instructions)
                {
                    let error = error * area + function_error(&cell).over(area, value);
                    add_region(canvas, &cell, region, value, error);
                }
            }
        }
    }
}

/// The part of a pixel that a tile has, which has one.
fn cell_of<const TERMS: usize>(tile: &Tile<TERMS>, column: u32, row: u32) -> Rectangle {
    let Rectangle { low, high } = tile.rectangle;
    let pixel = Rectangle::pixel(column, row);
    Rectangle {
        low: [0, 1].map(|axis| pixel.low[axis].max(low[axis])),
        high: [0, 1].map(|axis| pixel.high[axis].min(high[axis])),
    }
}

impl Region<'_> {
    /// Adds an integral of the function, and its error, times the region's factor.
    fn add_to(&self, pixel: &mut FilmPixel, value: [f64; 3], error: f64) {
        let gain = self.factor.into_iter().fold(0.0, f64::max);
        for ((sum, factor), value) in pixel.value.iter_mut().zip(self.factor).zip(value) {
            *sum += factor * value;
        }
        pixel.error += gain * error;
    }

    /// The columns of a row in which a tile's part of the pixel lies inside; of those that may, all between the
    /// outermost do.
    fn whole_cells<const TERMS: usize>(
        &self,
        tile: &Tile<TERMS>,
        columns: &Range<u32>,
        row: u32,
    ) -> Range<u32> {
        let is_whole = |column| self.outline.contains(&cell_of(tile, column, row));
        let inside = self.by_pixel.map_or(0..0, |by_pixel| by_pixel.inside(row));
        let known = inside.start.max(columns.start)..inside.end.min(columns.end);
        if known.is_empty() {
            let Range { mut start, mut end } = columns.clone();
            while start < end && !is_whole(start) {
                start += 1;
            }
            while start < end && !is_whole(end - 1) {
                end -= 1;
            }
            return start..end;
        }
        let Range { mut start, mut end } = known;
        while columns.start < start && is_whole(start - 1) {
            start -= 1;
        }
        while end < columns.end && is_whole(end) {
            end += 1;
        }
        start..end
    }

    /// The integral of a tile over what the region has of its part of a pixel, and how much that is; `None` where it
    /// has nothing.
    fn integral_of_part<const TERMS: usize>(
        &self,
        series: &Series<TERMS>,
        cell: &Rectangle,
        pixel: (u32, u32),
        instructions: Instructions,
    ) -> Option<([f64; 3], f64)> {
        let integral = |part: &Polygon| match series.by_centroids {
            true => series.tile.at_centroid(part),
            false => series.tile.integral_over(part, instructions),
        };
        let is_pixel = *cell == Rectangle::pixel(pixel.0, pixel.1);
        match self.by_pixel {
            Some(by_pixel) if is_pixel => Some(integral(&by_pixel.cut_pixel(pixel)?.part)),
            _ => Some(integral(&self.outline.clipped(cell))),
        }
    }
}

/// Adds the integral over a region's part of a pixel, and its error.
pub fn add_region(
    canvas: &mut Canvas<'_>,
    cell: &Rectangle,
    region: &Region<'_>,
    value: [f64; 3],
    error: f64,
) {
    let [column, row] = cell.low.map(|low| low as u32);
    for pixel in canvas.row(row, column..column + 1) {
        region.add_to(pixel, value, error);
    }
}

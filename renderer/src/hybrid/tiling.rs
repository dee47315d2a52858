//! Integrals over pixels of a function that is smooth on most of the film.
//!
//! The film is tiled by rectangles on each of which the function is a product of Chebyshev series,
//! halved until the last coefficients vanish against the target. A box-filtered pixel is then the
//! integral of a polynomial, in closed form, and one that the outline cuts the integral over the
//! covered polygon. A pixel on which even a tile of its own does not do is integrated by adaptive
//! quadrature.

use super::chebyshev::{Tile, add_scaled};
use super::pixel;
use super::polygon::{Polygon, Rectangle};
use crate::film::{FilmPixel, target};
use dataset::specification::Accuracy;

/// Terms of the series along each side of a tile.
const TERMS: usize = 8;

/// The narrowest tile that spans several pixels the other way.
const STRIP_MIN: f64 = 0.125;

/// The film as it is summed up: row by row.
pub struct Canvas<'a> {
    /// Pixels a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Values and bounds of their errors.
    pub pixels: &'a mut [FilmPixel],
}

impl Canvas<'_> {
    /// The whole film.
    pub fn bounds(&self) -> Rectangle {
        Rectangle {
            low: [0.0; 2],
            high: [f64::from(self.width), f64::from(self.height)],
        }
    }

    /// The least brightness so far of the pixels of a rectangle that lie inside an outline.
    fn least(&self, rectangle: &Rectangle, outline: &Polygon) -> f64 {
        let least = rectangle
            .pixels()
            .filter(|&(column, row)| outline.contains(&Rectangle::pixel(column, row)))
            .map(|(column, row)| {
                let [r, g, b] = self.pixels[(row * self.width + column) as usize].value;
                r.max(g).max(b)
            })
            .fold(f64::INFINITY, f64::min);
        if least.is_finite() { least } else { 0.0 }
    }

    /// Adds to a pixel.
    pub fn add(&mut self, (column, row): (u32, u32), value: [f64; 3], error: f64) {
        let place = &mut self.pixels[(row * self.width + column) as usize];
        add_scaled(&mut place.value, value, 1.0);
        place.error += error;
    }
}

/// A part of the outline that multiplies the function.
pub struct Region {
    /// Where.
    pub outline: Polygon,
    /// By what, a channel.
    pub factor: [f64; 3],
}

/// What a function asks of its tiling.
pub struct Demand<'a> {
    /// The target for what is added to a pixel.
    pub accuracy: &'a Accuracy,
    /// The side in pixels of a tile that cannot overlook a feature of the function.
    pub side_max: f64,
    /// Calls of the function after which nothing is refined any more.
    pub calls_max: u64,
    /// What the function itself may be off by.
    pub function_error: f64,
}

/// Adds the integrals of `function` over the pixels of the regions, which lie inside `outline`.
/// Returns how often it was called.
pub fn integrate(
    canvas: &mut Canvas<'_>,
    outline: &Polygon,
    regions: &[Region],
    demand: &Demand<'_>,
    mut function: impl FnMut(f64, f64) -> [f64; 3],
) -> u64 {
    let gain = regions
        .iter()
        .flat_map(|region| region.factor)
        .fold(0.0, f64::max);
    let mut calls = 0;
    let mut counted = |column: f64, row: f64| {
        calls += 1;
        (function(column, row), calls)
    };
    let mut open: Vec<Rectangle> = outline
        .bounds()
        .intersection(&canvas.bounds())
        .map(|bounds| bounds.rounded_out())
        .into_iter()
        .collect();
    let mut spent = 0;
    while let Some(rectangle) = open.pop() {
        if outline.clipped(&rectangle).is_empty() {
            continue;
        }
        let sides = rectangle.sides();
        let longest = usize::from(sides[1] > sides[0]);
        if sides[longest] > demand.side_max.max(1.0) {
            open.extend(rectangle.halves(longest));
            continue;
        }
        let (tile, fit) = Tile::<TERMS>::fit(rectangle, |column, row| {
            let (value, calls) = counted(column, row);
            spent = calls;
            value
        });
        // What was added before counts: a pixel's target is for all of it.
        let before = canvas.least(&rectangle, outline);
        let allowed = target(demand.accuracy, [before + gain * fit.least; 3]) / gain;
        if fit.error <= allowed || spent >= demand.calls_max {
            add_tile(canvas, &tile, fit.error + demand.function_error, regions);
            continue;
        }
        let steep = usize::from(fit.tails[1] > fit.tails[0]);
        if let Some(axis) = axis_to_halve(sides, steep) {
            open.extend(rectangle.halves(axis));
            continue;
        }
        let mean = tile.integral(&rectangle).map(|sum| sum / rectangle.area());
        let brightest = mean[0].max(mean[1]).max(mean[2]);
        let allowed = target(demand.accuracy, [before + gain * brightest; 3]) / gain;
        for region in regions {
            let covered = region.outline.clipped(&rectangle);
            let (value, error) = pixel::integrate(&covered, steep, allowed, |column, row| {
                let (value, calls) = counted(column, row);
                spent = calls;
                value
            });
            let error = error + demand.function_error * covered.area();
            add_region(canvas, &rectangle, region, value, error);
        }
    }
    spent
}

/// Along which axis a tile is to be halved that is too coarse: the steeper one, into parts of a
/// pixel where that saves halving the other, which changes little over several pixels.
fn axis_to_halve(sides: [f64; 2], steep: usize) -> Option<usize> {
    let other = 1 - steep;
    if sides[steep] > 1.0 || (sides[other] > 2.0 && sides[steep] > STRIP_MIN) {
        Some(steep)
    } else if sides[other] > 1.0 {
        Some(other)
    } else {
        None
    }
}

fn add_tile(canvas: &mut Canvas<'_>, tile: &Tile<TERMS>, error: f64, regions: &[Region]) {
    for region in regions {
        let Some(shared) = region.outline.bounds().intersection(&tile.rectangle) else {
            continue;
        };
        for (column, row) in shared.pixels() {
            let Some(cell) = Rectangle::pixel(column, row).intersection(&tile.rectangle) else {
                continue;
            };
            let (value, area) = if region.outline.contains(&cell) {
                (tile.integral(&cell), cell.area())
            } else {
                tile.integral_over(&region.outline.clipped(&cell))
            };
            add_region(canvas, &cell, region, value, error * area);
        }
    }
}

fn add_region(
    canvas: &mut Canvas<'_>,
    cell: &Rectangle,
    region: &Region,
    value: [f64; 3],
    error: f64,
) {
    let place = (cell.low[0] as u32, cell.low[1] as u32);
    let gain = region.factor.into_iter().fold(0.0, f64::max);
    let scaled = std::array::from_fn(|channel| region.factor[channel] * value[channel]);
    canvas.add(place, scaled, gain * error);
}

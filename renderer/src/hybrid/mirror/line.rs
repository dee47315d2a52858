//! A line of cells across the film, in the mirror of one normal.

use super::MirroredChart;
use super::affine::Affine;
use super::cells::{Cells, Rays, place_on};
use super::kernels::{meet, shine};
use super::span::Spans;
use crate::hybrid::batch::LANES;
use crate::hybrid::chart::patch_at;
use crate::hybrid::polygon::{Polygon, Rectangle};
use crate::vector::Vec3;
use std::ops::Range;

/// A line of cells across the film.
///
/// In memory all pixels' first cells come first, then their second ones, and so on: neighbours
/// add to sums of their own, and a pixel's cells in their order.
pub struct Line<'a> {
    view: &'a MirroredChart<'a>,
    cell_side: f64,
    /// Column of the first cell's left edge, and the line's upper edge.
    origin: [f64; 2],
    /// Cells of a pixel.
    phases: usize,
    /// Entries of a phase: one more than there are pixels, filled up to whole vectors.
    stride: usize,
    /// Through the left corners above and below.
    rays: [Vec<Rays>; 2],
    cells: Vec<Cells>,
    /// Cells that the sample covers in part, by phase.
    parts: Vec<Vec<Part>>,
    /// Where on the chart the corners show, in patches from its corner: along either axis those
    /// above and below.
    corners: [[Vec<f64>; 2]; 2],
    /// Cells that the kernel left.
    rest: Vec<usize>,
}

/// A cell that the sample covers in part.
struct Part {
    pixel: usize,
    covered: Polygon,
    area: f64,
}

impl<'a> Line<'a> {
    pub fn new(view: &'a MirroredChart<'a>, top: f64, columns: Range<u32>, cells: u32) -> Self {
        let (pixels, phases) = (columns.len(), cells as usize);
        let cell_side = 1.0 / f64::from(cells);
        let left = f64::from(columns.start);
        let direction = |column: f64, row: f64| view.camera.direction(column, row);
        let step = direction(left + cell_side, top) - direction(left, top);
        let stride = (pixels + 1).next_multiple_of(LANES);
        // What fills vectors up stays close to the line.
        let last = (pixels * phases + 1).next_multiple_of(LANES) - 1;
        let index = |entry: usize| (entry % stride * phases + entry / stride).min(last);
        let rays = [top, top + cell_side].map(|row| {
            let start = direction(left, row);
            let mut rays = vec![Rays::default(); stride / LANES * phases];
            for entry in 0..stride * phases {
                let rays = &mut rays[entry / LANES];
                rays.set(entry % LANES, view, start + step * index(entry) as f64);
            }
            rays
        });
        let half = 0.5 * cell_side;
        let start = direction(left + half, top + half);
        let mut line = Self {
            view,
            cell_side,
            origin: [left, top],
            phases,
            stride,
            rays,
            cells: vec![Cells::default(); stride / LANES * phases],
            parts: (0..phases).map(|_| Vec::new()).collect(),
            // One more for the right corners of a pixel's last cells.
            corners: std::array::from_fn(|_| {
                std::array::from_fn(|_| vec![0.0; stride * phases + 1])
            }),
            rest: Vec::new(),
        };
        for phase in 0..phases {
            for pixel in 0..pixels {
                let entry = phase * stride + pixel;
                let cell = line.cell(phase, pixel);
                let covered = view.outline.clipped(&cell);
                let whole = view.outline.contains(&cell);
                if !whole && !covered.is_empty() {
                    let area = covered.area();
                    line.parts[phase].push(Part {
                        pixel,
                        covered,
                        area,
                    });
                }
                let direction = start + step * index(entry) as f64;
                line.cells[entry / LANES].set(entry % LANES, view, whole, direction);
            }
        }
        line
    }

    /// A pixel's cell on the film.
    fn cell(&self, phase: usize, pixel: usize) -> Rectangle {
        let [left, top] = self.origin;
        let index = pixel * self.phases + phase;
        let low = [left + self.cell_side * index as f64, top];
        Rectangle {
            low,
            high: low.map(|edge| edge + self.cell_side),
        }
    }

    /// Turns the mirror to a normal; returns the least and the largest place on the chart, in
    /// patches from its corner, along either axis.
    pub fn mirror(&mut self, normal: Vec3) -> [[f64; 2]; 2] {
        let panel = &self.view.chart.panel;
        let frame = [panel.x, panel.y, panel.z].map(|axis| axis * (1.0 / panel.pitch));
        let [u, v] = &mut self.corners;
        let mut ends = [[f64::INFINITY, f64::NEG_INFINITY]; 2];
        for ((rays, u), v) in self.rays.iter().zip(u).zip(v) {
            let found = meet(self.view.instructions, rays, [u, v], normal, frame);
            for (ends, [low, high]) in ends.iter_mut().zip(found) {
                ends[0] = low.into_iter().fold(ends[0], f64::min);
                ends[1] = high.into_iter().fold(ends[1], f64::max);
            }
        }
        ends
    }

    /// Adds what the cells mirror to the sums of their pixels.
    pub fn shine(&mut self, normal: Vec3, sums: &mut [[[f64; LANES]; 3]], spans: &mut [Spans]) {
        let optics = (normal, self.view.reflectance.ior, self.cell_side);
        for phase in 0..self.phases {
            let mut rest = std::mem::take(&mut self.rest);
            let from = phase * self.stride;
            // The last cell's right corner is the next pixel's first.
            let right = if phase + 1 < self.phases {
                from + self.stride
            } else {
                1
            };
            let corners = self.corners.each_ref().map(|[above, below]| {
                [
                    &above[from..],
                    &above[right..],
                    &below[from..],
                    &below[right..],
                ]
            });
            shine(
                self.view.instructions,
                self.view.chart,
                optics,
                &self.cells[from / LANES..],
                corners,
                sums,
                spans,
                &mut rest,
            );
            for pixel in rest.drain(..) {
                self.add(normal, phase, pixel, None, sums);
            }
            for part in &self.parts[phase] {
                self.add(normal, phase, part.pixel, Some(part), sums);
            }
            self.rest = rest;
        }
    }

    /// Adds what one cell mirrors, whole or covered in part.
    fn add(
        &self,
        normal: Vec3,
        phase: usize,
        pixel: usize,
        part: Option<&Part>,
        sums: &mut [[[f64; LANES]; 3]],
    ) {
        let chart = self.view.chart;
        let entry = phase * self.stride + pixel;
        let right = if phase + 1 < self.phases {
            entry + self.stride
        } else {
            pixel + 1
        };
        let places = self.corners.each_ref().map(|[above, below]| {
            Affine::through([above[entry], above[right], below[entry], below[right]])
        });
        let low = places.map(Affine::low);
        let high = places.map(Affine::high);
        let counts = [chart.panel.columns, chart.panel.rows].map(f64::from);
        if (0..2).any(|axis| high[axis] <= 0.0 || low[axis] >= counts[axis]) {
            return;
        }
        let tint = self.cells[entry / LANES].tint(entry % LANES, normal, self.view.reflectance.ior);
        let range = |axis: usize| {
            let last = counts[axis] - 1.0;
            let first = low[axis].floor().clamp(0.0, last);
            (first as u32, high[axis].floor().clamp(first, last) as u32)
        };
        let (columns, rows) = (range(0), range(1));
        for row in rows.0..=rows.1 {
            for column in columns.0..=columns.1 {
                let patch = [column, row].map(f64::from);
                let inside: [bool; 2] = std::array::from_fn(|axis| {
                    low[axis] >= patch[axis] && high[axis] <= patch[axis] + 1.0
                });
                let area = match (part, inside) {
                    (None, [true, true]) => self.cell_side * self.cell_side,
                    (None, [false, true]) => self.strip(places[0], patch[0]),
                    (None, [true, false]) => self.strip(places[1], patch[1]),
                    (Some(part), [true, true]) => part.area,
                    _ => self.part(phase, pixel, part, &places, patch),
                };
                if area <= 0.0 {
                    continue;
                }
                let at = [0, 1].map(|axis| place_on(low[axis], high[axis], patch[axis]));
                let index = chart.patch(column, row);
                let light = patch_at(&chart.light[index], &chart.patches[index], at);
                let sums = &mut sums[pixel / LANES];
                for channel in 0..3 {
                    sums[channel][pixel % LANES] += area * tint[channel] * light[channel];
                }
            }
        }
    }

    /// The area of a cell on which a place lies between `from` and `from + 1`.
    fn strip(&self, place: Affine, from: f64) -> f64 {
        place.share_of_unit(from) * self.cell_side * self.cell_side
    }

    /// The covered area of a cell that lies on a patch, where that is no strip.
    fn part(
        &self,
        phase: usize,
        pixel: usize,
        part: Option<&Part>,
        places: &[Affine; 2],
        patch: [f64; 2],
    ) -> f64 {
        let cell = self.cell(phase, pixel);
        let mut polygon = part.map_or_else(|| Polygon::rectangle(&cell), |part| part.covered);
        for (place, from) in places.iter().zip(patch) {
            let above = |[column, row]: [f64; 2]| {
                let x = (column - cell.low[0]) / self.cell_side - 0.5;
                let y = (row - cell.low[1]) / self.cell_side - 0.5;
                place.middle + place.across * x + place.down * y - from
            };
            polygon = polygon.cut(above).cut(|point| 1.0 - above(point));
        }
        polygon.area()
    }
}

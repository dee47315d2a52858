//! A line of cells across the film, reflected about one normal.

use super::affine::Affine;
use super::cells::{Cells, Rays, position_on};
use super::glossy_chart::GlossyChart;
use super::kernels::{intersect, shine};
use super::span::Spans;
use crate::hybrid::reflected_chart::lit_chart::patch_at;
use crate::numerics::batch::LANES;
use crate::numerics::polygon::{Polygon, Rectangle};
use crate::vector::Vec3;
use std::ops::Range;

/// A line of cells across the film.
///
/// In memory all pixels' first cells come first, then their second ones, and so on: neighbours
/// add to sums of their own, and a pixel's cells in their order.
pub struct Line<'a> {
    glossy: &'a GlossyChart<'a>,
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
    pub fn new(glossy: &'a GlossyChart<'a>, top: f64, columns: Range<u32>, cells: u32) -> Self {
        let (pixels, phases) = (columns.len(), cells as usize);
        let cell_side = 1.0 / f64::from(cells);
        let left = f64::from(columns.start);
        let direction = |column: f64, row: f64| glossy.camera.direction(column, row);
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
                rays.set(entry % LANES, glossy, start + step * index(entry) as f64);
            }
            rays
        });
        let half = 0.5 * cell_side;
        let start = direction(left + half, top + half);
        let mut line = Self {
            glossy,
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
                let covered = glossy.outline.clipped(&cell);
                let whole = glossy.outline.contains(&cell);
                if !whole && !covered.is_empty() {
                    let area = covered.area();
                    line.parts[phase].push(Part {
                        pixel,
                        covered,
                        area,
                    });
                }
                let direction = start + step * index(entry) as f64;
                line.cells[entry / LANES].set(entry % LANES, glossy, whole, direction);
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

    /// Intersects the rays, reflected about a normal, with the chart; returns the least and the
    /// largest position on it, in patches from its corner, along either axis.
    pub fn reflect(&mut self, normal: Vec3) -> [[f64; 2]; 2] {
        let plane = &self.glossy.chart.plane;
        let frame = [plane.x, plane.y, plane.z].map(|axis| axis * (1.0 / plane.pitch));
        let [u, v] = &mut self.corners;
        let mut ends = [[f64::INFINITY, f64::NEG_INFINITY]; 2];
        for ((rays, u), v) in self.rays.iter().zip(u).zip(v) {
            let found = intersect(self.glossy.instructions, rays, [u, v], normal, frame);
            for (ends, [low, high]) in ends.iter_mut().zip(found) {
                ends[0] = low.into_iter().fold(ends[0], f64::min);
                ends[1] = high.into_iter().fold(ends[1], f64::max);
            }
        }
        ends
    }

    /// Adds what the cells reflect to the sums of their pixels.
    pub fn shine(&mut self, normal: Vec3, sums: &mut [[[f64; LANES]; 3]], spans: &mut [Spans]) {
        let optics = (normal, self.glossy.reflectance.ior, self.cell_side);
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
                self.glossy.instructions,
                self.glossy.chart,
                optics,
                &self.cells[from / LANES..],
                corners,
                (&mut *sums, &mut *spans),
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

    /// Where on the chart a cell shows, along either axis.
    fn positions(&self, phase: usize, pixel: usize) -> [Affine; 2] {
        let entry = phase * self.stride + pixel;
        let right = if phase + 1 < self.phases {
            entry + self.stride
        } else {
            pixel + 1
        };
        let position = |axis: usize| {
            let [above, below] = &self.corners[axis];
            Affine::through([above[entry], above[right], below[entry], below[right]])
        };
        [position(0), position(1)]
    }

    /// Adds what one cell reflects, whole or covered in part.
    fn add(
        &self,
        normal: Vec3,
        phase: usize,
        pixel: usize,
        part: Option<&Part>,
        sums: &mut [[[f64; LANES]; 3]],
    ) {
        let chart = self.glossy.chart;
        let entry = phase * self.stride + pixel;
        let positions = self.positions(phase, pixel);
        let low = [positions[0].low(), positions[1].low()];
        let high = [positions[0].high(), positions[1].high()];
        let counts = [chart.plane.columns, chart.plane.rows].map(f64::from);
        if (0..2).any(|axis| high[axis] <= 0.0 || low[axis] >= counts[axis]) {
            return;
        }
        let tint =
            self.cells[entry / LANES].tint(entry % LANES, normal, self.glossy.reflectance.ior);
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
                    (None, [false, true]) => self.strip(positions[0], patch[0]),
                    (None, [true, false]) => self.strip(positions[1], patch[1]),
                    (Some(part), [true, true]) => part.area,
                    _ => self.part(phase, pixel, part, &positions, patch),
                };
                if area <= 0.0 {
                    continue;
                }
                let at = [
                    position_on(low[0], high[0], patch[0]),
                    position_on(low[1], high[1], patch[1]),
                ];
                let index = chart.patch(column, row);
                let light = patch_at(&chart.light[index], &chart.patches[index], at);
                let sums = &mut sums[pixel / LANES];
                for channel in 0..3 {
                    sums[channel][pixel % LANES] += area * tint[channel] * light[channel];
                }
            }
        }
    }

    /// The area of a cell on which a position lies between `from` and `from + 1`.
    fn strip(&self, position: Affine, from: f64) -> f64 {
        position.share_of_unit(from) * self.cell_side * self.cell_side
    }

    /// The covered area of a cell that lies on a patch, where that is no strip.
    fn part(
        &self,
        phase: usize,
        pixel: usize,
        part: Option<&Part>,
        positions: &[Affine; 2],
        patch: [f64; 2],
    ) -> f64 {
        let cell = self.cell(phase, pixel);
        let mut polygon = part.map_or_else(|| Polygon::rectangle(&cell), |part| part.covered);
        for (position, from) in positions.iter().zip(patch) {
            let above = |[column, row]: [f64; 2]| {
                let x = (column - cell.low[0]) / self.cell_side - 0.5;
                let y = (row - cell.low[1]) / self.cell_side - 0.5;
                position.middle + position.across * x + position.down * y - from
            };
            polygon = polygon.cut(above).cut(|point| 1.0 - above(point));
        }
        polygon.area()
    }
}

#[cfg(test)]
mod tests {
    use super::super::span::Span;
    use super::*;
    use crate::geometry::BackendChoice;
    use crate::hybrid::PreparedView;
    use crate::hybrid::reflected_chart::lit_chart::LitChart;
    use crate::numerics::instructions::Instructions;
    use crate::reflectance::Reflectance;
    use crate::scene::Scene;
    use dataset::{HARD_CASES, Specification};

    /// Sums and spans of a line's pixels.
    type Found = Vec<([[u64; 3]; LANES], [Span; LANES])>;

    fn found(sums: &[[[f64; LANES]; 3]], spans: &[Spans]) -> Found {
        let lanes = |sums: &[[f64; LANES]; 3], lane: usize| sums.map(|sum| sum[lane].to_bits());
        sums.iter()
            .zip(spans)
            .map(|(sums, spans)| {
                (
                    std::array::from_fn(|lane| lanes(sums, lane)),
                    std::array::from_fn(|lane| spans.of(lane)),
                )
            })
            .collect()
    }

    #[test]
    fn the_kernel_adds_what_cells_add_one_by_one_on_every_instruction_set() {
        const COLUMNS: Range<u32> = 4..124;
        const BLOCKS: usize = 15;
        let specification = Specification::preset();
        let scene = Scene::new(&specification, 5, BackendChoice::Native);
        let scene = scene.expect("a view").expect("a scene");
        let prepared = PreparedView::new(&scene, &specification).expect("a prepared view");
        let chart = prepared.chart.as_ref().expect("a chart");
        let chart = LitChart::new(chart, 1, |[a, b]| [1.0 + a, 2.0 - b, 1.0 + a * b]);
        // A highly anisotropic lobe: its normals lead all over the chart and beside it.
        let material = HARD_CASES[2].material;
        let reflectance = Reflectance::new(&material, 0.0, specification.tint);
        let normals: Vec<Vec3> = (0..40)
            .map(|i| {
                let along = (f64::from(i) * 0.618_034).fract().max(1e-3);
                reflectance
                    .lobe
                    .sample([along, (f64::from(i) + 0.5) / 40.0])
            })
            .collect();
        let (mut cut, mut lit) = (0, 0);
        for instructions in Instructions::available() {
            let glossy = GlossyChart {
                chart: &chart,
                reflectance: &reflectance,
                camera: &prepared.view.camera,
                outline: &prepared.view.sample,
                accuracy: &prepared.view.budget.chart,
                key: 1,
                instructions,
            };
            for (cells, top) in [(1, 40.0), (1, 64.0), (1, 87.0), (3, 60.0)] {
                let mut line = Line::new(&glossy, top, COLUMNS, cells);
                let sums = vec![[[0.0; LANES]; 3]; BLOCKS];
                let spans = vec![Spans::default(); BLOCKS];
                let (mut together, mut together_spans) = (sums.clone(), spans.clone());
                let (mut alone, mut alone_spans) = (sums, spans);
                for normal in &normals {
                    line.reflect(*normal);
                    line.shine(*normal, &mut together, &mut together_spans);
                    for phase in 0..line.phases {
                        for pixel in 0..COLUMNS.len() {
                            let (block, lane) = (pixel / LANES, pixel % LANES);
                            let positions = line.positions(phase, pixel);
                            for (axis, position) in positions.into_iter().enumerate() {
                                let mut ends = [[f64::INFINITY; LANES], [f64::NEG_INFINITY; LANES]];
                                ends[0][lane] = position.low();
                                ends[1][lane] = position.high();
                                alone_spans[block].extend(axis, &ends[0], &ends[1]);
                            }
                            let cell = &line.cells[(phase * line.stride + pixel) / LANES];
                            let part = line.parts[phase].iter().find(|part| part.pixel == pixel);
                            let parted = |position: Affine| {
                                position.low().floor() != position.high().floor()
                            };
                            cut += usize::from(positions.into_iter().any(parted));
                            if cell.whole[lane] > 0.0 || part.is_some() {
                                line.add(*normal, phase, pixel, part, &mut alone);
                            }
                        }
                    }
                }
                let (together, alone) = (
                    found(&together, &together_spans),
                    found(&alone, &alone_spans),
                );
                assert_eq!(together, alone, "{instructions}, {cells} cells, row {top}");
                let shown = together.iter().flat_map(|(sums, _)| sums);
                lit += shown.filter(|sum| **sum != [0; 3]).count();
            }
        }
        assert!(
            cut > 1000 && lit > 200,
            "{cut} cells on edges, {lit} pixels lit"
        );
    }
}

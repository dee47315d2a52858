//! The chart in a smooth sample: pixels by areas, the lobe by points.
//!
//! A narrow lobe mirrors the chart with edges finer than any tile. But in a mirror with one tilted
//! normal the chart is a picture, and on a pixel of it the patches are parted by straight lines: its
//! integral is areas times a patch's light. What is left is the integral over the normals, the
//! half vectors of the lobe. They are drawn from it in independent scrambles, the same for all
//! pixels, so that the model's lobe cancels against their density; as a pixel's areas change
//! smoothly with the normal, few are enough, and for a mirror one.

use super::batch::LANES;
use super::chart::LitChart;
use super::mirror_kernels::{extent, meet, weigh};
use super::polygon::{Polygon, Rectangle};
use crate::film::{FilmPixel, target};
use crate::instructions::Instructions;
use crate::reflectance::Reflectance;
use crate::replicates::{REPLICATES, estimate};
use crate::sampler::{Dimension, Sampler};
use crate::scene::PinholeCamera;
use crate::vector::Vec3;
use dataset::specification::Accuracy;
use rayon::prelude::*;

/// From this exponent on a lobe mirrors edges about as fine as a pixel: a quarter of the time that
/// tiles take.
const SHARP_EXPONENT: f64 = 1e5;

/// From these exponents on, the one along a lobe's narrow axis and the other less, it is a sheet
/// that a product rule over the chart resolves only with many points.
const SHEET_EXPONENTS: [f64; 2] = [3e3, 100.0];

/// Whether the chart in a sample of this material is worked out here.
pub fn wanted(reflectance: &Reflectance) -> bool {
    let lobe = &reflectance.lobe;
    lobe.n_u > SHARP_EXPONENT || (lobe.n_u > SHEET_EXPONENTS[0] && lobe.n_v < SHEET_EXPONENTS[1])
}

/// Rows that share a pilot.
const BAND_ROWS: usize = 4;

/// Normals that a replicate of the pilot takes. It is thrown away: to stop by the normals that are
/// kept would bias them.
const PILOT: usize = 4;

/// The relative target to which the limits below are made: the chart's share of the preset's.
const TARGET: f64 = 4e-4;

/// The fewest normals that a replicate takes; the most to [`TARGET`] and coarser ones; and to finer
/// ones, where it rises with the target's inverse.
const NORMALS_MIN: usize = 4;
const NORMALS_MAX: usize = 256;
const NORMALS_MAX_FINEST: usize = 1024;

/// Doubling the normals cuts the error by at least this power of two.
const CONVERGENCE: f64 = 1.0;

/// Of a band's pixels so many may miss the target.
const LEFT_OUT: f64 = 0.02;

/// What a patch may differ from its neighbour by, in units of white: where an edge lies just beyond
/// all of n normals, this over n may have been missed.
const CONTRAST: f64 = 0.3;

/// How far beyond, as a share of what the normals span.
const BEYOND: f64 = 0.2;

/// To [`TARGET`] a cell may span so much of the distance from the camera to the sample: edges bend on
/// it by less than a thousandth of its side.
const CELL_SPAN: f64 = 0.008;

/// The most cells along a pixel's side.
const CELLS_MAX: f64 = 16.0;

/// A smooth sample with the chart in it.
pub struct MirroredChart<'a> {
    /// What is mirrored.
    pub chart: &'a LitChart,
    /// What mirrors it.
    pub reflectance: &'a Reflectance,
    /// From where.
    pub camera: &'a PinholeCamera,
    /// The sample's outline on the film.
    pub outline: &'a Polygon,
    /// The target.
    pub accuracy: &'a Accuracy,
    /// Names the image.
    pub key: u64,
    /// What it is worked out on.
    pub instructions: Instructions,
}

/// Keeps the pilot's normals apart from the others.
const PILOT_PURPOSE: u64 = 0x70_696c_6f74;

impl MirroredChart<'_> {
    /// The pixels of a rectangle of whole ones, row by row, and how many normals they took in all.
    /// `before` is what a pixel, by column and row, holds already.
    pub fn render(
        &self,
        bounds: &Rectangle,
        before: impl Fn(u32, u32) -> [f64; 3] + Sync,
    ) -> (Vec<FilmPixel>, u64) {
        let first = bounds.low[1] as u32;
        let rows: Vec<u32> = (first..bounds.high[1] as u32).collect();
        let columns = bounds.low[0] as u32..bounds.high[0] as u32;
        let pilot = self.normals(PILOT_PURPOSE, PILOT);
        let normals_max = self.normals_max();
        let most = self.normals(0, normals_max);
        let bands: Vec<(Vec<FilmPixel>, u64)> = rows
            .par_chunks(BAND_ROWS)
            .map(|rows| {
                let mut spent = 0;
                let middle = rows[rows.len() / 2];
                let tried = self.row(middle, columns.clone(), &pilot, PILOT, &mut spent);
                let mut excess: Vec<f64> = tried
                    .iter()
                    .zip(columns.clone())
                    .map(|(pixel, column)| {
                        let before = before(column, middle);
                        let value = std::array::from_fn(|c| before[c] + pixel.value[c]);
                        pixel.error / target(self.accuracy, value)
                    })
                    .collect();
                excess.sort_unstable_by(f64::total_cmp);
                let worst = excess[((excess.len() - 1) as f64 * (1.0 - LEFT_OUT)) as usize];
                let wanted = PILOT as f64 * libm::pow(worst, 1.0 / CONVERGENCE);
                let count = (wanted.min(normals_max as f64) as usize)
                    .clamp(NORMALS_MIN, normals_max)
                    .next_power_of_two();
                let pixels = rows
                    .iter()
                    .flat_map(|&row| self.row(row, columns.clone(), &most, count, &mut spent))
                    .collect();
                (pixels, spent)
            })
            .collect();
        let spent = bands.iter().map(|(_, spent)| spent).sum();
        (
            bands.into_iter().flat_map(|(pixels, _)| pixels).collect(),
            spent,
        )
    }

    /// Half vectors of the lobe, `count` in each replicate.
    fn normals(&self, purpose: u64, count: usize) -> Vec<Vec<Vec3>> {
        (0..REPLICATES)
            .map(|replicate| {
                let sampler = Sampler::new(self.key ^ purpose, 0, replicate);
                (0..count as u32)
                    .map(|index| {
                        let point = sampler.point(Dimension::Scatter(0), index);
                        self.reflectance.lobe.sample(point)
                    })
                    .collect()
            })
            .collect()
    }

    /// A row of pixels with the first `count` normals of each replicate.
    fn row(
        &self,
        row: u32,
        columns: std::ops::Range<u32>,
        normals: &[Vec<Vec3>],
        count: usize,
        spent: &mut u64,
    ) -> Vec<FilmPixel> {
        let cells = self.cells();
        let mut means = vec![[[0.0; 3]; REPLICATES as usize]; columns.len()];
        let mut spans = vec![Span::default(); columns.len()];
        for sub_row in 0..cells {
            let top = f64::from(row) + f64::from(sub_row) / f64::from(cells);
            let mut line = Line::new(self, top, columns.clone(), cells);
            for (replicate, normals) in normals.iter().enumerate() {
                for normal in &normals[..count] {
                    *spent += line.cover.len() as u64;
                    if !line.mirror(self, *normal) {
                        spans
                            .iter_mut()
                            .for_each(|span| span.extend(line.low, line.high));
                        continue;
                    }
                    for (index, (mean, span)) in means.iter_mut().zip(&mut spans).enumerate() {
                        for cell in index * cells as usize..(index + 1) * cells as usize {
                            line.add(self, cell, &mut mean[replicate], span);
                        }
                    }
                }
            }
        }
        let scale = 1.0 / count as f64;
        means
            .into_iter()
            .zip(spans)
            .map(|(mean, span)| {
                let mut pixel = estimate(&mean.map(|sum| sum.map(|channel| channel * scale)));
                if span.near_edge(self.chart) {
                    let unseen = CONTRAST / (f64::from(REPLICATES) * count as f64);
                    pixel.error = pixel.error.max(unseen);
                }
                pixel
            })
            .collect()
    }

    /// The most normals that a replicate takes.
    fn normals_max(&self) -> usize {
        let finer = TARGET / self.target().min(TARGET);
        let most = (NORMALS_MAX as f64 * finer).min(NORMALS_MAX_FINEST as f64);
        (most as usize).next_power_of_two()
    }

    fn target(&self) -> f64 {
        self.accuracy.relative.max(self.accuracy.absolute)
    }

    /// Cells along a pixel's side.
    fn cells(&self) -> u32 {
        let camera = self.camera.position;
        // A row spans more of a sample that is seen at a slant.
        let span = self.camera.pixel_size() * camera.length() / camera.z;
        let cells = span / CELL_SPAN * (TARGET / self.target()).sqrt();
        cells.clamp(1.0, CELLS_MAX).ceil() as u32
    }
}

/// Where on the chart, in patches from its corner, all normals of a pixel lead.
#[derive(Clone, Copy)]
struct Span {
    low: [f64; 2],
    high: [f64; 2],
}

impl Default for Span {
    fn default() -> Self {
        Self {
            low: [f64::INFINITY; 2],
            high: [f64::NEG_INFINITY; 2],
        }
    }
}

impl Span {
    fn extend(&mut self, low: [f64; 2], high: [f64; 2]) {
        for axis in 0..2 {
            self.low[axis] = self.low[axis].min(low[axis]);
            self.high[axis] = self.high[axis].max(high[axis]);
        }
    }

    /// Whether an edge lies just beyond.
    fn near_edge(&self, chart: &LitChart) -> bool {
        let counts = [chart.panel.columns, chart.panel.rows].map(f64::from);
        let more: [f64; 2] =
            std::array::from_fn(|axis| BEYOND * (self.high[axis] - self.low[axis]));
        let meets = (0..2).all(|axis| {
            self.low[axis] - more[axis] < counts[axis] && self.high[axis] + more[axis] > 0.0
        });
        meets
            && (0..2).any(|axis| {
                let bound = |at: f64| at.clamp(-1.0, counts[axis] + 1.0).floor();
                bound(self.low[axis]) != bound(self.low[axis] - more[axis])
                    || bound(self.high[axis]) != bound(self.high[axis] + more[axis])
            })
    }
}

/// How much of a cell the sample covers.
enum Cover {
    None,
    All,
    Part(Box<Polygon>),
}

/// A line of cells across the film, in the mirror of one normal.
struct Line {
    cell_side: f64,
    /// Column of the first cell's left edge, and the line's upper edge.
    origin: [f64; 2],
    cover: Vec<Cover>,
    /// Directions through the corners above and below and through the middles of the cells: the
    /// first, and the step from cell to cell.
    start: [Vec3; 3],
    step: Vec3,
    /// 0, 1, 2, ..., one more than there are cells, filled up to whole vectors.
    indices: Vec<f64>,
    /// The tint's response at the middles: slopes, bends, knees.
    slopes: Vec<[f64; 3]>,
    bends: Vec<[f64; 3]>,
    knees: Vec<f64>,
    /// Corners above and below, in patches from the chart's corner.
    u: [Vec<f64>; 2],
    v: [Vec<f64>; 2],
    /// The least and the largest of them.
    low: [f64; 2],
    high: [f64; 2],
    /// Fresnel's reflectance times the weight, and what it exceeds the knee by.
    fresnel: Vec<f64>,
    excess: Vec<f64>,
}

impl Line {
    fn new(view: &MirroredChart<'_>, top: f64, columns: std::ops::Range<u32>, cells: u32) -> Self {
        let cell_side = 1.0 / f64::from(cells);
        let count = columns.len() * cells as usize;
        let padded = (count + 1).next_multiple_of(LANES);
        let left = f64::from(columns.start);
        let direction = |column: f64, row: f64| view.camera.direction(column, row);
        let middle = [left + 0.5 * cell_side, top + 0.5 * cell_side];
        let mut line = Self {
            cell_side,
            origin: [left, top],
            cover: Vec::with_capacity(count),
            start: [
                direction(left, top),
                direction(left, top + cell_side),
                direction(middle[0], middle[1]),
            ],
            step: direction(left + cell_side, top) - direction(left, top),
            indices: (0..padded as u32).map(f64::from).collect(),
            slopes: Vec::with_capacity(count),
            bends: Vec::with_capacity(count),
            knees: Vec::with_capacity(padded),
            u: [vec![0.0; padded], vec![0.0; padded]],
            v: [vec![0.0; padded], vec![0.0; padded]],
            low: [0.0; 2],
            high: [0.0; 2],
            fresnel: vec![0.0; padded],
            excess: vec![0.0; padded],
        };
        for index in 0..count {
            let cell = line.cell(index);
            let covered = view.outline.clipped(&cell);
            line.cover.push(if view.outline.contains(&cell) {
                Cover::All
            } else if covered.is_empty() {
                Cover::None
            } else {
                Cover::Part(Box::new(covered))
            });
            let to_camera = -(line.start[2] + line.step * index as f64).normalized();
            let response = view.reflectance.tint_response(to_camera.z);
            line.slopes.push(response.slope);
            line.bends.push(response.bend);
            line.knees.push(response.knee);
        }
        line.knees.resize(padded, 2.0);
        line
    }

    fn cell(&self, index: usize) -> Rectangle {
        let [left, top] = self.origin;
        let low = [left + self.cell_side * index as f64, top];
        Rectangle {
            low,
            high: low.map(|edge| edge + self.cell_side),
        }
    }

    /// Turns the mirror to a normal; returns whether anything of the chart may be seen in it.
    fn mirror(&mut self, view: &MirroredChart<'_>, normal: Vec3) -> bool {
        let panel = &view.chart.panel;
        let height = view.camera.position.z;
        for side in 0..2 {
            let offset = view.camera.position - panel.corner;
            let frame = [panel.x, panel.y, panel.z].map(|axis| axis * (1.0 / panel.pitch));
            meet(
                view.instructions,
                &self.indices,
                [&mut self.u[side], &mut self.v[side]],
                [self.start[side], self.step],
                normal,
                (height, offset),
                frame,
            );
        }
        let counts = [panel.columns, panel.rows].map(f64::from);
        let ends = [&self.u, &self.v].map(|lines| extent(view.instructions, &lines[0], &lines[1]));
        self.low = ends.map(|[low, _]| low);
        self.high = ends.map(|[_, high]| high);
        if (0..2).any(|axis| self.high[axis] <= 0.0 || self.low[axis] >= counts[axis]) {
            return false;
        }
        weigh(
            view.instructions,
            &self.indices,
            &self.knees,
            [&mut self.fresnel, &mut self.excess],
            [self.start[2], self.step],
            normal,
            view.reflectance.ior,
        );
        true
    }

    /// Adds what a cell mirrors.
    fn add(&self, view: &MirroredChart<'_>, index: usize, sum: &mut [f64; 3], span: &mut Span) {
        let corners = |lines: &[Vec<f64>; 2]| {
            [
                lines[0][index],
                lines[0][index + 1],
                lines[1][index],
                lines[1][index + 1],
            ]
        };
        let places = [corners(&self.u), corners(&self.v)].map(Affine::through);
        let low = places.map(|place| place.low());
        let high = places.map(|place| place.high());
        span.extend(low, high);
        let panel = &view.chart.panel;
        let counts = [panel.columns, panel.rows].map(f64::from);
        if (0..2).any(|axis| high[axis] <= 0.0 || low[axis] >= counts[axis]) {
            return;
        }
        let cover = match &self.cover[index] {
            Cover::None => return,
            Cover::All => None,
            Cover::Part(polygon) => Some(&**polygon),
        };
        let tint: [f64; 3] = std::array::from_fn(|channel| {
            let slope = self.slopes[index][channel] * self.fresnel[index];
            (slope + self.bends[index][channel] * self.excess[index]).max(0.0)
        });
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
                let area = match (cover, inside) {
                    (None, [true, true]) => self.cell_side * self.cell_side,
                    (None, [false, true]) => self.strip(places[0], patch[0]),
                    (None, [true, false]) => self.strip(places[1], patch[1]),
                    (Some(polygon), [true, true]) => polygon.area(),
                    _ => self.part(index, cover, &places, patch),
                };
                if area <= 0.0 {
                    continue;
                }
                // The middle of what lies on the patch.
                let at = std::array::from_fn(|axis| {
                    let from = low[axis].max(patch[axis]);
                    let to = high[axis].min(patch[axis] + 1.0);
                    0.5 * (from + to) - patch[axis]
                });
                let light = view.chart.light_at(column, row, at);
                for channel in 0..3 {
                    sum[channel] += area * tint[channel] * light[channel];
                }
            }
        }
    }

    /// The area of a cell on which a place lies between `from` and `from + 1`.
    fn strip(&self, place: Affine, from: f64) -> f64 {
        let share = place.share_below(from + 1.0) - place.share_below(from);
        share * self.cell_side * self.cell_side
    }

    /// The covered area of a cell that lies on a patch, where that is no strip.
    fn part(
        &self,
        index: usize,
        cover: Option<&Polygon>,
        places: &[Affine; 2],
        patch: [f64; 2],
    ) -> f64 {
        let cell = self.cell(index);
        let mut part = cover.copied().unwrap_or_else(|| Polygon::rectangle(&cell));
        for (place, from) in places.iter().zip(patch) {
            let above = |[column, row]: [f64; 2]| {
                let x = (column - cell.low[0]) / self.cell_side - 0.5;
                let y = (row - cell.low[1]) / self.cell_side - 0.5;
                place.middle + place.across * x + place.down * y - from
            };
            part = part.cut(above).cut(|point| 1.0 - above(point));
        }
        part.area()
    }
}

/// A linear function on a cell: at its middle, and its rise from side to side.
#[derive(Clone, Copy)]
struct Affine {
    middle: f64,
    across: f64,
    down: f64,
}

impl Affine {
    /// From the corners: upper left, upper right, lower left, lower right.
    fn through([a, b, c, d]: [f64; 4]) -> Self {
        Self {
            middle: 0.25 * ((a + b) + (c + d)),
            across: 0.5 * ((b - a) + (d - c)),
            down: 0.5 * ((c - a) + (d - b)),
        }
    }

    fn low(self) -> f64 {
        self.middle - 0.5 * (self.across.abs() + self.down.abs())
    }

    fn high(self) -> f64 {
        self.middle + 0.5 * (self.across.abs() + self.down.abs())
    }

    /// The share of the cell on which the function is below `limit`.
    fn share_below(self, limit: f64) -> f64 {
        let (x, y) = (self.across.abs(), self.down.abs());
        let (less, more) = (x.min(y), x.max(y));
        let rise = limit - self.low();
        let left = less + more - rise;
        if rise <= 0.0 {
            0.0
        } else if left <= 0.0 {
            1.0
        } else if rise < less {
            0.5 * rise * rise / (less * more)
        } else if rise < more {
            (rise - 0.5 * less) / more
        } else {
            1.0 - 0.5 * left * left / (less * more)
        }
    }
}

//! The colour chart in a glossy sample: pixels by areas, the lobe by points.
//!
//! A glossy lobe reflects the edges of patches so sharply that no tile follows them. But reflected
//! about one normal the chart is a picture, and straight lines part its patches on a pixel: the pixel
//! is a sum of areas times a patch's light. What remains is an integral over the normals, the half
//! vectors of the lobe. They are drawn from the lobe in independent scrambles, the same for all
//! pixels, so that the model's lobe cancels against their density. A pixel's areas change smoothly
//! with the normal, so a few normals are enough, and a perfect mirror needs one.

mod affine;
mod cells;
mod glossy_chart;
mod kernels;
mod line;
mod span;

use crate::film::replicates::{REPLICATES, estimate};
use crate::film::{FilmPixel, target};
use crate::hybrid::budget::glossy::{
    BAND_ROWS, CELL_SPAN, CELLS_MAX, CONTRAST, CONVERGENCE, LEFT_OUT, NORMALS_MAX,
    NORMALS_MAX_FINEST, NORMALS_MIN, PILOT, TARGET,
};
use crate::numerics::batch::LANES;
use crate::numerics::polygon::Rectangle;
use crate::sampler::{Dimension, Sampler};
use crate::scene::ChartPlane;
use crate::vector::Vec3;
pub use glossy_chart::GlossyChart;
use line::Line;
use rayon::prelude::*;
use span::{Span, Spans};

/// Keeps the pilot's normals apart from the others.
const PILOT_PURPOSE: u64 = 0x70_696c_6f74;

impl GlossyChart<'_> {
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
        let blocks = columns.len().div_ceil(LANES);
        let mut sums = vec![vec![[[0.0; LANES]; 3]; blocks]; REPLICATES as usize];
        let mut spans = vec![Spans::default(); blocks];
        // The span of normals about which no pixel reflects anything of the chart.
        let mut beyond = Span::default();
        for sub_row in 0..cells {
            let top = f64::from(row) + f64::from(sub_row) / f64::from(cells);
            let mut line = Line::new(self, top, columns.clone(), cells);
            for (sums, normals) in sums.iter_mut().zip(normals) {
                for normal in &normals[..count] {
                    *spent += columns.len() as u64 * u64::from(cells);
                    let ends = line.reflect(*normal);
                    if may_show(&self.chart.plane, ends) {
                        line.shine(*normal, sums, &mut spans);
                    } else {
                        beyond.extend(ends.map(|[low, _]| low), ends.map(|[_, high]| high));
                    }
                }
            }
        }
        let scale = 1.0 / count as f64;
        (0..columns.len())
            .map(|pixel| {
                let (block, lane) = (pixel / LANES, pixel % LANES);
                let means = std::array::from_fn(|replicate| {
                    sums[replicate][block].map(|channel| channel[lane] * scale)
                });
                let mut pixel = estimate(&means);
                let span = spans[block].of(lane).with(beyond);
                if span.near_edge(&self.chart.plane) {
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

/// Whether anything of the chart may be seen between two positions along either axis, in patches from
/// its corner.
fn may_show(plane: &ChartPlane, ends: [[f64; 2]; 2]) -> bool {
    let counts = [plane.columns, plane.rows].map(f64::from);
    ends.iter()
        .zip(counts)
        .all(|([low, high], count)| *high > 0.0 && *low < count)
}

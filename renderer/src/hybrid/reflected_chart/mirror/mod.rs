//! The chart in a near mirror: sharp but for a blur of less than a pixel.
//!
//! There the chart is its mirror image, times what the mirror makes of white light, blurred. Lines between patches are
//! straight on the film ([`image`]), and the lobe blurs positions on the chart nearly normally. So of each pixel the
//! shares of patches are closed forms or small sums ([`blur`]), and white light is told over the chart by polynomials
//! ([`white`]). What that misses shows along every edge, at points where the lobe is integrated as everywhere else.
//! Pixels that miss more than they may are left to tiles.

mod blur;
mod correlation;
mod image;
mod looks;
mod pixel;
mod white;

use super::glossy::{self, GlossyChart};
use crate::film::canvas::Canvas;
use crate::film::demand::FunctionError;
use crate::film::target;
use crate::hybrid::budget::{TILING, mirror as budget};
use crate::hybrid::view::View;
use crate::numerics::channels::largest_difference;
use crate::numerics::polygon::Rectangle;
use crate::numerics::tolerance::Tolerance;
use crate::parallel;
use blur::CornerPoints;
use dataset::specification::Accuracy;
use image::Mirror;
use looks::{Looks, Off, Place};
use pixel::{Along, Pixel};
use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;
use white::{Cell, WhiteLight, WhitePatch};

/// What a near mirror shows, and how well it has to.
pub struct NearMirror<'a> {
    pub view: &'a View,
    pub chart: &'a GlossyChart<'a>,
    /// The same with its light told by finer polynomials, where these were not found to be good enough.
    pub finer: Option<&'a GlossyChart<'a>>,
    /// What the polynomials miss.
    pub missed: f64,
    pub function_error: FunctionError,
    pub accuracy: &'a Accuracy,
    pub tolerance: Tolerance,
}

/// What is known of a pixel.
enum Found {
    /// Nothing of the chart shows.
    Dark,
    /// More than is worked out here.
    Left,
    Lit(Box<Pixel>),
}

/// What was worked out, and evaluations.
struct Counted<T> {
    of: T,
    evaluations: u64,
}

/// What a pixel comes to.
struct Value {
    value: [f64; 3],
    /// What is missed here, and beside it what the light on the chart may be off by.
    missed: f64,
    function_error: f64,
}

/// White light by column and row of patches.
type WhiteChart = BTreeMap<(u32, u32), WhitePatch>;

/// Adds what it can of the light within `bounds`, which is `around` the chart's image; returns the parts of the film
/// that are left, and evaluations.
pub fn add(
    near: &NearMirror<'_>,
    canvas: &mut Canvas<'_>,
    (around, bounds): (&Rectangle, &Rectangle),
) -> (Vec<Rectangle>, u64) {
    let worker = Worker::new(near);
    let [columns, rows] = around.pixel_ranges();
    let pixels: Vec<(u32, Vec<Found>)> = rows
        .map(|row| (row, worker.find(row, columns.clone())))
        .collect();
    if shows_beyond(&pixels, &columns, bounds) {
        return (vec![*bounds], 0);
    }
    let Counted {
        of: white,
        mut evaluations,
    } = worker.white(&pixels);
    let firsts = worker.first_of_stretches(&pixels);
    let looked_at = parallel::map(
        &pixels,
        budget::EVALUATIONS_A_ROW,
        |scratch, (_, pixels)| worker.look(pixels, &firsts, &white, scratch),
        |row| row.evaluations,
    );
    let mut looks = Looks::default();
    for row in looked_at {
        evaluations += row.evaluations;
        for (place, off) in row.of {
            looks.add(place, off);
        }
    }
    let mut left = Vec::new();
    for (row, pixels) in &pixels {
        for (column, found) in columns.clone().zip(pixels) {
            let is_done = match found {
                Found::Dark => true,
                Found::Left => false,
                Found::Lit(pixel) => worker
                    .value(pixel, &white, &looks)
                    .is_some_and(|value| worker.keep(canvas, (column, *row), &value)),
            };
            if !is_done {
                push(&mut left, column, *row);
            }
        }
    }
    (stacked(left), evaluations)
}

/// Whether the chart may show beyond what was looked at.
fn shows_beyond(pixels: &[(u32, Vec<Found>)], columns: &Range<u32>, bounds: &Rectangle) -> bool {
    let [all_columns, all_rows] = bounds.pixel_ranges();
    let mut rim = Vec::new();
    for (_, pixels) in pixels {
        rim.extend(pixels.first().filter(|_| columns.start > all_columns.start));
        rim.extend(pixels.last().filter(|_| columns.end < all_columns.end));
    }
    let first = pixels.first().filter(|(row, _)| *row > all_rows.start);
    let last = pixels.last().filter(|(row, _)| row + 1 < all_rows.end);
    rim.extend(first.into_iter().chain(last).flat_map(|(_, pixels)| pixels));
    rim.into_iter().any(|found| !matches!(found, Found::Dark))
}

/// Adds a pixel to rows of pixels.
fn push(rows: &mut Vec<Rectangle>, column: u32, row: u32) {
    let pixel = Rectangle::pixel(column, row);
    match rows.last_mut() {
        Some(last) if last.low[1] == pixel.low[1] && last.high[0] == pixel.low[0] => {
            last.high[0] = pixel.high[0];
        }
        _ => rows.push(pixel),
    }
}

/// Rows that lie upon each other and are as long made one: tiles may then be higher than a pixel.
fn stacked(rows: Vec<Rectangle>) -> Vec<Rectangle> {
    let mut stacks: Vec<Rectangle> = Vec::new();
    let mut last_of = BTreeMap::new();
    for row in rows {
        let columns = [row.low[0], row.high[0]].map(|column| column as u32);
        match last_of
            .get(&columns)
            .map(|&index: &usize| &mut stacks[index])
        {
            Some(stack) if stack.high[1] == row.low[1] => stack.high[1] = row.high[1],
            _ => {
                last_of.insert(columns, stacks.len());
                stacks.push(row);
            }
        }
    }
    stacks
}

struct Worker<'a> {
    near: &'a NearMirror<'a>,
    /// The chart with its light told by the finest polynomials that there are, and all of it white.
    chart: &'a GlossyChart<'a>,
    white: GlossyChart<'a>,
    /// White, with coarser polynomials that may not be good enough.
    coarser: Option<GlossyChart<'a>>,
    mirror: Mirror<'a>,
    /// Columns and rows of patches.
    counts: [f64; 2],
    /// Blurs beyond which an edge does not show.
    reach: f64,
    corner_points: CornerPoints,
}

impl<'a> Worker<'a> {
    fn new(near: &'a NearMirror<'a>) -> Self {
        let plane = near.chart.plane;
        let chart = near.finer.unwrap_or(near.chart);
        Self {
            near,
            chart,
            white: chart.white(),
            coarser: near.finer.map(|_| near.chart.white()),
            mirror: Mirror::new(near.view, plane, near.chart.reflectance),
            counts: [plane.columns, plane.rows].map(f64::from),
            reach: budget::reach(near.accuracy.absolute),
            corner_points: if near.view.budget.is_coarse {
                CornerPoints::COARSE
            } else {
                CornerPoints::FINE
            },
        }
    }

    /// What shows on the pixels of a row.
    fn find(&self, row: u32, columns: Range<u32>) -> Vec<Found> {
        columns
            .map(|column| self.pixel((column, row)).unwrap_or(Found::Left))
            .collect()
    }

    fn pixel(&self, at: (u32, u32)) -> Option<Found> {
        let sample = &self.near.view.sample;
        let part = match sample.cut_pixel(at) {
            Some(cut) if cut.area > 0.0 => Some(cut.part),
            None if sample.inside(at.1).contains(&at.0) => None,
            _ => return Some(Found::Dark),
        };
        let film_point = [at.0, at.1].map(|index| f64::from(index) + 0.5);
        let position = self.mirror.at(film_point)?;
        let gradient = self.mirror.gradient(film_point, position);
        let blur = self.mirror.blur(film_point, position)?;
        let along = |axis| {
            let place = (film_point, position, gradient);
            let axis = (axis, self.counts[axis]);
            Along::new(&self.mirror, place, &blur, axis, self.reach)
        };
        let along = [along(0)?, along(1)?];
        if along.iter().any(Along::is_dark) {
            return Some(Found::Dark);
        }
        Some(Found::Lit(Box::new(Pixel {
            at,
            middle: [0, 1].map(|axis| position[axis] + blur.shift[axis]),
            gradient,
            correlation: blur.correlation,
            along,
            part,
        })))
    }

    /// The chart's light off the sample at a film point, and evaluations.
    fn off(
        &self,
        chart: &GlossyChart<'_>,
        film_point: [f64; 2],
        tolerance: Tolerance,
        scratch: &mut glossy::Scratch,
    ) -> ([f64; 3], u64) {
        let (position, wo) = self.near.view.sample_point(film_point);
        let (light, evaluations) = chart.reflected(position, wo, tolerance, scratch);
        (light, u64::from(evaluations))
    }

    /// White light on all patches that show.
    fn white(&self, pixels: &[(u32, Vec<Found>)]) -> Counted<WhiteChart> {
        let lit = pixels.iter().flat_map(|(_, pixels)| pixels);
        let patches: BTreeSet<_> = lit
            .filter_map(|found| match found {
                Found::Lit(pixel) => Some(self.patch(pixel.middle)),
                _ => None,
            })
            .collect();
        let patches: Vec<_> = patches.into_iter().collect();
        let told = parallel::map(
            &patches,
            budget::EVALUATIONS_A_ROW,
            |scratch, &patch| self.told(patch, scratch),
            |told| told.evaluations,
        );
        let evaluations = told.iter().map(|told| told.evaluations).sum();
        let told = patches.into_iter().zip(told);
        Counted {
            of: told
                .filter_map(|(patch, told)| Some((patch, told.of?)))
                .collect(),
            evaluations,
        }
    }

    /// The patch in which a position lies, or that is nearest to it.
    fn patch(&self, position: [f64; 2]) -> (u32, u32) {
        let [column, row] =
            [0, 1].map(|axis| position[axis].clamp(0.0, self.counts[axis] - 1.0) as u32);
        (column, row)
    }

    /// White light on a patch, on as few cells as tell it; `None` where no film point leads to some of it.
    fn told(
        &self,
        patch: (u32, u32),
        scratch: &mut glossy::Scratch,
    ) -> Counted<Option<WhitePatch>> {
        let mut evaluations = 0;
        let mut light = |film_point, tolerance: Tolerance, is_looked_at: bool| {
            let mut off = |chart, tolerance| {
                let (light, took) = self.off(chart, film_point, tolerance, scratch);
                evaluations += took;
                light
            };
            let value = off(&self.white, tolerance);
            let (mut by_rule, mut of_chart) = (0.0, 0.0);
            if is_looked_at {
                by_rule = largest_difference(value, off(&self.white, tolerance.finer()));
                if let Some(coarser) = &self.coarser {
                    let coarse = off(coarser, tolerance);
                    of_chart = budget::FINER_SHARE * largest_difference(value, coarse);
                }
            }
            WhiteLight {
                value,
                by_rule,
                of_chart,
            }
        };
        let is_told = |brightest, missed| {
            missed <= budget::WHITE_SHARE * target(self.near.accuracy, [brightest; 3])
        };
        let of = self.ends(patch).and_then(|ends| {
            WhitePatch::new(&self.mirror, ends, self.near.tolerance, is_told, &mut light)
        });
        Counted { of, evaluations }
    }

    /// Where a patch begins and ends along each axis, without what is so near to the chart's ends that white light is
    /// less there, but for no more than a third of it.
    fn ends(&self, (column, row): (u32, u32)) -> Option<[[f64; 2]; 2]> {
        let mut margins = [0.0f64; 2];
        for [right, up] in [[0, 0], [1, 0], [0, 1], [1, 1]] {
            let position = [column + right, row + up].map(f64::from);
            let blur = self
                .mirror
                .blur(self.mirror.film_point(position)?, position)?;
            for (margin, width) in margins.iter_mut().zip(blur.widths) {
                *margin = margin.max((self.reach * width).min(1.0 / 3.0));
            }
        }
        Some([0, 1].map(|axis| {
            let low = f64::from([column, row][axis]);
            let (margin, count) = (margins[axis], self.counts[axis]);
            [low.max(margin), (low + 1.0).min(count - margin)]
        }))
    }

    /// White light on the patch about a pixel.
    fn white_patch<'c>(&self, pixel: &Pixel, white: &'c WhiteChart) -> Option<&'c WhitePatch> {
        white.get(&self.patch(pixel.middle))
    }

    /// The first pixel of each stretch that is not a corner.
    fn first_of_stretches(&self, pixels: &[(u32, Vec<Found>)]) -> BTreeMap<Place, (u32, u32)> {
        let mut firsts = BTreeMap::new();
        for found in pixels.iter().flat_map(|(_, pixels)| pixels) {
            let Found::Lit(pixel) = found else { continue };
            if !pixel.has_corners() {
                for stretch in self.stretches(pixel) {
                    firsts.entry(stretch).or_insert(pixel.at);
                }
            }
        }
        firsts
    }

    /// What the pixels of a row are off by along the edges on them, as far as that is looked at.
    fn look(
        &self,
        pixels: &[Found],
        firsts: &BTreeMap<Place, (u32, u32)>,
        white: &WhiteChart,
        scratch: &mut glossy::Scratch,
    ) -> Counted<Vec<(Place, Off)>> {
        let (mut looks, mut evaluations) = (Vec::new(), 0);
        for found in pixels {
            let Found::Lit(pixel) = found else { continue };
            let stretches = self.stretches(pixel);
            let is_first = |stretch| firsts.get(stretch) == Some(&pixel.at);
            let is_looked_at = stretches.len() > 1
                || (pixel.at.0 + pixel.at.1).is_multiple_of(budget::LOOKS)
                || stretches.iter().any(is_first);
            let Some(patch) = self.white_patch(pixel, white).filter(|_| is_looked_at) else {
                continue;
            };
            let mut off = |u| {
                let film_point = pixel.film_point(u);
                let (light, took) = self.off(self.chart, film_point, patch.tolerance, scratch);
                evaluations += took;
                let told = self.at(pixel, patch.cell(pixel.middle), u);
                [0, 1, 2].map(|channel| light[channel] - told[channel])
            };
            if pixel.has_corners() {
                let off: Vec<_> = pixel.corners().map(off).collect();
                looks.push((Place::Corner(pixel.at.0, pixel.at.1), Off::at_points(&off)));
                continue;
            }
            let edges = pixel.along.iter().flat_map(|along| &along.edges);
            for (edge, stretch) in edges.zip(stretches) {
                let off = if edge.is_narrow() {
                    Off::across(&edge.across().map(&mut off))
                } else {
                    Off::at_points(
                        &[0.0, edge.distance.signum()].map(|below| off(edge.foot(below))),
                    )
                };
                looks.push((stretch, off));
            }
        }
        Counted {
            of: looks,
            evaluations,
        }
    }

    /// The stretches of edges on a pixel.
    fn stretches(&self, pixel: &Pixel) -> Vec<Place> {
        let (column, row) = self.patch(pixel.middle);
        let mut stretches = Vec::new();
        for ((axis, along), beside) in pixel.along.iter().enumerate().zip([row, column]) {
            let last = along.first + along.edges.len() as u32;
            stretches.extend((along.first..last).map(|edge| Place::Stretch(axis, edge, beside)));
        }
        stretches
    }

    /// The chart's light at a point of a pixel, by what the pixel's value is worked out with.
    fn at(&self, pixel: &Pixel, cell: &Cell, u: [f64; 2]) -> [f64; 3] {
        let white = cell.at(pixel.position(u));
        let mut light = [0.0; 3];
        for (patch, share) in pixel.patches().zip(pixel.shares_at(u)) {
            let colour = self.colour(patch);
            for channel in 0..3 {
                light[channel] += colour[channel] * share * white[channel];
            }
        }
        light
    }

    fn colour(&self, patch: Option<(u32, u32)>) -> [f64; 3] {
        patch.map_or([0.0; 3], |(column, row)| self.chart.colour(column, row))
    }

    /// What a pixel comes to; `None` where that is not known.
    fn value(&self, pixel: &Pixel, white: &WhiteChart, looks: &Looks) -> Option<Value> {
        let cell = self.white_patch(pixel, white)?.cell(pixel.middle);
        let off = looks.off(pixel, &self.stretches(pixel), self.reach)?;
        let light = White::over(pixel, cell);
        let (mut value, mut palest) = ([0.0; 3], 0.0f64);
        for (patch, means) in pixel
            .patches()
            .zip(pixel.shares(self.near.view.instructions, self.corner_points)?)
        {
            let colour = self.colour(patch);
            palest = colour.into_iter().fold(palest, f64::max);
            for channel in 0..3 {
                value[channel] += colour[channel]
                    * (light.mean[channel] * means.share
                        + light.slope[0][channel] * means.first[0]
                        + light.slope[1][channel] * means.first[1]);
            }
        }
        let brightest = light.mean.into_iter().fold(0.0, f64::max);
        let tail = brightest * budget::tail(self.reach);
        let summed = if pixel.is_summed() {
            brightest * self.corner_points.off
        } else {
            0.0
        };
        // Of a whole pixel without an edge the mean is a parabola's.
        let is_even = pixel.part.is_none() && !pixel.has_edges();
        let bend = if is_even {
            0.0
        } else {
            budget::BEND * light.bend
        };
        // What is missed of white light shows times the patches' reflectance.
        let of_white = TILING.doubt * (cell.missed + bend) + summed + tail;
        let area = pixel.area();
        Some(Value {
            value,
            missed: area * (TILING.doubt * off + palest * of_white + self.near.missed),
            function_error: self.near.function_error.over(area, value),
        })
    }

    /// Adds a pixel if it misses no more than it may, and tells whether it does.
    fn keep(&self, canvas: &mut Canvas<'_>, at: (u32, u32), value: &Value) -> bool {
        let before = canvas.value(at);
        let lit = before.into_iter().zip(value.value);
        let brightest = lit
            .map(|(before, value)| before + value)
            .fold(0.0, f64::max);
        // The accuracy is what is left beside the error of the light on the chart.
        let allowed = target(self.near.accuracy, [brightest; 3]);
        let is_met = value.value.iter().all(|channel| channel.is_finite())
            && value.missed <= (TILING.doubt + TILING.beside) * allowed;
        if is_met {
            canvas.add(at, value.value, value.missed + value.function_error);
        }
        is_met
    }
}

/// White light over a pixel.
struct White {
    mean: [f64; 3],
    /// For a pixel along columns and along rows.
    slope: [[f64; 3]; 2],
    /// What a parabola makes of the mean beside a straight line.
    bend: f64,
}

impl White {
    fn over(pixel: &Pixel, cell: &Cell) -> Self {
        let at = |u| cell.at(pixel.position(u));
        let middle = at([0.0; 2]);
        let mut white = Self {
            mean: middle,
            slope: [[0.0; 3]; 2],
            bend: 0.0,
        };
        for axis in 0..2 {
            let [before, after] = [-0.5, 0.5].map(|half| {
                let mut u = [0.0; 2];
                u[axis] = half;
                at(u)
            });
            let mut bend = 0.0f64;
            for channel in 0..3 {
                white.slope[axis][channel] = after[channel] - before[channel];
                let second = before[channel] + after[channel] - 2.0 * middle[channel];
                white.mean[channel] += second / 6.0;
                bend = bend.max(second.abs() / 6.0);
            }
            white.bend += bend;
        }
        white
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The pixels of parts of the film, each as often as it stands in them.
    fn pixels_of(parts: &[Rectangle]) -> Vec<(u32, u32)> {
        let mut pixels: Vec<_> = parts.iter().flat_map(Rectangle::pixels).collect();
        pixels.sort_unstable();
        pixels
    }

    #[test]
    fn what_is_left_is_stacked_and_none_of_it_lost_or_doubled() {
        let (mut rows, mut left) = (Vec::new(), Vec::new());
        for row in 0..12 {
            for column in 0..9 {
                // A column two pixels wide with a gap, a slanted edge, and a row.
                let is_upright = column < 2 && row != 5;
                if is_upright || column == 3 + row / 3 || row == 8 {
                    push(&mut rows, column, row);
                    left.push((column, row));
                }
            }
        }
        left.sort_unstable();
        assert_eq!(pixels_of(&rows), left);
        let stacks = stacked(rows.clone());
        assert_eq!(pixels_of(&stacks), left);
        assert!(
            stacks.len() < rows.len() / 2,
            "{} of {}",
            stacks.len(),
            rows.len()
        );
    }
}

//! Products of Chebyshev series on rectangles.

use super::batch::LANES;
use super::channels::add_scaled;
use super::instructions::{Instructions, kernel};
use super::polygon::{OF_DEGREE_3, Polygon, Rectangle};
use std::f64::consts::PI;
use std::ops::Range;

/// The last terms along a side, by which what the series leaves out is judged.
pub const TAIL: usize = 2;

/// What it leaves out is less than this share of them, as coefficients fall from term to term: the
/// true error of 95 pixels in 100 stays below half of what this gives.
const LEFT_OUT: f64 = 0.4;

/// Over a part of a tile whose sides are this many times shorter a rule of degree 3 serves. Derived: it misses at
/// most (2 / 10)^4 / 4320 times the fourth derivative of a term, a seventieth of the last coefficient and less than
/// a ten thousandth of the fourth.
const SMALL_PART: f64 = 10.0;

/// As many points as most polygons have in a rule of degree 3.
const POINTS_USUAL: usize = 16;

/// A function of the film on a rectangle, in each channel the sum of `coefficients[j][i]` T_i along
/// columns times T_j along rows.
#[derive(Clone, Debug)]
pub struct Tile<const TERMS: usize> {
    /// Where.
    pub rectangle: Rectangle,
    coefficients: [[[f64; 3]; TERMS]; TERMS],
}

/// What the fit of a tile tells of it.
#[derive(Clone, Copy, Debug)]
pub struct Fit {
    /// A bound of the interpolation error, from the sizes of the last coefficients.
    pub error: f64,
    /// The part of it along columns and along rows.
    pub tails: [f64; 2],
    /// The least over the nodes of the largest channel.
    pub least: f64,
}

/// Chebyshev's points, and the series through values at them.
#[derive(Clone, Debug)]
pub struct Nodes<const TERMS: usize> {
    /// The points on [-1, 1].
    pub points: [f64; TERMS],
    /// Coefficients from values at the points.
    transform: [[f64; TERMS]; TERMS],
}

impl<const TERMS: usize> Nodes<TERMS> {
    /// The points and their series.
    pub fn new() -> Self {
        let count = TERMS as f64;
        // cos(pi k / (2 n)) serves all of them: angles are odd multiples of pi / (2 n).
        let cosine = |multiple: usize| libm::cos(0.5 * PI * multiple as f64 / count);
        Self {
            points: std::array::from_fn(|k| cosine(2 * k + 1)),
            transform: std::array::from_fn(|i| {
                let scale = if i == 0 { 1.0 } else { 2.0 } / count;
                std::array::from_fn(|k| scale * cosine(i * (2 * k + 1)))
            }),
        }
    }

    /// The nodes of a rectangle, row by row.
    pub fn on(&self, rectangle: &Rectangle) -> impl Iterator<Item = [f64; 2]> + use<TERMS> {
        let (Rectangle { low, high }, points) = (*rectangle, self.points);
        let at = move |axis: usize, point: f64| {
            0.5 * (low[axis] + high[axis]) + 0.5 * (high[axis] - low[axis]) * point
        };
        points
            .into_iter()
            .flat_map(move |y| points.map(|x| [at(0, x), at(1, y)]))
    }

    /// The coefficients, `[j][i]` those of T_i along columns times T_j along rows, from values at the nodes.
    pub fn coefficients<const N: usize>(
        &self,
        values: &[[[f64; N]; TERMS]; TERMS],
    ) -> [[[f64; N]; TERMS]; TERMS] {
        let mut lines = [[[0.0; N]; TERMS]; TERMS];
        for (into, from) in lines.iter_mut().zip(values) {
            for (sum, transform) in into.iter_mut().zip(&self.transform) {
                for (value, factor) in from.iter().zip(transform) {
                    add_scaled(sum, *value, *factor);
                }
            }
        }
        let mut coefficients = [[[0.0; N]; TERMS]; TERMS];
        for (into, transform) in coefficients.iter_mut().zip(&self.transform) {
            for (from, factor) in lines.iter().zip(transform) {
                for (sum, value) in into.iter_mut().zip(from) {
                    add_scaled(sum, *value, *factor);
                }
            }
        }
        coefficients
    }
}

/// What the series of one part of a function leaves out, by the sizes of its last coefficients. Adds
/// those along columns and along rows to `tails`.
pub fn left_out<const N: usize, const TERMS: usize>(
    coefficients: &[[[f64; N]; TERMS]; TERMS],
    part: usize,
    tails: &mut [f64; 2],
) -> f64 {
    let mut error = 0.0;
    for (j, line) in coefficients.iter().enumerate() {
        for (i, coefficient) in line.iter().enumerate() {
            let size = coefficient[part].abs();
            let last = [i, j].map(|index| index >= TERMS - TAIL);
            for (tail, last) in tails.iter_mut().zip(last) {
                *tail += if last { size } else { 0.0 };
            }
            error += if last[0] || last[1] { size } else { 0.0 };
        }
    }
    LEFT_OUT * error
}

/// The points of a rectangle at which a function of three channels has to be known, and its series
/// from there.
#[derive(Clone, Debug)]
pub struct Basis<const TERMS: usize>(Nodes<TERMS>);

impl<const TERMS: usize> Basis<TERMS> {
    /// The basis.
    pub fn new() -> Self {
        Self(Nodes::new())
    }

    /// The nodes of a rectangle, row by row.
    pub fn nodes(&self, rectangle: &Rectangle) -> impl Iterator<Item = [f64; 2]> + use<TERMS> {
        self.0.on(rectangle)
    }

    /// What a series through the values on a row or a column of nodes leaves out, where its last
    /// polynomials are as large as this: part of what a fit of all nodes finds.
    pub fn line_left_out(&self, line: &[[f64; 3]; TERMS], sizes: [f64; TAIL]) -> f64 {
        let mut sums = [0.0; 3];
        for (transform, size) in self.0.transform[TERMS - TAIL..].iter().zip(sizes) {
            let mut coefficient = [0.0; 3];
            for (value, factor) in line.iter().zip(transform) {
                add_scaled(&mut coefficient, *value, *factor);
            }
            add_scaled(&mut sums, coefficient.map(f64::abs), LEFT_OUT * size);
        }
        sums[0].max(sums[1]).max(sums[2])
    }

    /// The coordinates of a rectangle's nodes along an axis, in the order of [`Basis::nodes`].
    pub fn along(&self, rectangle: &Rectangle, axis: usize) -> [f64; TERMS] {
        let (low, side) = (rectangle.low[axis], rectangle.sides()[axis]);
        self.0.points.map(|point| low + 0.5 * side * (1.0 + point))
    }

    /// Interpolates a function of these values at [`Basis::nodes`].
    pub fn fit(
        &self,
        rectangle: Rectangle,
        at_nodes: impl Iterator<Item = [f64; 3]>,
    ) -> (Tile<TERMS>, Fit) {
        let mut values = [[[0.0; 3]; TERMS]; TERMS];
        let mut least = f64::INFINITY;
        for (node, value) in values.iter_mut().flatten().zip(at_nodes) {
            *node = value;
            let brightest = value[0].max(value[1]).max(value[2]);
            least = least.min(brightest);
        }
        let coefficients = self.0.coefficients(&values);
        let (mut error, mut tails) = (0.0f64, [0.0; 2]);
        for channel in 0..3 {
            error = error.max(left_out(&coefficients, channel, &mut tails));
        }
        let fit = Fit {
            error,
            tails,
            least,
        };
        (
            Tile {
                rectangle,
                coefficients,
            },
            fit,
        )
    }
}

/// The integrals of a tile over all cells of a grid, worked out a row and a column at a time.
pub struct CellIntegrals<const TERMS: usize> {
    /// For each row, the integral along it of the series of each polynomial along columns.
    rows: Vec<[[f64; 3]; TERMS]>,
    /// For each column, the integrals along it of the polynomials: columns in blocks, the last filled up with zeros.
    columns: Vec<[[f64; LANES]; TERMS]>,
    scale: f64,
}

impl<const TERMS: usize> CellIntegrals<TERMS> {
    /// The integrals over the cells in some columns of a row of the grid: [`Tile::integral`], to the bit.
    pub fn in_row<'a>(
        &self,
        instructions: Instructions,
        row: usize,
        columns: Range<usize>,
        buffer: &'a mut Vec<[f64; 3]>,
    ) -> &'a [[f64; 3]] {
        let blocks = columns.start / LANES..columns.end.div_ceil(LANES);
        let before = LANES * blocks.start;
        buffer.clear();
        buffer.resize(LANES * blocks.len(), [0.0; 3]);
        contract_blocks(
            instructions,
            &self.rows[row],
            &self.columns[blocks],
            self.scale,
            buffer.as_chunks_mut::<LANES>().0,
        );
        &buffer[columns.start - before..columns.end - before]
    }
}

impl<const TERMS: usize> Tile<TERMS> {
    /// The integrals over the cells between neighbours of `columns` and `rows`, edges that lie
    /// inside the tile, in rising order.
    pub fn cell_integrals(&self, columns: &[f64], rows: &[f64]) -> CellIntegrals<TERMS> {
        let [width, height] = self.rectangle.sides();
        let along = |axis: usize, edges: &[f64]| -> Vec<[f64; TERMS]> {
            let at_edges: Vec<[f64; TERMS]> = edges
                .iter()
                .map(|&edge| antiderivatives(self.rectangle.local(axis, edge)))
                .collect();
            at_edges
                .windows(2)
                .map(|pair| std::array::from_fn(|i| pair[1][i] - pair[0][i]))
                .collect()
        };
        let rows = along(1, rows);
        let columns = along(0, columns);
        let in_block = |columns: &[[f64; TERMS]]| {
            std::array::from_fn(|term| {
                std::array::from_fn(|lane| columns.get(lane).map_or(0.0, |column| column[term]))
            })
        };
        CellIntegrals {
            rows: rows.iter().map(|y| self.contract_rows(y)).collect(),
            columns: columns.chunks(LANES).map(in_block).collect(),
            scale: 0.25 * width * height,
        }
    }

    /// What the series leaves out of the mean over a cell between neighbours of `columns` and `rows`, edges
    /// inside the tile in rising order: at most, by the sizes of the last coefficients.
    pub fn left_out_of_means(&self, columns: &[f64], rows: &[f64]) -> f64 {
        let [columns, rows] = [(0, columns), (1, rows)]
            .map(|(axis, edges)| means::<TERMS>(&self.rectangle, axis, edges));
        let largest: [f64; TERMS] =
            std::array::from_fn(|i| columns.iter().map(|x| x[i]).fold(0.0, f64::max));
        let mut most = 0.0f64;
        for y in &rows {
            let mut lines = [[0.0; 3]; TERMS];
            for (j, (line, y)) in self.coefficients.iter().zip(y).enumerate() {
                let first = if j >= TERMS - TAIL { 0 } else { TERMS - TAIL };
                for (sum, coefficient) in lines.iter_mut().zip(line).skip(first) {
                    add_scaled(sum, coefficient.map(f64::abs), *y);
                }
            }
            let left_out = |x: &[f64; TERMS]| {
                let [r, g, b] = contract_line(&lines, x);
                r.max(g).max(b)
            };
            // Most rows need no look at their cells: none leaves out more than one with the largest means of all.
            if left_out(&largest) > most {
                most = columns.iter().map(left_out).fold(most, f64::max);
            }
        }
        LEFT_OUT * most
    }

    /// The part of a difference found at a point that is left in the mean over a pixel's part of the tile. What a
    /// series misses changes its sign from node to node, so a mean over n gaps between nodes keeps the root of
    /// 1/n of it.
    pub fn kept_in_means(&self) -> f64 {
        let gaps = |side: f64| (TERMS as f64 * (1.0 / side).min(1.0)).max(1.0);
        let [columns, rows] = self.rectangle.sides().map(gaps);
        1.0 / (columns * rows).sqrt()
    }

    /// The integral over a rectangle inside the tile, in square pixels.
    pub fn integral(&self, cell: &Rectangle) -> [f64; 3] {
        let [width, height] = self.rectangle.sides();
        let factors: [[f64; TERMS]; 2] = std::array::from_fn(|axis| {
            integrals(
                self.rectangle.local(axis, cell.low[axis]),
                self.rectangle.local(axis, cell.high[axis]),
            )
        });
        self.contract(&factors[0], &factors[1])
            .map(|value| 0.25 * width * height * value)
    }

    /// The integral over a polygon inside the tile, and the polygon's area.
    pub fn integral_over(&self, polygon: &Polygon, instructions: Instructions) -> ([f64; 3], f64) {
        let (mut points, mut area) = (Vec::with_capacity(POINTS_USUAL), 0.0);
        let add = |at: [f64; 2], weight: f64| {
            let local = [0, 1].map(|axis| self.rectangle.local(axis, at[axis]));
            points.push((local, weight));
            area += weight;
        };
        let [whole, part] = [self.rectangle, polygon.bounds()].map(|rectangle| rectangle.sides());
        if (0..2).all(|axis| part[axis] * SMALL_PART <= whole[axis]) {
            polygon.for_each_point_of(&OF_DEGREE_3, add);
        } else {
            polygon.for_each_point(add);
        }
        let mut moments = [[0.0; TERMS]; TERMS];
        add_moments(instructions, &points, &mut moments);
        let mut sum = [0.0; 3];
        for (line, moments) in self.coefficients.iter().zip(&moments) {
            for (coefficient, moment) in line.iter().zip(moments) {
                add_scaled(&mut sum, *coefficient, *moment);
            }
        }
        (sum, area)
    }

    /// By how much the mean over a convex part with such sides may differ from the value at its centroid, at most.
    ///
    /// Of a convex part no coordinate has a larger variance than of a rectangle, a twelfth of its side's square, and no
    /// |T_n| has a larger slope than n^2 nor a larger second derivative than n^2 (n^2 - 1) / 3.
    pub fn off_at_centroids(&self, sides: [f64; 2]) -> f64 {
        let whole = self.rectangle.sides();
        let [across, along] = [0, 1].map(|axis| 2.0 * sides[axis] / whole[axis]);
        let square = |n: usize| (n * n) as f64;
        let bend = |n: usize| square(n) * (square(n) - 1.0) / 3.0;
        let mut sums = [0.0; 3];
        for (j, line) in self.coefficients.iter().enumerate() {
            for (i, coefficient) in line.iter().enumerate() {
                let factor = across * across * bend(i)
                    + 2.0 * across * along * square(i) * square(j)
                    + along * along * bend(j);
                add_scaled(&mut sums, coefficient.map(f64::abs), factor / 24.0);
            }
        }
        sums[0].max(sums[1]).max(sums[2])
    }

    /// The value at a polygon's centroid times its area, and the area: nearly [`Tile::integral_over`] of a small one.
    pub fn at_centroid(&self, polygon: &Polygon) -> ([f64; 3], f64) {
        let (centroid, area) = polygon.centroid();
        (self.value(centroid).map(|value| area * value), area)
    }

    /// The value at a point.
    pub fn value(&self, at: [f64; 2]) -> [f64; 3] {
        let factors: [[f64; TERMS]; 2] =
            std::array::from_fn(|axis| values(self.rectangle.local(axis, at[axis])));
        self.contract(&factors[0], &factors[1])
    }

    /// The same with further terms, all zero.
    pub fn widened<const MORE: usize>(&self) -> Tile<MORE> {
        const { assert!(MORE >= TERMS, "terms would be lost") };
        let mut coefficients = [[[0.0; 3]; MORE]; MORE];
        for (into, from) in coefficients.iter_mut().zip(&self.coefficients) {
            into[..TERMS].copy_from_slice(from);
        }
        Tile {
            rectangle: self.rectangle,
            coefficients,
        }
    }

    fn contract(&self, x: &[f64; TERMS], y: &[f64; TERMS]) -> [f64; 3] {
        contract_line(&self.contract_rows(y), x)
    }

    /// The series along columns where the polynomials along rows have these values. The compiler makes
    /// vectors of whole lines.
    fn contract_rows(&self, y: &[f64; TERMS]) -> [[f64; 3]; TERMS] {
        let mut sums = [[0.0; 3]; TERMS];
        for (line, y) in self.coefficients.iter().zip(y) {
            let values = line.as_flattened().iter();
            for (sum, value) in sums.as_flattened_mut().iter_mut().zip(values) {
                *sum += value * y;
            }
        }
        sums
    }
}

kernel! {
    /// Adds the sums over points of their weights times the products of polynomials there.
    pub fn add_moments<const TERMS: usize>(
        points: &[([f64; 2], f64)],
        moments: &mut [[f64; TERMS]; TERMS],
    ) {
        for (at, weight) in points {
            let [x, y]: [[f64; TERMS]; 2] = at.map(values);
            for (moments, y) in moments.iter_mut().zip(&y) {
                let weight = weight * y;
                for (moment, x) in moments.iter_mut().zip(&x) {
                    *moment += weight * x;
                }
            }
        }
    }
}

kernel! {
    /// `scale` times [`contract_line`] for blocks of columns.
    pub fn contract_blocks<const TERMS: usize>(
        line: &[[f64; 3]; TERMS],
        columns: &[[[f64; LANES]; TERMS]],
        scale: f64,
        values: &mut [[[f64; 3]; LANES]],
    ) {
        for (columns, values) in columns.iter().zip(values) {
            let mut sums = [[0.0; LANES]; 3];
            for (coefficient, columns) in line.iter().zip(columns) {
                for (sum, coefficient) in sums.iter_mut().zip(coefficient) {
                    for (sum, x) in sum.iter_mut().zip(columns) {
                        *sum += coefficient * x;
                    }
                }
            }
            for (lane, value) in values.iter_mut().enumerate() {
                *value = [0, 1, 2].map(|channel| scale * sums[channel][lane]);
            }
        }
    }
}

fn contract_line<const TERMS: usize>(line: &[[f64; 3]; TERMS], x: &[f64; TERMS]) -> [f64; 3] {
    let mut sum = [0.0; 3];
    for (coefficient, x) in line.iter().zip(x) {
        add_scaled(&mut sum, *coefficient, *x);
    }
    sum
}

/// How large the means of T_0, T_1, ... between neighbouring edges along an axis of a tile are.
fn means<const TERMS: usize>(tile: &Rectangle, axis: usize, edges: &[f64]) -> Vec<[f64; TERMS]> {
    // An edge is the end of one cell and the beginning of the next.
    let local = edges.iter().map(|&edge| {
        let at = tile.local(axis, edge);
        (at, antiderivatives::<TERMS>(at))
    });
    let local: Vec<(f64, [f64; TERMS])> = local.collect();
    let means = local.windows(2).map(|pair| {
        let [(low, below), (high, above)] = [pair[0], pair[1]];
        let per_length = 1.0 / (high - low);
        std::array::from_fn(|i| (per_length * (above[i] - below[i])).abs())
    });
    means.collect()
}

/// How large means of the last polynomials of a tile between neighbouring edges along an axis are at most.
pub fn largest_means<const TERMS: usize>(
    tile: &Rectangle,
    axis: usize,
    edges: &[f64],
) -> [f64; TAIL] {
    let mut largest = [0.0f64; TAIL];
    for mean in means::<TERMS>(tile, axis, edges) {
        for (largest, mean) in largest.iter_mut().zip(&mean[TERMS - TAIL..]) {
            *largest = largest.max(*mean);
        }
    }
    largest
}

/// T_0, T_1, ... at x.
pub fn values<const TERMS: usize>(x: f64) -> [f64; TERMS] {
    let mut values = [1.0; TERMS];
    values[1] = x;
    for i in 2..TERMS {
        values[i] = 2.0 * x * values[i - 1] - values[i - 2];
    }
    values
}

/// Their integrals from `low` to `high`.
fn integrals<const TERMS: usize>(low: f64, high: f64) -> [f64; TERMS] {
    let (low, high) = (
        antiderivatives::<TERMS>(low),
        antiderivatives::<TERMS>(high),
    );
    std::array::from_fn(|i| high[i] - low[i])
}

/// (T_(i+1)/(i+1) - T_(i-1)/(i-1))/2, the antiderivative of T_i from i = 2 on.
fn antiderivatives<const TERMS: usize>(x: f64) -> [f64; TERMS] {
    let chebyshev = values::<TERMS>(x);
    let last = 2.0 * x * chebyshev[TERMS - 1] - chebyshev[TERMS - 2];
    std::array::from_fn(|i| match i {
        0 => x,
        1 => 0.5 * x * x,
        _ => {
            let n = i as f64;
            let above = chebyshev.get(i + 1).copied().unwrap_or(last);
            0.5 * (above / (n + 1.0) - chebyshev[i - 1] / (n - 1.0))
        }
    })
}

#[cfg(test)]
mod tests;

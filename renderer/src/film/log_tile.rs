//! A positive function on a rectangle of the film: exp(G) times a tint, where G and the tint's
//! channels are products of Chebyshev series.
//!
//! A glossy lobe's tail falls by orders of magnitude over a few pixels while its logarithm is
//! nearly a parabola. So a tile of the logarithm spans what many tiles of the function would.

use crate::numerics::batch::LANES;
use crate::numerics::chebyshev::{self, Nodes, left_out};
use crate::numerics::elementary::exp;
use crate::numerics::gauss::GaussRule;
use crate::numerics::instructions::{Instructions, kernel};
use crate::numerics::polygon::{Polygon, Rectangle};

/// Terms of the series along each side of a tile.
pub const TERMS: usize = 10;

/// The logarithm and the three channels of the tint.
const PARTS: usize = 4;

/// The most Gauss points along a side of a pixel.
pub const POINTS_MAX: usize = 12;

/// Above this the logarithm is cut: far above any radiance, far below what overflows.
pub const LOG_MAX: f64 = 300.0;

/// The value of a positive function by its logarithm: exp(`log`) `tint`.
#[derive(Clone, Copy, Debug)]
pub struct TintedLog {
    /// The logarithm of the part that all channels share.
    pub log: f64,
    /// What each channel multiplies it by, 0 to 1.
    pub tint: [f64; 3],
}

/// A function on a rectangle: `coefficients[part][j][i]` times T_i along columns times T_j along
/// rows.
pub struct LogTile {
    rectangle: Rectangle,
    coefficients: [[[f64; TERMS]; TERMS]; PARTS],
}

/// What the fit of a tile tells of it.
#[derive(Clone, Copy, Debug)]
pub struct LogFit {
    /// A bound of the relative error of the largest channel, as far as the series goes.
    pub error: f64,
    /// The part of it along columns and along rows.
    pub tails: [f64; 2],
    /// A bound of the function.
    pub most: f64,
    /// How much the logarithm changes along columns and along rows, a pixel.
    pub slopes: [f64; 2],
    /// How much that slope changes, a pixel.
    pub curvatures: [f64; 2],
}

/// The nodes of a tile and the series through values at them.
pub struct LogBasis(Nodes<TERMS>);

impl LogBasis {
    /// The basis.
    pub fn new() -> Self {
        Self(Nodes::new())
    }

    /// The nodes of a rectangle, row by row.
    pub fn nodes(&self, rectangle: &Rectangle) -> impl Iterator<Item = [f64; 2]> + use<> {
        self.0.on(rectangle)
    }

    /// Interpolates a function of these values at [`LogBasis::nodes`].
    pub fn fit(
        &self,
        rectangle: Rectangle,
        at_nodes: impl Iterator<Item = TintedLog>,
    ) -> (LogTile, LogFit) {
        let mut values = [[[0.0; PARTS]; TERMS]; TERMS];
        let (mut brightest, mut faintest, mut highest) = (0.0f64, 1.0f64, f64::NEG_INFINITY);
        for (node, TintedLog { log, tint }) in values.iter_mut().flatten().zip(at_nodes) {
            *node = [log, tint[0], tint[1], tint[2]];
            let largest = tint[0].max(tint[1]).max(tint[2]);
            (brightest, faintest) = (brightest.max(largest), faintest.min(largest));
            highest = highest.max(log);
        }
        let coefficients = self.0.coefficients(&values);
        let mut tails = [[0.0; 2]; PARTS];
        let left_out: [f64; PARTS] =
            std::array::from_fn(|part| left_out(&coefficients, part, &mut tails[part]));
        let tile = LogTile {
            rectangle,
            coefficients: std::array::from_fn(|part| {
                coefficients.map(|line| line.map(|parts| parts[part]))
            }),
        };
        let log_error = left_out[0];
        let [mut tails, tint_tails @ ..] = tails;
        let mut error = log_error;
        if brightest > 0.0 {
            let tint_error = left_out[1..].iter().copied().fold(0.0, f64::max);
            let faintest = faintest.max(f64::MIN_POSITIVE);
            error += tint_error / faintest;
            for [columns, rows] in tint_tails {
                tails[0] += columns / faintest;
                tails[1] += rows / faintest;
            }
        }
        let sides = rectangle.sides();
        let logs = values.map(|line| line.map(|parts| parts[0]));
        let steepest = [0, 1].map(|axis| self.steepest(&logs, axis));
        let fit = LogFit {
            error,
            tails,
            most: brightest * libm::exp((highest + log_error).min(LOG_MAX)),
            slopes: [0, 1].map(|axis| steepest[axis][0] * 2.0 / sides[axis]),
            curvatures: [0, 1].map(|axis| steepest[axis][1] * 4.0 / (sides[axis] * sides[axis])),
        };
        (tile, fit)
    }

    /// The steepest slope and the largest curvature between neighbouring nodes along an axis, on
    /// [-1, 1].
    fn steepest(&self, values: &[[f64; TERMS]; TERMS], axis: usize) -> [f64; 2] {
        let (mut steepest, mut bent) = (0.0f64, 0.0f64);
        for (other, line) in values.iter().enumerate() {
            let value = |k: usize| match axis {
                0 => line[k],
                _ => values[k][other],
            };
            let slope = |k: usize| {
                let step = self.0.points[k] - self.0.points[k - 1];
                (value(k) - value(k - 1)) / step
            };
            for k in 1..TERMS {
                steepest = steepest.max(slope(k).abs());
            }
            for k in 2..TERMS {
                let between = 0.5 * (self.0.points[k] - self.0.points[k - 2]).abs();
                bent = bent.max((slope(k) - slope(k - 1)).abs() / between);
            }
        }
        [steepest, bent]
    }
}

/// Gauss points along a pixel over which the logarithm of a function changes by `change`, for a
/// relative error of `tolerance`; `None` if more than [`POINTS_MAX`]. For exp(k x) the rule of n
/// points misses k^(2n) (n!)^4 / ((2n+1) ((2n)!)^3).
pub fn points_for_change(change: f64, tolerance: f64) -> Option<usize> {
    let mut missed = 1.0;
    for n in 1..=POINTS_MAX {
        let count = n as f64;
        let pair = 2.0 * count * (2.0 * count - 1.0);
        // From n - 1 to n, but for the factor of 2n + 1.
        missed *= change * change * count * count * count * count / (pair * pair * pair);
        if missed <= tolerance * (2.0 * count + 1.0) {
            return Some(n);
        }
    }
    None
}

kernel! {
    /// Adds a row of points to the sums of their columns: `weight` times the function. `lines`
    /// holds for each block of columns the coefficients along it of every part, `rows` the
    /// polynomials at the row.
    pub fn add_row(
        lines: &[[[f64; LANES]; PARTS * TERMS]],
        rows: &[f64; TERMS],
        weight: f64,
        sums: &mut [[[f64; LANES]; 3]],
    ) {
        for (lines, sums) in lines.iter().zip(sums) {
            let mut parts = [[0.0; LANES]; PARTS];
            // Lanes outside: with lanes inside, the compiler makes vectors of the terms of a lane, which it gathers.
            for i in 0..LANES {
                for part in 0..PARTS {
                    let mut sum = 0.0;
                    for term in 0..TERMS {
                        sum += lines[TERMS * part + term][i] * rows[term];
                    }
                    parts[part][i] = sum;
                }
            }
            for i in 0..LANES {
                let log = if parts[0][i] < LOG_MAX { parts[0][i] } else { LOG_MAX };
                let value = weight * exp(log);
                sums[0][i] += value * parts[1][i];
                sums[1][i] += value * parts[2][i];
                sums[2][i] += value * parts[3][i];
            }
        }
    }
}

/// Buffers for the integrals over a tile's pixels.
#[derive(Default)]
pub struct PixelSums {
    lines: Vec<[[f64; LANES]; PARTS * TERMS]>,
    sums: Vec<[[f64; LANES]; 3]>,
}

impl LogTile {
    /// Visits the pixels of the tile that meet `outline`, with the integral over what is covered:
    /// `points` Gauss points along columns and along rows.
    pub fn for_each_pixel(
        &self,
        outline: &Polygon,
        points: [usize; 2],
        instructions: Instructions,
        buffers: &mut PixelSums,
        mut visit: impl FnMut((u32, u32), [f64; 3]),
    ) {
        let rules = points.map(GaussRule::of);
        let edges = [0, 1].map(|axis| self.rectangle.pixel_edges(axis));
        let [column, row] = self.rectangle.low.map(|low| low.floor() as u32);
        self.contract_columns(&edges[0], rules[0], buffers);
        for (row, along) in (row..).zip(edges[1].windows(2)) {
            let (low, high) = (along[0], along[1]);
            let PixelSums { lines, sums } = &mut *buffers;
            sums.clear();
            sums.resize(lines.len(), [[0.0; LANES]; 3]);
            for (y, weight) in rules[1].on(low, high) {
                let rows = chebyshev::values::<TERMS>(self.rectangle.local(1, y));
                add_row(instructions, lines, &rows, weight, sums);
            }
            for (index, across) in edges[0].windows(2).enumerate() {
                let cell = Rectangle {
                    low: [across[0], low],
                    high: [across[1], high],
                };
                let pixel = (column + index as u32, row);
                if outline.contains(&cell) {
                    let weights = rules[0].on(across[0], across[1]);
                    let mut value = [0.0; 3];
                    for (at, (_, weight)) in (index * points[0]..).zip(weights) {
                        let sums = &sums[at / LANES];
                        for channel in 0..3 {
                            value[channel] += weight * sums[channel][at % LANES];
                        }
                    }
                    visit(pixel, value);
                } else {
                    let covered = outline.clipped(&cell);
                    if !covered.is_empty() {
                        visit(pixel, self.integral_over(&covered, rules));
                    }
                }
            }
        }
    }

    /// The coefficients along every column of points.
    fn contract_columns(&self, edges: &[f64], rule: &GaussRule, buffers: &mut PixelSums) {
        let lines = &mut buffers.lines;
        lines.clear();
        let nodes = edges.windows(2).flat_map(|pair| rule.on(pair[0], pair[1]));
        for (at, (x, _)) in nodes.enumerate() {
            if at % LANES == 0 {
                lines.push([[0.0; LANES]; PARTS * TERMS]);
            }
            let line = self.contracted(x);
            if let Some(block) = lines.last_mut() {
                for (lanes, value) in block.iter_mut().zip(line.as_flattened()) {
                    lanes[at % LANES] = *value;
                }
            }
        }
    }

    /// The coefficients along the column x.
    fn contracted(&self, x: f64) -> [[f64; TERMS]; PARTS] {
        let columns = chebyshev::values::<TERMS>(self.rectangle.local(0, x));
        self.coefficients.each_ref().map(|part| {
            part.each_ref().map(|line| {
                let mut sum = 0.0;
                for (coefficient, factor) in line.iter().zip(&columns) {
                    sum += coefficient * factor;
                }
                sum
            })
        })
    }

    /// The integral over a polygon inside a pixel, by chords between its corners' columns. The lengths of
    /// chords are linear between them: one more point than over a whole pixel takes that in.
    fn integral_over(&self, polygon: &Polygon, rules: [&GaussRule; 2]) -> [f64; 3] {
        let mut breaks: Vec<f64> = polygon.corners().iter().map(|corner| corner[0]).collect();
        breaks.sort_unstable_by(f64::total_cmp);
        let columns = GaussRule::of(rules[0].size() + 1);
        let mut sum = [0.0; 3];
        for pair in breaks.windows(2) {
            if pair[0] >= pair[1] {
                continue;
            }
            for (x, across) in columns.on(pair[0], pair[1]) {
                let Some([low, high]) = polygon.chord(0, x) else {
                    continue;
                };
                let line = self.contracted(x);
                for (y, along) in rules[1].on(low, high) {
                    let rows = chebyshev::values::<TERMS>(self.rectangle.local(1, y));
                    let parts = line.each_ref().map(|part| {
                        let mut sum = 0.0;
                        for (coefficient, factor) in part.iter().zip(&rows) {
                            sum += coefficient * factor;
                        }
                        sum
                    });
                    let value = across * along * exp(parts[0].min(LOG_MAX));
                    for channel in 0..3 {
                        sum[channel] += value * parts[channel + 1];
                    }
                }
            }
        }
        sum
    }
}

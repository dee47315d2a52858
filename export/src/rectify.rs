//! The sample warped to a square: the paper's homography (section 4.1, "Pre-processing").
//!
//! An output pixel is a cell of the sample, 1/N by 1/N; row 0 is at the top, v = 1. The filter is
//! exact: a film pixel holds the mean over its own square, so it stands for that square, whose
//! image on the sample is a quadrilateral, and its weight in a cell is the area that both share on
//! the sample. That is the film's measure times the homography's Jacobian, integrated in closed
//! form, so what is far and foreshortened counts for the area it shows, and nothing is sampled.
//!
//! Film pixels on the sample's edge see black beside it. Only a share of such a pixel, its
//! coverage, is the sample's, so weights are divided by the coverage that they meet: a constant
//! sample becomes a constant square up to its border. (Where other things than black stand
//! directly behind the sample, their light stays in the outermost cells.)

use dataset::Specification;
use thiserror::Error;

/// The largest square, in pixels a side.
pub const SIDE_PIXELS_MAX: u32 = 2048;

/// The share of a cell that the film has to see.
const SEEN_MIN: f64 = 1.0 - 1e-6;

/// Areas of film or cells, in their own units, below which an overlap is rounding.
const AREA_MIN: f64 = 1e-12;

/// Why a view cannot be rectified.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum RectifyError {
    /// The side is out of range.
    #[error("rectified images have 1 to {SIDE_PIXELS_MAX} pixels a side, not {0}")]
    Side(u32),
    /// There is no such view.
    #[error("there is no view {0}")]
    NoSuchView(u32),
    /// Part of the sample is off the film.
    #[error("view {0} cannot be rectified: its film does not see the whole sample")]
    Unseen(u32),
}

/// The warp of one view: for every output pixel the film pixels that it is a mean of.
#[derive(Clone, Debug, PartialEq)]
pub struct Rectifier {
    side: u32,
    // Where the weights of each cell end.
    ends: Vec<u32>,
    // Film pixel (row by row) and weight; the weights of a cell, times coverages, sum to 1.
    weights: Vec<(u32, f64)>,
}

type Point = [f64; 2];
type Homography = [[f64; 3]; 3];

impl Rectifier {
    /// The warp of a view to `side` x `side` pixels.
    ///
    /// # Errors
    /// When the side is out of range or the film does not see the whole sample.
    pub fn new(specification: &Specification, view: u32, side: u32) -> Result<Self, RectifyError> {
        if !(1..=SIDE_PIXELS_MAX).contains(&side) {
            return Err(RectifyError::Side(side));
        }
        let geometry = specification.view_geometry(view as usize);
        let sample_from_film = geometry
            .ok_or(RectifyError::NoSuchView(view))?
            .sample_from_film;
        let outline = sample_outline(&sample_from_film).ok_or(RectifyError::Unseen(view))?;
        let (width, height) = (specification.image.width, specification.image.height);
        let mut cells: Vec<Cell> = vec![Cell::default(); side as usize * side as usize];
        for row in 0..height {
            for column in 0..width {
                let corner = [f64::from(column), f64::from(row)];
                let footprint = square(corner)
                    .iter()
                    .map(|&point| on_sample(&sample_from_film, point))
                    .collect::<Option<Vec<Point>>>();
                // A pixel that reaches the horizon sees none of the sample: its outline does not.
                let Some(footprint) = footprint else { continue };
                let coverage = clipped_area(&outline, corner, [corner[0] + 1.0, corner[1] + 1.0]);
                if coverage > AREA_MIN {
                    share_out(&footprint, row * width + column, coverage, side, &mut cells);
                }
            }
        }
        let mut ends = Vec::with_capacity(cells.len());
        let mut weights = Vec::new();
        for cell in cells {
            if cell.seen < SEEN_MIN {
                return Err(RectifyError::Unseen(view));
            }
            let pixels = cell.pixels.into_iter();
            weights.extend(pixels.map(|(pixel, weight)| (pixel, weight / cell.covered)));
            ends.push(weights.len() as u32);
        }
        Ok(Self {
            side,
            ends,
            weights,
        })
    }

    /// The side of the square in pixels.
    pub fn side(&self) -> u32 {
        self.side
    }

    /// The square, row by row from the top, of a film, row by row. Film pixels that are missing
    /// count as black.
    pub fn apply(&self, film: &[[f32; 3]]) -> Vec<[f32; 3]> {
        let mut begin = 0;
        let cells = self.ends.iter().map(|&end| {
            let mut sum = [0.0; 3];
            for &(pixel, weight) in &self.weights[begin..end as usize] {
                let value = film.get(pixel as usize).copied().unwrap_or_default();
                for (sum, channel) in sum.iter_mut().zip(value) {
                    *sum += weight * f64::from(channel);
                }
            }
            begin = end as usize;
            sum.map(|channel| channel as f32)
        });
        cells.collect()
    }
}

/// What is known of an output pixel while it is collected; areas are in cells.
#[derive(Clone, Default)]
struct Cell {
    pixels: Vec<(u32, f64)>,
    /// Area seen by the film.
    seen: f64,
    /// The same, each film pixel's part times its coverage.
    covered: f64,
}

/// Adds a film pixel to the cells that its footprint meets.
fn share_out(footprint: &[Point], pixel: u32, coverage: f64, side: u32, cells: &mut [Cell]) {
    // In units of cells, rows counted from the top.
    let scale = f64::from(side);
    let footprint: Vec<Point> = footprint
        .iter()
        .map(|[u, v]| [u * scale, (1.0 - v) * scale])
        .collect();
    let range = |axis: usize| {
        let low = footprint
            .iter()
            .map(|p| p[axis])
            .fold(f64::INFINITY, f64::min);
        let high = footprint
            .iter()
            .map(|p| p[axis])
            .fold(f64::NEG_INFINITY, f64::max);
        // A conversion to an integer saturates, at 0 too.
        (low.floor() as u32)..(high.ceil() as u32).min(side)
    };
    for row in range(1) {
        for column in range(0) {
            let low = [f64::from(column), f64::from(row)];
            let area = clipped_area(&footprint, low, [low[0] + 1.0, low[1] + 1.0]);
            if area > AREA_MIN {
                let cell = &mut cells[(row * side + column) as usize];
                cell.pixels.push((pixel, area));
                cell.seen += area;
                cell.covered += area * coverage;
            }
        }
    }
}

/// The corners of the pixel or cell at a corner, in order.
fn square([x, y]: Point) -> [Point; 4] {
    [[x, y], [x + 1.0, y], [x + 1.0, y + 1.0], [x, y + 1.0]]
}

/// A film point on the sample; `None` at and above its horizon.
fn on_sample(map: &Homography, [x, y]: Point) -> Option<Point> {
    let [u, v, w] = map.map(|line| line[0] * x + line[1] * y + line[2]);
    (w > 0.0).then(|| [u / w, v / w])
}

/// The sample's corners on the film; `None` where one is behind the camera.
fn sample_outline(sample_from_film: &Homography) -> Option<Vec<Point>> {
    let film_from_sample = adjugate(sample_from_film);
    // The adjugate is the inverse times the determinant, whose sign has to go.
    let det = (0..3)
        .map(|i| sample_from_film[0][i] * film_from_sample[i][0])
        .sum::<f64>();
    let corners = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
    corners
        .iter()
        .map(|&[u, v]| {
            let [x, y, w] = film_from_sample.map(|line| line[0] * u + line[1] * v + line[2]);
            (w * det > 0.0).then(|| [x / w, y / w])
        })
        .collect()
}

fn adjugate(m: &Homography) -> Homography {
    std::array::from_fn(|row| {
        std::array::from_fn(|column| {
            let (r, c) = ((column + 1) % 3, (row + 1) % 3);
            let (rr, cc) = ((column + 2) % 3, (row + 2) % 3);
            m[r][c] * m[rr][cc] - m[r][cc] * m[rr][c]
        })
    })
}

/// The area of a convex polygon's part inside a rectangle (Sutherland and Hodgman 1974).
fn clipped_area(polygon: &[Point], low: Point, high: Point) -> f64 {
    let mut part = polygon.to_vec();
    for axis in 0..2 {
        part = clip(&part, axis, low[axis], 1.0);
        part = clip(&part, axis, high[axis], -1.0);
    }
    let pairs = part.iter().zip(part.iter().cycle().skip(1));
    let twice: f64 = pairs.map(|(a, b)| a[0] * b[1] - a[1] * b[0]).sum();
    0.5 * twice.abs()
}

/// The part of a polygon where `sign * (coordinate - bound)` is not negative.
fn clip(polygon: &[Point], axis: usize, bound: f64, sign: f64) -> Vec<Point> {
    let mut part = Vec::with_capacity(polygon.len() + 1);
    for (&a, &b) in polygon.iter().zip(polygon.iter().cycle().skip(1)) {
        let (at_a, at_b) = (sign * (a[axis] - bound), sign * (b[axis] - bound));
        if at_a >= 0.0 {
            part.push(a);
        }
        if (at_a > 0.0 && at_b < 0.0) || (at_a < 0.0 && at_b > 0.0) {
            let t = at_a / (at_a - at_b);
            part.push([a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1])]);
        }
    }
    part
}

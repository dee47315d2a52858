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
    /// The sample is not flat.
    #[error(
        "a curved sample cannot be warped to a square: leave --rectified out, or set sample.shape to \
         \"square\""
    )]
    Curved,
    /// Part of the sample is off the film.
    #[error("view {0} cannot be rectified: its film does not see the whole sample")]
    Unseen(u32),
    /// Part of the sample is off an image.
    #[error("the image does not show the whole sample")]
    OffImage,
}

/// The warp of one view to a square.
#[derive(Clone, Debug, PartialEq)]
pub struct Rectifier {
    side: u32,
    warp: Warp,
}

/// A warp: for every output cell the image pixels that it is a mean of.
#[derive(Clone, Debug, PartialEq)]
pub struct Warp {
    // Where the weights of each cell end.
    ends: Vec<u32>,
    // Image pixel (row by row) and weight; the weights of a cell, times coverages, sum to 1.
    weights: Vec<(u32, f64)>,
}

/// (x, y).
pub type Point = [f64; 2];

/// A map from a plane to a plane: row-major, acts on columns (x, y, 1).
pub type Homography = [[f64; 3]; 3];

impl Rectifier {
    /// The warp of a view to `side` x `side` pixels.
    ///
    /// # Errors
    /// When the sample is curved, the side is out of range or the film does not see the whole sample.
    pub fn new(specification: &Specification, view: u32, side: u32) -> Result<Self, RectifyError> {
        if !specification.sample.shape.is_square() {
            return Err(RectifyError::Curved);
        }
        let geometry = specification.view_geometry(view as usize);
        let geometry = geometry.ok_or(RectifyError::NoSuchView(view))?;
        let film = [specification.image.width, specification.image.height];
        let warp = Self::of_image(&geometry.sample_from_film, film, side);
        warp.map_err(|error| match error {
            RectifyError::OffImage => RectifyError::Unseen(view),
            other => other,
        })
    }

    /// The warp of an image of width x height pixels to `side` x `side`. `sample_from_image` takes
    /// its pixels to the sample as [`dataset::ViewGeometry::sample_from_film`] does a film's.
    ///
    /// # Errors
    /// When the side is out of range or the image does not show the whole sample.
    pub fn of_image(
        sample_from_image: &Homography,
        [width, height]: [u32; 2],
        side: u32,
    ) -> Result<Self, RectifyError> {
        if !(1..=SIDE_PIXELS_MAX).contains(&side) {
            return Err(RectifyError::Side(side));
        }
        let cells = cells(sample_from_image, [width, height], [side, side]);
        let seen = |cells: &Vec<Cell>| cells.iter().all(|cell| cell.seen >= SEEN_MIN);
        let cells = cells.filter(seen).ok_or(RectifyError::OffImage)?;
        let warp = Warp::of_cells(cells);
        Ok(Self { side, warp })
    }

    /// The side of the square in pixels.
    pub fn side(&self) -> u32 {
        self.side
    }

    /// The square, row by row from the top, of a film, row by row. Film pixels that are missing
    /// count as black.
    pub fn apply(&self, film: &[[f32; 3]]) -> Vec<[f32; 3]> {
        self.warp.apply(film)
    }
}

impl Warp {
    /// The warp of an image of width x height pixels to a grid of columns x rows cells, row 0 at the
    /// top, of the unit square that `square_from_image` takes it to. Cells that the image does not
    /// show become black.
    pub fn new(square_from_image: &Homography, image: [u32; 2], grid: [u32; 2]) -> Self {
        let [columns, rows] = grid;
        let black = || vec![Cell::default(); columns as usize * rows as usize];
        Self::of_cells(cells(square_from_image, image, grid).unwrap_or_else(black))
    }

    fn of_cells(cells: Vec<Cell>) -> Self {
        let mut ends = Vec::with_capacity(cells.len());
        let mut weights = Vec::new();
        for cell in cells {
            let pixels = cell.pixels.into_iter();
            weights.extend(pixels.map(|(pixel, weight)| (pixel, weight / cell.covered)));
            ends.push(weights.len() as u32);
        }
        Self { ends, weights }
    }

    /// The cells, row by row from the top, of an image, row by row. Pixels that are missing count as
    /// black.
    pub fn apply(&self, image: &[[f32; 3]]) -> Vec<[f32; 3]> {
        let mut begin = 0;
        let cells = self.ends.iter().map(|&end| {
            let mut sum = [0.0; 3];
            for &(pixel, weight) in &self.weights[begin..end as usize] {
                let value = image.get(pixel as usize).copied().unwrap_or_default();
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

/// What each cell of a grid over the unit square gets from an image; `None` where a corner of the
/// square is behind the camera.
fn cells(
    square_from_image: &Homography,
    [width, height]: [u32; 2],
    grid: [u32; 2],
) -> Option<Vec<Cell>> {
    let outline = outline(square_from_image)?;
    let range = |axis: usize, count: u32| {
        let places = || outline.iter().map(|corner| corner[axis]);
        let low = places().fold(f64::INFINITY, f64::min).floor();
        let high = places().fold(f64::NEG_INFINITY, f64::max).ceil();
        // A conversion to an integer saturates, at 0 too.
        (low as u32)..(high as u32).min(count)
    };
    let mut cells = vec![Cell::default(); grid[0] as usize * grid[1] as usize];
    for row in range(1, height) {
        for column in range(0, width) {
            let corner = [f64::from(column), f64::from(row)];
            let footprint = square(corner)
                .iter()
                .map(|&point| on_sample(square_from_image, point))
                .collect::<Option<Vec<Point>>>();
            // A pixel that reaches the horizon sees none of the sample: its outline does not.
            let Some(footprint) = footprint else { continue };
            let coverage = clipped_area(&outline, corner, [corner[0] + 1.0, corner[1] + 1.0]);
            if coverage > AREA_MIN {
                share_out(&footprint, row * width + column, coverage, grid, &mut cells);
            }
        }
    }
    Some(cells)
}

/// Adds a film pixel to the cells that its footprint meets.
fn share_out(
    footprint: &[Point],
    pixel: u32,
    coverage: f64,
    [columns, rows]: [u32; 2],
    cells: &mut [Cell],
) {
    // In units of cells, rows counted from the top.
    let footprint: Vec<Point> = footprint
        .iter()
        .map(|[u, v]| [u * f64::from(columns), (1.0 - v) * f64::from(rows)])
        .collect();
    let range = |axis: usize, count: u32| {
        let low = footprint
            .iter()
            .map(|p| p[axis])
            .fold(f64::INFINITY, f64::min);
        let high = footprint
            .iter()
            .map(|p| p[axis])
            .fold(f64::NEG_INFINITY, f64::max);
        // A conversion to an integer saturates, at 0 too.
        (low.floor() as u32)..(high.ceil() as u32).min(count)
    };
    for row in range(1, rows) {
        for column in range(0, columns) {
            let low = [f64::from(column), f64::from(row)];
            let area = clipped_area(&footprint, low, [low[0] + 1.0, low[1] + 1.0]);
            if area > AREA_MIN {
                let cell = &mut cells[(row * columns + column) as usize];
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

/// The corners of the sample in an image, near left, near right, far right, far left, by the map that
/// takes its pixels to the sample; `None` where one is behind the camera.
pub fn outline(sample_from_film: &Homography) -> Option<[Point; 4]> {
    let film_from_sample = adjugate(sample_from_film);
    // The adjugate is the inverse times the determinant, whose sign has to go.
    let det = (0..3)
        .map(|i| sample_from_film[0][i] * film_from_sample[i][0])
        .sum::<f64>();
    let corner = |u: f64, v: f64| {
        let [x, y, w] = film_from_sample.map(|line| line[0] * u + line[1] * v + line[2]);
        (w * det > 0.0).then(|| [x / w, y / w])
    };
    Some([
        corner(0.0, 0.0)?,
        corner(1.0, 0.0)?,
        corner(1.0, 1.0)?,
        corner(0.0, 1.0)?,
    ])
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

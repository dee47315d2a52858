//! Integrals over pixels of a positive function whose logarithm is smooth on most of the film.
//!
//! The film is tiled by rectangles on each of which the logarithm and the tint are products of
//! Chebyshev series. A tile is halved until its series meet the tolerance, also below the size of a
//! pixel, and pixels are then Gauss rules over the series, which cost next to nothing.
//!
//! A feature between the nodes of a tile does not pass for darkness. The logarithm of a lobe falls
//! with the square of the distance from the feature, so the nodes see it from afar: either the
//! series converge, and then they tell what lies between the nodes, or the tile is halved. A tile
//! is left out only where the lobe's exponent bounds all that it may hold.

use super::canvas::Canvas;
use super::log_tile::{LOG_MAX, LogBasis, LogFit, PixelSums, TintedLog, points_for_change};
use super::refine::{Rounds, refine, roots};
use crate::numerics::instructions::Instructions;
use crate::numerics::polygon::{Polygon, Rectangle};
use crate::numerics::tolerance::Tolerance;
use dataset::specification::Accuracy;

/// The largest tile to begin with, in pixels.
const ROOT_SIDE: f64 = 64.0;

/// A relative error is not asked to be less: rounding shows.
const RELATIVE_MIN: f64 = 1e-11;

/// Nor may it be more: the bounds are for small ones.
const RELATIVE_MAX: f64 = 0.1;

/// Tiles are not halved below this many pixels: there the nodes' coordinates round.
const SIDE_MIN: f64 = 1e-10;

/// On a tile of at most this many pixels over which the logarithm changes by at most `FLAT`, what
/// the series leave out is no lobe but the rule's last digits, or a bend where cos_i = cos_o:
/// halving would gain little, and the error is stated as it is.
const FLAT_SIDE: f64 = 1.0 / 16.0;
const FLAT: f64 = 0.5;

/// Tiles between two looks at how much has been spent. They are cheap.
const ROUNDS: Rounds = Rounds {
    tiles_max: 1024,
    evaluations: u64::MAX,
};

/// How a tiling divides what a tile may miss.
#[derive(Clone, Copy, Debug)]
pub struct Shares {
    /// The share of what is allowed that a tile may hold and be left out.
    pub dark: f64,
    /// The share of the relative error allowed that the rule at a point may miss.
    pub rule: f64,
    /// The share of it that the rule over pixels may miss.
    pub quadrature: f64,
    /// This many tiles, side by side, make up an edge across. Small tiles lie along edges, so a pixel
    /// holds about as many of them as its side does, times this. Each may miss its share of what is
    /// allowed to the pixel.
    pub edge_tiles: f64,
}

/// What a function asks of its tiling.
pub struct Demand<'a> {
    /// The target for what is added to a pixel.
    pub accuracy: &'a Accuracy,
    /// Evaluations after which nothing is halved any more.
    pub evaluations_max: u64,
    /// How fine the function is worked out.
    pub tolerance: Tolerance,
    /// How the error allowed is divided.
    pub shares: Shares,
    /// What pixels are summed with.
    pub instructions: Instructions,
}

/// A positive function of the film. What it works with is kept from call to call.
pub trait LogShade: Sync {
    /// Buffers.
    type Scratch: Default;

    /// The function at (column, row) and how many evaluations of the reflectance it took.
    fn at(
        &self,
        scratch: &mut Self::Scratch,
        film_point: [f64; 2],
        tolerance: Tolerance,
    ) -> (TintedLog, u32);

    /// A bound of the function on a rectangle, in any channel.
    fn most(&self, rectangle: &Rectangle) -> f64;

    /// The axis along which a rectangle is to be halved at once, because it holds an edge that is
    /// much sharper than its series could be.
    fn edge_along(&self, rectangle: &Rectangle) -> Option<usize>;
}

/// Adds the integrals of `shade` over the parts of pixels inside `outline`. Returns how many
/// evaluations it took.
pub fn integrate<S: LogShade>(
    canvas: &mut Canvas<'_>,
    outline: &Polygon,
    demand: &Demand<'_>,
    shade: &S,
) -> u64 {
    let Some(bounds) = outline.bounds().intersection(&canvas.bounds()) else {
        return 0;
    };
    let tiling = Tiling {
        outline,
        demand,
        shade,
        basis: LogBasis::new(),
    };
    // A tile sees how bright its pixel has become in the rounds before.
    refine(
        canvas,
        roots(bounds, ROOT_SIDE),
        &ROUNDS,
        |so_far, spent, rectangle, buffers| {
            tiling.grow(rectangle, so_far, spent >= demand.evaluations_max, buffers)
        },
        |canvas, growth| match growth {
            Growth::Pixels(pixels) => {
                for (index, value, error) in pixels {
                    canvas.add(index, value, error);
                }
                None
            }
            Growth::Halves(halves) => Some(halves),
        },
    )
}

/// What a rectangle of the film came to.
enum Growth {
    /// The integrals over its pixels and their errors.
    Pixels(Vec<((u32, u32), [f64; 3], f64)>),
    /// The function is not smooth on it.
    Halves([Rectangle; 2]),
}

/// What works on tiles, one after another.
struct Buffers<T> {
    shade: T,
    sums: PixelSums,
}

impl<T: Default> Default for Buffers<T> {
    fn default() -> Self {
        Self {
            shade: T::default(),
            sums: PixelSums::default(),
        }
    }
}

struct Tiling<'a, S> {
    outline: &'a Polygon,
    demand: &'a Demand<'a>,
    shade: &'a S,
    basis: LogBasis,
}

impl<S: LogShade> Tiling<'_, S> {
    /// Works out a rectangle, or halves it where its series do not meet the tolerance; also counts
    /// evaluations.
    fn grow(
        &self,
        rectangle: &Rectangle,
        so_far: &Canvas<'_>,
        exhausted: bool,
        buffers: &mut Buffers<S::Scratch>,
    ) -> (Growth, u64) {
        if self.outline.clipped(rectangle).is_empty() {
            return (Growth::Pixels(Vec::new()), 0);
        }
        let allowed = self.allowed(rectangle, so_far);
        let most = self.shade.most(rectangle);
        if most <= self.demand.shares.dark * allowed || exhausted {
            return (Growth::Pixels(self.dark(rectangle, most)), 0);
        }
        if let Some(axis) = self.shade.edge_along(rectangle) {
            return (Growth::Halves(rectangle.halves(axis)), 0);
        }
        let mut spent = 0;
        let mut evaluate = |film_point: [f64; 2], tolerance: Tolerance| {
            let (value, evaluations) = self.shade.at(&mut buffers.shade, film_point, tolerance);
            spent += u64::from(evaluations);
            value
        };
        let [low, high] = [rectangle.low, rectangle.high];
        let middle = [0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1])];
        // What a rule misses shows against the next finer one.
        let mut tolerance = self.demand.tolerance;
        let mut coarse = evaluate(middle, tolerance);
        let missed = loop {
            let fine = evaluate(middle, tolerance.finer());
            let missed = relative_difference(&coarse, &fine);
            let relative = self.relative(allowed, libm::exp(fine.log.min(LOG_MAX)));
            if missed <= self.demand.shares.rule * relative || tolerance.is_finest() {
                break missed;
            }
            (tolerance, coarse) = (tolerance.finer(), fine);
        };
        let nodes = self.basis.nodes(rectangle);
        let values = nodes.map(|node| evaluate(node, tolerance));
        let (tile, fit) = self.basis.fit(*rectangle, values);
        let relative = self.relative(allowed, fit.most);
        let sides = rectangle.sides();
        let points = self.points(&fit, sides, relative);
        let meets = fit.error <= relative || (fit.error <= RELATIVE_MAX && is_flat(&fit, sides));
        let (Some(points), true) = (points, meets) else {
            if sides[0].max(sides[1]) < SIDE_MIN {
                return (Growth::Pixels(self.dark(rectangle, most)), spent);
            }
            let axis = axis_to_halve(&fit, sides, relative);
            return (Growth::Halves(rectangle.halves(axis)), spent);
        };
        let error = fit.error + missed + self.demand.shares.quadrature * relative;
        let mut pixels = Vec::new();
        tile.for_each_pixel(
            self.outline,
            points,
            self.demand.instructions,
            &mut buffers.sums,
            |index, value| {
                let brightest = value[0].max(value[1]).max(value[2]);
                pixels.push((index, value, error * brightest));
            },
        );
        (Growth::Pixels(pixels), spent)
    }

    /// Gauss points along the sides of a pixel; `None` if there would be too many.
    fn points(&self, fit: &LogFit, sides: [f64; 2], relative: f64) -> Option<[usize; 2]> {
        let [columns, rows] = [0, 1].map(|axis| {
            let side = sides[axis].min(1.0);
            // The fourth derivative of exp(G) is at most (G'^2 + 3 G'')^2 times it, but for what
            // bends even less.
            let change = fit.slopes[axis] * side;
            let change = (change * change + 3.0 * fit.curvatures[axis] * side * side).sqrt();
            points_for_change(change, 0.5 * self.demand.shares.quadrature * relative)
        });
        Some([columns?, rows?])
    }

    /// No light, and as its error all that there may be.
    fn dark(&self, rectangle: &Rectangle, most: f64) -> Vec<((u32, u32), [f64; 3], f64)> {
        rectangle
            .pixels()
            .filter_map(|index| {
                let cell = Rectangle::pixel(index.0, index.1).intersection(rectangle)?;
                Some((index, [0.0; 3], most * cell.area()))
            })
            .collect()
    }

    /// The error allowed to the function: for all of a pixel, as bright as it is known to be.
    fn allowed(&self, rectangle: &Rectangle, so_far: &Canvas<'_>) -> f64 {
        let accuracy = self.demand.accuracy;
        let sides = rectangle.sides();
        if sides[0] > 1.0 || sides[1] > 1.0 {
            return accuracy.absolute;
        }
        let least = rectangle
            .pixels()
            .map(|index| {
                let [r, g, b] = so_far.value(index);
                r.max(g).max(b)
            })
            .fold(f64::INFINITY, f64::min);
        let longest = sides[0].max(sides[1]);
        let spread = (1.0 / (self.demand.shares.edge_tiles * longest)).max(1.0);
        (accuracy.absolute.max(accuracy.relative * least)) * spread
    }

    /// The relative error allowed where the function is at most `most`.
    fn relative(&self, allowed: f64, most: f64) -> f64 {
        let relative = self.demand.accuracy.relative;
        relative
            .max(allowed / most.max(f64::MIN_POSITIVE))
            .clamp(RELATIVE_MIN, RELATIVE_MAX)
    }
}

/// Whether a tile is so small and the function on it so even that no lobe can hide: see [`FLAT`].
fn is_flat(fit: &LogFit, sides: [f64; 2]) -> bool {
    (0..2).all(|axis| sides[axis] <= FLAT_SIDE && fit.slopes[axis] * sides[axis] <= FLAT)
}

/// The axis along which a tile is less smooth, against what is allowed.
fn axis_to_halve(fit: &LogFit, sides: [f64; 2], relative: f64) -> usize {
    if fit.error > relative {
        return usize::from(fit.tails[1] > fit.tails[0]);
    }
    // The series would do, but pixels change too much.
    usize::from(fit.slopes[1] * sides[1] > fit.slopes[0] * sides[0])
}

/// How far apart two values are, as a share of the largest channel.
fn relative_difference(a: &TintedLog, b: &TintedLog) -> f64 {
    let largest = a.tint.into_iter().chain(b.tint).fold(0.0, f64::max);
    let apart = (0..3)
        .map(|channel| (a.tint[channel] - b.tint[channel]).abs())
        .fold(0.0, f64::max);
    let tints = if largest > 0.0 { apart / largest } else { 0.0 };
    (a.log - b.log).abs() + tints
}

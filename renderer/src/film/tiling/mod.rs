//! Integrals over pixels of a function that is smooth on most of the film.
//!
//! The film is tiled by rectangles on each of which the function is a product of Chebyshev series,
//! halved until what they leave out of the means over pixels vanishes against the target. A
//! box-filtered pixel is then the integral of a polynomial, in closed form, and one that the outline
//! cuts the integral over the covered polygon. A pixel on which even a tile of its own does not do is
//! integrated by adaptive quadrature.

mod gaps;
mod rules;
mod shade;
mod steps;

use super::canvas::{Brightness, Canvas};
use super::demand::{Demand, Terms};
pub use super::edge::Edge;
use super::outline::Outline;
use super::pixel::{self, Work};
use super::refine::{Rounds, cut_out, refine, roots};
use super::region::{Region, Series, add_region, add_tile};
use super::target;
use super::tile_nodes::{FEW, FINER, MANY, NodeValues, layout};
use crate::numerics::channels::largest_difference;
use crate::numerics::chebyshev::{Basis, Fit, TAIL, Tile, largest_means};
use crate::numerics::polygon::Rectangle;
use crate::numerics::tolerance::Tolerance;
use gaps::{in_gaps, on_long_sides};
use rules::Rule;
use shade::Counted;
pub use shade::Shade;
use steps::Values;

/// Tiles that are worked out between two looks at the limit on evaluations, at most.
const TILES_A_LOOK: usize = 32;

/// A look comes before one part in this many of the limit is spent, too, by what tiles took so far. Chosen.
const LOOKS_A_LIMIT: u64 = 4;

/// A tile that is left off by more than this many times what is allowed does not resolve the function. Chosen.
const RESOLVED: f64 = 3.0;

/// A tile that is left although it misses what is allowed may hold an edge. The mean over a tile of one pixel
/// with an edge across is then off by up to 0.69 of what the tile is off by at a point (derived: edges along a
/// side, at 401 places). Its last coefficients do not show it where the edge runs through the middle.
const EDGE: f64 = 0.7;

/// A pixel gets no more lines after this many points. Chosen.
const POINTS_MAX: u64 = 4_000;

/// Nor after one part in this many of the limit on evaluations is spent. Chosen.
const PIXELS_A_LIMIT: u64 = 8;

/// The narrowest tile that spans several pixels the other way.
const STRIP_MIN: f64 = 0.125;

/// The longest strip in pixels. The top of a round edge could reach into a longer one between its
/// nodes: a circle of ten pixels' radius covers three of a strip of an eighth.
const STRIP_LENGTH: f64 = 8.0;

/// A thicker tile may be longer than wide by this factor, for the same reason.
const ASPECT_MAX: f64 = 16.0;

/// A tile that may hide something between its nodes is halved down to this side in pixels. A limit on work.
const HIDING_MIN: f64 = 1.0 / 64.0;

/// Adds the integrals of `shade` over the pixels of the regions, which lie inside `outline`.
/// Returns how many evaluations it took.
pub fn integrate<S: Shade>(
    canvas: &mut Canvas<'_>,
    outline: &Outline,
    regions: &[Region<'_>],
    demand: &Demand<'_>,
    shade: &S,
) -> u64 {
    let bounds = outline.polygon().bounds().intersection(&canvas.bounds());
    let parts = Vec::from_iter(bounds);
    integrate_on(canvas, outline, (regions, &parts), demand, shade)
}

/// The same over parts of the film that do not overlap.
pub fn integrate_on<S: Shade>(
    canvas: &mut Canvas<'_>,
    outline: &Outline,
    (regions, parts): (&[Region<'_>], &[Rectangle]),
    demand: &Demand<'_>,
    shade: &S,
) -> u64 {
    let where_to = (regions, parts);
    match demand.terms {
        Terms::Many => integrate_by::<S, MANY>(canvas, outline, where_to, demand, shade),
        Terms::Few => integrate_by::<S, FEW>(canvas, outline, where_to, demand, shade),
    }
}

/// The same by series of so many terms.
fn integrate_by<S: Shade, const TERMS: usize>(
    canvas: &mut Canvas<'_>,
    outline: &Outline,
    (regions, parts): (&[Region<'_>], &[Rectangle]),
    demand: &Demand<'_>,
    shade: &S,
) -> u64 {
    let before = Brightness::of(canvas);
    let place = (&before, outline, regions);
    let on_pixels = Tiling::<S, FINER>::new(place, demand, shade, None);
    let tiling = Tiling::<S, TERMS>::new(place, demand, shade, Some(&on_pixels));
    let side_max = (demand.side_max / demand.terms.spread()).max(1.0);
    let open = parts.iter().flat_map(|&part| match &demand.feature {
        Some(feature) => cut_out(part, feature, side_max),
        None => vec![part],
    });
    let open = open.flat_map(|part| roots(part, side_max));
    refine(
        canvas,
        open.collect(),
        &Rounds {
            tiles_max: TILES_A_LOOK,
            evaluations: demand.evaluations_max / LOOKS_A_LIMIT,
        },
        |_, spent, rectangle, scratch| {
            let effort = Effort::after(spent, demand.evaluations_max);
            tiling.grow(rectangle, effort, scratch)
        },
        |canvas, growth| {
            match growth {
                Growth::Nothing => {}
                Growth::Tile(series) => tiling.add(canvas, &series),
                Growth::Finer(series) => tiling.add(canvas, &series),
                Growth::Pixel(cell, parts) => {
                    for (region, (value, error)) in regions.iter().zip(parts) {
                        add_region(canvas, &cell, region, value, error);
                    }
                }
                Growth::Halves(halves) => return Some(halves),
            }
            None
        },
    )
}

/// What a rectangle of the film came to.
enum Growth<const TERMS: usize> {
    /// Nothing of the outline is on it.
    Nothing,
    Tile(Box<Series<TERMS>>),
    /// On a part of one pixel.
    Finer(Box<Series<FINER>>),
    /// For each region the integral over what it covers, and its error.
    Pixel(Rectangle, Vec<([f64; 3], f64)>),
    /// The function is not smooth on it.
    Halves([Rectangle; 2]),
}

/// What a tile is off by.
struct FitError {
    /// In the mean over a pixel.
    mean: f64,
    /// At a point.
    point: f64,
}

/// How hard to try, by what has been spent.
#[derive(Clone, Copy, PartialEq)]
enum Effort {
    /// Everything is refined that its target asks for.
    Full,
    /// What is too faint to matter is not.
    Less,
    /// Nothing is refined any more.
    None,
}

impl Effort {
    fn after(spent: u64, most: u64) -> Self {
        if spent >= most {
            Self::None
        } else if spent >= most / 2 {
            Self::Less
        } else {
            Self::Full
        }
    }
}

/// A rectangle that may become a tile.
struct Candidate<'a> {
    rectangle: &'a Rectangle,
    /// The least of what was on its pixels before.
    before: f64,
    effort: Effort,
}

/// What the series of a rectangle came to.
enum Fitted<const TERMS: usize> {
    Series(Box<Series<TERMS>>),
    /// A few lines of nodes show that the rectangle is too coarse along an axis.
    Coarse(usize),
    /// The series does not do. It is worse along the axis.
    Off(Box<Tile<TERMS>>, Rule, usize),
}

struct Tiling<'a, S, const TERMS: usize> {
    /// The film as it was.
    before: &'a Brightness,
    outline: &'a Outline,
    regions: &'a [Region<'a>],
    demand: &'a Demand<'a>,
    shade: &'a S,
    basis: Basis<TERMS>,
    gain: f64,
    /// What is tried on a part of a pixel, before lines are.
    finer: Option<&'a Tiling<'a, S, FINER>>,
}

impl<'a, S: Shade, const TERMS: usize> Tiling<'a, S, TERMS> {
    fn new(
        (before, outline, regions): (&'a Brightness, &'a Outline, &'a [Region<'a>]),
        demand: &'a Demand<'a>,
        shade: &'a S,
        finer: Option<&'a Tiling<'a, S, FINER>>,
    ) -> Self {
        let factors = regions.iter().flat_map(|region| region.factor);
        Self {
            before,
            outline,
            regions,
            demand,
            shade,
            basis: Basis::new(),
            gain: factors.fold(0.0, f64::max),
            finer,
        }
    }

    /// Adds the integrals of a series over the pixels of the regions.
    fn add<const ANY: usize>(&self, canvas: &mut Canvas<'_>, series: &Series<ANY>) {
        let function_error = |cell: &Rectangle| self.shade.function_error(cell);
        let instructions = self.demand.instructions;
        add_tile(canvas, series, function_error, self.regions, instructions);
    }

    /// Works out a rectangle, or halves it where the function is not smooth; also counts
    /// evaluations.
    fn grow(
        &self,
        rectangle: &Rectangle,
        effort: Effort,
        scratch: &mut S::Scratch,
    ) -> (Growth<TERMS>, u64) {
        let covered = self.outline.polygon().clipped(rectangle);
        if covered.is_empty() {
            return (Growth::Nothing, 0);
        }
        if let Some(halves) = self.halves_of_hiding(rectangle, covered.corners(), effort) {
            return (Growth::Halves(halves), 0);
        }
        let mut function = Counted {
            shade: self.shade,
            scratch,
            spent: 0,
            points: 0,
        };
        let candidate = Candidate {
            rectangle,
            // What was added before counts: a pixel's target is for all of it.
            before: self.before.least(rectangle, self.outline),
            effort,
        };
        let growth = self.work_out(&candidate, &mut function);
        (growth, function.spent)
    }

    /// The halves of a rectangle all of whose nodes may miss a part of the function.
    fn halves_of_hiding(
        &self,
        rectangle: &Rectangle,
        corners: &[[f64; 2]],
        effort: Effort,
    ) -> Option<[Rectangle; 2]> {
        if effort == Effort::None {
            return None;
        }
        let axis = self.shade.hides_between(rectangle, corners)?;
        (rectangle.sides()[axis] > HIDING_MIN).then(|| rectangle.halves(axis))
    }

    /// Works out a rectangle on which there is something of the outline.
    fn work_out(&self, candidate: &Candidate<'_>, function: &mut Counted<'_, S>) -> Growth<TERMS> {
        let rectangle = candidate.rectangle;
        let halves = |steep: usize| {
            let axis = axis_to_halve(rectangle, steep)?;
            Some(Growth::Halves(rectangle.halves(axis)))
        };
        let can_halve = |steep| axis_to_halve(rectangle, steep).is_some();
        let (tile, rule, steep) = match self.fitted(candidate, can_halve, function) {
            Fitted::Series(series) => return Growth::Tile(series),
            Fitted::Coarse(steep) => return halves(steep).expect("it can be halved"),
            Fitted::Off(tile, rule, steep) => (tile, rule, steep),
        };
        if let Some(halves) = halves(steep) {
            return halves;
        }
        if let Some(finer) = self.finer
            && let Fitted::Series(series) = finer.fitted(candidate, |_| true, function)
        {
            return Growth::Finer(series);
        }
        let mean = tile.integral(rectangle).map(|sum| sum / rectangle.area());
        let brightest = mean[0].max(mean[1]).max(mean[2]);
        let allowed = self.allowed(candidate.before + self.gain * brightest, candidate.effort);
        let (tolerance, missed) = self.rule_of_pixel(candidate, &rule, allowed, function);
        let parts = self.pixel(rectangle, steep, [allowed, missed], tolerance, function);
        Growth::Pixel(*rectangle, parts)
    }

    /// The series on a rectangle. `gives_up` tells whether it is not worked out where a few lines of nodes show that
    /// the rectangle is too coarse along an axis.
    fn fitted(
        &self,
        candidate: &Candidate<'_>,
        gives_up: impl Fn(usize) -> bool,
        function: &mut Counted<'_, S>,
    ) -> Fitted<TERMS> {
        let Candidate {
            rectangle,
            before,
            effort,
        } = *candidate;
        let demand = self.demand;
        let mut nodes = NodeValues::unknown(self.basis.nodes(rectangle).collect());
        let steep = self.steep_cross(candidate, &mut nodes, function);
        if let Some(steep) = steep.filter(|&steep| gives_up(steep)) {
            return Fitted::Coarse(steep);
        }
        let rule = self.rule(candidate, function);
        let Rule {
            tolerance, missed, ..
        } = rule;
        if tolerance.is_finer_than(demand.tolerance) {
            nodes.forget();
        }
        let steep = self.steep_line(candidate, &mut nodes, &rule, function);
        if let Some(steep) = steep.filter(|&steep| gives_up(steep)) {
            return Fitted::Coarse(steep);
        }
        let values = nodes.all(|node| function.at(node, tolerance));
        let (tile, fit) = self.basis.fit(*rectangle, values.iter().flatten().copied());
        let allowed = self.allowed(before + self.gain * fit.least, effort);
        let is_met = |fit_error: f64| {
            effort == Effort::None || demand.shares.is_met(fit_error, rule.own, allowed)
        };
        match self.fit_error(&tile, (&fit, &values), &rule, is_met, function) {
            Ok(fit_error) => {
                let off_at_centroids = tile.off_at_centroids([1.0; 2]);
                let by_centroids = off_at_centroids < demand.shares.centroids * allowed;
                let of_parts = if by_centroids { off_at_centroids } else { 0.0 };
                Fitted::Series(Box::new(Series {
                    tile,
                    error: self.stated(&fit_error, allowed, &values) + missed + of_parts,
                    by_centroids,
                }))
            }
            Err(steep) => Fitted::Off(Box::new(tile), rule, steep),
        }
    }

    /// What a tile states for its series.
    fn stated(&self, error: &FitError, allowed: f64, at_nodes: &Values<TERMS>) -> f64 {
        let &FitError { mean, point } = error;
        let doubt = self.demand.shares.doubt;
        // Where the function is not resolved, what a series misses is no ripple from node to node. A mean over a pixel
        // lies among the values on the tile, and of their range the nodes show most.
        let is_resolved = mean <= RESOLVED * allowed;
        let fit_error = if !is_resolved {
            range(at_nodes).max(point)
        } else if mean > allowed {
            mean.max(EDGE / doubt * point)
        } else {
            mean
        };
        doubt * fit_error
    }

    /// Along which axis a tile is steeper that the row and the column through its middle show to be too
    /// coarse; `None` where they do not.
    fn steep_cross(
        &self,
        candidate: &Candidate<'_>,
        nodes: &mut NodeValues<TERMS>,
        function: &mut Counted<'_, S>,
    ) -> Option<usize> {
        let demand = self.demand;
        let cross = nodes.cross(|node| function.at(node, demand.tolerance));
        let allowed = self.allowed(candidate.before + self.gain * nodes.least, candidate.effort);
        let tails = cross.map(|line| self.basis.line_left_out(&line, [1.0; TAIL]));
        let steep = usize::from(tails[1] > tails[0]);
        let is_coarse =
            candidate.effort != Effort::None && demand.shares.cross * tails[steep] > allowed;
        is_coarse.then_some(steep)
    }

    /// Works lines of nodes out until one shows that the tile is too coarse, and returns along which axis;
    /// `None` where none does. What a line leaves out of means along it is less than what the tile does.
    fn steep_line(
        &self,
        candidate: &Candidate<'_>,
        nodes: &mut NodeValues<TERMS>,
        rule: &Rule,
        function: &mut Counted<'_, S>,
    ) -> Option<usize> {
        let Candidate {
            rectangle,
            before,
            effort,
        } = *candidate;
        if effort == Effort::None {
            return None;
        }
        let largest = [0, 1]
            .map(|axis| largest_means::<TERMS>(rectangle, axis, &rectangle.pixel_edges(axis)));
        let is_steep = |&line: &[usize; 2]| {
            let values = nodes.line(line, |node| function.at(node, rule.tolerance));
            let allowed = self.allowed(before + self.gain * nodes.least, effort);
            let left_out = self.basis.line_left_out(&values, largest[line[0]]);
            !self.demand.shares.is_met(left_out, rule.own, allowed)
        };
        let mut lines = layout(TERMS).lines.iter().copied();
        lines.find(is_steep).map(|[axis, _]| axis)
    }

    /// What a tile shows to be off by: what its series leaves out, what steps between its nodes leave open, and what
    /// its corners, sides and points between its nodes show. As soon as that is not met, the axis along which the tile
    /// is to be halved instead.
    fn fit_error(
        &self,
        tile: &Tile<TERMS>,
        (fit, at_nodes): (&Fit, &Values<TERMS>),
        rule: &Rule,
        is_met: impl Fn(f64) -> bool,
        function: &mut Counted<'_, S>,
    ) -> Result<FitError, usize> {
        let shares = &self.demand.shares;
        let steep = usize::from(fit.tails[1] > fit.tails[0]);
        let [columns, rows] = [0, 1].map(|axis| tile.rectangle.pixel_edges(axis));
        let left_out = tile.left_out_of_means(&columns, &rows);
        let mut mean = left_out.max(shares.point * fit.error);
        if !is_met(mean) {
            return Err(steep);
        }
        let tolerance = rule.tolerance;
        let steps =
            self.left_open_by_steps(&tile.rectangle, at_nodes, &is_met, tolerance, function);
        mean = mean.max(steps);
        if !is_met(mean) {
            return Err(steep);
        }
        let kept = shares.apart * tile.kept_in_means();
        // The outermost nodes leave a hundredth of the tile uncovered on each side. An edge that lies
        // there shows at the corners, and the start of a steep rise on the sides.
        let sides = layout(TERMS).on_sides.map(|at| tile.rectangle.point(at));
        let between = layout(TERMS).between.map(|at| tile.rectangle.point(at));
        let mut apart = 0.0f64;
        let mut values = [[0.0; 3]; 4];
        for (at, value) in between.into_iter().zip(&mut values) {
            *value = function.at(at, tolerance);
            apart = apart.max(largest_difference(*value, tile.value(at)));
        }
        let rim = tile.rectangle.corners().into_iter().chain(sides);
        let rim = rim.chain(on_long_sides::<TERMS>(&tile.rectangle));
        let gaps = self
            .shade
            .is_cheap()
            .then(|| in_gaps::<TERMS>(&tile.rectangle));
        for at in rim.chain(gaps.into_iter().flatten()) {
            if !is_met(kept * apart) {
                return Err(steep);
            }
            let value = function.at(at, tolerance);
            apart = apart.max(largest_difference(value, tile.value(at)));
        }
        mean = mean.max(kept * apart);
        if !is_met(mean) {
            return Err(steep);
        }
        let mut missed = self.missed_at(&between, &values, tolerance, function);
        let mut to_halve = steep;
        if self.shade.is_uneven() && is_met(rule.times * missed) {
            let counts = |missed: f64| !is_met(rule.times * missed);
            let corners = self.missed_at_corners(&tile.rectangle, counts, tolerance, function);
            (missed, to_halve) = (missed.max(corners.missed), corners.worse_along);
        }
        let missed = rule.times * missed;
        mean = mean.max(missed);
        if !is_met(mean) {
            return Err(to_halve);
        }
        Ok(FitError {
            mean,
            point: fit.error.max(apart).max(missed),
        })
    }

    /// For each region the integral over what it covers of a part of a pixel, by adaptive quadrature,
    /// and its error: what the quadrature misses, and `missed` of the function.
    fn pixel(
        &self,
        rectangle: &Rectangle,
        steep: usize,
        [allowed, missed]: [f64; 2],
        tolerance: Tolerance,
        function: &mut Counted<'_, S>,
    ) -> Vec<([f64; 3], f64)> {
        let evaluations_max = self.demand.evaluations_max / PIXELS_A_LIMIT;
        let affordable = evaluations_max * function.points / function.spent.max(1);
        let work = Work {
            points_max: affordable.min(POINTS_MAX),
            evaluations_max,
        };
        let integral = |region: &Region<'_>| {
            let covered = region.outline.clipped(rectangle);
            let at_tolerance = function.at_tolerance(tolerance);
            let (value, error) = pixel::integrate(&covered, steep, allowed, &work, at_tolerance);
            let function_error = self.shade.function_error(rectangle);
            let function_error = function_error.over(covered.area(), value);
            (value, error + missed * covered.area() + function_error)
        };
        self.regions.iter().map(integral).collect()
    }

    /// The error allowed to the function where a pixel is so bright.
    fn allowed(&self, brightness: f64, effort: Effort) -> f64 {
        let allowed = target(self.demand.accuracy, [brightness; 3]);
        let faint = match effort {
            Effort::Full => 0.0,
            Effort::Less | Effort::None => self.demand.faint,
        };
        allowed.max(faint) / self.gain
    }
}

/// By how much a channel differs over the nodes of a tile at most.
fn range<const TERMS: usize>(at_nodes: &Values<TERMS>) -> f64 {
    let ends = |channel: usize| {
        let values = at_nodes.iter().flatten().map(|value| value[channel]);
        values.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], value| {
            [low.min(value), high.max(value)]
        })
    };
    let ranges = [0, 1, 2].map(|channel| {
        let [low, high] = ends(channel);
        high - low
    });
    ranges.into_iter().fold(0.0, f64::max)
}

/// Along which axis a tile is to be halved that is too coarse: the steeper one, into parts of a
/// pixel where that saves halving the other, which changes little over several pixels. None for a
/// part of one pixel.
fn axis_to_halve(rectangle: &Rectangle, steep: usize) -> Option<usize> {
    let (sides, other) = (rectangle.sides(), 1 - steep);
    let is_strip = sides[other] > (ASPECT_MAX * sides[steep]).max(STRIP_LENGTH);
    if is_strip && rectangle.spans_pixels(other) {
        Some(other)
    } else if rectangle.spans_pixels(steep) || (sides[other] > 2.0 && sides[steep] > STRIP_MIN) {
        Some(steep)
    } else if rectangle.spans_pixels(other) {
        Some(other)
    } else {
        None
    }
}

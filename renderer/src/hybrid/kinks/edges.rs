//! Edges, tried wherever they may lie.

use super::{Exact, Film, NO_LIMIT, Ramps, Tally, direction, seeded};
use crate::film::demand::Terms;
use crate::film::tile_nodes::{MANY, layout};
use crate::film::tiling::Shade;
use crate::numerics::polygon::Polygon;
use crate::numerics::tolerance::Tolerance;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::Rng;

/// 1, and more beyond a straight line.
#[derive(Clone, Copy)]
pub struct Step {
    pub line: [f64; 3],
    pub height: f64,
}

impl Step {
    pub fn drawn(random: &mut ChaCha8Rng) -> Self {
        let mut uniform = || f64::from(random.next_u32()) / f64::from(u32::MAX);
        let normal = direction(uniform());
        let [x, y] = [uniform(), uniform()];
        let line = [normal[0], normal[1], -normal[0] * x - normal[1] * y];
        Self {
            line,
            height: 0.1 * libm::exp10(-3.0 * uniform()),
        }
    }
}

impl Exact for Step {
    fn integral(&self, part: &Polygon) -> f64 {
        part.area() + self.height * part.cut(|at| Ramps::height(self.line, at)).area()
    }
}

impl Shade for Step {
    type Scratch = ();

    fn at(&self, (): &mut (), at: [f64; 2], _: Tolerance) -> ([f64; 3], u32) {
        let beyond = Ramps::height(self.line, at) > 0.0;
        ([1.0 + if beyond { self.height } else { 0.0 }; 3], 1)
    }
}

/// Two parallel edges: what rises twice, anywhere, or a stripe that no two neighbouring nodes lie on either side of.
struct Stripe([Step; 2]);

impl Stripe {
    /// Across a square of so many pixels a side.
    fn drawn(random: &mut ChaCha8Rng, side: f64) -> Self {
        let mut first = Step::drawn(random);
        first.line[2] *= side;
        let mut second = first;
        let uniform = f64::from(random.next_u32()) / f64::from(u32::MAX);
        let (width, height) = match random.next_u32() % 4 {
            0 => (side * (layout(MANY).widest_gap + 0.5 * uniform), -1.0),
            1 => (side * (layout(MANY).widest_gap + 0.5 * uniform), -0.5),
            2 => (libm::exp10(-2.5 * uniform), 0.5),
            _ => (libm::exp10(-2.5 * uniform), 1.0),
        };
        second.line[2] += width;
        second.height *= height;
        Self([first, second])
    }
}

impl Exact for Stripe {
    fn integral(&self, part: &Polygon) -> f64 {
        let [first, second] = self.0.each_ref().map(|step| step.integral(part));
        first + second - part.area()
    }
}

impl Shade for Stripe {
    type Scratch = ();

    fn at(&self, (): &mut (), at: [f64; 2], tolerance: Tolerance) -> ([f64; 3], u32) {
        let values = self.0.each_ref().map(|step| {
            let ([value, ..], _) = step.at(&mut (), at, tolerance);
            value
        });
        ([values[0] + values[1] - 1.0; 3], 1)
    }
}

/// A bump like a normal density.
struct Bump {
    centre: [f64; 2],
    width: f64,
}

impl Bump {
    /// On a square of so many pixels a side, so wide that some node of one tile is on it.
    fn drawn(random: &mut ChaCha8Rng, side: f64) -> Self {
        let mut uniform = || f64::from(random.next_u32()) / f64::from(u32::MAX);
        Self {
            centre: [side * uniform(), side * uniform()],
            width: side * layout(MANY).widest_gap * (0.4 + 0.6 * uniform()),
        }
    }
}

impl Exact for Bump {
    /// Of a part of a square, which is a rectangle.
    fn integral(&self, part: &Polygon) -> f64 {
        let bounds = part.bounds();
        let along = |axis: usize| {
            let scaled =
                |at: f64| (at - self.centre[axis]) / (std::f64::consts::SQRT_2 * self.width);
            let [low, high] = [bounds.low[axis], bounds.high[axis]].map(|at| libm::erf(scaled(at)));
            (0.5 * std::f64::consts::PI).sqrt() * self.width * (high - low)
        };
        along(0) * along(1)
    }
}

impl Shade for Bump {
    type Scratch = ();

    fn at(&self, (): &mut (), at: [f64; 2], _: Tolerance) -> ([f64; 3], u32) {
        let off = [0, 1].map(|axis| (at[axis] - self.centre[axis]) / self.width);
        (
            [libm::exp(-0.5 * (off[0] * off[0] + off[1] * off[1])); 3],
            1,
        )
    }
}

/// A film with something on this outline, in tiles as large as it is.
fn film(side: f64, outline: Polygon, terms: Terms, evaluations_max: u64) -> Film {
    Film {
        side: side.ceil() as u32,
        outline,
        side_max: side,
        terms,
        feature: None,
        evaluations_max,
    }
}

/// A square of so many pixels a side.
fn square(side: f64) -> Polygon {
    Polygon::quadrilateral([[0.0, 0.0], [side, 0.0], [side, side], [0.0, side]])
}

/// What is worked out of many functions on squares, which are seen whole.
fn tally<E: Exact>(
    side: f64,
    (terms, evaluations_max): (Terms, u64),
    mut drawn: impl FnMut(&mut ChaCha8Rng) -> E,
) -> Tally {
    let mut random = seeded(20_261_126);
    let film = film(side, square(side), terms, evaluations_max);
    let mut tally = Tally::default();
    for _ in 0..(20_000.0 / side) as u32 {
        tally.add(&film, &drawn(&mut random));
    }
    tally
}

/// Edges through squares of so many pixels a side.
fn edges(side: f64, terms: Terms, evaluations_max: u64) -> Tally {
    tally(side, (terms, evaluations_max), |random| {
        let mut step = Step::drawn(random);
        step.line[2] *= side;
        step
    })
}

/// Where an edge runs along a tile's side through its middle, the coefficients of even polynomials vanish, and the
/// means of the odd ones.
#[test]
fn an_edge_through_a_pixel_is_stated() {
    for terms in TERMS {
        for evaluations_max in [0, NO_LIMIT] {
            let Tally { worst, beyond, .. } = edges(1.0, terms, evaluations_max);
            assert_eq!(
                beyond, 0,
                "{terms:?}: off by up to {worst} of what is stated"
            );
        }
    }
}

/// Of the tiles' series.
const TERMS: [Terms; 2] = [Terms::Many, Terms::Few];

/// Where no work is left and a peak lies between the nodes, a pixel may lie beyond what they show: with no more than
/// the range of that two of 320,000 were off by more than stated. In draw 808 of seed 20261150 of the search, if accuracies
/// are drawn from 0.01 to 0.1, one was by 1.3 times.
#[test]
fn a_bump_between_the_nodes_of_a_tile_that_is_given_up_is_stated() {
    for (terms, side) in [(Terms::Many, 8.0), (Terms::Many, 16.0), (Terms::Few, 16.0)] {
        let Tally { worst, beyond, .. } =
            tally(side, (terms, 0), |random| Bump::drawn(random, side));
        assert_eq!(beyond, 0, "{terms:?}, {side}: off by up to {worst}");
    }
}

/// Sides of tiles of several pixels, and of parts of pixels.
const SIDES: [f64; 9] = [0.3, 1.2, 1.5, 2.0, 2.5, 3.0, 5.3, 8.0, 11.5];

/// By the last coefficients and points between the nodes, one pixel in 800 is off by more than it may be, by up to 2.3
/// times: edges of a hundredth of the light that run along a tile's side (draw 2513 of seed 20261134 of the search was
/// one). Now the worst is off by 0.7 of what it may be.
#[test]
fn an_edge_through_several_pixels_is_stated() {
    for (terms, side) in TERMS
        .into_iter()
        .flat_map(|terms| SIDES.map(|side| (terms, side)))
    {
        let Tally { worst, beyond, .. } = edges(side, terms, NO_LIMIT);
        assert_eq!(
            beyond, 0,
            "{terms:?}, {side}: off by up to {worst} of what it may be off by"
        );
    }
}

/// Where two edges are equally high, neither is more than half of what a line changes by: one pixel in 1,000 is off by
/// more than it may be on parts of pixels, by up to 2.7 times, and one in 20,000 on larger tiles.
#[test]
fn two_edges_are_stated_but_for_few() {
    for (terms, side) in TERMS
        .into_iter()
        .flat_map(|terms| SIDES.map(|side| (terms, side)))
    {
        let drawn = |random: &mut ChaCha8Rng| Stripe::drawn(random, side);
        let Tally {
            worst, beyond, lit, ..
        } = tally(side, (terms, NO_LIMIT), drawn);
        let (one_in, worst_max) = if side < 1.5 {
            (1_000, 2.7)
        } else {
            (15_000, 1.3)
        };
        assert!(
            beyond * one_in < lit,
            "{terms:?}, {side}: {beyond} of {lit}"
        );
        assert!(worst < worst_max, "{terms:?}, {side}: {worst}");
    }
}

/// Of a pixel that the outline cuts, an edge may change a larger share: of 700,000 pixels three were off by up to 1.3
/// times what they may be off by.
#[test]
fn an_edge_beside_an_outline_is_stated() {
    let mut random = seeded(20_261_128);
    let sides = [1.0, 2.0, 3.0, 5.0, 8.0];
    for (terms, side) in TERMS
        .into_iter()
        .flat_map(|terms| sides.map(|side| (terms, side)))
    {
        let mut tally = Tally::default();
        for _ in 0..(20_000.0 / side) as u32 {
            let mut uniform = || f64::from(random.next_u32()) / f64::from(u32::MAX);
            let corners = [[0.0, 0.0], [0.5, 0.0], [0.5, 0.5], [0.0, 0.5]];
            let corners = corners.map(|corner| corner.map(|at| side * (at + 0.5 * uniform())));
            let mut step = Step::drawn(&mut random);
            step.line[2] *= side;
            tally.add(
                &film(side, Polygon::quadrilateral(corners), terms, NO_LIMIT),
                &step,
            );
        }
        let Tally { worst, beyond, .. } = tally;
        assert_eq!(
            beyond, 0,
            "{terms:?}, {side}: off by up to {worst} of what it may be off by"
        );
    }
}

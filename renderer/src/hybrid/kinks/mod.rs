//! The shares of a tiling, tried on functions with kinks and edges whose integrals are closed forms.
//!
//! What the tests demand holds for their seeds, so that a change shows. These functions are made to be hard, and other
//! seeds show what is rarer: with `BRDFARM_KINKS=N` in the environment N is added to each. Of 72 million pixels with
//! N = 0, 1000, ..., 7000 these were off by more than they state and the tolerance:
//!
//! | function | pixels | by up to, times |
//! | --- | --- | --- |
//! | two parallel edges through a third of a pixel | one in 1,600 | 2.7 |
//! | the same through 1.2 pixels | one in 11,000 | 3.7 |
//! | the same through larger tiles | one in 490,000 | 1.9 |
//! | four kinks, half of them along the tiles' sides | one in 29,000 | 2.1 |
//! | smooth bumps, from a third of the widest gap between nodes on | one in 320,000 | 1.5 |
//! | an edge in a pixel that an outline cuts | one in 1,400,000 | 1.2 |
//! | smooth rises, where every gap is looked at (N = 0) | one in 48,000 | 1.1 |
//! | rules that miss in a corner of a pixel | one in 32,000 | 1.1 |
//! | one edge; other rules; the tip of a disc | none | |

mod bumps;
mod edges;
mod rises;
mod rules;

use super::budget::{Budget, TILING};
use crate::film::canvas::Canvas;
use crate::film::demand::{Demand, Terms};
use crate::film::outline::Outline;
use crate::film::region::Region;
use crate::film::tiling::{Shade, integrate};
use crate::film::{FilmPixel, target};
use crate::numerics::instructions::Instructions;
use crate::numerics::polygon::{Polygon, Rectangle};
use crate::numerics::tolerance::Tolerance;
use dataset::specification::Accuracy;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

/// Random numbers of a test's seed: see above.
fn seeded(seed: u64) -> ChaCha8Rng {
    let more = std::env::var("BRDFARM_KINKS").map_or(0, |more| {
        more.parse().expect("BRDFARM_KINKS is a whole number")
    });
    ChaCha8Rng::seed_from_u64(seed + more)
}

const SIDE: u32 = 48;

/// More evaluations than any of these takes.
const NO_LIMIT: u64 = 1 << 40;

/// For a number from 0 to 1 a direction on the film; in half of the cases along one of its axes.
fn direction(uniform: f64) -> [f64; 2] {
    let turn = 8.0 * uniform;
    let angle = if turn < 4.0 { turn.floor() } else { turn } * std::f64::consts::FRAC_PI_2;
    [libm::cos(angle), libm::sin(angle)]
}

/// A function whose integral over a polygon is a closed form.
trait Exact: Shade {
    fn integral(&self, part: &Polygon) -> f64;
}

/// 1 plus ramps that begin at straight lines.
struct Ramps(Vec<[f64; 3]>);

impl Ramps {
    fn drawn(random: &mut ChaCha8Rng) -> Self {
        let mut uniform = || f64::from(random.next_u32()) / f64::from(u32::MAX);
        let ramp = |_| {
            let normal = direction(uniform());
            let steep = 0.03 * uniform();
            let offset = normal[0] * uniform() + normal[1] * uniform();
            [
                steep * normal[0],
                steep * normal[1],
                -steep * f64::from(SIDE) * offset,
            ]
        };
        Self((0..4).map(ramp).collect())
    }

    fn height([a, b, c]: [f64; 3], [x, y]: [f64; 2]) -> f64 {
        a * x + b * y + c
    }
}

impl Exact for Ramps {
    fn integral(&self, part: &Polygon) -> f64 {
        let mut sum = part.area();
        for &ramp in &self.0 {
            let risen = part.cut(|at| Self::height(ramp, at));
            risen.for_each_point(|at, weight| sum += weight * Self::height(ramp, at));
        }
        sum
    }
}

impl Shade for Ramps {
    type Scratch = ();

    fn at(&self, (): &mut (), at: [f64; 2], _: Tolerance) -> ([f64; 3], u32) {
        let ramps = self.0.iter().map(|&ramp| Self::height(ramp, at).max(0.0));
        ([1.0 + ramps.sum::<f64>(); 3], 1)
    }
}

/// White on a disc, and black outside.
struct Disc {
    centre: [f64; 2],
    radius: f64,
}

impl Disc {
    /// The box around it.
    fn bounds(&self) -> Rectangle {
        Rectangle {
            low: self.centre.map(|at| at - self.radius),
            high: self.centre.map(|at| at + self.radius),
        }
    }
}

impl Exact for Disc {
    /// By the middles of many columns.
    fn integral(&self, part: &Polygon) -> f64 {
        const COLUMNS: u32 = 20_000;
        let Some(shared) = part.bounds().intersection(&self.bounds()) else {
            return 0.0;
        };
        let step = shared.sides()[0] / f64::from(COLUMNS);
        let column = |index: u32| {
            let x = shared.low[0] + step * (f64::from(index) + 0.5);
            let off = x - self.centre[0];
            let half = (self.radius * self.radius - off * off).max(0.0).sqrt();
            let [low, high] = part.chord(0, x).unwrap_or([0.0; 2]);
            let [low, high] = [
                low.max(self.centre[1] - half),
                high.min(self.centre[1] + half),
            ];
            (high - low).max(0.0)
        };
        (0..COLUMNS).map(column).sum::<f64>() * step
    }
}

impl Shade for Disc {
    type Scratch = ();

    fn at(&self, (): &mut (), [x, y]: [f64; 2], _: Tolerance) -> ([f64; 3], u32) {
        let [right, down] = [x - self.centre[0], y - self.centre[1]];
        let inside = right * right + down * down < self.radius * self.radius;
        ([if inside { 1.0 } else { 0.0 }; 3], 1)
    }
}

/// The first rule that functions are worked out by.
const FIRST_RULE: f64 = 1e-5;

const ACCURACY: Accuracy = Accuracy {
    absolute: 1e-4,
    relative: 1e-3,
};

/// A square film, and how a function on it is tiled.
struct Film {
    side: u32,
    outline: Polygon,
    side_max: f64,
    terms: Terms,
    /// Where the function is lit, if not everywhere.
    feature: Option<Rectangle>,
    /// Nothing is refined after so many.
    evaluations_max: u64,
}

/// A film with something everywhere, in tiles as large as it is.
fn whole_film() -> Film {
    let side = f64::from(SIDE);
    Film {
        side: SIDE,
        outline: Polygon::quadrilateral([[0.0, 0.0], [side, 0.0], [side, side], [0.0, side]]),
        side_max: side,
        terms: Terms::Many,
        feature: None,
        evaluations_max: NO_LIMIT,
    }
}

/// What pixels were off by.
#[derive(Default)]
struct Tally {
    /// Those on which there is something of the outline.
    lit: usize,
    /// How many are off by more than they state.
    beyond_stated: usize,
    /// How many are off by more than they state and the tolerance.
    beyond: usize,
    /// The largest error over what is stated or the tolerance.
    worst: f64,
}

impl Tally {
    /// Many pixels, each off by no more than it may be.
    fn expect_stated(&self) {
        assert!(self.lit > 80_000, "{}", self.lit);
        assert_eq!(
            self.beyond, 0,
            "off by up to {} of what is stated",
            self.worst
        );
    }

    fn add(&mut self, film: &Film, function: &impl Exact) {
        let Film { side, outline, .. } = *film;
        let mut pixels = vec![FilmPixel::default(); (side * side) as usize];
        let mut canvas = Canvas {
            width: side,
            height: side,
            pixels: &mut pixels,
        };
        let by_pixel = Outline::new(outline, [side, side]);
        let region = Region {
            outline,
            by_pixel: Some(&by_pixel),
            factor: [1.0; 3],
        };
        let demand = Demand {
            accuracy: &Budget::new(&ACCURACY).chart,
            faint: 0.0,
            terms: film.terms,
            side_max: film.side_max,
            feature: film.feature,
            evaluations_max: film.evaluations_max,
            tolerance: Tolerance::new(FIRST_RULE),
            shares: TILING,
            instructions: Instructions::widest(),
        };
        integrate(&mut canvas, &by_pixel, &[region], &demand, function);
        for (column, row) in outline.bounds().pixels() {
            let pixel = &pixels[(row * side + column) as usize];
            let part = outline.clipped(&Rectangle::pixel(column, row));
            let off = (pixel.value[0] - function.integral(&part)).abs();
            let allowed = target(&ACCURACY, pixel.value).max(pixel.error);
            self.lit += usize::from(!part.is_empty());
            self.beyond_stated += usize::from(off > pixel.error.max(1e-12));
            self.beyond += usize::from(off > allowed);
            self.worst = self.worst.max(off / allowed);
        }
    }
}

/// A bulb's image that reaches over a side of the sample by next to nothing. Between the nodes of thin tiles its tip
/// was missed: a pixel lost a quarter of its light (draw 1570 of seed 20261130 of the search).
#[test]
fn the_tip_of_a_disc_is_found() {
    let side = f64::from(SIDE);
    let mut random = seeded(20_261_130);
    let mut uniform = || f64::from(random.next_u32()) / f64::from(u32::MAX);
    let mut tally = Tally::default();
    for _ in 0..400 {
        let radius = 2.0 + 4.0 * uniform();
        let depth = libm::exp10(-3.0 * uniform());
        let bottom = 30.0 + uniform();
        let disc = Disc {
            centre: [24.0 + uniform(), bottom - depth + radius],
            radius,
        };
        let film = Film {
            side: SIDE,
            outline: Polygon::quadrilateral([
                [0.0, 0.0],
                [side, 0.0],
                [side, bottom],
                [0.0, bottom],
            ]),
            side_max: 3.0 * radius,
            terms: Terms::Many,
            feature: Some(disc.bounds()),
            evaluations_max: NO_LIMIT,
        };
        tally.add(&film, &disc);
    }
    let Tally { beyond, worst, .. } = tally;
    // One is, of a disc that is hardly there; without a look at the long sides 387 were, by up to 1,000 times.
    assert!(beyond <= 1 && worst < 1.6, "{beyond}, by up to {worst}");
}

/// Kinks at places and in directions that no tile knows; half of them run along the tiles' sides, where no
/// averaging helps. The true error of each pixel is known in closed form. With these seeds 12 pixels of 77,800
/// were off by more than the tolerance, by up to 1.3 times as much.
#[test]
fn kinks_are_off_by_no_more_than_stated() {
    for terms in [Terms::Many, Terms::Few] {
        let mut random = seeded(20_261_123);
        let side = f64::from(SIDE);
        let film = Film {
            side: SIDE,
            outline: Polygon::quadrilateral([
                [2.3, 1.6],
                [side - 3.0, 4.0],
                [side - 1.2, side - 2.0],
                [0.7, side - 5.0],
            ]),
            side_max: 16.0,
            terms,
            feature: None,
            evaluations_max: NO_LIMIT,
        };
        let mut tally = Tally::default();
        for _ in 0..40 {
            tally.add(&film, &Ramps::drawn(&mut random));
        }
        let Tally {
            lit,
            beyond_stated,
            beyond,
            worst,
        } = tally;
        assert!(lit > 60_000, "{terms:?}: {lit}");
        assert!(
            beyond_stated * 200 < lit,
            "{terms:?}: {beyond_stated} of {lit}"
        );
        assert!(beyond * 5_000 < lit, "{terms:?}: {beyond} of {lit}");
        assert!(worst < 1.5, "{terms:?}: {worst}");
    }
}

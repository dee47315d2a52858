//! The shares of a tiling, tried on functions with kinks and edges whose integrals are closed forms.

mod edges;

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
use edges::Step;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

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

/// A tenth of white by rules that miss a share of it at one side of the film, and converge slowly: each misses most of
/// what the one before it does, but the last two nothing.
struct Slow {
    missed: f64,
    kept: f64,
    /// How fast it falls away from the side, a pixel.
    fall: f64,
}

impl Slow {
    const VALUE: f64 = 0.1;
}

impl Exact for Slow {
    fn integral(&self, part: &Polygon) -> f64 {
        Self::VALUE * part.area()
    }
}

impl Shade for Slow {
    type Scratch = ();

    fn at(&self, (): &mut (), [_, row]: [f64; 2], tolerance: Tolerance) -> ([f64; 3], u32) {
        let level = tolerance.level();
        let kept = if level + 1 < self.finest_level() {
            libm::pow(self.kept, f64::from(level))
        } else {
            0.0
        };
        let missed = self.missed * kept * libm::exp(-self.fall * row);
        ([Self::VALUE + missed; 3], 1)
    }

    fn is_uneven(&self) -> bool {
        true
    }
}

/// The same, and an edge.
struct SlowStep {
    slow: Slow,
    step: Step,
}

impl Exact for SlowStep {
    fn integral(&self, part: &Polygon) -> f64 {
        self.slow.integral(part) + self.step.integral(part)
    }
}

impl Shade for SlowStep {
    type Scratch = ();

    fn at(&self, (): &mut (), at: [f64; 2], tolerance: Tolerance) -> ([f64; 3], u32) {
        let ([slow, ..], _) = self.slow.at(&mut (), at, tolerance);
        let ([step, ..], _) = self.step.at(&mut (), at, tolerance);
        ([slow + step; 3], 1)
    }

    fn is_uneven(&self) -> bool {
        true
    }
}

/// A tenth of white by rules of two kinds, and what those of each level miss.
struct TwoKinds<const LEVELS: usize> {
    missed: [f64; LEVELS],
    changes_at: u32,
}

impl<const LEVELS: usize> Exact for TwoKinds<LEVELS> {
    fn integral(&self, part: &Polygon) -> f64 {
        Slow::VALUE * part.area()
    }
}

impl<const LEVELS: usize> Shade for TwoKinds<LEVELS> {
    type Scratch = ();

    fn at(&self, (): &mut (), _: [f64; 2], tolerance: Tolerance) -> ([f64; 3], u32) {
        let missed = self.missed[tolerance.level() as usize];
        ([Slow::VALUE + missed; 3], 1)
    }

    fn finest_level(&self) -> u32 {
        LEVELS as u32 - 1
    }

    fn kind_changes_at(&self) -> Option<u32> {
        Some(self.changes_at)
    }
}

/// A tenth of white by rules of one kind, to which more digits mean nothing until they are many. What those of each
/// level miss, and what one of the first level that is only a little finer misses.
struct Sudden {
    missed: [f64; 3],
    a_little_finer: f64,
}

/// The first of its rules.
const FIRST_RULE: f64 = 1e-5;

impl Exact for Sudden {
    fn integral(&self, part: &Polygon) -> f64 {
        Slow::VALUE * part.area()
    }
}

impl Shade for Sudden {
    type Scratch = ();

    fn at(&self, (): &mut (), _: [f64; 2], tolerance: Tolerance) -> ([f64; 3], u32) {
        let is_finer = tolerance.is_finer_than(Tolerance::new(FIRST_RULE));
        let missed = match tolerance.level() {
            0 if is_finer => self.a_little_finer,
            level => self.missed[level as usize],
        };
        ([Slow::VALUE + missed; 3], 1)
    }

    fn finest_level(&self) -> u32 {
        2
    }

    fn kind_changes_at(&self) -> Option<u32> {
        Some(3)
    }
}

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

/// A rule that was refined is no better for agreeing with the next one: both missed 5 percent of a point's light in the
/// far tail of a lobe, and agreed to 1e-9 of white (draw 2790 of seed 20261136 of the search).
#[test]
fn rules_that_agree_once_they_are_refined_are_found_out() {
    for missed in [2e-4, 1e-3, 1e-2] {
        let function = Sudden {
            missed: [4.0 * missed, missed, 0.0],
            a_little_finer: missed + 1e-9,
        };
        let mut tally = Tally::default();
        tally.add(&whole_film(), &function);
        assert_eq!(tally.beyond, 0, "{missed}: {}", tally.worst);
    }
}

/// A bulb's image that reaches over a side of the sample by next to nothing. Between the nodes of thin tiles its tip
/// was missed: a pixel lost a quarter of its light (draw 1570 of seed 20261130 of the search).
#[test]
fn the_tip_of_a_disc_is_found() {
    let side = f64::from(SIDE);
    let mut random = ChaCha8Rng::seed_from_u64(20_261_130);
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

/// What a rule differs from the next finer one by may be a fraction of what it misses. Next to the chart it was up to
/// 4.5 times as much, in the corners of tiles in whose middle nothing showed.
#[test]
fn a_rule_that_converges_slowly_is_found_out() {
    let film = whole_film();
    let mut random = ChaCha8Rng::seed_from_u64(20_261_127);
    let mut uniform = || f64::from(random.next_u32()) / f64::from(u32::MAX);
    let mut tally = Tally::default();
    for _ in 0..60 {
        let slow = Slow {
            missed: 1e-4 * libm::exp10(uniform()),
            kept: 0.78 * uniform(),
            fall: 0.5 * uniform(),
        };
        tally.add(&film, &slow);
    }
    let Tally {
        beyond, worst, lit, ..
    } = tally;
    assert!(lit > 100_000, "{lit}");
    assert_eq!(beyond, 0, "off by up to {worst} of what is stated");
}

/// The same on pixels with an edge, which no tile serves. Their rule was chosen in the middle (draw 1929 of seed
/// 20261132 of the search): 819 of these were off by up to seven times what they stated.
#[test]
fn a_rule_that_misses_in_a_corner_of_a_pixel_is_found_out() {
    let mut random = ChaCha8Rng::seed_from_u64(20_261_132);
    let film = Film {
        side: 1,
        outline: Polygon::quadrilateral([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]),
        side_max: 1.0,
        ..whole_film()
    };
    let mut tally = Tally::default();
    for _ in 0..2_000 {
        let step = Step::drawn(&mut random);
        let mut uniform = || f64::from(random.next_u32()) / f64::from(u32::MAX);
        let slow = Slow {
            missed: 1e-2 * libm::exp10(uniform()),
            kept: 0.78 * uniform(),
            fall: 6.0 + 8.0 * uniform(),
        };
        tally.add(&film, &SlowStep { slow, step });
    }
    let Tally { beyond, worst, .. } = tally;
    assert_eq!(beyond, 0, "off by up to {worst} of what is stated");
}

/// Where finer rules of another kind have not converged, those that have are the better ones: the finest was off by
/// more than it stated (draw 2406 of seed 20261130 of the search). Which kind is the right one does not matter, as
/// long as the other one's rules do not agree by chance.
#[test]
fn the_kind_of_rule_that_converges_is_believed() {
    let mut random = ChaCha8Rng::seed_from_u64(20_261_130);
    let mut uniform = || f64::from(random.next_u32()) / f64::from(u32::MAX);
    let film = whole_film();
    let mut tallies = [Tally::default(), Tally::default()];
    for _ in 0..20 {
        // The other kind's errors, of either sign, and the right one's first: its second has none.
        let mut sign = || if uniform() < 0.5 { -1.0 } else { 1.0 };
        let [first, second] = [sign(), sign()];
        let wrong = 0.01 + 0.02 * uniform();
        let wrong = [first * wrong, second * wrong * (0.1 + 0.7 * uniform())];
        let right = 5e-5 * (1.0 + 2.0 * uniform());
        for (kind, tally) in tallies.iter_mut().enumerate() {
            let missed = match kind {
                0 => [right, 0.0, wrong[0], wrong[1]],
                _ => [wrong[0], wrong[1], right, 0.0],
            };
            let kinds = TwoKinds {
                missed,
                changes_at: 2,
            };
            tally.add(&film, &kinds);
        }
    }
    for (kind, tally) in tallies.iter().enumerate() {
        let Tally {
            lit, beyond, worst, ..
        } = tally;
        assert!(*lit > 40_000, "{lit}");
        assert_eq!(
            *beyond, 0,
            "kind {kind}: off by up to {worst} of what is stated"
        );
    }
}

/// Two rules that follow each other may agree by chance where both are far off. The finest of their kind shows it, if
/// what they differ by is not far below what may be missed.
#[test]
fn rules_that_agree_by_chance_are_found_out() {
    let mut random = ChaCha8Rng::seed_from_u64(20_261_131);
    let mut uniform = || f64::from(random.next_u32()) / f64::from(u32::MAX);
    let film = whole_film();
    let mut tally = Tally::default();
    for _ in 0..40 {
        let missed = 1e-4 * libm::exp10(2.0 * uniform());
        let differ = 6e-6 + 2.4e-5 * uniform();
        let chance = TwoKinds {
            missed: [missed, missed - differ, 0.0, 0.0],
            changes_at: 3,
        };
        tally.add(&film, &chance);
    }
    tally.expect_stated();
}

/// Next to the chart polynomials converge slowly, and where no rule of wide lobes follows the finest of them misses
/// several times what it differs from its neighbour by (draw 1929 of seed 20261132 of the search).
#[test]
fn the_finest_of_slow_polynomials_states_what_it_misses() {
    let mut random = ChaCha8Rng::seed_from_u64(20_261_132);
    let mut uniform = || f64::from(random.next_u32()) / f64::from(u32::MAX);
    let film = whole_film();
    let mut tally = Tally::default();
    for _ in 0..40 {
        let finest = 1e-3 * libm::exp10(uniform());
        let share = 3.5 + 2.2 * uniform();
        let missed = [
            finest * (1.0 + 2.5 / share),
            finest * (1.0 + 1.0 / share),
            finest,
        ];
        let slow = TwoKinds {
            missed,
            changes_at: 3,
        };
        tally.add(&film, &slow);
    }
    tally.expect_stated();
}

/// Kinks at places and in directions that no tile knows; half of them run along the tiles' sides, where no
/// averaging helps. The true error of each pixel is known in closed form. With these seeds 8 pixels of 77,800
/// were off by more than the tolerance, by up to 1.2 times as much.
#[test]
fn kinks_are_off_by_no_more_than_stated() {
    for terms in [Terms::Many, Terms::Few] {
        let mut random = ChaCha8Rng::seed_from_u64(20_261_123);
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

//! Rules that miss more than they show, of which the true value is known.

use super::edges::Step;
use super::{Exact, FIRST_RULE, Film, Tally, seeded, whole_film};
use crate::film::tiling::Shade;
use crate::numerics::polygon::Polygon;
use crate::numerics::tolerance::Tolerance;
use rand_chacha::rand_core::Rng;

/// A tenth of white by rules that miss a share of it at one side of the film, and converge slowly: each misses most of
/// what the one before it does, but the last two nothing.
struct Slow {
    missed: f64,
    kept: f64,
    /// How fast it falls away from the side, a pixel.
    fall: f64,
    /// Whether it says so. If not, it says that rules of another kind might follow.
    is_uneven: bool,
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

    fn kind_changes_at(&self) -> Option<u32> {
        (!self.is_uneven).then_some(self.finest_level() + 1)
    }

    fn is_uneven(&self) -> bool {
        self.is_uneven
    }
}

/// A function by rules, and an edge.
struct WithStep<F> {
    function: F,
    step: Step,
}

impl<F: Exact<Scratch = ()>> Exact for WithStep<F> {
    fn integral(&self, part: &Polygon) -> f64 {
        self.function.integral(part) + self.step.integral(part)
    }
}

impl<F: Shade<Scratch = ()>> Shade for WithStep<F> {
    type Scratch = ();

    fn at(&self, (): &mut (), at: [f64; 2], tolerance: Tolerance) -> ([f64; 3], u32) {
        let ([value, ..], _) = self.function.at(&mut (), at, tolerance);
        let ([step, ..], _) = self.step.at(&mut (), at, tolerance);
        ([value + step; 3], 1)
    }

    fn finest_level(&self) -> u32 {
        self.function.finest_level()
    }

    fn kind_changes_at(&self) -> Option<u32> {
        self.function.kind_changes_at()
    }

    fn is_uneven(&self) -> bool {
        self.function.is_uneven()
    }
}

/// A tenth of white by rules of two kinds, and what those of each level miss.
struct TwoKinds<const LEVELS: usize> {
    missed: [f64; LEVELS],
    changes_at: u32,
    /// How fast what the first kind misses falls away from a side of the film, a pixel.
    fall: f64,
}

impl<const LEVELS: usize> Exact for TwoKinds<LEVELS> {
    fn integral(&self, part: &Polygon) -> f64 {
        Slow::VALUE * part.area()
    }
}

impl<const LEVELS: usize> Shade for TwoKinds<LEVELS> {
    type Scratch = ();

    fn at(&self, (): &mut (), [_, row]: [f64; 2], tolerance: Tolerance) -> ([f64; 3], u32) {
        let level = tolerance.level();
        let is_first = level < self.changes_at;
        let share = if is_first {
            libm::exp(-self.fall * row)
        } else {
            1.0
        };
        let missed = share * self.missed[level as usize];
        ([Slow::VALUE + missed; 3], 1)
    }

    fn finest_level(&self) -> u32 {
        LEVELS as u32 - 1
    }

    fn kind_changes_at(&self) -> Option<u32> {
        Some(self.changes_at)
    }

    fn is_uneven(&self) -> bool {
        self.fall > 0.0
    }
}

/// A tenth of white by rules of one kind, to which more digits mean nothing until they are many. What those of each
/// level miss, and what one of the first level that is only a little finer misses.
struct Sudden {
    missed: [f64; 3],
    a_little_finer: f64,
}

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

/// A film of one pixel, all of it covered.
fn one_pixel() -> Film {
    Film {
        side: 1,
        outline: Polygon::quadrilateral([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]),
        side_max: 1.0,
        ..whole_film()
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

/// What a rule differs from the next finer one by may be a fraction of what it misses. Next to the chart it was up to
/// 4.5 times as much, in the corners of tiles in whose middle nothing showed.
#[test]
fn a_rule_that_converges_slowly_is_found_out() {
    let film = whole_film();
    let mut random = seeded(20_261_127);
    let mut uniform = || f64::from(random.next_u32()) / f64::from(u32::MAX);
    let mut tally = Tally::default();
    for _ in 0..60 {
        let slow = Slow {
            missed: 1e-4 * libm::exp10(uniform()),
            kept: 0.78 * uniform(),
            fall: 0.5 * uniform(),
            is_uneven: true,
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
/// 20261132 of the search): 819 of 2,000 were off by up to seven times what they stated. Half of these are said not to be
/// uneven: their corners were not looked at (draw 1663 of seed 20261150).
#[test]
fn a_rule_that_misses_in_a_corner_of_a_pixel_is_found_out() {
    let mut random = seeded(20_261_132);
    let film = one_pixel();
    let mut tally = Tally::default();
    for index in 0..4_000 {
        let step = Step::drawn(&mut random);
        let mut uniform = || f64::from(random.next_u32()) / f64::from(u32::MAX);
        let slow = Slow {
            missed: 1e-2 * libm::exp10(uniform()),
            kept: 0.78 * uniform(),
            fall: 6.0 + 8.0 * uniform(),
            is_uneven: index % 2 == 0,
        };
        let function = slow;
        tally.add(&film, &WithStep { function, step });
    }
    let Tally { beyond, worst, .. } = tally;
    assert_eq!(beyond, 0, "off by up to {worst} of what is stated");
}

/// Where finer rules of another kind have not converged, those that have are the better ones: the finest was off by
/// more than it stated (draw 2406 of seed 20261130 of the search). Which kind is the right one does not matter, as
/// long as the other one's rules do not agree by chance.
#[test]
fn the_kind_of_rule_that_converges_is_believed() {
    let mut random = seeded(20_261_130);
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
                fall: 0.0,
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

/// Two kinds of rules, of which the second's have not converged: they differ by 1.6 to 32 percent of what they miss.
fn with_a_wrong_kind(uniform: &mut dyn FnMut() -> f64) -> TwoKinds<4> {
    let wrong = 0.01 + 0.02 * uniform();
    let differ = libm::exp10(-1.8 + 1.3 * uniform());
    let right = 5e-5 * (1.0 + 2.0 * uniform());
    TwoKinds {
        missed: [right, 0.3 * right, wrong * (1.0 + differ), wrong],
        changes_at: 2,
        fall: 0.0,
    }
}

/// The finest two rules may agree by chance to some percent of what they miss, where the other kind's are right (draw
/// 1783 of seed 20261151 of the search).
#[test]
fn the_finest_rule_states_what_the_other_kind_tells() {
    let mut random = seeded(20_261_151);
    let mut uniform = || f64::from(random.next_u32()) / f64::from(u32::MAX);
    let film = whole_film();
    let mut tally = Tally::default();
    for _ in 0..40 {
        tally.add(&film, &with_a_wrong_kind(&mut uniform));
    }
    tally.expect_stated();
}

/// The same on pixels with an edge, where only a corner asks for finer rules than the first.
#[test]
fn the_rule_of_a_pixel_states_what_the_other_kind_tells() {
    expect_stated_on_pixels(20_261_152, 20.0, with_a_wrong_kind);
}

/// Two kinds of rules on pixels with an edge. What the first kind misses is so many times what was drawn, and falls
/// away from one side.
fn expect_stated_on_pixels(
    seed: u64,
    times: f64,
    drawn: impl Fn(&mut dyn FnMut() -> f64) -> TwoKinds<4>,
) {
    let mut random = seeded(seed);
    let film = one_pixel();
    let mut tally = Tally::default();
    for _ in 0..2_000 {
        let step = Step::drawn(&mut random);
        let mut uniform = || f64::from(random.next_u32()) / f64::from(u32::MAX);
        let mut function = drawn(&mut uniform);
        function.missed[0] *= times;
        function.fall = 6.0 + 8.0 * uniform();
        tally.add(&film, &WithStep { function, step });
    }
    let Tally { beyond, worst, .. } = tally;
    assert_eq!(beyond, 0, "off by up to {worst} of what is stated");
}

/// Two kinds of rules, of which the first shows to miss a little too much. The second's are far off, and agree by chance
/// to 2 percent of that and more: better than a tile asks for.
fn with_a_kind_that_agrees_by_chance(uniform: &mut dyn FnMut() -> f64) -> TwoKinds<4> {
    let wrong = 5e-4 * libm::exp10(0.4 * uniform());
    let differ = wrong * (0.02 + 0.004 * uniform());
    let right = 5e-5 * (1.0 + uniform());
    TwoKinds {
        missed: [right, 0.3 * right, wrong + differ, wrong],
        changes_at: 2,
        fall: 0.0,
    }
}

/// Rules of the second kind that agree well enough state what the other kind tells, where what that one shows to miss
/// does not explain how far the kinds are apart: they were off by up to 5.6 times what they stated.
#[test]
fn rules_of_the_second_kind_that_agree_by_chance_are_found_out() {
    let mut random = seeded(20_261_153);
    let mut uniform = || f64::from(random.next_u32()) / f64::from(u32::MAX);
    let film = whole_film();
    let mut tally = Tally::default();
    for _ in 0..40 {
        tally.add(&film, &with_a_kind_that_agrees_by_chance(&mut uniform));
    }
    tally.expect_stated();
}

/// The same on pixels with an edge, where only a corner asks for rules of the second kind.
#[test]
fn rules_of_a_pixel_that_agree_by_chance_are_found_out() {
    expect_stated_on_pixels(20_261_154, 1.5, with_a_kind_that_agrees_by_chance);
}

/// Two rules that follow each other may agree by chance where both are far off. The finest of their kind shows it, if
/// what they differ by is not far below what may be missed.
#[test]
fn rules_that_agree_by_chance_are_found_out() {
    let mut random = seeded(20_261_131);
    let mut uniform = || f64::from(random.next_u32()) / f64::from(u32::MAX);
    let film = whole_film();
    let mut tally = Tally::default();
    for _ in 0..40 {
        let missed = 1e-4 * libm::exp10(2.0 * uniform());
        let differ = 6e-6 + 2.4e-5 * uniform();
        let chance = TwoKinds {
            missed: [missed, missed - differ, 0.0, 0.0],
            changes_at: 3,
            fall: 0.0,
        };
        tally.add(&film, &chance);
    }
    tally.expect_stated();
}

/// Next to the chart polynomials converge slowly, and where no rule of wide lobes follows the finest of them misses
/// several times what it differs from its neighbour by (draw 1929 of seed 20261132 of the search).
#[test]
fn the_finest_of_slow_polynomials_states_what_it_misses() {
    let mut random = seeded(20_261_132);
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
            fall: 0.0,
        };
        tally.add(&film, &slow);
    }
    tally.expect_stated();
}

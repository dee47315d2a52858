//! The flank of a streak along the limb of a curved sample.
//!
//! Where a streak runs along the limb and over it, its middle is beside the sample and one flank still on it: a band
//! along the limb, a thousandth of a pixel deep. It is looked for all along the limb.

use super::footprint::{Area, Outline};
use super::seen::{OUTWARD, Seen, seen_toward};

/// Places of a pixel's border toward which the limb is looked for. Chosen.
const AROUND: usize = 64;

/// Places of the limb between two of these, where a flank is. Chosen.
const PIECES: usize = 8;

/// Halvings by which the limb is found: a band may be a millionth of a pixel deep.
const LIMB_STEPS: usize = 40;

/// Halvings by which a flank's ends are found, and one that is shorter than the way between two places. Chosen.
const SHARE_STEPS: usize = 24;

/// The least and the largest depth of a band that is looked for, as a share of the way to the pixel's middle.
const DEPTHS: [f64; 2] = [1e-7, 0.25];

/// By how much depths that are looked at grow.
const DEEPER: f64 = 2.0;

/// How far a band reaches over the limb, as a share of its depth and of its length: the limb bends. Chosen.
const OVER: [f64; 2] = [0.1, 0.05];

/// A place of the limb.
#[derive(Clone, Copy)]
struct Limb {
    at: [f64; 2],
    slope: f64,
    reach: f64,
}

impl Limb {
    /// Toward a place; `None` where that is on the sample, too.
    fn toward(seen: &impl Seen, middle: [f64; 2], to: [f64; 2]) -> Option<Self> {
        if seen.slope(to).is_some() {
            return None;
        }
        let at = seen_toward(seen, [middle, to], LIMB_STEPS);
        let (slope, reach) = (seen.slope(at)?, seen.reach(at)?);
        Some(Self { at, slope, reach })
    }

    /// By how much the slope is too large for light; below 0 where there is some.
    fn unlit(&self) -> f64 {
        self.slope.abs() - self.reach
    }

    fn is_lit(&self) -> bool {
        self.unlit() < 0.0
    }
}

/// The limb as it is seen from a place on the sample, by what share of the way around the pixel's border one looks at.
struct Around<'a, S> {
    seen: &'a S,
    area: &'a Area,
    middle: [f64; 2],
}

impl<S: Seen> Around<'_, S> {
    fn limb(&self, share: f64) -> Option<Limb> {
        Limb::toward(self.seen, self.middle, border(self.area.bounds(), share))
    }

    /// The last share at which something holds of the limb, on the way from one where it does to one where it does not.
    fn last(&self, [mut from, mut to]: [f64; 2], holds: impl Fn(&Limb) -> bool) -> f64 {
        for _ in 0..SHARE_STEPS {
            let between = 0.5 * (from + to);
            if self.limb(between).is_some_and(|limb| holds(&limb)) {
                from = between;
            } else {
                to = between;
            }
        }
        from
    }

    /// Where a flank may be between two shares, at which the limb is this.
    fn lit_between(&self, [from, to]: [f64; 2], ends: [Option<Limb>; 2]) -> Option<[f64; 2]> {
        match ends {
            [Some(first), Some(last)] => is_flank([first, last]).then_some([from, to]),
            // The limb leaves the pixel.
            [Some(_), None] => Some([from, self.last([from, to], |_| true)]),
            [None, Some(_)] => Some([self.last([to, from], |_| true), to]),
            [None, None] => None,
        }
    }

    /// Where a flank is that is shorter than the way between two places, if the limb is nearest to being lit at the
    /// middle one of three.
    fn short(&self, shares: [f64; 3], limbs: [Limb; 3]) -> Option<[f64; 2]> {
        let [before, middle, after] = limbs.map(|limb| limb.unlit());
        let is_least = middle > 0.0 && middle <= before && middle <= after;
        let [first, _, last] = limbs;
        if !is_least || (first.slope < 0.0) != (last.slope < 0.0) {
            return None;
        }
        let [mut low, mut at, mut high] = shares;
        let mut least = middle;
        for step in 0..SHARE_STEPS {
            let is_low = step % 2 == 0;
            let next = 0.5 * (at + if is_low { low } else { high });
            let unlit = self.limb(next)?.unlit();
            if unlit < least {
                (low, high) = if is_low { (low, at) } else { (at, high) };
                (at, least) = (next, unlit);
            } else if is_low {
                low = next;
            } else {
                high = next;
            }
            if least < 0.0 {
                return Some([shares[0], shares[2]].map(|end| self.last([at, end], Limb::is_lit)));
            }
        }
        None
    }

    /// The bands between two shares.
    fn bands(&self, [from, to]: [f64; 2]) -> Vec<(Area, f64)> {
        let pieces = (0..=PIECES).map(|piece| from + (to - from) * piece as f64 / PIECES as f64);
        let limbs: Vec<Limb> = pieces.filter_map(|share| self.limb(share)).collect();
        let of_pair = |pair: &[Limb]| band(self.seen, self.area, self.middle, [pair[0], pair[1]]);
        limbs.windows(2).filter_map(of_pair).collect()
    }
}

/// Whether there may be a flank between two places of the limb.
fn is_flank([first, last]: [Limb; 2]) -> bool {
    let crosses = (first.slope < 0.0) != (last.slope < 0.0);
    first.is_lit() || last.is_lit() || crosses
}

/// The bands along the limb in the part of a pixel that sees the sample, and how bright they are, in units of white.
/// `middle` is a place of it on the sample.
pub fn of(seen: &impl Seen, area: &Area, middle: [f64; 2]) -> Vec<(Area, f64)> {
    let around = Around { seen, area, middle };
    let share = |step: usize| step as f64 / AROUND as f64;
    let limbs: Vec<Option<Limb>> = (0..AROUND).map(|step| around.limb(share(step))).collect();
    let limb = |step: usize| limbs[step % AROUND];
    let parts = (0..AROUND).filter_map(|step| {
        let ends = [step, step + 1];
        around.lit_between(ends.map(share), ends.map(limb))
    });
    let short = (0..AROUND).filter_map(|step| {
        let places = [step, step + 1, step + 2];
        let [Some(before), Some(middle), Some(after)] = places.map(limb) else {
            return None;
        };
        around.short(places.map(share), [before, middle, after])
    });
    parts
        .chain(short)
        .flat_map(|part| around.bands(part))
        .collect()
}

/// A place somewhat outside of a rectangle's border, `share` of the way around.
fn border([least, largest]: [[f64; 2]; 2], share: f64) -> [f64; 2] {
    let around = 4.0 * share;
    let along = around.fract();
    let [x, y] = match around as usize % 4 {
        0 => [along, 0.0],
        1 => [1.0, along],
        2 => [1.0 - along, 1.0],
        _ => [0.0, 1.0 - along],
    };
    let outward = |x: f64| x + OUTWARD * (2.0 * x - 1.0);
    [
        least[0] + (largest[0] - least[0]) * outward(x),
        least[1] + (largest[1] - least[1]) * outward(y),
    ]
}

/// The band between two places of the limb.
fn band(
    seen: &impl Seen,
    area: &Area,
    middle: [f64; 2],
    [from, to]: [Limb; 2],
) -> Option<(Area, f64)> {
    if !is_flank([from, to]) {
        return None;
    }
    let lit = if from.slope.abs() < to.slope.abs() {
        from
    } else {
        to
    };
    let inward = [0, 1].map(|axis| middle[axis] - lit.at[axis]);
    let below = |at: [f64; 2], depth: f64| [0, 1].map(|axis| at[axis] + depth * inward[axis]);
    let mut depth = DEPTHS[0];
    let mut bright = seen.brightness(lit.at);
    while depth < DEPTHS[1] {
        let at = below(lit.at, depth);
        bright = bright.max(seen.brightness(at));
        if seen.slope(at)?.abs() > seen.reach(at)? {
            break;
        }
        depth *= DEEPER;
    }
    let chord = [0, 1].map(|axis| to.at[axis] - from.at[axis]);
    let length = libm::hypot(chord[0], chord[1]) / libm::hypot(inward[0], inward[1]);
    let over = -(OVER[0] * depth + OVER[1] * length);
    let places = [
        below(from.at, over),
        below(to.at, over),
        below(to.at, depth),
        below(from.at, depth),
    ];
    let corners = places.map(|[column, row]| [column, row, 1.0]).to_vec();
    let band = Outline::of_corners(corners).within(area.bounds())?;
    (bright > 0.0).then_some((band, bright))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::path::strips::tests::{pixel, uniform};
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::SeedableRng;
    use std::f64::consts::TAU;

    /// A sample that ends at a circle, and a streak along another one, whose middle is beside the sample.
    struct Rim {
        limb: f64,
        /// The middle of the streak's circle.
        centre: [f64; 2],
        radius: f64,
        half_width: f64,
        /// In which direction from the limb's middle the flank is deepest, and to how far on either side it reaches.
        deepest: f64,
        spread: f64,
    }

    /// The middle of the limb's circle.
    const BELOW: [f64; 2] = [0.5, -1.0];

    impl Rim {
        /// The middle of the streak is `beyond` the limb where it is nearest, and its flank `depth` deep. Its circle is
        /// larger than the limb by a little more than `larger`.
        fn of(limb: f64, deepest: f64, larger: f64, [beyond, depth]: [f64; 2]) -> Self {
            let (sin, cos) = libm::sincos(deepest);
            Self {
                limb,
                centre: [BELOW[0] - larger * cos, BELOW[1] - larger * sin],
                radius: limb + larger + beyond,
                half_width: beyond + depth,
                deepest,
                spread: (2.0 * depth / larger).sqrt().min(0.4),
            }
        }
    }

    impl Seen for Rim {
        fn slope(&self, [x, y]: [f64; 2]) -> Option<f64> {
            let [on, off] =
                [BELOW, self.centre].map(|centre| libm::hypot(x - centre[0], y - centre[1]));
            (on <= self.limb).then_some(off - self.radius)
        }

        fn reach(&self, _: [f64; 2]) -> Option<f64> {
            Some(self.half_width)
        }

        fn brightness(&self, at: [f64; 2]) -> f64 {
            f64::from(
                self.slope(at)
                    .is_some_and(|slope| slope.abs() < self.half_width),
            )
        }
    }

    /// The middle of the streak is nowhere on the sample, and its flank is a millionth to a hundredth of a pixel deep.
    #[test]
    fn bands_hold_the_flank() {
        let area = pixel();
        let mut random = ChaCha8Rng::seed_from_u64(29);
        let mut draws = || uniform(&mut random);
        let (mut looked_at, mut missed) = (0u32, 0u32);
        for draw in 0..300 {
            let depth = libm::exp10(-2.0 - 4.0 * draws());
            let beyond = depth * libm::exp10(2.0 * draws() - 1.0);
            let deepest = TAU * (0.25 + 0.1 * (draws() - 0.5));
            let larger = libm::exp10(-4.0 * draws());
            let rim = Rim::of(1.2 + 0.7 * draws(), deepest, larger, [beyond, depth]);
            let bands = of(&rim, &area, [0.5, 0.05]);
            let mut inside = 0;
            for _ in 0..2_000 {
                let along = rim.deepest + rim.spread * (2.0 * draws() - 1.0);
                let (sin, cos) = libm::sincos(along);
                let from_middle = rim.limb - depth * draws();
                let at = [BELOW[0] + from_middle * cos, BELOW[1] + from_middle * sin];
                let is_seen = at.iter().all(|at| (0.0..1.0).contains(at));
                if is_seen && rim.brightness(at) > 0.0 {
                    inside += 1;
                    missed += u32::from(!bands.iter().any(|(band, _)| band.holds(at)));
                }
            }
            looked_at += inside;
            let size: f64 = bands.iter().map(|(band, _)| band.size()).sum();
            assert!(
                size < 3.0 * depth + 0.01,
                "draw {draw}: bands of {size}, {depth} deep"
            );
        }
        assert!(looked_at > 10_000, "{looked_at}");
        assert!(missed * 10_000 < looked_at, "{missed} of {looked_at}");
    }
}

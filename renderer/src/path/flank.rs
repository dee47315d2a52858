//! The flank of a streak along the limb of a curved sample.
//!
//! Where a streak runs along the limb and over it, its middle is beside the sample and one flank still on it: a band
//! along the limb, a thousandth of a pixel deep. It is looked for all along the limb.

use super::footprint::{Area, Outline};
use super::strips::{OUTWARD, Seen, seen_toward};

/// Places of a pixel's border toward which the limb is looked for. Chosen.
const AROUND: usize = 64;

/// Places of the limb between two of these, where a flank is. Chosen.
const PIECES: usize = 8;

/// Halvings by which the limb is found: a band may be a millionth of a pixel deep.
const LIMB_STEPS: usize = 40;

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

    fn is_lit(&self) -> bool {
        self.slope.abs() < self.reach
    }
}

/// The bands along the limb in the part of a pixel that sees the sample, and how bright they are, in units of white.
/// `middle` is a place of it on the sample.
pub fn of(seen: &impl Seen, area: &Area, middle: [f64; 2]) -> Vec<(Area, f64)> {
    let bounds = area.bounds();
    let at_border = |step: usize| border(bounds, step as f64 / AROUND as f64);
    let toward = |to: [f64; 2]| Limb::toward(seen, middle, to);
    let limbs: Vec<Option<Limb>> = (0..AROUND).map(|step| toward(at_border(step))).collect();
    let mut bands = Vec::new();
    for step in 0..AROUND {
        let (Some(first), Some(last)) = (limbs[step], limbs[(step + 1) % AROUND]) else {
            continue;
        };
        let crosses = (first.slope < 0.0) != (last.slope < 0.0);
        if !(first.is_lit() || last.is_lit() || crosses) {
            continue;
        }
        let [from, to] = [at_border(step), at_border(step + 1)];
        let pieces = (0..=PIECES).map(|piece| {
            let share = piece as f64 / PIECES as f64;
            toward([0, 1].map(|axis| from[axis] + (to[axis] - from[axis]) * share))
        });
        let pieces: Vec<Limb> = pieces.flatten().collect();
        let of_pair = |pair: &[Limb]| band(seen, area, middle, [pair[0], pair[1]]);
        bands.extend(pieces.windows(2).filter_map(of_pair));
    }
    bands
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
    let crosses = (from.slope < 0.0) != (to.slope < 0.0);
    if !(from.is_lit() || to.is_lit() || crosses) {
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

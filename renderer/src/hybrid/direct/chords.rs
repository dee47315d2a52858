//! Chords of the ellipse of half vectors that see the bulb, worked out side by side.

use crate::numerics::batch::LANES;
use crate::numerics::instructions::kernel;
use crate::numerics::tolerance::Tolerance;
use crate::reflectance::slope_plane::crossings;
use crate::vector::Vec3;

/// Cosines of the light's direction at which the integrand bends: how many there are.
pub const LEVELS: usize = 3;

/// Points more for what multiplies the lobe: min(1, cos_i/cos_o), the tint and the Jacobian.
pub const MORE_POINTS: f64 = 0.8;

/// The ellipse of half vectors that see the bulb, by its centre, its half extent along p, and its
/// chords across: at p + `radius` sin the chord runs over q + `slant` sin -/+ `half_chord` cos.
pub struct Disc {
    pub p: f64,
    pub q: f64,
    pub radius: f64,
    pub slant: f64,
    pub half_chord: f64,
}

impl Disc {
    /// The half extent along q.
    pub fn height(&self) -> f64 {
        self.half_chord + self.slant.abs()
    }
}

/// Where the lobe's exponent, as a quadratic form, counts.
#[derive(Clone, Copy)]
pub struct Depth {
    /// The angle of the chord that is nearest to the lobe's centre.
    pub nearest: f64,
    /// The exponent there: the least on the bulb.
    pub least: f64,
    /// What is above this is left out.
    pub most: f64,
}

/// A number for each chord.
pub type Lanes = [f64; LANES];

/// Chords: the sine and cosine of their angles, and the weights of these.
#[derive(Default)]
pub struct Angles {
    pub sin: Lanes,
    pub cos: Lanes,
    pub weight: Lanes,
}

/// What counts of chords.
pub struct Chords {
    /// Where they are.
    pub p: Lanes,
    /// Their ends. The one is not below the other where nothing counts.
    pub low: Lanes,
    pub high: Lanes,
    /// What their points' weights are multiplied by.
    pub scale: Lanes,
    /// How many points they take as one piece, before this is rounded up.
    pub points: Lanes,
}

/// Chords in pieces between which the integrand bends; most of the pieces have no length.
pub struct Pieces {
    /// Their ends, in rising order.
    pub ends: [Lanes; PIECES + 1],
    /// How many points they take, before this is rounded up.
    pub points: [Lanes; PIECES],
}

/// How many pieces there are: each level is crossed at most twice.
pub const PIECES: usize = 2 * LEVELS + 1;

/// Compared and exchanged in this order, six numbers are sorted.
const SORTS_SIX: [[usize; 2]; 12] = [
    [0, 5],
    [1, 3],
    [2, 4],
    [1, 2],
    [3, 4],
    [0, 3],
    [2, 5],
    [0, 1],
    [2, 3],
    [4, 5],
    [1, 2],
    [3, 4],
];

/// How many points a piece of the chord at p takes, before this is rounded up. Where it begins below the
/// bulb's brightest point it takes fewer digits.
#[inline(always)]
pub fn points_of_piece(
    [n_u, n_v]: [f64; 2],
    p: f64,
    [from, to]: [f64; 2],
    least: f64,
    tolerance: Tolerance,
) -> f64 {
    let near = within(0.0, from, to);
    let begin = 0.5 * (n_u * p * p + n_v * near * near);
    let fall = |end: f64| 0.5 * n_v * (end - near).abs() * (end + near).abs();
    let tolerance = tolerance.after_fall(begin - least);
    tolerance.points_for_fall_exactly([fall(from), fall(to)], MORE_POINTS)
}

kernel! {
    /// What counts of chords.
    pub fn cut(
        angles: &Angles,
        disc: &Disc,
        exponents: [f64; 2],
        depth: Depth,
        tolerance: Tolerance,
    ) -> Chords {
        let mut chords = Chords {
            p: [0.0; LANES],
            low: [0.0; LANES],
            high: [0.0; LANES],
            scale: [0.0; LANES],
            points: [0.0; LANES],
        };
        let [n_u, n_v] = exponents;
        for i in 0..LANES {
            let (sin, cos) = (angles.sin[i], angles.cos[i]);
            let p = disc.p + disc.radius * sin;
            let reach2 = (2.0 * depth.most - n_u * p * p) / n_v;
            let reach = if reach2 > 0.0 { reach2 } else { 0.0 }.sqrt();
            let middle = disc.q + disc.slant * sin;
            let half = disc.half_chord * cos;
            let (low, high) = (middle - half, middle + half);
            let low = if low > -reach { low } else { -reach };
            let high = if high < reach { high } else { reach };
            chords.p[i] = p;
            chords.low[i] = low;
            chords.high[i] = high;
            chords.scale[i] = angles.weight[i] * disc.radius * cos;
            chords.points[i] = points_of_piece(exponents, p, [low, high], depth.least, tolerance);
        }
        chords
    }
}

kernel! {
    /// The pieces of chords for a viewer, parted where the light's cosine is one of `levels`.
    pub fn part(
        chords: &Chords,
        wo: &Vec3,
        levels: &[f64; LEVELS],
        exponents: [f64; 2],
        least: f64,
        tolerance: Tolerance,
    ) -> Pieces {
        let mut pieces = Pieces {
            ends: [[0.0; LANES]; PIECES + 1],
            points: [[0.0; LANES]; PIECES],
        };
        for i in 0..LANES {
            let (p, low, high) = (chords.p[i], chords.low[i], chords.high[i]);
            let mut inner = [0.0; PIECES - 1];
            for level in 0..LEVELS {
                let [first, second] = crossings(wo, p, levels[level]);
                inner[2 * level] = within(first, low, high);
                inner[2 * level + 1] = within(second, low, high);
            }
            for [a, b] in SORTS_SIX {
                let (x, y) = (inner[a], inner[b]);
                inner[a] = if y < x { y } else { x };
                inner[b] = if y < x { x } else { y };
            }
            pieces.ends[0][i] = low;
            for (ends, inner) in pieces.ends[1..].iter_mut().zip(inner) {
                ends[i] = inner;
            }
            pieces.ends[PIECES][i] = high;
        }
        for piece in 0..PIECES {
            for i in 0..LANES {
                let ends = [pieces.ends[piece][i], pieces.ends[piece + 1][i]];
                pieces.points[piece][i] =
                    points_of_piece(exponents, chords.p[i], ends, least, tolerance);
            }
        }
        pieces
    }
}

#[inline(always)]
fn within(x: f64, low: f64, high: f64) -> f64 {
    let x = if x < low { low } else { x };
    if x > high { high } else { x }
}

//! The tolerance of a rule over a lobe, and the points that it takes.

use super::elementary::ROUND;
use std::f64::consts::{LN_10, PI};

/// A tolerance finer by this many digits takes at least one point more along every interval.
const FINER_DIGITS: f64 = 3.3;

/// A little finer is this many digits: a third of [`FINER_DIGITS`].
const LITTLE_DIGITS: f64 = 1.1;

/// Tolerances that differ by less than this many digits are one.
const SAME_DIGITS: f64 = 0.1;

/// Digits beyond those that count at which an integrand's tail is cut: the tail's integral is a
/// few times what it is at the cut.
const SPARE_DIGITS: f64 = 0.5;

/// The error allowed to a cubature over a lobe, as a share of the lobe's largest value.
#[derive(Clone, Copy, Debug)]
pub struct Tolerance {
    /// Minus its decimal logarithm: the digits that count.
    digits: f64,
    /// How many finer ones it is the check of.
    level: u32,
}

/// A midpoint rule over all of a lobe, in widths from its middle.
#[derive(Clone, Copy, Debug)]
pub struct Midpoints {
    /// How many points.
    pub count: usize,
    /// How far they reach to either side.
    pub reach: f64,
}

impl Midpoints {
    /// The points and their weights.
    #[inline(always)]
    pub fn nodes(self) -> impl Iterator<Item = (f64, f64)> {
        let step = 2.0 * self.reach / self.count as f64;
        (0..self.count).map(move |index| ((index as f64 + 0.5) * step - self.reach, step))
    }
}

impl Tolerance {
    /// For errors of about `error` times the lobe's largest value.
    pub fn new(error: f64) -> Self {
        Self {
            digits: -libm::log10(error).clamp(-12.0, -2.0),
            level: 0,
        }
    }

    /// The error asked for, as a share of the lobe's largest value.
    pub fn error(self) -> f64 {
        libm::exp10(-self.digits)
    }

    /// The next finer, which tells how far this one is off.
    pub fn finer(self) -> Self {
        Self {
            digits: self.digits + FINER_DIGITS,
            level: self.level + 1,
        }
    }

    /// A little finer, but no finer than `check`.
    pub fn little_finer(self, check: Self) -> Self {
        let digits = self.digits + LITTLE_DIGITS;
        if digits >= check.digits - SAME_DIGITS {
            check
        } else {
            Self { digits, ..self }
        }
    }

    /// The slope beyond which a lobe of exponent `n` is left out, where it has fallen by `more`
    /// digits more than count; infinite for one that never does.
    pub fn reach(self, n: f64, more: f64) -> f64 {
        let exponent = 2.0 * LN_10 * (self.digits + more) / n;
        if exponent > 600.0 {
            f64::INFINITY
        } else {
            libm::expm1(exponent).sqrt()
        }
    }

    /// Whether it is finer than another.
    pub fn is_finer_than(self, other: Self) -> bool {
        self.digits > other.digits
    }

    /// How often [`Tolerance::finer`] was called for it. A rule may change its kind with it.
    pub fn level(self) -> u32 {
        self.level
    }

    /// Whether no finer one would gain anything.
    pub fn is_finest(self) -> bool {
        self.digits >= 12.0
    }

    /// From one end of a narrow lobe's reach to the other, in widths.
    pub fn reach_widths(self, more: f64) -> f64 {
        2.0 * (2.0 * LN_10 * (self.digits + more)).sqrt()
    }

    /// Gauss points for an interval of this many lobe widths: enough for a normal density wherever
    /// the interval lies on it (found by trying), and `more` for what multiplies it.
    #[inline(always)]
    pub fn points(self, widths: f64, more: f64) -> usize {
        let d = self.digits;
        rounded_up(0.2 + 0.31 * d + (0.6 + 0.115 * d) * widths + more)
    }

    /// The same where what multiplies the density has a pole or the singularity of a logarithm not far away: by
    /// `growth` in logarithms the distance from it grows over the interval. A whole number. Found by trying, on the
    /// lines of glossy lobes in the preset.
    #[inline(always)]
    pub fn points_of_growth(self, widths: f64, growth: f64) -> f64 {
        let d = self.digits;
        let points = 0.2 + (0.2 + 0.25 * growth) * d + (0.6 + 0.115 * d) * widths;
        // Rounded up, in operations that become vector instructions.
        let nearest = (points + ROUND) - ROUND;
        if nearest < points {
            nearest + 1.0
        } else {
            nearest
        }
    }

    /// A midpoint rule over all of a lobe. Points h widths apart miss about exp(-2 pi^2 / h^2) of a normal
    /// density (Poisson's summation formula).
    pub fn midpoints(self) -> Midpoints {
        let reach = (2.0 * self.fall()).sqrt();
        let apart = PI * (2.0 / (LN_10 * self.digits)).sqrt();
        Midpoints {
            count: (2.0 * reach / apart).ceil() as usize,
            reach,
        }
    }

    /// Gauss points for the arcs of a disc, in a variable in which their lengths are smooth. Found by
    /// trying: 3 points miss 8e-3, 4 1e-3, 5 1.4e-4, 6 2e-5.
    pub fn points_of_arcs(self) -> usize {
        (0.6 + 1.16 * self.digits).ceil() as usize
    }

    /// How far the logarithm of an integrand falls before what is left no longer counts.
    pub fn fall(self) -> f64 {
        LN_10 * (self.digits + SPARE_DIGITS)
    }

    /// The tolerance for a part of an integral whose logarithm starts this far below the largest value:
    /// digits below the last one of the whole do not count there.
    #[inline(always)]
    pub fn after_fall(self, fall: f64) -> Self {
        Self {
            digits: (self.digits - fall.max(0.0) / LN_10).max(1.0),
            level: self.level,
        }
    }

    /// Gauss points for an interval in which the logarithm of the integrand is largest somewhere
    /// and falls by `falls` to either end, linearly or like a normal density's. Found by trying
    /// 3 to 11 digits and falls of 0.1 to 26; `more` for what multiplies it.
    #[inline(always)]
    pub fn points_for_fall(self, falls: [f64; 2], more: f64) -> usize {
        rounded_up(self.points_for_fall_exactly(falls, more))
    }

    /// The same before it is rounded up.
    #[inline(always)]
    pub fn points_for_fall_exactly(self, falls: [f64; 2], more: f64) -> f64 {
        let d = self.digits;
        let widths = falls[0].sqrt() + falls[1].sqrt();
        0.6 + 0.3 * d + (0.75 + 0.165 * d) * widths + more
    }

    /// The `more` for the squared cosine by which a disc's chords end.
    pub fn more_on_disc(self) -> f64 {
        2.8 + 0.27 * self.digits
    }

    /// The `more` for a function that is analytic less than pi/2 beside an interval of this
    /// length: Gauss's rule of n points misses rho^(-2n) with ln rho = asinh(pi / length).
    #[inline(always)]
    pub fn more_beside(self, length: f64) -> f64 {
        0.334 * self.digits * length
    }
}

/// The least whole number that is not below a positive one. `f64::ceil` calls a function where the
/// processor need not have the instruction.
#[inline(always)]
pub fn rounded_up(x: f64) -> usize {
    let below = x as usize;
    below.saturating_add(usize::from((below as f64) < x))
}

#[cfg(test)]
mod tests {
    use super::rounded_up;

    #[test]
    fn rounding_up_is_that_of_the_library() {
        for x in [
            0.0,
            0.5,
            1.0,
            1.0 + f64::EPSILON,
            2.0,
            7.3,
            1e18,
            f64::INFINITY,
        ] {
            assert_eq!(rounded_up(x), x.ceil() as usize, "{x}");
        }
    }
}

//! Lines of one s, side by side.

use super::{BENDS, NOWHERE};
use crate::numerics::batch::FOUR;
use crate::numerics::elementary::exp;
use crate::scene::ChartPlane;

/// e^-3 to e^3 without e^0, about.
const POWERS_OF_E: [f64; BENDS] = [0.05, 0.135, 0.37, 2.7, 7.4, 20.0];

/// One number a line.
pub type OfFour = [f64; FOUR];

/// Directions of one s each, in a row of patches.
pub struct Lines {
    /// Of the angle from +y.
    sin: OfFour,
    cos: OfFour,
    /// Of the angle to the chart's normal.
    pub cos_gamma: OfFour,
    /// From the sample's point to the chart, across its x axis.
    reach: OfFour,
    /// The height on the chart in metres.
    pub height: OfFour,
    /// The larger t at which the integrand bends.
    bends: [OfFour; 3],
    /// The smaller ones: one over these.
    bends_before: [OfFour; 3],
}

/// Directions of one s.
pub struct Line {
    /// Of the angle from +y.
    pub sin: f64,
    pub cos: f64,
    /// From the sample's point to the chart, across its x axis.
    pub reach: f64,
    /// The t at which the integrand bends, and some at which long intervals are parted.
    pub bends: [f64; 2 * BENDS],
}

impl Lines {
    #[inline(always)]
    pub fn new(
        plane: &ChartPlane,
        [height, foot]: [f64; 2],
        s: &OfFour,
        levels: &[f64; 3],
    ) -> Self {
        let [mut sin, mut cos, mut cos_gamma, mut reach, mut heights] = [[0.0; FOUR]; 5];
        for i in 0..FOUR {
            let e = exp(s[i]);
            let (sinh, cosh) = (0.5 * (e - 1.0 / e), 0.5 * (e + 1.0 / e));
            cos_gamma[i] = 1.0 / cosh;
            let across = plane.y * (sinh * cos_gamma[i]) - plane.z * cos_gamma[i];
            (sin[i], cos[i]) = (across.z, across.y);
            reach[i] = height * cosh;
            heights[i] = foot + height * sinh;
        }
        let [mut bends, mut bends_before] = [[[0.0; FOUR]; 3]; 2];
        for (index, level) in levels.iter().enumerate() {
            for i in 0..FOUR {
                // cosh ln t is this where light stands at the level.
                let ratio = sin[i] / level;
                let bend = ratio + (ratio * ratio - 1.0).sqrt();
                bends[index][i] = if ratio > 1.0 { bend } else { NOWHERE };
                bends_before[index][i] = 1.0 / bends[index][i];
            }
        }
        Self {
            sin,
            cos,
            cos_gamma,
            reach,
            height: heights,
            bends,
            bends_before,
        }
    }

    /// One of them.
    #[inline(always)]
    pub fn line(&self, i: usize) -> Line {
        let ([a, b, c], [d, e, f]) = (&self.bends, &self.bends_before);
        let [g, h, k, l, m, n] = POWERS_OF_E;
        Line {
            sin: self.sin[i],
            cos: self.cos[i],
            reach: self.reach[i],
            bends: [a[i], b[i], c[i], d[i], e[i], f[i], g, h, k, l, m, n],
        }
    }
}

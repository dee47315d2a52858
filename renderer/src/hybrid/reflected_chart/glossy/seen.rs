//! What lines side by side show of the chart: the moments of their pieces.

use super::lanes::Lanes;
use super::moments::Moments;
use crate::numerics::batch::LANES;

/// Where pieces can lie: light higher than the viewer, or lower; and the same beyond the tint's knee
/// once more.
pub const PARTS: usize = 4;
pub const HIGH: usize = 0;
pub const LOW: usize = 1;
pub const BEYOND: usize = 2;

/// What the lines show of the chart.
pub struct Seen<const N: usize> {
    /// The moments of pieces times their patches' reflectances, by part and channel.
    pub moments: [[Moments<N>; 3]; PARTS],
    /// Whether any line has such a part.
    pub used: [bool; PARTS],
    /// The middle of a line's last piece on the chart, in patches from its corner.
    pub middle: [Lanes; 2],
    /// The first and the last p of a line that show any of it; the first beyond the last where
    /// nothing does.
    pub span: [Lanes; 2],
}

impl<const N: usize> Seen<N> {
    /// Adds pieces that lie in a part.
    #[inline(always)]
    pub fn add(
        &mut self,
        part: usize,
        piece: &Moments<N>,
        colours: &[Lanes; 3],
        here: &[bool; LANES],
    ) {
        if *here == [false; LANES] {
            return;
        }
        self.used[part] = true;
        for channel in 0..3 {
            let mut colour = [0.0; LANES];
            for i in 0..LANES {
                colour[i] = if here[i] { colours[channel][i] } else { 0.0 };
            }
            for k in 0..N {
                for i in 0..LANES {
                    self.moments[part][channel][k][i] += colour[i] * piece[k][i];
                }
            }
        }
    }

    /// Extends what shows by pieces whose middles lie at these positions, where they are on the chart.
    #[inline(always)]
    pub fn extend(
        &mut self,
        [from, to]: [&Lanes; 2],
        positions: &[Lanes; 2],
        on_chart: &[bool; LANES],
    ) {
        for i in 0..LANES {
            let [first, last] = [self.span[0][i], self.span[1][i]];
            let begins = on_chart[i] & (from[i] < first);
            self.span[0][i] = if begins { from[i] } else { first };
            self.span[1][i] = if on_chart[i] { to[i] } else { last };
            for axis in 0..2 {
                let before = self.middle[axis][i];
                self.middle[axis][i] = if on_chart[i] {
                    positions[axis][i]
                } else {
                    before
                };
            }
        }
    }

    /// Takes the moments about `middle`, in units of `unit`.
    #[inline(always)]
    pub fn move_to(&mut self, middle: &Lanes, unit: &Lanes) {
        let mut scales = [[1.0; LANES]; N];
        for i in 0..LANES {
            let per_unit = 1.0 / unit[i];
            for k in 1..N {
                scales[k][i] = scales[k - 1][i] * per_unit;
            }
        }
        for (moments, used) in self.moments.iter_mut().zip(self.used) {
            if !used {
                continue;
            }
            for moments in moments {
                // Lanes outside: with lanes inside, the compiler makes vectors of the moments of a lane, which it
                // gathers and scatters.
                for i in 0..LANES {
                    let mut of_lane: [f64; N] = std::array::from_fn(|k| moments[k][i]);
                    // The binomial theorem, a factor at a time.
                    for first in 1..N {
                        for k in (1..N).rev() {
                            if k >= first {
                                of_lane[k] -= middle[i] * of_lane[k - 1];
                            }
                        }
                    }
                    for k in 0..N {
                        moments[k][i] = of_lane[k] * scales[k][i];
                    }
                }
            }
        }
    }

    /// The weights of a point in each part, by the polynomial that is 1 at it.
    #[inline(always)]
    pub fn at(&self, channel: usize, polynomial: &[f64; N]) -> [Lanes; PARTS] {
        let mut weights = [[0.0; LANES]; PARTS];
        for part in 0..PARTS {
            if self.used[part] {
                for k in 0..N {
                    for i in 0..LANES {
                        weights[part][i] += polynomial[k] * self.moments[part][channel][k][i];
                    }
                }
            }
        }
        weights
    }
}

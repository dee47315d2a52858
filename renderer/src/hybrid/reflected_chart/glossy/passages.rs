//! Where edges of patches pass through the lobe along its wide axis, and where the rule along that axis
//! has to be parted.
//!
//! Let an edge pass `rate` widths of the narrow axis a unit of q, and z be its place in those widths. Across
//! the passage the integral over the narrow axis goes from one smooth function to another as
//! before Phi(-z) + after Phi(z). An edge that passes fast next to the lobe's fall along q takes few lines:
//!
//! - Taken for a step, it misses (after' - before') / (2 rate^2), because the integral of 2 z Phi(-z) over z > 0 is
//!   1/2. The lines beside it must lie beyond the passage. An edge that bends crosses a line of constant p at
//!   q_0 + p slope + p^2 bend, where p^2 has a mean of 1 / n: at the mean of that the step has to be.
//! - [`Passage::RULE`] is exact for that term and for the first of the edge's bend, so it misses terms in
//!   1 / rate^3.
//!
//! An edge that runs along p within the lobe bends more than it is slanted. It passes as far as it bends, to one side,
//! and no rule here serves it but one about the mean: it misses the square of the bend.

use super::point::Point;
use crate::hybrid::budget::glossy::PASSAGE;

/// An edge of patches that passes through the lobe along the wide axis.
#[derive(Clone, Copy, Debug)]
pub struct Passage {
    /// The q at which it crosses p = 0, or the middle between its ends where it turns back.
    pub middle: f64,
    /// Widths of the lobe along p that it passes a unit of q, at most.
    pub rate: f64,
    /// How far it goes on to either side of the middle.
    pub(super) half: f64,
    /// Where a step stands for it: the mean of where it crosses lines of constant p, over the lobe.
    pub(super) step: f64,
}

impl Passage {
    /// Lines and their weights, over [`PASSAGE`] to either side of z = 0. With A the integral of
    /// z (2 Phi(z) - 1) over half of it and B that of z^2 phi(z) over all of it, the points at +-s of
    /// weight w satisfy w s (2 Phi(s) - 1) = A and 2 w s^2 phi(s) = B; the middle has the rest.
    pub const RULE: [[f64; 2]; 3] = [
        [-2.146_818_392_216_401, 2.706_446_064_758_85],
        [0.0, 2.0 * PASSAGE - 2.0 * 2.706_446_064_758_85],
        [2.146_818_392_216_401, 2.706_446_064_758_85],
    ];

    /// Whether it goes on at q.
    pub fn covers(&self, q: f64) -> bool {
        (q - self.middle).abs() < self.half
    }

    /// Whether the rule of three lines misses no more than a tolerance.
    fn has_rule(&self, point: &Point<'_>) -> bool {
        let slow = point.per_wide_width / self.rate;
        slow * slow * slow < point.error
    }
}

/// Where a piece of the wide axis may end.
#[derive(Clone, Copy, Debug)]
pub struct End {
    pub q: f64,
    /// Whether the integral over p bends here, so that a piece has to end.
    pub kink: bool,
    /// The index of the passage that begins or ends here, if the rule of three lines may serve it.
    pub passage: Option<usize>,
    /// The index of the passage for which a step stands here.
    pub step: Option<usize>,
}

impl End {
    pub(super) fn kink(q: f64) -> Self {
        Self {
            q,
            kink: true,
            passage: None,
            step: None,
        }
    }
}

/// What was found along the wide axis.
#[derive(Default)]
pub struct Found {
    pub passages: Vec<Passage>,
    /// Passages for which a step stands.
    pub steps: Vec<Passage>,
    /// Where pieces may end. Once all are found, in rising order.
    pub ends: Vec<End>,
}

impl Found {
    pub fn clear(&mut self) {
        self.passages.clear();
        self.steps.clear();
        self.ends.clear();
    }

    /// Adds a passage and its ends.
    pub fn add_passage(&mut self, passage: Passage, point: &Point<'_>) {
        let index = passage.has_rule(point).then_some(self.passages.len());
        self.ends
            .extend([-passage.half, passage.half].map(|off| End {
                passage: index,
                kink: false,
                ..End::kink(passage.middle + off)
            }));
        self.passages.push(passage);
    }

    /// Adds a passage for which a step stands.
    pub fn add_step(&mut self, passage: Passage) {
        self.ends.push(End {
            step: Some(self.steps.len()),
            ..End::kink(passage.step)
        });
        self.steps.push(passage);
    }

    /// Takes an end off at which a step stands, and gives its passage two ends.
    pub fn widen_step(&mut self, end: usize, point: &Point<'_>) {
        if let Some(index) = self.ends[end].step.take() {
            // It ends no piece any more.
            self.ends[end].q = f64::NAN;
            self.add_passage(self.steps[index], point);
        }
    }

    /// How many passages go on at q. Steps do nowhere.
    pub fn count_covering(&self, q: f64) -> usize {
        let passages = self.passages.iter();
        passages.filter(|passage| passage.covers(q)).count()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numerics::gauss::GaussRule;

    /// The integral across a passage of `before` Phi(-z) + `after` Phi(z), where z bends.
    fn across(rate: f64, points: impl Iterator<Item = (f64, f64)>) -> f64 {
        let phi = |z: f64| 0.5 * libm::erfc(-z * std::f64::consts::FRAC_1_SQRT_2);
        points
            .map(|(q, weight)| {
                let z = rate * q * (1.0 + 0.7 * q);
                weight * (libm::exp(q) * phi(-z) + (0.3 + libm::sin(2.0 * q)) * phi(z))
            })
            .sum()
    }

    #[test]
    fn three_lines_miss_the_third_power() {
        for rate in [30.0, 100.0, 300.0] {
            let half = PASSAGE / rate;
            let expected = across(rate, GaussRule::of(60).on(-half, half));
            let rule = Passage::RULE.map(|[z, weight]| (z / rate, weight / rate));
            let missed = (across(rate, rule.into_iter()) - expected).abs();
            assert!(missed * rate * rate * rate < 4.0, "{rate}: {missed:e}");
        }
    }
}

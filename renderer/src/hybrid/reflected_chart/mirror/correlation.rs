//! What lies below two edges whose blurs are correlated: a normal distribution of two variables.

use super::blur::{Edge, Means, normal};
use crate::numerics::batch::{Batch, LANES};
use crate::numerics::elementary::exp;
use crate::numerics::gauss::GaussRule;
use crate::numerics::instructions::{Instructions, kernel};
use std::f64::consts::PI;

/// Points along the integral by which the distribution is known, up to a correlation.
const POINTS: [(f64, usize); 2] = [(0.7, 5), (CORRELATION_MAX, 12)];

/// The largest correlation, to either side, for which these points serve.
pub const CORRELATION_MAX: f64 = 0.9;

/// A correlation of two blurs.
///
/// Below two edges at a and b lies Phi(a) Phi(b), and the integral over t, up to the arc sine of the correlation, of
/// exp(-(a^2 + b^2 - 2 a b sin t) / (2 cos^2 t)) / (2 pi).
pub struct Correlation {
    /// Points along that integral.
    nodes: Vec<Node>,
}

/// A point along the integral.
pub struct Node {
    sin: f64,
    /// 1 / (2 cos^2 t).
    per_cos2: f64,
    /// Over 2 pi.
    weight: f64,
}

impl Node {
    /// What it adds.
    #[inline(always)]
    fn term(&self, a: f64, b: f64) -> f64 {
        let exponent = (a * a + b * b - 2.0 * a * b * self.sin) * self.per_cos2;
        self.weight * exp(-exponent)
    }
}

impl Correlation {
    /// Of blurs that are correlated by so much, at most [`CORRELATION_MAX`] to either side.
    pub fn new(correlation: f64) -> Self {
        if correlation == 0.0 {
            return Self { nodes: Vec::new() };
        }
        let [(moderate, few), (_, many)] = POINTS;
        let points = if correlation.abs() <= moderate {
            few
        } else {
            many
        };
        let node = |(t, weight): (f64, f64)| {
            let (sin, cos) = libm::sincos(t);
            Node {
                sin,
                per_cos2: 0.5 / (cos * cos),
                weight: weight / (2.0 * PI),
            }
        };
        let rule = GaussRule::of(points).on(0.0, libm::asin(correlation));
        Self {
            nodes: rule.map(node).collect(),
        }
    }

    /// The share below two edges at a point where they lie at `a` and `b`.
    pub fn below_both(&self, [a, b]: [f64; 2]) -> f64 {
        let terms = self.nodes.iter().map(|node| node.term(a, b));
        normal(a) * normal(b) + terms.sum::<f64>()
    }

    /// The means of that by points of a pixel, from its middle, and their weights.
    pub fn means_below_both(
        &self,
        instructions: Instructions,
        [a, b]: [&Edge; 2],
        points: &[([f64; 2], f64)],
    ) -> Means {
        let mut places = Batch::default();
        for &(u, _) in points {
            places.push([a.at(u), b.at(u)]);
        }
        let mut terms = Vec::new();
        sum_terms(instructions, &self.nodes, &places, &mut terms);
        let mut means = Means::default();
        for (index, &(u, weight)) in points.iter().enumerate() {
            let [a, b] = places.point(index);
            means.add(u, weight * (normal(a) * normal(b) + terms[index]));
        }
        means
    }
}

kernel! {
    /// Sums what nodes add at places of two edges, whole blocks of them.
    pub fn sum_terms(nodes: &[Node], places: &Batch<2>, terms: &mut Vec<f64>) {
        terms.clear();
        for [a, b] in places.blocks() {
            let mut sums = [0.0; LANES];
            for node in nodes {
                for i in 0..LANES {
                    sums[i] += node.term(a[i], b[i]);
                }
            }
            terms.extend_from_slice(&sums);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::blur::density;
    use super::*;
    use proptest::prelude::*;

    /// Against the distribution along one variable for each value of the other.
    #[test]
    fn two_correlated_blurs_are_what_their_density_says() {
        for correlation in [0.3, -0.3, 0.65, -0.65, 0.75, 0.9, -0.9] {
            let spread = libm::sqrt(1.0 - correlation * correlation);
            for [a, b] in [
                [0.3, -0.2],
                [1.5, 1.0],
                [-2.0, 1.0],
                [0.0, 0.0],
                [-1.0, -1.5],
            ] {
                let rule = GaussRule::of(64);
                let expected: f64 = rule
                    .on(-9.0, a)
                    .map(|(t, weight)| weight * density(t) * normal((b - correlation * t) / spread))
                    .sum();
                let found = Correlation::new(correlation).below_both([a, b]);
                assert!(
                    (found - expected).abs() < 1e-5,
                    "{a} {b} {correlation}: {found} {expected}"
                );
            }
        }
    }

    proptest! {
        /// Sums over points side by side are those over points one by one, however many they are and far out.
        #[test]
        fn means_are_sums_over_points(
            correlation in -CORRELATION_MAX..CORRELATION_MAX,
            numbers in prop::array::uniform6(-60.0..60.0f64),
            points in prop::collection::vec(([-0.5..0.5f64, -0.5..0.5], 0.0..1.0f64), 0..40),
        ) {
            let [d, x, y, e, v, w] = numbers;
            let edges = [
                Edge { distance: d, gradient: [x, y] },
                Edge { distance: e, gradient: [v, w] },
            ];
            let correlation = Correlation::new(correlation);
            for instructions in Instructions::available() {
                let [a, b] = &edges;
                let means = correlation.means_below_both(instructions, [a, b], &points);
                let mut expected = Means::default();
                for &(u, weight) in &points {
                    expected.add(u, weight * correlation.below_both(edges.map(|edge| edge.at(u))));
                }
                prop_assert_eq!(means.share.to_bits(), expected.share.to_bits());
                prop_assert_eq!(means.first.map(f64::to_bits), expected.first.map(f64::to_bits));
            }
        }
    }
}

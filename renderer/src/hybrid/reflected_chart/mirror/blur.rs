//! Means over a pixel of what lies on one side of straight edges that are blurred by a normal distribution.
//!
//! An edge is at `distance - gradient . u` for a point u of the pixel, in units of the blur: u is in pixels from the
//! pixel's middle, and what lies below the edge has the share Phi of that.

use crate::numerics::gauss::GaussRule;
use crate::numerics::polygon::Polygon;
use std::f64::consts::{FRAC_1_SQRT_2, PI, SQRT_2};

/// Points across a pixel by which the first moments are known: they multiply what changes little over a pixel.
const MOMENT_POINTS: usize = 6;

/// Below this step over a pixel, in units of the blur, the closed forms lose digits, and [`MOMENT_POINTS`] serve.
const GENTLE: f64 = 0.3;

/// Points across a pixel for a corner.
#[derive(Clone, Copy, Debug)]
pub struct CornerPoints {
    pub least: f64,
    /// So many more for each blur that a pixel is wide.
    pub per_blur: f64,
    /// What a share may then be off by: measured by the tests.
    pub off: f64,
}

impl CornerPoints {
    pub const FINE: Self = Self {
        least: 5.0,
        per_blur: 1.3,
        off: 2e-5,
    };

    pub const COARSE: Self = Self {
        least: 3.0,
        per_blur: 0.7,
        off: 2e-3,
    };
}

/// From here on edges are looked at across all of their fall. Chosen: what they are off by to either side then cancels
/// in most pixels.
const NARROW: f64 = 12.0;

/// Points across an edge, a blur apart: beyond them it falls by less than 1e-4.
const ACROSS: usize = 9;

/// How far from an edge, in blurs, the parts of a pixel are cut along it on which points tell shares.
const CUTS: [f64; 5] = [-4.0, -2.0, 0.0, 2.0, 4.0];

/// The steepest edges whose corners are known by points across the pixel. Of steeper ones by [`points_of`].
const STEEPEST: f64 = 20.0;

/// An edge over a pixel, in units of its blur.
#[derive(Clone, Copy, Debug)]
pub struct Edge {
    pub distance: f64,
    pub gradient: [f64; 2],
}

/// Means over a pixel: of a share, and of the share times u.
#[derive(Clone, Copy, Debug, Default)]
pub struct Means {
    pub share: f64,
    pub first: [f64; 2],
}

impl Means {
    /// Adds the share at a point, times the point's weight.
    pub fn add(&mut self, u: [f64; 2], value: f64) {
        self.share += value;
        self.first[0] += value * u[0];
        self.first[1] += value * u[1];
    }
}

impl std::ops::Add for Means {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self {
            share: self.share + other.share,
            first: [0, 1].map(|axis| self.first[axis] + other.first[axis]),
        }
    }
}

impl std::ops::Sub for Means {
    type Output = Self;

    fn sub(self, other: Self) -> Self {
        Self {
            share: self.share - other.share,
            first: [0, 1].map(|axis| self.first[axis] - other.first[axis]),
        }
    }
}

/// The normal distribution.
pub fn normal(t: f64) -> f64 {
    0.5 * libm::erfc(-FRAC_1_SQRT_2 * t)
}

/// The normal density.
pub fn density(t: f64) -> f64 {
    libm::exp(-0.5 * t * t) / (2.0 * PI).sqrt()
}

/// The integrals from far below: of the distribution, of that integral, and of t times the distribution.
fn integrals(t: f64) -> [f64; 3] {
    let (below, density) = (normal(t), density(t));
    let first = t * below + density;
    let second = 0.5 * ((t * t + 1.0) * below + t * density);
    let moment = 0.5 * ((t * t - 1.0) * below + t * density);
    [first, second, moment]
}

impl Edge {
    /// How much it changes along a column or a row, at most.
    fn steepest(&self) -> f64 {
        let [x, y] = self.gradient;
        x.abs().max(y.abs())
    }

    /// Whether it is blurred by too little for points across the pixel.
    pub fn is_steep(&self) -> bool {
        self.steepest() > STEEPEST
    }

    /// How far above a point it lies.
    pub fn at(&self, u: [f64; 2]) -> f64 {
        self.distance - self.gradient[0] * u[0] - self.gradient[1] * u[1]
    }

    /// The point nearest to the pixel's middle on a line `below` the edge, in units of the blur.
    pub fn foot(&self, below: f64) -> [f64; 2] {
        let [x, y] = self.gradient;
        let per_gradient = (self.distance - below) / (x * x + y * y).max(f64::MIN_POSITIVE);
        [x, y].map(|gradient| gradient * per_gradient)
    }

    /// Whether it falls within little more than a pixel.
    pub fn is_narrow(&self) -> bool {
        self.steepest() > NARROW
    }

    /// Points across it at equal steps of a blur.
    pub fn across(&self) -> [[f64; 2]; ACROSS] {
        std::array::from_fn(|index| self.foot(index as f64 - 0.5 * (ACROSS - 1) as f64))
    }

    /// How long it is on a pixel at most, in units of its blur: the share of the pixel on which it falls by one.
    pub fn length_max(&self) -> f64 {
        let [x, y] = self.gradient;
        SQRT_2 / (x * x + y * y).sqrt()
    }

    /// Over the pixel.
    pub fn means(&self) -> Means {
        let steep = usize::from(self.gradient[1].abs() > self.gradient[0].abs());
        let [g, h] = [self.gradient[steep], self.gradient[1 - steep]];
        let mut means = Means::default();
        if g.abs() < GENTLE {
            for (u, weight) in GaussRule::of(MOMENT_POINTS).on(-0.5, 0.5) {
                for (v, other) in GaussRule::of(MOMENT_POINTS).on(-0.5, 0.5) {
                    let value = weight * other * normal(self.distance - g * u - h * v);
                    means.share += value;
                    means.first[steep] += value * u;
                    means.first[1 - steep] += value * v;
                }
            }
            return means;
        }
        for (v, weight) in GaussRule::of(MOMENT_POINTS).on(-0.5, 0.5) {
            let at = self.distance - h * v;
            let [low, high] = [at + 0.5 * g, at - 0.5 * g].map(integrals);
            let share = (low[0] - high[0]) / g;
            let along = (at * (low[0] - high[0]) - (low[2] - high[2])) / (g * g);
            means.share += weight * share;
            means.first[steep] += weight * along;
            means.first[1 - steep] += weight * share * v;
        }
        if h.abs() >= GENTLE {
            let second = |u: f64, v: f64| integrals(self.distance - g * u - h * v)[1];
            let sum = second(-0.5, -0.5) + second(0.5, 0.5) - second(-0.5, 0.5) - second(0.5, -0.5);
            means.share = sum / (g * h);
        }
        means
    }
}

/// Where two edges meet; `None` where they do not.
pub fn meeting(a: &Edge, b: &Edge) -> Option<[f64; 2]> {
    let determinant = a.gradient[0] * b.gradient[1] - a.gradient[1] * b.gradient[0];
    let point = [
        (a.distance * b.gradient[1] - b.distance * a.gradient[1]) / determinant,
        (b.distance * a.gradient[0] - a.distance * b.gradient[0]) / determinant,
    ];
    let is_met = point.iter().all(|at| at.is_finite());
    is_met.then_some(point)
}

/// Points across a pixel for a corner of two edges that are not steep, from its middle, and their weights.
pub fn points_across([a, b]: [&Edge; 2], points: CornerPoints) -> Vec<([f64; 2], f64)> {
    let steepest = a.steepest().max(b.steepest());
    let rule = GaussRule::of((points.least + points.per_blur * steepest) as usize);
    let column = |(u, weight): (f64, f64)| {
        let rows = rule.on(-0.5, 0.5);
        rows.map(move |(v, other)| ([u, v], weight * other))
    };
    rule.on(-0.5, 0.5).flat_map(column).collect()
}

/// Points of a part of the pixel about a film point, from there, and their weights: on pieces that none of the edges
/// crosses with more than a part of its blur.
pub fn points_of<'a>(
    part: &Polygon,
    middle: [f64; 2],
    edges: impl Iterator<Item = &'a Edge>,
) -> Vec<([f64; 2], f64)> {
    let from_middle = |at: [f64; 2]| [0, 1].map(|axis| at[axis] - middle[axis]);
    let mut pieces = vec![*part];
    for edge in edges {
        for cut in CUTS {
            let beyond = |at| edge.at(from_middle(at)) - cut;
            pieces = pieces
                .iter()
                .flat_map(|piece| [piece.cut(beyond), piece.cut(|at| -beyond(at))])
                .filter(|piece| !piece.is_empty())
                .collect();
        }
    }
    let mut points = Vec::new();
    for piece in &pieces {
        piece.for_each_point(|at, weight| points.push((from_middle(at), weight)));
    }
    points
}

/// The means of a share by such points.
pub fn means_by(points: &[([f64; 2], f64)], share: &dyn Fn([f64; 2]) -> f64) -> Means {
    let mut means = Means::default();
    for &(u, weight) in points {
        means.add(u, weight * share(u));
    }
    means
}

#[cfg(test)]
mod tests {
    use super::super::correlation::Correlation;
    use super::*;
    use crate::numerics::instructions::Instructions;

    fn means_below_both(
        correlation: &Correlation,
        edges: [&Edge; 2],
        points: CornerPoints,
    ) -> Means {
        let points = points_across(edges, points);
        correlation.means_below_both(Instructions::widest(), edges, &points)
    }

    /// By many points.
    fn by_points(share: impl Fn([f64; 2]) -> f64) -> Means {
        const SIDE: u32 = 400;
        let mut means = Means::default();
        let at = |index: u32| (f64::from(index) + 0.5) / f64::from(SIDE) - 0.5;
        for u in (0..SIDE).map(at) {
            for v in (0..SIDE).map(at) {
                let value = share([u, v]) / f64::from(SIDE * SIDE);
                means.share += value;
                means.first[0] += value * u;
                means.first[1] += value * v;
            }
        }
        means
    }

    const EDGES: [Edge; 7] = [
        Edge {
            distance: 0.3,
            gradient: [7.0, 0.1],
        },
        Edge {
            distance: -1.2,
            gradient: [-3.0, 5.0],
        },
        Edge {
            distance: 2.0,
            gradient: [0.2, -9.0],
        },
        Edge {
            distance: 0.1,
            gradient: [0.1, 0.2],
        },
        Edge {
            distance: 0.0,
            gradient: [15.0, 15.0],
        },
        Edge {
            distance: 6.0,
            gradient: [-12.0, -0.29],
        },
        Edge {
            distance: -9.0,
            gradient: [1.0, 0.31],
        },
    ];

    #[test]
    fn means_by_an_edge_are_those_by_points() {
        for edge in EDGES {
            let (means, expected) = (edge.means(), by_points(|u| normal(edge.at(u))));
            assert!(
                (means.share - expected.share).abs() < 1e-5,
                "{edge:?} {means:?} {expected:?}"
            );
            for (first, expected) in means.first.iter().zip(expected.first) {
                assert!(
                    (first - expected).abs() < 2e-3,
                    "{edge:?}: {first} {expected}"
                );
            }
        }
    }

    #[test]
    fn means_by_a_corner_are_those_by_points() {
        for (index, a) in EDGES.iter().enumerate() {
            let b = &EDGES[(index + 3) % EDGES.len()];
            for correlation in [0.0, 0.1, -0.6] {
                let fine = CornerPoints::FINE;
                let correlation = Correlation::new(correlation);
                let means = means_below_both(&correlation, [a, b], fine);
                let expected = by_points(|u| correlation.below_both([a.at(u), b.at(u)]));
                let off = (means.share - expected.share).abs();
                assert!(off < fine.off, "{a:?} {b:?}: {off}");
                for (first, expected) in means.first.iter().zip(expected.first) {
                    assert!((first - expected).abs() < 2e-5);
                }
            }
        }
    }

    #[test]
    fn coarse_corners_are_off_by_less_than_stated() {
        for (index, a) in EDGES.iter().enumerate() {
            let b = &EDGES[(index + 3) % EDGES.len()];
            let [coarse, fine] = [CornerPoints::COARSE, CornerPoints::FINE]
                .map(|points| means_below_both(&Correlation::new(0.3), [a, b], points));
            let off = (coarse.share - fine.share).abs();
            assert!(off < CornerPoints::COARSE.off, "{a:?} {b:?}: {off}");
        }
    }

    #[test]
    fn parts_of_a_pixel_are_what_the_edge_leaves_of_them() {
        let middle = [4.5, 7.5];
        let whole = Polygon::quadrilateral([[4.0, 7.0], [5.0, 7.0], [5.0, 8.0], [4.0, 8.0]]);
        for edge in EDGES {
            let points = points_of(&whole, middle, [edge].iter());
            let means = means_by(&points, &|u| normal(edge.at(u)));
            let expected = edge.means();
            assert!(
                (means.share - expected.share).abs() < 2e-5,
                "{edge:?} {means:?}"
            );
            let half = whole.cut(|[column, _]| 4.5 - column);
            let points = points_of(&half, middle, [edge].iter());
            let means = means_by(&points, &|u| normal(edge.at(u)));
            let expected = by_points(|u| if u[0] < 0.0 { normal(edge.at(u)) } else { 0.0 });
            assert!(
                (means.share - expected.share).abs() < 2e-5,
                "{edge:?} {means:?}"
            );
            assert!((means.first[0] - expected.first[0]).abs() < 2e-5);
        }
    }
}

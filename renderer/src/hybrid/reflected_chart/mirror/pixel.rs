//! A pixel and the patches that show on it.

use super::blur::{self, CornerPoints, Edge, Means};
use super::correlation::{CORRELATION_MAX, Correlation};
use super::image::{Blur, Mirror};
use crate::numerics::instructions::Instructions;
use crate::numerics::polygon::{Polygon, Rectangle};
use std::iter;
use std::ops::{Add, Sub};

/// The most edges that are told apart along one axis.
const EDGES_MAX: usize = 2;

/// A pixel on which the chart shows.
pub struct Pixel {
    /// Column and row.
    pub at: (u32, u32),
    /// The position on the chart of the pixel's middle.
    pub middle: [f64; 2],
    /// How far it changes from column to column and from row to row, by axis.
    pub gradient: [[f64; 2]; 2],
    pub correlation: f64,
    /// What lies along each of the chart's axes.
    pub along: [Along; 2],
    /// What the sample has of the pixel, if not all.
    pub part: Option<Polygon>,
}

/// What shows of the chart along one of its axes: edges, and the patches before, between and behind them, of which
/// there are none beyond the chart's ends.
#[derive(Clone, Debug)]
pub struct Along {
    /// The first edge's number.
    pub first: u32,
    pub edges: Vec<Edge>,
    pub patches: Vec<Option<u32>>,
}

impl Along {
    /// Where `count` patches are, for the pixel about a film point that leads to a position; `None` where too many
    /// edges show.
    pub fn new(
        mirror: &Mirror<'_>,
        (film_point, position, gradient): ([f64; 2], [f64; 2], [[f64; 2]; 2]),
        blur: &Blur,
        (axis, count): (usize, f64),
        reach: f64,
    ) -> Option<Self> {
        let middle = position[axis] + blur.shift[axis];
        // Half a pixel, and a little more because positions bend.
        let [x, y] = gradient[axis].map(f64::abs);
        let reach = 0.6 * (x + y) + reach * blur.widths[axis];
        let (first, last) = (
            (middle - reach).ceil().max(0.0),
            (middle + reach).floor().min(count),
        );
        let patch = |index: f64| (0.0 <= index && index < count).then_some(index as u32);
        if first > last {
            return Some(Self {
                first: 0,
                edges: Vec::new(),
                patches: vec![patch(middle.floor())],
            });
        }
        let edges = (last - first) as usize + 1;
        if edges > EDGES_MAX {
            return None;
        }
        let number = |index: usize| first + index as f64;
        let edge = |index| mirror.edge(film_point, axis, number(index), blur);
        Some(Self {
            first: first as u32,
            edges: (0..edges).map(edge).collect::<Option<_>>()?,
            patches: (0..=edges)
                .map(|index| patch(number(index) - 1.0))
                .collect(),
        })
    }

    pub fn is_dark(&self) -> bool {
        self.patches.iter().all(Option::is_none)
    }
}

impl Pixel {
    pub fn film_point(&self, u: [f64; 2]) -> [f64; 2] {
        let (column, row) = self.at;
        [f64::from(column) + 0.5 + u[0], f64::from(row) + 0.5 + u[1]]
    }

    /// The position on the chart of a point of the pixel, nearly.
    pub fn position(&self, u: [f64; 2]) -> [f64; 2] {
        [0, 1].map(|axis| {
            let [x, y] = self.gradient[axis];
            self.middle[axis] + x * u[0] + y * u[1]
        })
    }

    /// What shows of each patch, if all is given as `all`, what lies below an edge by `below`, and below two by `both`:
    /// the patches as in [`Pixel::patches`].
    fn parts<T: Copy + Default + Add<Output = T> + Sub<Output = T>>(
        &self,
        all: T,
        below: impl Fn(&Edge) -> T,
        both: impl Fn(&Edge, &Edge) -> Option<T>,
    ) -> Option<Vec<T>> {
        let [across, up] = &self.along;
        // Of what lies below every edge, and below none and all.
        let ends = |along: &Along| -> Vec<T> {
            let below = along.edges.iter().map(&below);
            iter::once(T::default()).chain(below).chain([all]).collect()
        };
        let [below_across, below_up] = [ends(across), ends(up)];
        let corner = |column: usize, row: usize| {
            let edge = |along: &'_ Along, end: usize| along.edges.get(end.checked_sub(1)?).copied();
            match (edge(across, column), edge(up, row)) {
                _ if column == 0 || row == 0 => Some(T::default()),
                (Some(a), Some(b)) => both(&a, &b),
                (Some(_), None) => Some(below_across[column]),
                (None, _) => Some(below_up[row]),
            }
        };
        let mut parts = Vec::new();
        for row in 0..up.patches.len() {
            for column in 0..across.patches.len() {
                let high = corner(column + 1, row + 1)? - corner(column, row + 1)?;
                parts.push(high - corner(column + 1, row)? + corner(column, row)?);
            }
        }
        Some(parts)
    }

    /// The patches that show, columns first: `None` beyond the chart's ends.
    pub fn patches(&self) -> impl Iterator<Item = Option<(u32, u32)>> {
        let [across, up] = &self.along;
        let columns = |row: Option<u32>| {
            let pair = move |column: &Option<u32>| Some(((*column)?, row?));
            across.patches.iter().map(pair)
        };
        up.patches.iter().flat_map(move |&row| columns(row))
    }

    /// What the pixel has of them. `None` where the blurs of a corner's edges are too much correlated.
    pub fn shares(
        &self,
        instructions: Instructions,
        corner_points: CornerPoints,
    ) -> Option<Vec<Means>> {
        let all = Means {
            share: 1.0,
            first: [0.0; 2],
        };
        let edges = || self.along.iter().flat_map(|along| &along.edges);
        if self.has_corners() && self.correlation.abs() > CORRELATION_MAX {
            return None;
        }
        let correlation = Correlation::new(self.correlation);
        let is_steep = self.has_corners() && edges().any(Edge::is_steep);
        let part = match &self.part {
            Some(part) => *part,
            None if is_steep => {
                let Rectangle { low, high } = Rectangle::pixel(self.at.0, self.at.1);
                Polygon::quadrilateral([low, [high[0], low[1]], high, [low[0], high[1]]])
            }
            None => {
                return self.parts(all, Edge::means, |a, b| {
                    let points = blur::points_across([a, b], corner_points);
                    Some(correlation.means_below_both(instructions, [a, b], &points))
                });
            }
        };
        let points = blur::points_of(&part, self.film_point([0.0; 2]), edges());
        let sum = |share: &dyn Fn([f64; 2]) -> f64| blur::means_by(&points, share);
        self.parts(
            sum(&|_| 1.0),
            |edge| sum(&|u| blur::normal(edge.at(u))),
            |a, b| Some(correlation.means_below_both(instructions, [a, b], &points)),
        )
    }

    /// The same at a point.
    pub fn shares_at(&self, u: [f64; 2]) -> Vec<f64> {
        let correlation = Correlation::new(self.correlation);
        let both = |a: &Edge, b: &Edge| Some(correlation.below_both([a.at(u), b.at(u)]));
        self.parts(1.0, |edge| blur::normal(edge.at(u)), both)
            .unwrap_or_default()
    }

    /// Whether its shares are sums over points: they have corners, or the sample has no more than a part.
    pub fn is_summed(&self) -> bool {
        self.has_corners() || (self.has_edges() && self.part.is_some())
    }

    pub fn has_edges(&self) -> bool {
        self.along.iter().any(|along| !along.edges.is_empty())
    }

    /// Whether it has edges along both axes.
    pub fn has_corners(&self) -> bool {
        self.along.iter().all(|along| !along.edges.is_empty())
    }

    /// How much the sample has of it.
    pub fn area(&self) -> f64 {
        self.part.as_ref().map_or(1.0, Polygon::area)
    }

    /// Where its edges meet.
    pub fn corners(&self) -> impl Iterator<Item = [f64; 2]> {
        let [across, up] = &self.along;
        let meeting = |a| up.edges.iter().filter_map(move |b| blur::meeting(a, b));
        across.edges.iter().flat_map(meeting)
    }
}

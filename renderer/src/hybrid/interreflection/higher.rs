//! Orders from 2 on: from the chart off the sample to the chart, over and over.
//!
//! A cubature over the chart gives points that send light; the nodes of one tile receive it. For
//! every pair the integral over the sample is worked out once. That matrix takes the bulb's light
//! on the chart to order 2, order 1 to order 3, and any order to the second next.

use super::frame::Frame;
use super::levels::{TERMS, compared};
use super::matrix::{Points, Row, rows};
use super::unresolved::{Unresolved, unresolved_error};
use crate::hybrid::budget::interreflection::{
    EVALUATIONS_MAX, LEVEL_MAX, RULE_SHARE, UNRESOLVED_SHARE,
};
use crate::numerics::channels::{add_scaled, largest, largest_difference};
use crate::numerics::chebyshev::{Basis, Tile};

/// Interreflection of all orders from 2 on.
pub struct Higher {
    /// For paths of `max_bounces` hits, and of one hit less.
    pub tiles: [Tile<TERMS>; 2],
    /// A bound of what they are off by.
    pub error: f64,
    pub evaluations: u64,
}

/// The result with this many terms.
struct Solved<const TERMS: usize> {
    tiles: [Tile<TERMS>; 2],
    fit_error: f64,
    missed: f64,
    largest: f64,
    resolved: bool,
}

impl Higher {
    /// Works out the orders with rules as fine, and as many terms, as `allowed` asks for.
    pub fn solve(
        frame: &Frame<'_>,
        allowed: f64,
        order_1: impl Fn([f64; 2]) -> [f64; 3],
    ) -> Result<Self, Unresolved> {
        let (mut level, mut terms, mut evaluations) = (0, 0, 0);
        loop {
            let (solved, spent) = match terms {
                0 => widened(solve::<4>(frame, level, &order_1)),
                1 => widened(solve::<6>(frame, level, &order_1)),
                _ => solve::<TERMS>(frame, level, &order_1),
            };
            evaluations += spent;
            let rough = solved.missed > RULE_SHARE * allowed && level < LEVEL_MAX;
            let short = solved.fit_error > (1.0 - RULE_SHARE) * allowed && terms < 2;
            // The next level has up to sixteen times the evaluations.
            let dear = evaluations + 16 * spent > EVALUATIONS_MAX;
            if (rough || short) && !dear {
                level += usize::from(rough);
                terms += usize::from(short);
                continue;
            }
            let unclear = solved.missed > (UNRESOLVED_SHARE * solved.largest).max(allowed);
            let mut error = solved.fit_error + solved.missed;
            if !solved.resolved || unclear {
                error += unresolved_error(solved.largest, solved.missed)?;
            }
            return Ok(Self {
                tiles: solved.tiles,
                error,
                evaluations,
            });
        }
    }
}

fn widened<const FEWER: usize>((solved, spent): (Solved<FEWER>, u64)) -> (Solved<TERMS>, u64) {
    let solved = Solved {
        tiles: solved.tiles.map(|tile| tile.widened()),
        fit_error: solved.fit_error,
        missed: solved.missed,
        largest: solved.largest,
        resolved: solved.resolved,
    };
    (solved, spent)
}

fn solve<const TERMS: usize>(
    frame: &Frame<'_>,
    level: usize,
    order_1: &impl Fn([f64; 2]) -> [f64; 3],
) -> (Solved<TERMS>, u64) {
    let basis = Basis::<TERMS>::new();
    let nodes: Vec<[f64; 2]> = basis.nodes(&frame.bounds()).collect();
    let points = Points::new(frame, level, order_1);
    let rows = rows(frame, &nodes, &points, level);
    let indices = compared(TERMS);
    let finer_points = Points::new(frame, level + 1, order_1);
    let finer = self::rows(
        frame,
        &indices.map(|node| nodes[node]),
        &finer_points,
        level + 1,
    );
    let mut missed = 0.0f64;
    for (node, finer) in indices.into_iter().zip(&finer) {
        let rough = rows[node].apply(&points, |i| points.first(i));
        let better = finer.apply(&finer_points, |i| finer_points.first(i));
        missed = missed.max(largest_difference(rough, better));
    }
    let (values, fit_error) = series(frame, &basis, &rows, &points);
    let most = values[0]
        .iter()
        .fold(0.0, |most: f64, value| most.max(largest(*value)));
    let bounds = frame.bounds();
    let tiles = values.map(|values| basis.fit(bounds, values.into_iter()).0);
    let spent = rows.iter().chain(&finer).map(|row| row.evaluations).sum();
    let solved = Solved {
        tiles,
        fit_error,
        missed,
        largest: most,
        resolved: finer.iter().all(|row| row.resolved),
    };
    (solved, spent)
}

/// The sums of the orders from 2 on at the nodes, for paths of `max_bounces` hits and of one less,
/// and what the series leaves out.
fn series<const TERMS: usize>(
    frame: &Frame<'_>,
    basis: &Basis<TERMS>,
    rows: &[Row],
    points: &Points,
) -> ([Vec<[f64; 3]>; 2], f64) {
    let mut sums = [(); 2].map(|()| vec![[0.0; 3]; rows.len()]);
    let mut error = 0.0;
    let bounds = frame.bounds();
    // The light on the points by the two orders before the one that comes next.
    let mut before = [points.direct.clone(), points.order_1.clone()];
    for order in 2..frame.view.bounces_max {
        let from = &before[order as usize % 2];
        let values: Vec<[f64; 3]> = rows
            .iter()
            .map(|row| row.apply(points, |i| from[i]))
            .collect();
        for (sum, value) in sums[0].iter_mut().zip(&values) {
            add_scaled(sum, *value, 1.0);
        }
        if order + 1 < frame.view.bounces_max {
            for (sum, value) in sums[1].iter_mut().zip(&values) {
                add_scaled(sum, *value, 1.0);
            }
        }
        let (tile, fit) = basis.fit(bounds, values.into_iter());
        error += fit.error;
        before[order as usize % 2] = points
            .points
            .iter()
            .map(|point| {
                tile.value(frame.tile_position(point.at))
                    .map(|channel| channel.max(0.0))
            })
            .collect();
    }
    (sums, error)
}

//! One pixel of a function that is not smooth on it: nested adaptive quadrature.

use crate::numerics::channels::{add_scaled, largest_difference};
use crate::numerics::gauss::KRONROD;
use crate::numerics::polygon::Polygon;

/// Halvings of a line across a pixel: edges of 1/4,000 of a pixel are resolved.
const HALVINGS_MAX: u32 = 12;

/// The most points of a line across a pixel: what is left out then shows in the error. Enough for two
/// edges of 1/4,000 of a pixel.
const LINE_POINTS_MAX: u64 = 780;

/// The first lines over a pixel may take this many times the points after which none are added: an edge
/// along them is followed to its end before another line tells anything. Chosen.
const FIRST_LINES: u64 = 4;

/// Halvings of the interval that lines are spread over.
const SPREAD_HALVINGS_MAX: u32 = 6;

/// Over lines, whose integrals have kinks where the corners of a feature lie, 15 points are off by up to
/// this many times what they differ from 7 by (found by trying).
const KINKS: f64 = 3.0;

/// The integral of `function` over a polygon no larger than a pixel and its estimated error, to
/// `tolerance` if it can be had. Lines run along `axis`, which should be the one along which the
/// function changes faster. After `points_max` points no more lines are added, and the first lines
/// together take at most [`FIRST_LINES`] times as many, or 15 each: what is left out then shows in
/// the error.
pub fn integrate(
    polygon: &Polygon,
    axis: usize,
    tolerance: f64,
    points_max: u64,
    mut function: impl FnMut(f64, f64) -> [f64; 3],
) -> ([f64; 3], f64) {
    let across = 1 - axis;
    // Between the corners' coordinates the chords change smoothly.
    let mut breaks: Vec<f64> = polygon
        .corners()
        .iter()
        .map(|corner| corner[across])
        .collect();
    breaks.sort_unstable_by(f64::total_cmp);
    let mut open: Vec<_> = breaks
        .windows(2)
        .map(|pair| (pair[0], pair[1], 0))
        .collect();
    let per_length = match breaks[..] {
        [first, .., last] if first < last => 1.0 / (last - first),
        _ => return ([0.0; 3], 0.0),
    };
    let rule = KRONROD.len() as u64;
    let line_points_max = (FIRST_LINES * points_max / rule).min(LINE_POINTS_MAX);
    let (mut total, mut error) = ([0.0; 3], 0.0);
    let mut points = 0u64;
    while let Some((low, high, depth)) = open.pop() {
        if low >= high {
            continue;
        }
        let (middle, half) = (0.5 * (low + high), 0.5 * (high - low));
        let (mut fine, mut coarse) = ([0.0; 3], [0.0; 3]);
        let mut line_error = 0.0;
        for (node, kronrod, gauss) in KRONROD {
            let at = middle + half * node;
            let Some([from, to]) = polygon.chord(across, at) else {
                continue;
            };
            let along = |position: f64| {
                points += 1;
                match axis {
                    0 => function(position, at),
                    _ => function(at, position),
                }
            };
            let (line, missed) = line_integral(along, from, to, 0.5 * tolerance, line_points_max);
            add_scaled(&mut fine, line, half * kronrod);
            add_scaled(&mut coarse, line, half * gauss);
            line_error += half * kronrod * missed;
        }
        let missed = KINKS * largest_difference(fine, coarse);
        let share = (high - low) * per_length;
        if missed > tolerance * share && depth < SPREAD_HALVINGS_MAX && points < points_max {
            open.extend([(low, middle, depth + 1), (middle, high, depth + 1)]);
            continue;
        }
        add_scaled(&mut total, fine, 1.0);
        error += line_error + missed;
    }
    (total, error)
}

/// The integral along a line by halving where 7 and 15 points disagree, and their disagreement. It
/// takes `points_max` points at most, or 15.
fn line_integral(
    mut function: impl FnMut(f64) -> [f64; 3],
    from: f64,
    to: f64,
    tolerance: f64,
    points_max: u64,
) -> ([f64; 3], f64) {
    let rule = KRONROD.len() as u64;
    let (mut total, mut error) = ([0.0; 3], 0.0);
    let mut open = vec![(from, to, 0)];
    let mut points = rule;
    while let Some((low, high, depth)) = open.pop() {
        let (mut fine, mut coarse) = ([0.0; 3], [0.0; 3]);
        let (middle, half) = (0.5 * (low + high), 0.5 * (high - low));
        for (node, kronrod, gauss) in KRONROD {
            let value = function(middle + half * node);
            add_scaled(&mut fine, value, half * kronrod);
            add_scaled(&mut coarse, value, half * gauss);
        }
        let missed = largest_difference(fine, coarse);
        if missed > tolerance && depth < HALVINGS_MAX && points + 2 * rule <= points_max {
            points += 2 * rule;
            open.extend([(low, middle, depth + 1), (middle, high, depth + 1)]);
            continue;
        }
        add_scaled(&mut total, fine, 1.0);
        error += missed;
    }
    (total, error)
}

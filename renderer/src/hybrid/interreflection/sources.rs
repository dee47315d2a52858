//! Point sources that stand for the bulb and for the chart.

use crate::hybrid::budget::interreflection::DIVISIONS_MAX;
use crate::numerics::gauss::GaussRule;
use crate::scene::ChartPlane;
use std::f64::consts::PI;

/// A cubature over the unit disc: two coordinates and a weight, the weights adding up to 1. With
/// `rings` rings it is exact to degree 4 `rings` - 1; without any it is the middle.
pub fn disc(rings: usize) -> Vec<[f64; 3]> {
    if rings == 0 {
        return vec![[0.0, 0.0, 1.0]];
    }
    let spokes = 4 * rings;
    let mut points = Vec::with_capacity(rings * spokes);
    for (radius2, weight) in GaussRule::of(rings).on(0.0, 1.0) {
        let radius = radius2.sqrt();
        for spoke in 0..spokes {
            let angle = 2.0 * PI * (spoke as f64 + 0.5) / spokes as f64;
            let (sin, cos) = libm::sincos(angle);
            points.push([radius * cos, radius * sin, weight / spokes as f64]);
        }
    }
    points
}

/// A point of a cubature over the chart.
#[derive(Clone, Copy, Debug)]
pub struct ChartPoint {
    /// Where: (a, b).
    pub at: [f64; 2],
    /// Its share of the chart's area, in square metres.
    pub area: f64,
    /// On which patch.
    pub patch: usize,
}

/// A square of a patch.
#[derive(Clone, Copy, Debug)]
pub struct Cell {
    low: [f64; 2],
    side: f64,
    patch: usize,
}

/// The chart in cells. Patches are halved until a cell's sides are at most `ratio` times its distance from
/// the sample, a square of half side `half`.
pub fn cells(plane: &ChartPlane, half: f64, gap: f64, ratio: f64) -> Vec<Cell> {
    let mut found = Vec::new();
    let mut open = Vec::new();
    for row in 0..plane.rows {
        for column in 0..plane.columns {
            let low = [column, row].map(|step| f64::from(step) * plane.pitch);
            let patch = plane.patch(column, row);
            let side = plane.pitch;
            open.push((Cell { low, side, patch }, 0));
        }
    }
    while let Some((cell, depth)) = open.pop() {
        let ([a, b], side) = (cell.low, cell.side);
        let (left, right) = (plane.corner.x + a, plane.corner.x + a + side);
        let beside = (left - half).max(-half - right).max(0.0);
        let distance = libm::hypot(gap + b, beside);
        if side > ratio * distance && depth < DIVISIONS_MAX {
            let side = 0.5 * side;
            for (da, db) in [(0.0, 0.0), (side, 0.0), (0.0, side), (side, side)] {
                let low = [a + da, b + db];
                open.push((Cell { low, side, ..cell }, depth + 1));
            }
            continue;
        }
        found.push(cell);
    }
    found
}

/// A cubature over the chart: `points` by `points` in each cell.
pub fn chart_points(cells: &[Cell], points: usize) -> Vec<ChartPoint> {
    let rule = GaussRule::of(points);
    let mut found = Vec::with_capacity(cells.len() * points * points);
    for Cell { low, side, patch } in cells {
        let [a, b] = *low;
        for (b, weight_b) in rule.on(b, b + side) {
            for (a, weight_a) in rule.on(a, a + side) {
                found.push(ChartPoint {
                    at: [a, b],
                    area: weight_a * weight_b,
                    patch: *patch,
                });
            }
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn discs_integrate_polynomials() {
        for rings in 1..6 {
            let mean = |f: fn(f64, f64) -> f64| -> f64 {
                disc(rings).iter().map(|&[x, y, w]| w * f(x, y)).sum()
            };
            assert!((mean(|_, _| 1.0) - 1.0).abs() < 1e-14);
            assert!((mean(|x, _| x * x) - 0.25).abs() < 1e-14);
            assert!(mean(|x, y| x * x * y).abs() < 1e-14);
            if rings > 1 {
                assert!((mean(|x, y| x * x * y * y) - 1.0 / 24.0).abs() < 1e-14);
            }
        }
    }
}

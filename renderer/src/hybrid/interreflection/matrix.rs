//! What nodes on the chart receive from points of it by way of the sample: the matrix that takes the light of
//! one order to the second next.

use super::frame::Frame;
use super::levels::rule_tolerance;
use super::sources::{ChartPoint, chart_points};
use super::transfer::{ChartPoints, LineBatch, LineSums, from_chart};
use crate::hybrid::budget::interreflection::CELLS;
use rayon::prelude::*;

/// Buffers of a thread.
#[derive(Default)]
struct Scratch {
    batch: LineBatch,
    sums: LineSums,
}

/// What one node receives from each point of unit radiance.
pub struct Row {
    factors: Vec<[f64; 3]>,
    pub evaluations: u64,
    /// Whether the rule has points enough for the lobe.
    pub resolved: bool,
}

/// The points of a level, with the radiance that they have by the bulb and by order 1.
pub struct Points {
    pub points: Vec<ChartPoint>,
    /// In the sample's frame.
    positions: Vec<[f64; 3]>,
    /// Reflectance times area.
    weights: Vec<[f64; 3]>,
    pub direct: Vec<[f64; 3]>,
    pub order_1: Vec<[f64; 3]>,
}

impl Points {
    pub fn new(frame: &Frame<'_>, level: usize, order_1: &impl Fn([f64; 2]) -> [f64; 3]) -> Self {
        let plane = &frame.chart.plane;
        let half = frame.view.sample_half;
        let (ratio, points) = CELLS[level];
        let points = chart_points(plane, half, frame.gap, ratio, points);
        let positions = points.iter().map(|point| {
            let [a, b] = point.at;
            let position = frame.sample.to_frame(plane.point(a, b));
            [position.x, position.y, position.z]
        });
        let weights = points.iter().map(|point| {
            let colour = frame.chart.patches[point.patch];
            colour.map(|channel| channel * point.area)
        });
        let direct = points
            .iter()
            .map(|point| [frame.view.bulb_on_chart(&frame.chart.plane, point.at); 3]);
        Self {
            positions: positions.collect(),
            weights: weights.collect(),
            direct: direct.collect(),
            order_1: points.iter().map(|point| order_1(point.at)).collect(),
            points,
        }
    }

    /// The light of orders 0 and 1.
    pub fn first(&self, index: usize) -> [f64; 3] {
        std::array::from_fn(|i| self.direct[index][i] + self.order_1[index][i])
    }
}

impl Row {
    /// What the node receives if the light on each point is `light`.
    pub fn apply(&self, points: &Points, light: impl Fn(usize) -> [f64; 3]) -> [f64; 3] {
        let mut sum = [0.0; 3];
        for (index, (factor, weight)) in self.factors.iter().zip(&points.weights).enumerate() {
            let light = light(index);
            for channel in 0..3 {
                sum[channel] += factor[channel] * weight[channel] * light[channel];
            }
        }
        sum
    }
}

/// The rows of some nodes by the rules of a level.
pub fn rows(frame: &Frame<'_>, nodes: &[[f64; 2]], points: &Points, level: usize) -> Vec<Row> {
    nodes
        .par_iter()
        .map_init(Scratch::default, |scratch, &node| {
            row(frame, node, points, level, scratch)
        })
        .collect()
}

fn row(
    frame: &Frame<'_>,
    at: [f64; 2],
    points: &Points,
    level: usize,
    scratch: &mut Scratch,
) -> Row {
    let receiver = frame.receiver(at);
    let rule = frame.sample.rule(&receiver, rule_tolerance(level));
    let Scratch { batch, sums } = scratch;
    let source = ChartPoints {
        normal: receiver.normal,
    };
    let mut factors = vec![[0.0; 3]; points.positions.len()];
    let mut evaluations = 0;
    for [v, weight, low, high] in &rule.lines {
        batch.clear();
        for [x, y, z] in &points.positions {
            batch.push([*v, *weight, *low, *high, *x, *y, *z]);
        }
        sums.resize(batch.blocks().len(), Default::default());
        let instructions = frame.view.instructions;
        from_chart(
            instructions,
            batch,
            &receiver,
            &frame.surface,
            rule.along,
            &source,
            sums,
        );
        let per_block = sums.first().map_or(1, |block| block[0].len());
        for (index, factor) in factors.iter_mut().enumerate() {
            let block = &sums[index / per_block];
            for (sum, channel) in factor.iter_mut().zip(block) {
                *sum += channel[index % per_block];
            }
        }
        evaluations += batch.count() as u64 * rule.along.rule.size() as u64;
    }
    Row {
        factors,
        evaluations,
        resolved: rule.resolved,
    }
}

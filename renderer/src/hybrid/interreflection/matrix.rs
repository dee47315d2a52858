//! What nodes on the chart receive from points of it by way of the sample: the matrix that takes the light of
//! one order to the second next.

use super::frame::Frame;
use super::levels::rule_tolerance;
use super::sample_rule::SampleRule;
use super::sources::{Cell, ChartPoint, cells, chart_points};
use super::transfer::{Along, ChartPoints, LineBatch, LineSums, Receiver, from_chart};
use crate::hybrid::budget::interreflection::CELLS;
use rayon::prelude::*;

/// Buffers of a thread.
#[derive(Default)]
struct Scratch {
    batch: LineBatch,
    sums: LineSums,
}

/// A node with the rule over the sample by which it receives light: what it takes is known before.
pub struct Planned {
    receiver: Receiver,
    rule: SampleRule<Along>,
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
    pub fn new(
        frame: &Frame<'_>,
        (cells, level): (&[Cell], usize),
        order_1: &impl Fn([f64; 2]) -> [f64; 3],
    ) -> Self {
        let plane = &frame.chart.plane;
        let (_, points) = CELLS[level];
        let points = chart_points(cells, points);
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

/// The cells of a level, and how many points it has.
pub fn level_cells(frame: &Frame<'_>, level: usize) -> (Vec<Cell>, usize) {
    let (ratio, points) = CELLS[level];
    let half = frame.view.sample_half;
    let cells = cells(&frame.chart.plane, half, frame.gap, ratio);
    let count = cells.len() * points * points;
    (cells, count)
}

impl Planned {
    /// A node as the rules of a level work it out.
    pub fn new(frame: &Frame<'_>, at: [f64; 2], level: usize) -> Self {
        let receiver = frame.receiver(at);
        let rule = frame.sample.rule(&receiver, rule_tolerance(level));
        Self { receiver, rule }
    }

    /// How many evaluations it takes with as many points of the chart.
    pub fn evaluations(&self, points: usize) -> u64 {
        (points * self.rule.lines.len() * self.rule.along.rule.size()) as u64
    }
}

/// The rows of some nodes.
pub fn rows(frame: &Frame<'_>, planned: &[Planned], points: &Points) -> Vec<Row> {
    planned
        .par_iter()
        .map_init(Scratch::default, |scratch, planned| {
            row(frame, planned, points, scratch)
        })
        .collect()
}

fn row(frame: &Frame<'_>, planned: &Planned, points: &Points, scratch: &mut Scratch) -> Row {
    let Planned { receiver, rule } = planned;
    let Scratch { batch, sums } = scratch;
    let source = ChartPoints {
        normal: receiver.normal,
    };
    let mut factors = vec![[0.0; 3]; points.positions.len()];
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
            receiver,
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
    }
    Row {
        factors,
        evaluations: planned.evaluations(points.points.len()),
        resolved: rule.resolved,
    }
}

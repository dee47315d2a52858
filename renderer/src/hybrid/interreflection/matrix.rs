//! What nodes on the chart receive from points of it by way of the sample: the matrix that takes the light of
//! one order to the second next.

use super::chart_transfer::{PositionBatch, add_from_chart};
use super::frame::Frame;
use super::levels::rule_tolerance;
use super::sample_rule::SampleRule;
use super::sources::{Cell, ChartPoint, cells, chart_points};
use super::transfer::{Along, LineSums, Receiver};
use crate::hybrid::budget::interreflection::CELLS;
use crate::numerics::batch::LANES;
use crate::parallel;

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
    positions: PositionBatch,
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
        let mut positions = PositionBatch::default();
        for point in &points {
            let [a, b] = point.at;
            let position = frame.sample.to_frame(plane.point(a, b));
            positions.push([position.x, position.y, position.z]);
        }
        let weights = points.iter().map(|point| {
            let colour = frame.chart.patches[point.patch];
            colour.map(|channel| channel * point.area)
        });
        let direct = points
            .iter()
            .map(|point| [frame.view.bulb_on_chart(&frame.chart.plane, point.at); 3]);
        Self {
            positions,
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
    let work = |sums: &mut LineSums, planned: &Planned| row(frame, planned, points, sums);
    let likely = planned
        .iter()
        .map(|planned| planned.evaluations(points.positions.count()));
    parallel::map(planned, likely.max().unwrap_or(0), work, |row| {
        row.evaluations
    })
}

fn row(frame: &Frame<'_>, planned: &Planned, points: &Points, sums: &mut LineSums) -> Row {
    let Planned { receiver, rule } = planned;
    let positions = &points.positions;
    sums.clear();
    sums.resize(positions.blocks().len(), Default::default());
    for line in &rule.lines {
        let (instructions, surface) = (frame.view.instructions, &frame.surface);
        add_from_chart(
            instructions,
            positions,
            *line,
            receiver,
            surface,
            rule.along,
            sums,
        );
    }
    let factor = |index: usize| {
        let block = &sums[index / LANES];
        [0, 1, 2].map(|channel| block[channel][index % LANES])
    };
    Row {
        factors: (0..positions.count()).map(factor).collect(),
        evaluations: planned.evaluations(positions.count()),
        resolved: rule.resolved,
    }
}

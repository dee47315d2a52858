//! What points of the chart send to another point of it off one line of the sample.
//!
//! All of them share the line. Where its nodes are the same for all, what a node sends to the receiver is worked
//! out once.

#![allow(
    clippy::needless_range_loop,
    reason = "loops over lanes of several arrays: the compiler turns no other form into vectors"
)]

use super::surface::{Surface, Toward};
use super::transfer::{
    Along, Light, LineSums, Lines, Receiver, Sent, Sources, add_light, add_nodes,
};
use crate::numerics::batch::{Batch, LANES};
use crate::numerics::gauss::POINTS_MAX;
use crate::numerics::instructions::kernel;
use crate::vector::Vec3;

/// Positions in the sample's frame.
pub type PositionBatch = Batch<3>;

/// Points of the chart of unit radiance times area.
#[derive(Clone, Copy, Debug)]
struct ChartPoints {
    /// The normal of the chart's front in the frame.
    normal: Vec3,
}

impl Sources for ChartPoints {
    #[inline(always)]
    fn light(&self, [x, y, z]: [f64; 3], u: f64, v: f64) -> Light {
        let (x, y) = (x - u, y - v);
        let distance2 = x * x + y * y + z * z;
        let inverse = 1.0 / distance2.sqrt();
        let (x, y, z) = (x * inverse, y * inverse, z * inverse);
        let n = self.normal;
        let cosine = -(n.x * x + n.y * y + n.z * z);
        let cosine = if cosine > 0.0 { cosine } else { 0.0 };
        let weight = cosine * inverse * inverse;
        Light {
            wi: Vec3 { x, y, z },
            weight,
            irradiance: weight * z,
        }
    }

    #[inline(always)]
    fn origin(&self, [x, y, z]: [f64; 3], _: f64, _: f64) -> Vec3 {
        Vec3 { x, y, z }
    }
}

/// A node of the rule along a line.
#[derive(Clone, Copy, Default)]
struct Node {
    u: f64,
    wo: [f64; 3],
    form: f64,
    toward: Toward,
}

impl Node {
    /// The nodes of a rule along a line, and how many.
    #[inline(always)]
    fn all(
        line: [f64; 4],
        along: Along,
        receiver: &Receiver,
        surface: &Surface,
    ) -> ([Self; POINTS_MAX], usize) {
        let nothing = [0.0; LANES];
        let [v, weight, low, high] = line.map(|number| [number; LANES]);
        let block = [&v, &weight, &low, &high, &nothing, &nothing, &nothing];
        let lines = Lines::new(block, receiver);
        let mut nodes = [Self::default(); POINTS_MAX];
        let mut found = 0;
        let mut rule = along.rule.on(0.0, 1.0);
        loop {
            let (mut at, mut weights, mut count) = ([0.0; LANES], [0.0; LANES], 0);
            for (node, weight) in rule.by_ref().take(LANES) {
                (at[count], weights[count]) = (node, weight);
                count += 1;
            }
            if count == 0 {
                return (nodes, found);
            }
            let sent = Sent::new(&lines, &weight, [&at, &weights], receiver);
            for i in 0..count {
                let wo = [0, 1, 2].map(|axis| sent.wo[axis][i]);
                nodes[found] = Self {
                    u: sent.u[i],
                    wo,
                    form: sent.form[i],
                    toward: surface.toward(wo[2]),
                };
                found += 1;
            }
        }
    }

    /// In every lane.
    #[inline(always)]
    fn sent(&self) -> Sent {
        Sent {
            u: [self.u; LANES],
            wo: self.wo.map(|number| [number; LANES]),
            form: [self.form; LANES],
        }
    }
}

kernel! {
    /// Adds what points of the chart, each of unit radiance times area, send to the receiver off a line: v, its
    /// weight, and its least and largest u.
    pub fn add_from_chart(
        points: &PositionBatch,
        line: [f64; 4],
        receiver: &Receiver,
        surface: &Surface,
        along: Along,
        sums: &mut LineSums,
    ) {
        let source = &ChartPoints { normal: receiver.normal };
        let [v, weight, low, high] = line.map(|number| [number; LANES]);
        let Some(reach) = along.reach else {
            let (nodes, count) = Node::all(line, along, receiver, surface);
            for ([x, y, z], sums) in points.blocks().zip(sums) {
                for node in &nodes[..count] {
                    let light = |i: usize| source.light([x[i], y[i], z[i]], node.u, v[i]);
                    add_light(light, &node.sent(), surface, |_| node.toward, sums);
                }
            }
            return;
        };
        for ([x, y, z], sums) in points.blocks().zip(sums) {
            let mut lines = Lines::new([&v, &weight, &low, &high, x, y, z], receiver);
            lines.narrow(receiver, surface, source, reach);
            add_nodes(&lines, &weight, along.rule, receiver, surface, source, sums);
        }
    }
}

//! What the bulb sends to a point of the chart off lines of the sample, by points of a cubature over it.
//!
//! At a node of a rule along a line all points of the bulb share the way to the receiver and the bulb's place in
//! the sky: these are worked out once.

#![allow(
    clippy::needless_range_loop,
    reason = "loops over lanes of several arrays: the compiler turns no other form into vectors"
)]

use super::bulb::Bulb;
use super::bulb_arcs::PlainLineBatch;
use super::surface::{Surface, Towards};
use super::transfer::{Along, Light, Lines, Receiver, Sent, Sources, add_light, add_nodes};
use crate::numerics::batch::{Batch, LANES, total};
use crate::numerics::instructions::kernel;
use crate::vector::Vec3;
use std::f64::consts::PI;

/// The bulb as seen from a point of the sample.
#[derive(Clone, Copy)]
struct Cap {
    /// The direction to its centre, and two across it.
    centre: Vec3,
    axes: [Vec3; 2],
    /// The square of the map's radius.
    reach2: f64,
    /// One over the square of the axes' length.
    per_length2: f64,
    /// For a radiance of 1.
    irradiance: f64,
}

/// The same from a point a lane: 0 to 2 the direction, 3 to 8 the axes, then the others.
#[derive(Clone, Copy)]
struct Caps([[f64; LANES]; 12]);

impl Caps {
    #[inline(always)]
    fn new(bulb: &Bulb, u: &[f64; LANES], v: &[f64; LANES]) -> Self {
        let mut caps = [[0.0; LANES]; 12];
        for i in 0..LANES {
            let Cap {
                centre: c,
                axes: [a, b],
                reach2,
                per_length2,
                irradiance,
            } = bulb.cap(u[i], v[i]);
            let numbers = [
                c.x,
                c.y,
                c.z,
                a.x,
                a.y,
                a.z,
                b.x,
                b.y,
                b.z,
                reach2,
                per_length2,
                irradiance,
            ];
            for k in 0..12 {
                caps[k][i] = numbers[k];
            }
        }
        Self(caps)
    }

    #[inline(always)]
    fn at(&self, i: usize) -> Cap {
        let Self(caps) = self;
        let vector = |from: usize| Vec3 {
            x: caps[from][i],
            y: caps[from + 1][i],
            z: caps[from + 2][i],
        };
        Cap {
            centre: vector(0),
            axes: [vector(3), vector(6)],
            reach2: caps[9][i],
            per_length2: caps[10][i],
            irradiance: caps[11][i],
        }
    }
}

impl Bulb {
    /// About its half angle, from the middle of the sample.
    pub fn half_angle(&self) -> f64 {
        self.radius / self.centre.length()
    }

    #[inline(always)]
    fn cap(&self, u: f64, v: f64) -> Cap {
        let (cx, cy, cz) = (self.centre.x - u, self.centre.y - v, self.centre.z);
        let distance2 = cx * cx + cy * cy + cz * cz;
        let inverse = 1.0 / distance2.sqrt();
        let (cx, cy, cz) = (cx * inverse, cy * inverse, cz * inverse);
        let sin2 = self.radius * self.radius * inverse * inverse;
        // The x axis times the centre's direction.
        let [ex, ey] = self.x_axis;
        let (ax, ay, az) = (ey * cz, -ex * cz, ex * cy - ey * cx);
        let (bx, by, bz) = (cy * az - cz * ay, cz * ax - cx * az, cx * ay - cy * ax);
        let length2 = ax * ax + ay * ay + az * az;
        let one_and_cos = 1.0 + (1.0 - sin2).sqrt();
        // Divisions and roots are what takes longest: one of each serves the map and both axes' lengths.
        let divided = 1.0 / (one_and_cos * length2);
        let vector = |x, y, z| Vec3 { x, y, z };
        Cap {
            centre: vector(cx, cy, cz),
            axes: [vector(ax, ay, az), vector(bx, by, bz)],
            // Twice one minus the cosine of the half angle.
            reach2: 2.0 * sin2 * (length2 * divided),
            per_length2: one_and_cos * divided,
            irradiance: PI * sin2 * cz,
        }
    }
}

impl Cap {
    /// The light of a share of the bulb from the place of a point of the unit disc.
    #[inline(always)]
    fn light(&self, [x, y]: [f64; 2], radiance: f64) -> Light {
        let ([a, b], c) = (&self.axes, &self.centre);
        let chord2 = self.reach2 * (x * x + y * y);
        let along = 1.0 - 0.5 * chord2;
        let across = (self.reach2 * (1.0 - 0.25 * chord2) * self.per_length2).sqrt();
        let (x, y) = (across * x, across * y);
        Light {
            wi: Vec3 {
                x: c.x * along + a.x * x + b.x * y,
                y: c.y * along + a.y * x + b.y * y,
                z: c.z * along + a.z * x + b.z * y,
            },
            weight: radiance * PI * self.reach2,
            irradiance: radiance * self.irradiance,
        }
    }
}

/// A source is a point of the unit disc, and the share of the bulb that it stands for.
impl Sources for Bulb {
    #[inline(always)]
    fn light(&self, [x, y, share]: [f64; 3], u: f64, v: f64) -> Light {
        self.cap(u, v).light([x, y], self.radiance * share)
    }

    /// As far away as the centre.
    #[inline(always)]
    fn origin(&self, source: [f64; 3], u: f64, v: f64) -> Vec3 {
        let (cx, cy, cz) = (self.centre.x - u, self.centre.y - v, self.centre.z);
        let distance = (cx * cx + cy * cy + cz * cz).sqrt();
        let wi = self.light(source, u, v).wi;
        Vec3 {
            x: u + distance * wi.x,
            y: v + distance * wi.y,
            z: distance * wi.z,
        }
    }
}

/// Buffers.
#[derive(Default)]
pub struct Scratch {
    /// Lines with a point of the bulb: v, the weight, the least and largest u, and the source.
    with_sources: Batch<7>,
    /// Nodes of lines: v, the line's weight, its nearest point to the receiver and that one's distance, both ends,
    /// and the node with its weight.
    nodes: Batch<8>,
}

/// The rule for every line.
#[derive(Clone, Copy)]
pub struct BulbRule<'a> {
    /// Over the unit disc: two coordinates and a weight.
    pub disc: &'a [[f64; 3]],
    /// Along the line.
    pub along: Along,
}

kernel! {
    /// What the bulb sends to the receiver off lines.
    pub fn from_bulb(
        lines: &PlainLineBatch,
        rule: BulbRule<'_>,
        receiver: &Receiver,
        surface: &Surface,
        bulb: &Bulb,
        scratch: &mut Scratch,
    ) -> [f64; 3] {
        let BulbRule { disc, along } = rule;
        let mut sums = [[0.0; LANES]; 3];
        if let Some(reach) = along.reach {
            gather_with_sources(lines, disc, &mut scratch.with_sources);
            for block in scratch.with_sources.blocks() {
                let mut lines = Lines::new(block, receiver);
                lines.narrow(receiver, surface, bulb, reach);
                add_nodes(&lines, block[1], along.rule, receiver, surface, bulb, &mut sums);
            }
        } else {
            gather_nodes(lines, along, receiver, &mut scratch.nodes);
            for block in scratch.nodes.blocks() {
                add_alike(block, disc, receiver, surface, bulb, &mut sums);
            }
        }
        sums.map(total)
    }
}

/// Each line with every point of the bulb.
#[inline(always)]
fn gather_with_sources(lines: &PlainLineBatch, disc: &[[f64; 3]], found: &mut Batch<7>) {
    found.clear();
    for line in 0..lines.count() {
        let [v, weight, low, high] = lines.point(line);
        for [x, y, share] in disc {
            found.push([v, weight, low, high, *x, *y, *share]);
        }
    }
}

/// The nodes of all lines.
#[inline(always)]
fn gather_nodes(lines: &PlainLineBatch, along: Along, receiver: &Receiver, found: &mut Batch<8>) {
    found.clear();
    let nothing = [0.0; LANES];
    let mut left = lines.count();
    for [v, weight, low, high] in lines.blocks() {
        let block = [v, weight, low, high, &nothing, &nothing, &nothing];
        let lines = Lines::new(block, receiver);
        for i in 0..left.min(LANES) {
            let (nearest, delta) = (lines.nearest[i], lines.delta[i]);
            let line = [v[i], weight[i], nearest, delta, lines.low[i], lines.high[i]];
            for (node, weight_t) in along.rule.on(0.0, 1.0) {
                let [v, weight, nearest, delta, low, high] = line;
                found.push([v, weight, nearest, delta, low, high, node, weight_t]);
            }
        }
        left -= left.min(LANES);
    }
}

/// Adds what all points of the bulb send by way of nodes, one a lane.
#[inline(always)]
fn add_alike(
    [v, weight, nearest, delta, low, high, node, weight_t]: [&[f64; LANES]; 8],
    disc: &[[f64; 3]],
    receiver: &Receiver,
    surface: &Surface,
    bulb: &Bulb,
    sums: &mut [[f64; LANES]; 3],
) {
    let nothing = [0.0; LANES];
    let lines = Lines {
        v,
        sources: [&nothing; 3],
        nearest: *nearest,
        delta: *delta,
        low: *low,
        high: *high,
    };
    let sent = Sent::new(&lines, weight, [node, weight_t], receiver);
    let caps = Caps::new(bulb, &sent.u, v);
    let towards = Towards::new(surface, &sent.wo[2]);
    for [x, y, share] in disc {
        let light = |i: usize| caps.at(i).light([*x, *y], bulb.radiance * share);
        add_light(light, &sent, surface, |i| towards.at(i), sums);
    }
}

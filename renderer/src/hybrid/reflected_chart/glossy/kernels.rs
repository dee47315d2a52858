//! What reflection about one normal shows along a line of film points.

use super::affine::Affine;
use super::cells::{Cells, Lanes, Rays, at_lane, position_on};
use super::span::Spans;
use crate::hybrid::reflected_chart::lit_chart::{LitChart, patch_at};
use crate::numerics::batch::LANES;
use crate::numerics::instructions::kernel;
use crate::vector::Vec3;

/// Chart coordinates of a ray that does not hit the chart's front.
const FAR: f64 = -1e9;

kernel! {
    /// Where `rays`, reflected about `normal`, hit the chart, in patches from its corner; returns the
    /// least and the largest along either axis, lane by lane. `frame` holds the chart's axes over
    /// its pitch.
    pub fn intersect(
        rays: &[Rays],
        positions: [&mut [f64]; 2],
        normal: Vec3,
        frame: [Vec3; 3],
    ) -> [[Lanes; 2]; 2] {
        let [us, vs] = positions.map(|line| line.as_chunks_mut::<LANES>().0);
        for ((rays, u), v) in rays.iter().zip(us.iter_mut()).zip(vs.iter_mut()) {
            let (mut a, mut b) = ([0.0; LANES], [0.0; LANES]);
            for i in 0..LANES {
                let (d, at) = (at_lane(&rays.direction, i), at_lane(&rays.at, i));
                let twice = 2.0 * (normal.x * d.x + normal.y * d.y + normal.z * d.z);
                let on = Vec3::new(
                    d.x - twice * normal.x,
                    d.y - twice * normal.y,
                    d.z - twice * normal.z,
                );
                let approach = -(frame[2].x * on.x + frame[2].y * on.y + frame[2].z * on.z);
                let way = rays.above[i] / approach;
                let hit = Vec3::new(at.x + way * on.x, at.y + way * on.y, at.z + way * on.z);
                let along = frame[0].x * hit.x + frame[0].y * hit.y + frame[0].z * hit.z;
                let up = frame[1].x * hit.x + frame[1].y * hit.y + frame[1].z * hit.z;
                a[i] = if approach > 0.0 { along } else { FAR };
                b[i] = if approach > 0.0 { up } else { FAR };
            }
            (*u, *v) = (a, b);
        }
        [extent(us), extent(vs)]
    }
}

kernel! {
    /// Adds to the sums of `pixels` what cells, one of each, reflect, and extends their spans; appends
    /// to `rest` the cells left out, those on corners of patches. `corners` holds along either axis
    /// the positions that [`intersect`] found: upper left, upper right, lower left, lower right.
    /// `optics` is the normal, the index of refraction and the cells' side.
    pub fn shine(
        chart: &LitChart,
        optics: (Vec3, f64, f64),
        cells: &[Cells],
        corners: [[&[f64]; 4]; 2],
        pixels: (&mut [[Lanes; 3]], &mut [Spans]),
        rest: &mut Vec<usize>,
    ) {
        let (normal, ior, cell_side) = optics;
        let (sums, spans) = pixels;
        let corners = corners.map(|axis| axis.map(|line| line.as_chunks::<LANES>().0));
        let counts = [f64::from(chart.plane.columns), f64::from(chart.plane.rows)];
        let cell_area = cell_side * cell_side;
        for (block, ((cells, sums), spans)) in cells.iter().zip(sums).zip(spans).enumerate() {
            let (mut middle, mut across, mut down) = ([[0.0; LANES]; 2], [[0.0; LANES]; 2], [[0.0; LANES]; 2]);
            let (mut low, mut high) = ([[0.0; LANES]; 2], [[0.0; LANES]; 2]);
            for axis in 0..2 {
                let [a, b, c, d] = corners[axis];
                let (a, b, c, d) = (&a[block], &b[block], &c[block], &d[block]);
                for i in 0..LANES {
                    let position = Affine::through([a[i], b[i], c[i], d[i]]);
                    middle[axis][i] = position.middle;
                    across[axis][i] = position.across;
                    down[axis][i] = position.down;
                    low[axis][i] = position.low();
                    high[axis][i] = position.high();
                }
                spans.extend(axis, &low[axis], &high[axis]);
            }

            if cells.blank {
                continue;
            }
            let block_low = [least(&low[0]), least(&low[1])];
            let block_high = [largest(&high[0]), largest(&high[1])];
            if (block_high[0] <= 0.0)
                | (block_low[0] >= counts[0])
                | (block_high[1] <= 0.0)
                | (block_low[1] >= counts[1])
            {
                continue;
            }
            let mut starts = [
                floor_within(block_low[0], 0.0, counts[0] - 1.0),
                floor_within(block_low[1], 0.0, counts[1] - 1.0),
            ];
            let mut ends = starts;
            // Most often one patch shows in all of the cells.
            let alike = (block_low[0] >= starts[0])
                & (block_high[0] < starts[0] + 1.0)
                & (block_low[1] >= starts[1])
                & (block_high[1] < starts[1] + 1.0);

            // The first and last patches of a cell along either axis; none for what is left out.
            let (mut first, mut last) = ([[0.0; LANES]; 2], [[0.0; LANES]; 2]);
            if !alike {
                let mut corner = [0.0; LANES];
                for i in 0..LANES {
                    let f = [
                        floor_within(low[0][i], 0.0, counts[0] - 1.0),
                        floor_within(low[1][i], 0.0, counts[1] - 1.0),
                    ];
                    let l = [
                        floor_within(high[0][i], f[0], counts[0] - 1.0),
                        floor_within(high[1][i], f[1], counts[1] - 1.0),
                    ];
                    let seen = (cells.whole[i] > 0.0)
                        & (high[0][i] > 0.0)
                        & (low[0][i] < counts[0])
                        & (high[1][i] > 0.0)
                        & (low[1][i] < counts[1]);
                    let even = ((low[0][i] >= f[0]) & (high[0][i] < f[0] + 1.0))
                        | ((low[1][i] >= f[1]) & (high[1][i] < f[1] + 1.0));
                    corner[i] = if seen & !even { 1.0 } else { 0.0 };
                    let live = seen & even;
                    first[0][i] = if live { f[0] } else { f64::INFINITY };
                    first[1][i] = if live { f[1] } else { f64::INFINITY };
                    last[0][i] = if live { l[0] } else { -1.0 };
                    last[1][i] = if live { l[1] } else { -1.0 };
                }
                if largest(&corner) > 0.0 {
                    for (i, _) in corner.iter().enumerate().filter(|(_, corner)| **corner > 0.0) {
                        rest.push(LANES * block + i);
                    }
                }
                ends = [largest(&last[0]), largest(&last[1])];
                if ends[0] < 0.0 {
                    continue;
                }
                starts = [least(&first[0]), least(&first[1])];
            }

            let mut tint = [[0.0; LANES]; 3];
            // As arrays of channels: the compiler turns no other form into vectors.
            #[allow(clippy::needless_range_loop)]
            for i in 0..LANES {
                let [red, green, blue] = cells.tint(i, normal, ior);
                (tint[0][i], tint[1][i], tint[2][i]) = (red, green, blue);
            }

            for row in starts[1] as u32..=ends[1] as u32 {
                for column in starts[0] as u32..=ends[0] as u32 {
                    let patch = [f64::from(column), f64::from(row)];
                    let mut area = [0.0; LANES];
                    if alike {
                        for (area, &whole) in area.iter_mut().zip(&cells.whole) {
                            *area = if whole > 0.0 { cell_area } else { 0.0 };
                        }
                    } else {
                        for i in 0..LANES {
                            let on = (patch[0] >= first[0][i])
                                & (patch[0] <= last[0][i])
                                & (patch[1] >= first[1][i])
                                & (patch[1] <= last[1][i]);
                            area[i] = if on { cell_area } else { 0.0 };
                        }
                        for axis in 0..2 {
                            for i in 0..LANES {
                                let position = Affine {
                                    middle: middle[axis][i],
                                    across: across[axis][i],
                                    down: down[axis][i],
                                };
                                let strip = position.share_of_unit(patch[axis]) * cell_side * cell_side;
                                let inside = (low[axis][i] >= patch[axis])
                                    & (high[axis][i] <= patch[axis] + 1.0);
                                area[i] = if inside | (area[i] == 0.0) { area[i] } else { strip };
                            }
                        }
                    }
                    let index = chart.patch(column, row);
                    let (light, colour) = (&chart.light[index], &chart.patches[index]);
                    let mut terms = [[0.0; LANES]; 3];
                    for i in 0..LANES {
                        let at = [
                            position_on(low[0][i], high[0][i], patch[0]),
                            position_on(low[1][i], high[1][i], patch[1]),
                        ];
                        let light = patch_at(light, colour, at);
                        for channel in 0..3 {
                            let term = area[i] * tint[channel][i] * light[channel];
                            terms[channel][i] = if area[i] > 0.0 { term } else { 0.0 };
                        }
                    }
                    for channel in 0..3 {
                        for i in 0..LANES {
                            sums[channel][i] += terms[channel][i];
                        }
                    }
                }
            }
        }
    }
}

/// The whole number at or below `x` clamped to whole numbers from `least`, at least 0, to `most`.
#[inline(always)]
fn floor_within(x: f64, least: f64, most: f64) -> f64 {
    /// 2^52: what is added to it is rounded to a whole number.
    const ROUND: f64 = 4_503_599_627_370_496.0;
    let x = if x > least { x } else { least };
    let x = if x < most { x } else { most };
    let nearest = (x + ROUND) - ROUND;
    if nearest > x { nearest - 1.0 } else { nearest }
}

/// The least and the largest of a line, lane by lane.
#[inline(always)]
fn extent(line: &[Lanes]) -> [Lanes; 2] {
    let (mut low, mut high) = ([f64::INFINITY; LANES], [f64::NEG_INFINITY; LANES]);
    for block in line {
        for i in 0..LANES {
            low[i] = if block[i] < low[i] { block[i] } else { low[i] };
            high[i] = if block[i] > high[i] {
                block[i]
            } else {
                high[i]
            };
        }
    }
    [low, high]
}

#[inline(always)]
fn least(values: &Lanes) -> f64 {
    let [a, b, c, d, e, f, g, h] = *values;
    let less = |a: f64, b: f64| if a < b { a } else { b };
    less(less(less(a, e), less(b, f)), less(less(c, g), less(d, h)))
}

#[inline(always)]
fn largest(values: &Lanes) -> f64 {
    let [a, b, c, d, e, f, g, h] = *values;
    let more = |a: f64, b: f64| if a > b { a } else { b };
    more(more(more(a, e), more(b, f)), more(more(c, g), more(d, h)))
}

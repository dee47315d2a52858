//! Lines of constant q in the slope plane: pieces of patches, in closed form along p.
//!
//! Lines are worked out side by side, one a lane. A line is cut where an edge of a patch crosses it
//! and where the integrand bends. Each piece adds its moments, times its patch's reflectance, to
//! those of its line; then a few points along the line tell what multiplies the density.

use super::conic::Quadratics;
use super::lanes::{Cuts, Lanes, cell, patches, sort};
use super::light_cells::{self, CHANNELS, LightCells};
use super::moments::{self, Moments, Nodes, Order, TABLE_END, Table};
use super::point::Point;
use super::seen::{BEYOND, HIGH, LOW, PARTS, Seen};
use crate::hybrid::budget::glossy::{EDGES_AN_EVALUATION, span_min};
use crate::numerics::batch::{Batch, LANES, total};
use crate::numerics::elementary::{ROUND, log1p};
use crate::numerics::instructions::kernel;
use crate::reflectance::{fresnel, specular};

/// The lines of a rule: q, and the weight of the integral along p.
pub type Lines = Batch<2>;

/// What lines add up to, by channel.
#[derive(Clone, Copy, Debug, Default)]
pub struct LineSums {
    /// The integral of the light times the lobe and Fresnel's reflectance.
    pub fresnel: [f64; 3],
    /// The same with what that exceeds the tint's knee by.
    pub excess: [f64; 3],
    /// Points at which the lobe was evaluated, and cuts and edges in such units.
    pub evaluations: u32,
}

kernel! {
    /// Adds up lines as seen from a point.
    pub fn add_lines(point: &Point<'_>, lines: &Lines, cuts: &mut Cuts) -> LineSums {
        match point.order {
            Order::One => sum(point, &moments::ONE, lines, cuts),
            Order::Three => sum(point, &moments::THREE, lines, cuts),
            Order::Five => sum(point, &moments::FIVE, lines, cuts),
            Order::Seven => sum(point, &moments::SEVEN, lines, cuts),
            Order::Nine => sum(point, &moments::NINE, lines, cuts),
            Order::Eleven => sum(point, &moments::ELEVEN, lines, cuts),
        }
    }
}

#[inline(always)]
fn sum<const N: usize>(
    point: &Point<'_>,
    order: &Nodes<N>,
    lines: &Lines,
    cuts: &mut Cuts,
) -> LineSums {
    let table = &*moments::TABLE;
    let plane = &point.glossy.plane;
    let edges = (plane.columns + plane.rows + 2) as usize;
    let mut sums = Sums::default();
    for [q, weight] in lines.blocks() {
        let block = Block::new(point, q);
        if block.is_dark(point) {
            continue;
        }
        block.cut(point, cuts);
        let mut seen = block.pieces::<N>(point, table, cuts);
        let lines = weight.iter().filter(|weight| **weight != 0.0).count();
        sums.evaluations += (lines * (N + cuts.len() - 2 + edges / EDGES_AN_EVALUATION)) as u32;
        if seen.used != [false; PARTS] {
            block.add_points(point, order, weight, &mut seen, &mut sums);
        }
    }
    LineSums {
        fresnel: sums.fresnel.map(total),
        excess: sums.excess.map(total),
        evaluations: sums.evaluations,
    }
}

/// Sums by channel and lane.
#[derive(Default)]
struct Sums {
    fresnel: [Lanes; 3],
    excess: [Lanes; 3],
    evaluations: u32,
}

/// Lines side by side.
struct Block<'a> {
    q: &'a Lanes,
    /// Widths of the lobe along p for a unit of slope.
    per_width: Lanes,
    /// The p up to which a line is integrated, to either side.
    reach: Lanes,
    /// The position on the chart in patches from its corner, times the depth; and the depth.
    positions: [Quadratics; 2],
    depth: Quadratics,
}

impl<'a> Block<'a> {
    #[inline(always)]
    fn new(point: &Point<'_>, q: &'a Lanes) -> Self {
        let (mut per_width, mut reach) = ([0.0; LANES], [0.0; LANES]);
        for i in 0..LANES {
            per_width[i] = point.widths_per_slope(q[i]);
            reach[i] = point.reach / per_width[i];
        }
        Self {
            q,
            per_width,
            reach,
            positions: [point.across.on_lines(q), point.up.on_lines(q)],
            depth: point.depth.on_lines(q),
        }
    }

    /// Whether no line shows anything of the chart: each runs behind its plane, or beyond one of its
    /// sides.
    #[inline(always)]
    fn is_dark(&self, point: &Point<'_>) -> bool {
        let mut dark = self.depth.keep_sign(&self.reach, -1.0);
        for axis in 0..2 {
            let far = self.positions[axis].less(point.counts[axis], &self.depth);
            let before = self.positions[axis].keep_sign(&self.reach, -1.0);
            let beyond = far.keep_sign(&self.reach, 1.0);
            for i in 0..LANES {
                dark[i] |= before[i] | beyond[i];
            }
        }
        dark == [true; LANES]
    }

    /// Finds where lines are cut: at edges of patches and bends of the integrand, and at either end.
    #[inline(always)]
    fn cut(&self, point: &Point<'_>, cuts: &mut Cuts) {
        cuts.clear();
        cuts.push(self.reach.map(|reach| -reach));
        let mut counts = [1; LANES];
        let plane = &point.glossy.plane;
        for (axis, count) in [plane.columns, plane.rows].into_iter().enumerate() {
            let (position, other) = (&self.positions[axis], &self.positions[1 - axis]);
            let most = point.counts[1 - axis];
            for edge in 0..=count {
                let edge = position.less(f64::from(edge), &self.depth);
                if !edge.may_vanish(&self.reach) {
                    continue;
                }
                for mut zeros in edge.zeros() {
                    let (at, depth) = (other.values(&zeros), self.depth.values(&zeros));
                    for i in 0..LANES {
                        // Beyond the chart its lattice parts nothing.
                        let parts = (at[i] >= 0.0) & (at[i] <= most * depth[i]);
                        zeros[i] = if parts { zeros[i] } else { f64::INFINITY };
                    }
                    self.push(&zeros, cuts, &mut counts);
                }
            }
        }
        for level in point.branches.levels() {
            let level = level.on_lines(self.q);
            if level.may_vanish(&self.reach) {
                for zeros in level.zeros() {
                    self.push(&zeros, cuts, &mut counts);
                }
            }
        }
        sort(&mut cuts[1..]);
        cuts.push(self.reach);
    }

    /// Adds those of some cuts that lie in reach.
    #[inline(always)]
    fn push(&self, zeros: &Lanes, cuts: &mut Cuts, counts: &mut [usize; LANES]) {
        for i in 0..LANES {
            if zeros[i].abs() < self.reach[i] {
                if counts[i] == cuts.len() {
                    cuts.push(self.reach);
                }
                cuts[counts[i]][i] = zeros[i];
                counts[i] += 1;
            }
        }
    }

    /// Adds the pieces of all lines up.
    #[inline(always)]
    fn pieces<const N: usize>(&self, point: &Point<'_>, table: &Table, cuts: &Cuts) -> Seen<N> {
        let mut seen = Seen {
            moments: [[[[0.0; LANES]; N]; 3]; PARTS],
            used: [false; PARTS],
            middle: [[0.0; LANES]; 2],
            span: [[f64::INFINITY; LANES], [f64::NEG_INFINITY; LANES]],
        };
        let mut below = [[0.0; LANES]; N];
        for (index, to) in cuts.iter().enumerate().skip(1) {
            let above = if index + 1 < cuts.len() {
                let mut z = [0.0; LANES];
                for i in 0..LANES {
                    let inside = to[i] < self.reach[i];
                    z[i] = if inside {
                        to[i] * self.per_width[i]
                    } else {
                        TABLE_END
                    };
                }
                moments::up_to(table, &z)
            } else {
                moments::everything()
            };
            let mut piece = [[0.0; LANES]; N];
            for k in 0..N {
                for i in 0..LANES {
                    piece[k][i] = above[k][i] - below[k][i];
                }
            }
            self.add_piece(point, [&cuts[index - 1], to], &piece, &mut seen);
            below = above;
        }
        seen
    }

    /// Adds a piece of every line; an empty one has no moments.
    #[inline(always)]
    fn add_piece<const N: usize>(
        &self,
        point: &Point<'_>,
        [from, to]: [&Lanes; 2],
        piece: &Moments<N>,
        seen: &mut Seen<N>,
    ) {
        let mut middle = [0.0; LANES];
        for i in 0..LANES {
            middle[i] = 0.5 * (from[i] + to[i]);
        }
        let depth = self.depth.values(&middle);
        let (mut across, mut up) = (
            self.positions[0].values(&middle),
            self.positions[1].values(&middle),
        );
        let mut on_chart = [false; LANES];
        let [columns, rows] = point.counts;
        for i in 0..LANES {
            let per_depth = 1.0 / depth[i];
            across[i] *= per_depth;
            up[i] *= per_depth;
        }
        for i in 0..LANES {
            on_chart[i] = (depth[i] > 0.0)
                & (from[i] < to[i])
                & (across[i] >= 0.0)
                & (across[i] < columns)
                & (up[i] >= 0.0)
                & (up[i] < rows);
        }
        if on_chart == [false; LANES] {
            return;
        }
        let mut positions = [[0.0; LANES]; 2];
        for i in 0..LANES {
            positions[0][i] = if on_chart[i] { across[i] } else { 0.0 };
            positions[1][i] = if on_chart[i] { up[i] } else { 0.0 };
        }
        let patches = patches(&positions, point.counts);
        let mut colours = [[0.0; LANES]; 3];
        for i in 0..LANES {
            let colour = &point.glossy.colours[patches[i]];
            for channel in 0..3 {
                colours[channel][i] = if on_chart[i] { colour[channel] } else { 0.0 };
            }
        }
        seen.extend([from, to], &positions, &on_chart);
        let low = self.is_low(point, &middle, &on_chart);
        seen.add(HIGH, piece, &colours, &low.map(|low| !low));
        seen.add(LOW, piece, &colours, &low);
        if point.branches.has_knee() {
            let beyond = self.is_beyond(point, &middle, &on_chart);
            let [mut high, mut low] = [low; 2];
            for i in 0..LANES {
                high[i] = beyond[i] & !high[i];
                low[i] &= beyond[i];
            }
            seen.add(BEYOND + HIGH, piece, &colours, &high);
            seen.add(BEYOND + LOW, piece, &colours, &low);
        }
    }

    /// Whether light stands lower than the viewer at a p of each line on the chart.
    #[inline(always)]
    fn is_low(&self, point: &Point<'_>, p: &Lanes, on_chart: &[bool; LANES]) -> [bool; LANES] {
        let even = point.branches.even.on_lines(self.q).values(p);
        let mut low = [false; LANES];
        for i in 0..LANES {
            low[i] = on_chart[i] & (even[i] < 0.0);
        }
        low
    }

    /// Whether the tint is beyond its knee at a p of each line on the chart.
    #[inline(always)]
    fn is_beyond(&self, point: &Point<'_>, p: &Lanes, on_chart: &[bool; LANES]) -> [bool; LANES] {
        let (wo, branches) = (point.wo, &point.branches);
        let mut beyond = [false; LANES];
        for i in 0..LANES {
            let cos_i = specular::cos_i(&wo, [p[i], self.q[i]]);
            let cos_i = if cos_i > 0.0 { cos_i } else { 0.0 };
            beyond[i] = on_chart[i] & (fresnel::reflectance(cos_i, branches.ior) > branches.knee);
        }
        beyond
    }

    /// Where the points of a line lie: their middle and the unit of the order's nodes, in widths.
    ///
    /// Over a whole lobe they are Gauss's. Where only a part shows the chart they are drawn together
    /// to that part, because light is known nowhere else.
    #[inline(always)]
    fn frame<const N: usize>(&self, order: &Nodes<N>, seen: &Seen<N>) -> [Lanes; 2] {
        let farthest = if N > 1 { order.nodes[N - 1] } else { 1.0 };
        let span_min = span_min(N);
        let [mut middle, mut unit] = [[0.0; LANES]; 2];
        for i in 0..LANES {
            let [first, last] = [0, 1].map(|end| seen.span[end][i] * self.per_width[i]);
            let shows = first < last;
            let first = if first > -farthest { first } else { -farthest };
            let last = if last < farthest { last } else { farthest };
            let [centre, half] = [0.5 * (first + last), 0.5 * (last - first)];
            middle[i] = if shows { centre } else { 0.0 };
            let half = if shows & (half > span_min) {
                half
            } else {
                span_min
            };
            unit[i] = half / farthest;
        }
        [middle, unit]
    }

    /// Adds the points of the lines.
    #[inline(always)]
    fn add_points<const N: usize>(
        &self,
        point: &Point<'_>,
        order: &Nodes<N>,
        weight: &Lanes,
        seen: &mut Seen<N>,
        sums: &mut Sums,
    ) {
        let [middle, unit] = self.frame(order, seen);
        seen.move_to(&middle, &unit);
        let [mut width, mut scale] = [[0.0; LANES]; 2];
        for i in 0..LANES {
            width[i] = 1.0 / self.per_width[i];
            scale[i] = weight[i] * width[i];
        }
        // Each step is taken at all points of the lines before the next one: chains of operations that wait for each
        // other run side by side.
        let [mut p, mut density] = [[[0.0; LANES]; N]; 2];
        for k in 0..N {
            for i in 0..LANES {
                let z = middle[i] + unit[i] * order.nodes[k];
                p[k][i] = z * width[i];
                density[k][i] = 0.5 * z * z;
            }
        }
        let mut factors = [Factors::default(); N];
        for k in 0..N {
            factors[k] = self.factors(point, [&p[k], &density[k]], &scale);
        }
        let mut places = [Places::default(); N];
        for k in 0..N {
            places[k] = self.places(point, &p[k], &seen.middle);
        }
        for k in 0..N {
            let light = places[k].light(&point.glossy.light);
            let Factors {
                value,
                beyond,
                shade,
            } = &factors[k];
            for channel in 0..3 {
                let parts = seen.at(channel, &order.polynomials[k]);
                for i in 0..LANES {
                    let all = parts[HIGH][i] + shade[i] * parts[LOW][i];
                    sums.fresnel[channel][i] += value[i] * light[channel][i] * all;
                }
                if point.branches.has_knee() {
                    for i in 0..LANES {
                        let part = parts[BEYOND + HIGH][i] + shade[i] * parts[BEYOND + LOW][i];
                        sums.excess[channel][i] += beyond[i] * light[channel][i] * part;
                    }
                }
            }
        }
    }

    /// What multiplies the density and the light at a p of each line. The density's own fall is in the moments.
    #[inline(always)]
    fn factors(&self, point: &Point<'_>, [p, density]: [&Lanes; 2], scale: &Lanes) -> Factors {
        let (lobe, wo) = (&point.glossy.reflectance.lobe, point.wo);
        let exponents = [lobe.n_u, lobe.n_v];
        let per_viewer = 1.0 / wo.z;
        let (ior, knee) = (point.branches.ior, point.branches.knee);
        let mut factors = Factors::default();
        for i in 0..LANES {
            let [lobe, cos_i] = specular::at_slopes(exponents, &wo, [p[i], self.q[i]], density[i]);
            let lobe = scale[i] * lobe;
            // Points that a piece is told by can lie beyond it, and below the horizon.
            let cos_i = if cos_i > 0.0 { cos_i } else { 0.0 };
            let fresnel = fresnel::reflectance(cos_i, ior);
            factors.value[i] = lobe * fresnel;
            factors.beyond[i] = lobe * (fresnel - knee);
            factors.shade[i] = cos_i * per_viewer;
        }
        factors
    }

    /// Where the chart is seen at a p of each line; where it is not, at `middle`. The light there is a smooth function
    /// of the position, told beyond the chart's edges by the outer patches.
    #[inline(always)]
    fn places(&self, point: &Point<'_>, p: &Lanes, middle: &[Lanes; 2]) -> Places {
        let depth = self.depth.values(p);
        let (mut across, mut up) = (self.positions[0].values(p), self.positions[1].values(p));
        let light = &point.glossy.light;
        let (counts, parts) = (light.counts, light.parts);
        let (pitch_per_gap, per_log) = (light.pitch_per_gap, light.per_log);
        for i in 0..LANES {
            let per_depth = 1.0 / depth[i];
            let shows = depth[i] > 0.0;
            across[i] = if shows {
                across[i] * per_depth
            } else {
                middle[0][i]
            };
            up[i] = if shows {
                up[i] * per_depth
            } else {
                middle[1][i]
            };
        }
        for i in 0..LANES {
            across[i] *= parts;
            up[i] = if up[i] > 0.0 { up[i] } else { 0.0 };
            up[i] = log1p(up[i] * pitch_per_gap) * per_log;
        }
        let [mut column, mut row, mut cells] = [[0.0; LANES]; 3];
        for i in 0..LANES {
            column[i] = cell(across[i], counts[0]);
            row[i] = cell(up[i], counts[1]);
            cells[i] = row[i] * counts[0] + column[i] + ROUND;
        }
        Places {
            cells,
            across: within(&across, &column),
            up: within(&up, &row),
        }
    }
}

/// What multiplies the density and the light at a point of each line.
#[derive(Clone, Copy, Default)]
struct Factors {
    /// The lobe times Fresnel's reflectance.
    value: Lanes,
    /// The lobe times what that exceeds the tint's knee by.
    beyond: Lanes,
    /// The light's cosine over the viewer's.
    shade: Lanes,
}

/// Places on the chart, one of each line.
#[derive(Clone, Copy, Default)]
struct Places {
    /// The numbers of the cells of light, and [`ROUND`].
    cells: Lanes,
    /// The positions in these cells.
    across: Lanes,
    up: Lanes,
}

impl Places {
    /// The light there, by channel.
    #[inline(always)]
    fn light(&self, light: &LightCells) -> [Lanes; 3] {
        // Four channels of a line are a vector.
        let mut by_line = [[0.0; CHANNELS]; LANES];
        for i in 0..LANES {
            let cell = (self.cells[i].to_bits() - ROUND.to_bits()) as usize;
            by_line[i] = light_cells::value(&light.cells[cell], [self.across[i], self.up[i]]);
        }
        let mut by_channel = [[0.0; LANES]; 3];
        for channel in 0..3 {
            for i in 0..LANES {
                by_channel[channel][i] = by_line[i][channel];
            }
        }
        by_channel
    }
}

/// Positions within their cells, 0 to 1; no farther out than a cell beyond.
#[inline(always)]
fn within(positions: &Lanes, cells: &Lanes) -> Lanes {
    let mut within = [0.0; LANES];
    for i in 0..LANES {
        let at = positions[i] - cells[i];
        let at = if at > -1.0 { at } else { -1.0 };
        within[i] = if at < 2.0 { at } else { 2.0 };
    }
    within
}

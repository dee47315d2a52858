//! The colour chart and the light on it, told patch by patch by polynomials.
//!
//! What the sample sends to the chart rises from nothing at the sample's level to its peak at about
//! the height of the gap between the two, far below a patch's. So up a patch the polynomials are in
//! the logarithm of the height, as interreflection's own tiles are.
//!
//! Across a patch a parabola serves the preset's tolerance. A tighter one asks for a quartic: parabolas on
//! parts of patches need four times the parts, and so four times the work, for an eighth of the error.

use crate::hybrid::chart_on_film::ChartOnFilm;
use crate::numerics::batch::FOUR;
use crate::numerics::elementary::log1p;
use crate::scene::ChartPlane;
use std::f64::consts::FRAC_1_SQRT_2;

/// The chart with its patches and the light on them, which is known at `NODES` points across a patch:
/// [`PARABOLA`] or [`QUARTIC`].
#[derive(Clone, Debug)]
pub struct LitChart<const NODES: usize> {
    /// The chart, parted.
    pub plane: ChartPlane,
    /// Into how many parts each side of a patch is cut: below, "patch" is such a part.
    pub parts: u32,
    /// Reflectance times what `light` gives is a patch's radiance.
    pub patches: Vec<[f64; 3]>,
    /// Irradiance over pi, in units of white, at the nodes of each patch, a row of nodes after the other.
    light: Vec<[[f64; CHANNELS]; NODES]>,
    /// How heights are told.
    pub heights: Heights,
}

/// The light that such a chart sends out.
#[derive(Clone, Debug)]
pub struct RadiantChart<const NODES: usize> {
    /// The chart, parted.
    pub plane: ChartPlane,
    /// The chart in whole patches.
    pub whole_plane: ChartPlane,
    /// Radiance in units of white, at the nodes of each patch, a row of nodes after the other.
    radiance: Vec<[[f64; CHANNELS]; NODES]>,
    heights: Heights,
}

/// Three channels and one that is 0: together a vector.
const CHANNELS: usize = 4;

/// Points of a parabola: 0, 1/2 and 1.
pub const PARABOLA: usize = 3;

/// Points of a quartic, Chebyshev's with both ends: (1 - cos(k pi / 4)) / 2.
pub const QUARTIC: usize = 5;

/// Points of the polynomial up a patch whose light a quartic tells across, in the same way: (1 - cos(k pi / 8)) / 2.
pub const UP_MAX: usize = 9;

const QUARTIC_NODES: [f64; QUARTIC] = [
    0.0,
    0.146_446_609_406_726_24,
    0.5,
    0.853_553_390_593_273_8,
    1.0,
];

const UP_NODES: [f64; UP_MAX] = [
    0.0,
    0.038_060_233_744_356_62,
    0.146_446_609_406_726_24,
    0.308_658_283_817_455_1,
    0.5,
    0.691_341_716_182_544_9,
    0.853_553_390_593_273_8,
    0.961_939_766_255_643_4,
    1.0,
];

/// What the polynomials of a patch are made of.
struct Nodes<const NODES: usize> {
    /// Where across a patch its light is known.
    across: [f64; NODES],
    /// Where up a patch, in the logarithm of the height.
    up: &'static [f64],
    /// About where they miss most, across and up.
    probes: [[f64; 2]; 4],
}

impl<const NODES: usize> Nodes<NODES> {
    const ALL: Self = {
        let mut across = [0.0; NODES];
        match NODES {
            PARABOLA => {
                across.copy_from_slice(&[0.0, 0.5, 1.0]);
                // A parabola misses most of a cubic at (1 -+ 1/sqrt(3))/2.
                const LOW: f64 = 0.211_324_865_405_187_13;
                const HIGH: f64 = 1.0 - LOW;
                Self {
                    across,
                    up: &QUARTIC_NODES,
                    probes: [[LOW, 0.06], [HIGH, 0.31], [LOW, 0.69], [HIGH, 0.94]],
                }
            }
            QUARTIC => {
                across.copy_from_slice(&QUARTIC_NODES);
                Self {
                    across,
                    up: &UP_NODES,
                    probes: [[0.06, 0.01], [0.31, 0.22], [0.69, 0.6], [0.94, 0.92]],
                }
            }
            _ => panic!("no such polynomial"),
        }
    };

    /// How many points up a patch has.
    const UP: usize = Self::ALL.up.len();
}

/// The rows of a chart's patches over ln(1 + height / gap).
#[derive(Clone, Debug)]
pub struct Heights {
    /// The scale in metres.
    pub gap: f64,
    /// Of each row the lower end, and one over the length.
    rows: Vec<[f64; 2]>,
}

impl Heights {
    fn new(plane: &ChartPlane, gap: f64) -> Self {
        let end = |row: u32| libm::log1p(f64::from(row) * plane.pitch / gap);
        Self {
            gap,
            rows: (0..plane.rows)
                .map(|row| [end(row), 1.0 / (end(row + 1) - end(row))])
                .collect(),
        }
    }

    /// Where a height in metres lies in a row, 0 to 1.
    #[inline(always)]
    fn within(&self, row: u32, height: f64) -> f64 {
        let [low, per_length] = self.rows[row as usize];
        ((log1p(height.max(0.0) / self.gap) - low) * per_length).clamp(0.0, 1.0)
    }

    /// The height in metres of a position of 0 to 1 in a row.
    fn height(&self, row: u32, within: f64) -> f64 {
        let [low, per_length] = self.rows[row as usize];
        self.gap * libm::expm1(low + within / per_length)
    }
}

/// How it is known what polynomials miss.
#[derive(Clone)]
pub enum Missed<T> {
    /// Of the chart's radiance, and so of what the sample sends on of it: a sample sends on no more than it gets.
    AtMost(f64),
    /// By the same in smaller parts.
    Against(T),
}

impl<T> Missed<T> {
    /// Of what it is compared with a reference.
    pub fn as_ref(&self) -> Missed<&T> {
        match self {
            Self::AtMost(most) => Missed::AtMost(*most),
            Self::Against(finer) => Missed::Against(finer),
        }
    }

    /// Compared with something that is made of it.
    pub fn map<U>(self, map: impl FnOnce(T) -> U) -> Missed<U> {
        match self {
            Self::AtMost(most) => Missed::AtMost(most),
            Self::Against(finer) => Missed::Against(map(finer)),
        }
    }
}

/// What is missed between the probes is at most this many times what is missed at them.
const MISSED_MARGIN: f64 = 1.5;

impl<const NODES: usize> LitChart<NODES> {
    /// The chart under the light that `irradiance` (over pi) gives, each patch parted into `parts` by
    /// `parts`; `gap` is the scale in metres of heights over which the light changes.
    pub fn new(
        chart: &ChartOnFilm,
        gap: f64,
        parts: u32,
        irradiance: impl Fn([f64; 2]) -> [f64; 3],
    ) -> Self {
        let mut plane = chart.plane;
        plane.pitch /= f64::from(parts);
        plane.columns *= parts;
        plane.rows *= parts;
        let Nodes { across, up, .. } = Nodes::<NODES>::ALL;
        let heights = Heights::new(&plane, gap);
        let count = (plane.columns * plane.rows) as usize;
        let mut patches = Vec::with_capacity(count);
        let nodes = count * Nodes::<NODES>::UP;
        let mut light = Vec::with_capacity(nodes);
        for index in 0..count {
            let [column, row] = plane.cell(index);
            patches.push(chart.patches[chart.plane.patch(column / parts, row / parts)]);
            let a = f64::from(column) * plane.pitch;
            for up in up {
                let b = heights.height(row, *up);
                let here = across.map(|node| irradiance([a + plane.pitch * node, b]));
                light.push(here.map(|[r, g, b]| [r, g, b, 0.0]));
            }
        }
        Self {
            plane,
            parts,
            patches,
            light,
            heights,
        }
    }

    /// The chart in whole patches.
    pub fn whole_plane(&self) -> ChartPlane {
        let mut plane = self.plane;
        plane.pitch *= f64::from(self.parts);
        plane.columns /= self.parts;
        plane.rows /= self.parts;
        plane
    }

    /// A bound of what the polynomials miss, from where that shows most.
    pub fn missed(&self, irradiance: impl Fn([f64; 2]) -> [f64; 3]) -> f64 {
        let mut missed = 0.0f64;
        for row in 0..self.plane.rows {
            for column in 0..self.plane.columns {
                let patch = self.patch(column, row);
                let colour = &self.patches[patch];
                for [across, up] in Nodes::<NODES>::ALL.probes {
                    let a = (f64::from(column) + across) * self.plane.pitch;
                    let b = self.heights.height(row, up);
                    let exact = irradiance([a, b]);
                    let light = self.light_across(column, row, b);
                    let found = polynomial(&light, across);
                    for channel in 0..3 {
                        let off = colour[channel] * (found[channel] - exact[channel]);
                        missed = missed.max(off.abs());
                    }
                }
            }
        }
        MISSED_MARGIN * missed
    }

    /// The number of the patch in a column and row, counted from the chart's corner.
    #[inline(always)]
    pub fn patch(&self, column: u32, row: u32) -> usize {
        self.plane.patch(column, row)
    }

    /// The irradiance over pi on a patch at a height in metres, at its points across.
    #[inline(always)]
    pub fn light_across(&self, column: u32, row: u32, height: f64) -> [[f64; 3]; NODES] {
        let first = self.patch(column, row) * Nodes::<NODES>::UP;
        let light = &self.light[first..first + Nodes::<NODES>::UP];
        let weights = up_weights::<NODES, 1>(&[self.heights.within(row, height)]);
        let mut across = [[0.0; 3]; NODES];
        for up in 0..Nodes::<NODES>::UP {
            for node in 0..NODES {
                for i in 0..3 {
                    across[node][i] += weights[up][0] * light[up][node][i];
                }
            }
        }
        across
    }
}

impl<const NODES: usize> From<LitChart<NODES>> for RadiantChart<NODES> {
    fn from(chart: LitChart<NODES>) -> Self {
        let whole_plane = chart.whole_plane();
        let mut radiance = chart.light;
        let patches = radiance.chunks_exact_mut(Nodes::<NODES>::UP);
        for (nodes, [red, green, blue]) in patches.zip(chart.patches) {
            for [r, g, b, _] in nodes.as_flattened_mut() {
                (*r, *g, *b) = (*r * red, *g * green, *b * blue);
            }
        }
        Self {
            plane: chart.plane,
            whole_plane,
            radiance,
            heights: chart.heights,
        }
    }
}

impl<const NODES: usize> RadiantChart<NODES> {
    /// The weights of the nodes up a row of patches, at heights in metres.
    #[inline(always)]
    pub fn weights_up(&self, row: u32, heights: &[f64; FOUR]) -> [[f64; FOUR]; UP_MAX] {
        let mut within = [0.0; FOUR];
        for i in 0..FOUR {
            within[i] = self.heights.within(row, heights[i]);
        }
        up_weights::<NODES, FOUR>(&within)
    }

    /// The radiance of a patch at its points across, at the height of these weights.
    #[inline(always)]
    pub fn radiance_across(
        &self,
        column: u32,
        row: u32,
        weights: &[f64; UP_MAX],
    ) -> [[f64; 3]; NODES] {
        let first = self.plane.patch(column, row) * Nodes::<NODES>::UP;
        let radiance = &self.radiance[first..first + Nodes::<NODES>::UP];
        let mut across = [[0.0; CHANNELS]; NODES];
        for (weight, radiance) in weights.iter().zip(radiance) {
            let values = radiance.as_flattened().iter();
            for (sum, value) in across.as_flattened_mut().iter_mut().zip(values) {
                *sum += weight * value;
            }
        }
        across.map(|[r, g, b, _]| [r, g, b])
    }
}

/// The weights of the parabola through points at 0, 1/2 and 1, at `along`.
#[inline(always)]
fn parabola_weights(along: f64) -> [f64; PARABOLA] {
    let x = 2.0 * along - 1.0;
    [0.5 * x * (x - 1.0), 1.0 - x * x, 0.5 * x * (x + 1.0)]
}

/// The weights of the quartic through its points, at `along`.
#[inline(always)]
fn quartic_weights(along: f64) -> [f64; QUARTIC] {
    let x = 2.0 * along - 1.0;
    let (outer, inner) = (x * x - 1.0, x * x - 0.5);
    [
        x * (x - 1.0) * inner,
        -2.0 * x * (x - FRAC_1_SQRT_2) * outer,
        2.0 * outer * inner,
        -2.0 * x * (x + FRAC_1_SQRT_2) * outer,
        x * (x + 1.0) * inner,
    ]
}

/// The weights of the points up a patch, at each `up`; zeros beyond the last.
#[inline(always)]
fn up_weights<const NODES: usize, const N: usize>(up: &[f64; N]) -> [[f64; N]; UP_MAX] {
    if NODES == QUARTIC {
        return lagrange(up);
    }
    let mut weights = [[0.0; N]; UP_MAX];
    for i in 0..N {
        let [a, b, c, d, e] = quartic_weights(up[i]);
        (weights[0][i], weights[1][i], weights[2][i]) = (a, b, c);
        (weights[3][i], weights[4][i]) = (d, e);
    }
    weights
}

/// Lagrange's weights of the points [`UP_NODES`], at each `up`.
#[inline(always)]
fn lagrange<const N: usize>(up: &[f64; N]) -> [[f64; N]; UP_MAX] {
    const SCALES: [f64; UP_MAX] = {
        let mut scales = [1.0; UP_MAX];
        let (mut node, mut other) = (0, 0);
        while node < UP_MAX {
            if other != node {
                scales[node] /= UP_NODES[node] - UP_NODES[other];
            }
            other += 1;
            if other == UP_MAX {
                (node, other) = (node + 1, 0);
            }
        }
        scales
    };
    let mut weights = SCALES.map(|scale| [scale; N]);
    // From either end the product of the distances to the points passed.
    let (mut before, mut after) = ([1.0; N], [1.0; N]);
    for node in 0..UP_MAX {
        for i in 0..N {
            weights[node][i] *= before[i];
            before[i] *= up[i] - UP_NODES[node];
        }
        let node = UP_MAX - 1 - node;
        for i in 0..N {
            weights[node][i] *= after[i];
            after[i] *= up[i] - UP_NODES[node];
        }
    }
    weights
}

/// The polynomial through the points of a parabola or a quartic, at a position of 0 to 1.
#[inline(always)]
pub fn polynomial<const NODES: usize>(light: &[[f64; 3]; NODES], along: f64) -> [f64; 3] {
    let mut weights = [0.0; NODES];
    match NODES {
        PARABOLA => weights.copy_from_slice(&parabola_weights(along)),
        _ => weights.copy_from_slice(&quartic_weights(along)),
    }
    std::array::from_fn(|i| {
        let mut sum = weights[0] * light[0][i];
        for node in 1..NODES {
            sum += weights[node] * light[node][i];
        }
        sum
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn polynomials_go_through_their_nodes() {
        fn check<const NODES: usize>() {
            let Nodes { across, up, .. } = Nodes::<NODES>::ALL;
            let values: [[f64; 3]; NODES] =
                std::array::from_fn(|node| [1.0, node as f64, (7 * node % 4) as f64]);
            for (node, expected) in across.into_iter().zip(values) {
                for (found, expected) in polynomial(&values, node).into_iter().zip(expected) {
                    assert!((found - expected).abs() < 1e-13, "{NODES} {node}: {found}");
                }
            }
            for (node, up) in up.iter().enumerate() {
                for (other, [weight]) in up_weights::<NODES, 1>(&[*up]).into_iter().enumerate() {
                    let expected = if other == node { 1.0 } else { 0.0 };
                    assert!(
                        (weight - expected).abs() < 1e-13,
                        "{node} {other}: {weight}"
                    );
                }
            }
            let [across, ..] = polynomial(&values, 0.3);
            let up: f64 = up_weights::<NODES, 1>(&[0.3]).as_flattened().iter().sum();
            assert!((across - 1.0).abs() < 1e-14 && (up - 1.0).abs() < 1e-13);
        }
        check::<PARABOLA>();
        check::<QUARTIC>();
    }
}

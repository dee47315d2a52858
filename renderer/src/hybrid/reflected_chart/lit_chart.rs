//! The colour chart and the light on it, told patch by patch by polynomials.
//!
//! What the sample sends to the chart rises from nothing at the sample's level to its peak at about
//! the height of the gap between the two, far below a patch's. So up a patch the polynomials are in
//! the logarithm of the height, as interreflection's own tiles are.

use crate::hybrid::budget::reflected_chart::PATCHES_MAX;
use crate::hybrid::chart_on_film::ChartOnFilm;
use crate::numerics::elementary::log1p;
use crate::scene::ChartPlane;
use std::f64::consts::FRAC_1_SQRT_2;

/// The chart with its patches and their light.
#[derive(Clone, Debug)]
pub struct LitChart {
    /// The chart, parted.
    pub plane: ChartPlane,
    /// Into how many parts each side of a patch is cut: below, "patch" is such a part.
    pub parts: u32,
    /// Reflectance times what `light` gives is a patch's radiance.
    pub patches: Vec<[f64; 3]>,
    /// Irradiance over pi, in units of white, at the nodes of each patch.
    light: Vec<PatchLight>,
    /// Radiance there.
    radiance: Vec<[[f64; ACROSS]; UP_NODES]>,
    /// How heights are told.
    pub heights: Heights,
}

/// By node up, node across and channel.
type PatchLight = [[[f64; 3]; ACROSS_NODES]; UP_NODES];

/// Three channels at [`ACROSS_NODES`] points, and zeros that fill vectors up.
const ACROSS: usize = 12;

/// Equidistant points across a patch at which its light is known; a parabola goes through them.
pub const ACROSS_NODES: usize = 3;

/// Points up a patch, Lobatto's in the logarithm of the height: 0, (1 -+ 1/sqrt(2))/2, 1/2 and 1.
const UP_NODES: usize = 5;
const UP: [f64; UP_NODES] = [
    0.0,
    0.146_446_609_406_726_24,
    0.5,
    0.853_553_390_593_273_8,
    1.0,
];

/// About where the polynomials miss most: the parabola of a cubic, at (1 -+ 1/sqrt(3))/2, and the other
/// between its nodes.
const PROBES: [[f64; 2]; 4] = {
    const LOW: f64 = 0.211_324_865_405_187_13;
    const HIGH: f64 = 1.0 - LOW;
    [[LOW, 0.06], [HIGH, 0.31], [LOW, 0.69], [HIGH, 0.94]]
};

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

/// What is missed between the probes is at most this many times what is missed at them.
const MISSED_MARGIN: f64 = 1.5;

impl LitChart {
    /// Into how many parts a patch's side has to be cut, `least` or more, for the polynomials of
    /// [`LitChart::new`] to tell radiance to `allowed`.
    pub fn parts(
        chart: &ChartOnFilm,
        gap: f64,
        (least, allowed): (u32, f64),
        irradiance: impl Fn([f64; 2]) -> [f64; 3],
    ) -> u32 {
        let mut parts = least;
        loop {
            let missed = Self::new(chart, gap, parts, &irradiance).missed(&irradiance);
            let more = (2 * parts) * (2 * parts) * chart.patches.len() as u32;
            if missed <= allowed || more > PATCHES_MAX {
                return parts;
            }
            parts *= 2;
        }
    }

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
        let step = plane.pitch / (ACROSS_NODES - 1) as f64;
        let heights = Heights::new(&plane, gap);
        let count = (plane.columns * plane.rows) as usize;
        let mut patches = Vec::with_capacity(count);
        let (mut light, mut radiance) = (Vec::with_capacity(count), Vec::with_capacity(count));
        for index in 0..count {
            let [column, row] = plane.cell(index);
            let colour = chart.patches[chart.plane.patch(column / parts, row / parts)];
            patches.push(colour);
            let a = f64::from(column) * plane.pitch;
            let here: PatchLight = UP.map(|up| {
                let b = heights.height(row, up);
                std::array::from_fn(|i| irradiance([a + step * i as f64, b]))
            });
            light.push(here);
            radiance.push(here.map(|across| {
                let mut filled = [0.0; ACROSS];
                for (node, light) in filled.chunks_exact_mut(3).zip(across) {
                    for channel in 0..3 {
                        node[channel] = light[channel] * colour[channel];
                    }
                }
                filled
            }));
        }
        Self {
            plane,
            parts,
            patches,
            light,
            radiance,
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
    fn missed(&self, irradiance: &impl Fn([f64; 2]) -> [f64; 3]) -> f64 {
        let mut missed = 0.0f64;
        for row in 0..self.plane.rows {
            for column in 0..self.plane.columns {
                let patch = self.patch(column, row);
                let colour = &self.patches[patch];
                for [across, up] in PROBES {
                    let a = (f64::from(column) + across) * self.plane.pitch;
                    let b = self.heights.height(row, up);
                    let exact = irradiance([a, b]);
                    let light = self.light_across(column, row, b);
                    let found = parabola(&light, across);
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

    /// The weights of the nodes up a row of patches, at a height in metres.
    #[inline(always)]
    pub fn weights_up(&self, row: u32, height: f64) -> [f64; UP_NODES] {
        up_weights(self.heights.within(row, height))
    }

    /// The radiance of a patch at its points across, at the height of these weights.
    #[inline(always)]
    pub fn radiance_across(
        &self,
        column: u32,
        row: u32,
        weights: &[f64; UP_NODES],
    ) -> [[f64; 3]; ACROSS_NODES] {
        let radiance = &self.radiance[self.patch(column, row)];
        let mut across = [0.0; ACROSS];
        for (weight, radiance) in weights.iter().zip(radiance) {
            for (sum, value) in across.iter_mut().zip(radiance) {
                *sum += weight * value;
            }
        }
        let [r0, g0, b0, r1, g1, b1, r2, g2, b2, ..] = across;
        [[r0, g0, b0], [r1, g1, b1], [r2, g2, b2]]
    }

    /// The irradiance over pi on a patch at a height in metres, at its points across.
    #[inline(always)]
    pub fn light_across(&self, column: u32, row: u32, height: f64) -> [[f64; 3]; ACROSS_NODES] {
        let light = &self.light[self.patch(column, row)];
        let weights = self.weights_up(row, height);
        let mut across = [[0.0; 3]; ACROSS_NODES];
        for up in 0..UP_NODES {
            for node in 0..ACROSS_NODES {
                for i in 0..3 {
                    across[node][i] += weights[up] * light[up][node][i];
                }
            }
        }
        across
    }
}

/// The weights of the parabola through points at 0, 1/2 and 1, at `along`.
#[inline(always)]
fn parabola_weights(along: f64) -> [f64; ACROSS_NODES] {
    let x = 2.0 * along - 1.0;
    [0.5 * x * (x - 1.0), 1.0 - x * x, 0.5 * x * (x + 1.0)]
}

/// The weights of the polynomial through the nodes up, at `up`.
#[inline(always)]
fn up_weights(up: f64) -> [f64; UP_NODES] {
    let x = 2.0 * up - 1.0;
    let (outer, inner) = (x * x - 1.0, x * x - 0.5);
    [
        x * (x - 1.0) * inner,
        -2.0 * x * (x - FRAC_1_SQRT_2) * outer,
        2.0 * outer * inner,
        -2.0 * x * (x + FRAC_1_SQRT_2) * outer,
        x * (x + 1.0) * inner,
    ]
}

/// The parabola through three points, at a position of 0 to 1.
#[inline(always)]
pub fn parabola(light: &[[f64; 3]; ACROSS_NODES], along: f64) -> [f64; 3] {
    let [a, b, c] = parabola_weights(along);
    std::array::from_fn(|i| a * light[0][i] + b * light[1][i] + c * light[2][i])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_polynomial_up_a_patch_goes_through_its_nodes() {
        for (node, up) in UP.into_iter().enumerate() {
            for (other, weight) in up_weights(up).into_iter().enumerate() {
                let expected = if other == node { 1.0 } else { 0.0 };
                assert!(
                    (weight - expected).abs() < 1e-14,
                    "{node} {other}: {weight}"
                );
            }
        }
        let sum: f64 = up_weights(0.3).into_iter().sum();
        assert!((sum - 1.0).abs() < 1e-14);
    }
}

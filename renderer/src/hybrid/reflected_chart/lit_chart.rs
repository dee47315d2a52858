//! The colour chart and the light on it, told patch by patch by parabolas.

use crate::hybrid::budget::reflected_chart::PATCHES_MAX;
use crate::hybrid::chart_on_film::ChartOnFilm;
use crate::scene::ChartPlane;

/// The chart with its patches and their light.
#[derive(Clone, Debug)]
pub struct LitChart {
    /// The chart, parted.
    pub plane: ChartPlane,
    /// Into how many parts each side of a patch is cut: below, "patch" is such a part.
    pub parts: u32,
    /// Reflectance times what `light` gives is a patch's radiance.
    pub patches: Vec<[f64; 3]>,
    /// Irradiance over pi, in units of white, at `LIGHT_NODES` by `LIGHT_NODES` equidistant points
    /// of each patch, corners included.
    pub light: Vec<PatchLight>,
}

/// By node up, node across and channel.
pub type PatchLight = [[[f64; 3]; LIGHT_NODES]; LIGHT_NODES];

/// Points along a patch's side at which its light is known; a parabola goes through them.
pub const LIGHT_NODES: usize = 3;

/// Where a parabola through 0, 1/2 and 1 misses most of a cubic: at (1 -+ 1/sqrt(3))/2.
const PROBES: [[f64; 2]; 4] = {
    const LOW: f64 = 0.211_324_865_405_187_13;
    const HIGH: f64 = 1.0 - LOW;
    [[LOW, LOW], [HIGH, LOW], [LOW, HIGH], [HIGH, HIGH]]
};

/// What is missed between the probes is at most this many times what is missed at them.
const MISSED_MARGIN: f64 = 1.5;

impl LitChart {
    /// Into how many parts a patch's side has to be cut for the parabolas of [`LitChart::new`] to
    /// tell radiance to `allowed`.
    pub fn parts(
        chart: &ChartOnFilm,
        allowed: f64,
        irradiance: impl Fn([f64; 2]) -> [f64; 3],
    ) -> u32 {
        let mut parts = 1;
        loop {
            let missed = Self::new(chart, parts, &irradiance).missed(&irradiance);
            let more = (2 * parts) * (2 * parts) * chart.patches.len() as u32;
            if missed <= allowed || more > PATCHES_MAX {
                return parts;
            }
            parts *= 2;
        }
    }

    /// The chart under the light that `irradiance` (over pi) gives, each patch parted into `parts` by
    /// `parts`.
    pub fn new(chart: &ChartOnFilm, parts: u32, irradiance: impl Fn([f64; 2]) -> [f64; 3]) -> Self {
        let mut plane = chart.plane;
        plane.pitch /= f64::from(parts);
        plane.columns *= parts;
        plane.rows *= parts;
        let step = plane.pitch / (LIGHT_NODES - 1) as f64;
        let (mut patches, mut light) = (Vec::new(), Vec::new());
        for index in 0..(plane.columns * plane.rows) as usize {
            let [column, row] = plane.cell(index);
            patches.push(chart.patches[chart.plane.patch(column / parts, row / parts)]);
            let [a, b] = [column, row].map(|index| f64::from(index) * plane.pitch);
            light.push(std::array::from_fn(|j| {
                std::array::from_fn(|i| irradiance([a + step * i as f64, b + step * j as f64]))
            }));
        }
        Self {
            plane,
            parts,
            patches,
            light,
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

    /// A bound of what the parabolas miss, from where a cubic term shows most.
    fn missed(&self, irradiance: &impl Fn([f64; 2]) -> [f64; 3]) -> f64 {
        let mut missed = 0.0f64;
        for row in 0..self.plane.rows {
            for column in 0..self.plane.columns {
                let patch = self.patch(column, row);
                let colour = &self.patches[patch];
                for [across, up] in PROBES {
                    let at = [f64::from(column) + across, f64::from(row) + up];
                    let exact = irradiance(at.map(|at| at * self.plane.pitch));
                    let found = patch_at(&self.light[patch], colour, [across, up]);
                    for channel in 0..3 {
                        let off = found[channel] - colour[channel] * exact[channel];
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

    /// A patch's radiance at a height of 0 to 1 of it, at `LIGHT_NODES` points across.
    #[inline(always)]
    pub fn light_across(&self, patch: usize, up: f64) -> [[f64; 3]; LIGHT_NODES] {
        patch_across(&self.light[patch], &self.patches[patch], up)
    }
}

/// The weights of the parabola through points at 0, 1/2 and 1, at `along`.
#[inline(always)]
pub fn parabola_weights(along: f64) -> [f64; LIGHT_NODES] {
    let x = 2.0 * along - 1.0;
    [0.5 * x * (x - 1.0), 1.0 - x * x, 0.5 * x * (x + 1.0)]
}

/// The radiance of a patch of reflectance `colour` at a height of 0 to 1 of it, at `LIGHT_NODES`
/// points across.
#[inline(always)]
pub fn patch_across(light: &PatchLight, colour: &[f64; 3], up: f64) -> [[f64; 3]; LIGHT_NODES] {
    let [a, b, c] = parabola_weights(up);
    let mut across = [[0.0; 3]; LIGHT_NODES];
    for node in 0..LIGHT_NODES {
        for i in 0..3 {
            let value = a * light[0][node][i] + b * light[1][node][i] + c * light[2][node][i];
            across[node][i] = value * colour[i];
        }
    }
    across
}

/// The radiance of a patch of reflectance `colour` at a position of 0 to 1 along both of its sides.
#[inline(always)]
pub fn patch_at(light: &PatchLight, colour: &[f64; 3], [across, up]: [f64; 2]) -> [f64; 3] {
    parabola(&patch_across(light, colour, up), across)
}

/// The same at a position of 0 to 1 across a patch.
#[inline(always)]
pub fn parabola(light: &[[f64; 3]; LIGHT_NODES], along: f64) -> [f64; 3] {
    let [a, b, c] = parabola_weights(along);
    std::array::from_fn(|i| a * light[0][i] + b * light[1][i] + c * light[2][i])
}

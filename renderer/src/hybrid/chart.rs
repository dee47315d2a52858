//! The chart as the sample sees it: light off its patches, reflected toward a viewer.

use super::batch::{Batch, LANES, total};
use super::elementary::{exp, log1p};
use super::gather;
use super::slopes::{Fineness, Slopes};
use crate::instructions::{Instructions, kernel};
use crate::reflectance::{Reflectance, fresnel, lobe::Lobe};
use crate::vector::Vec3;
use std::f64::consts::{FRAC_1_PI, PI};

/// The panel with its patches and their light.
#[derive(Clone, Debug)]
pub struct LitChart {
    /// The panel.
    pub panel: Panel,
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

/// The chart's place and division.
#[derive(Clone, Copy, Debug)]
pub struct Panel {
    /// Where a and b are 0: the lower left corner.
    pub corner: Vec3,
    /// Unit, along a: from -x to +x.
    pub x: Vec3,
    /// Unit, along b: rising away from the sample.
    pub y: Vec3,
    /// Unit, the front's normal.
    pub z: Vec3,
    /// A patch's side in metres.
    pub pitch: f64,
    /// Patches along a.
    pub columns: u32,
    /// Patches along b.
    pub rows: u32,
}

impl Panel {
    /// Its sides in metres.
    pub fn size(&self) -> [f64; 2] {
        [self.columns, self.rows].map(|count| f64::from(count) * self.pitch)
    }

    /// The point at (a, b).
    pub fn point(&self, a: f64, b: f64) -> Vec3 {
        self.corner + self.x * a + self.y * b
    }

    /// Where a direction from `from`, in front of the panel, meets its plane; `None` where it does
    /// not.
    pub fn meet(&self, from: Vec3, direction: Vec3) -> Option<[f64; 2]> {
        let offset = from - self.corner;
        let approach = -self.z.dot(direction);
        if approach <= 0.0 {
            return None;
        }
        let hit = offset + direction * (self.z.dot(offset) / approach);
        Some([hit.dot(self.x), hit.dot(self.y)])
    }
}

impl LitChart {
    /// The number of the patch in a column and row, counted from the panel's corner.
    #[inline(always)]
    pub fn patch(&self, column: u32, row: u32) -> usize {
        ((self.panel.rows - 1 - row) * self.panel.columns + column) as usize
    }

    /// A patch's radiance at a height of 0 to 1 of it, at `LIGHT_NODES` points across.
    #[inline(always)]
    pub(super) fn light_across(&self, patch: usize, up: f64) -> [[f64; 3]; LIGHT_NODES] {
        patch_across(&self.light[patch], &self.patches[patch], up)
    }

    /// The chart's light off the sample at `position` toward `wo` (unit, the world's frame), in
    /// units of white, and how many evaluations it took; for a lobe that is no thin sheet.
    pub fn reflected(
        &self,
        position: Vec3,
        wo: Vec3,
        reflectance: &Reflectance,
        fineness: Fineness,
        instructions: Instructions,
        batch: &mut LightBatch,
    ) -> ([f64; 3], u32) {
        let window = Window::new(position, wo, reflectance, &self.panel, fineness);
        let response = reflectance.tint_response(wo.z);
        // min(1, cos_i/cos_o) bends, and so does the tint at its knee.
        let [first, second] = fresnel::cosines(response.knee, reflectance.ior);
        batch.clear();
        let levels = [wo.z, first, second];
        gather::directions(
            instructions,
            self,
            position,
            levels,
            &window,
            fineness,
            batch,
        );
        let (lobe, ior) = (&reflectance.lobe, reflectance.ior);
        let [fresnel, excess, diffuse] =
            integrals(instructions, batch, wo, lobe, ior, response.knee);
        let share = reflectance.specular_share;
        let specular = share * 0.25 * FRAC_1_PI * lobe.normalization;
        let lambert = (1.0 - share) * FRAC_1_PI;
        let radiance = std::array::from_fn(|channel| {
            let tinted = response.at_moments(fresnel[channel], excess[channel])[channel];
            specular * tinted + lambert * reflectance.rgb0[channel] * diffuse[channel]
        });
        (radiance, batch.count() as u32)
    }
}

/// Directions of a cubature and the light from them: a unit vector to the light, and radiance times
/// the rule's weight in each channel.
pub type LightBatch = Batch<6>;

kernel! {
    /// In each channel the integrals of the light times the lobe's power, cos_i / (|h| max(cos_i,
    /// cos_o)) and Fresnel's reflectance; of the same with what that exceeds the tint's knee by;
    /// and of the light times cos_i.
    pub fn integrals(
        batch: &LightBatch,
        wo: Vec3,
        lobe: &Lobe,
        ior: f64,
        knee: f64,
    ) -> [[f64; 3]; 3] {
        let (n_u, n_v) = (lobe.n_u, lobe.n_v);
        // The lobe's axes in the world's frame.
        let u = lobe.to_surface(Vec3::new(1.0, 0.0, 0.0));
        let mut sums = [[[0.0; LANES]; 3]; 3];
        for [x, y, z, r, g, b] in batch.blocks() {
            let mut terms = [[0.0; LANES]; 3];
            for i in 0..LANES {
                let (hx, hy, hz) = (x[i] + wo.x, y[i] + wo.y, z[i] + wo.z);
                let hu = u.x * hx + u.y * hy;
                let hv = u.x * hy - u.y * hx;
                let (hu2, hv2, hz2) = (hu * hu, hv * hv, hz * hz);
                let tangential = hu2 + hv2;
                let exponent = (n_u * hu2 + n_v * hv2) / (tangential + f64::MIN_POSITIVE);
                let power = exp(-0.5 * exponent * log1p(tangential / hz2));
                let cos_i = z[i];
                let larger = if cos_i > wo.z { cos_i } else { wo.z };
                let value = power * cos_i / ((tangential + hz2).sqrt() * larger);
                let fresnel = fresnel::reflectance(cos_i, ior);
                let beyond = fresnel - knee;
                let beyond = if beyond > 0.0 { beyond } else { 0.0 };
                terms[0][i] = value * fresnel;
                terms[1][i] = value * beyond;
                terms[2][i] = cos_i;
            }
            for (sums, term) in sums.iter_mut().zip(&terms) {
                for (sum, light) in sums.iter_mut().zip([r, g, b]) {
                    for i in 0..LANES {
                        sum[i] += term[i] * light[i];
                    }
                }
            }
        }
        sums.map(|channels| channels.map(total))
    }
}

/// The weights of the parabola through points at 0, 1/2 and 1, at `along`.
#[inline(always)]
pub(super) fn parabola_weights(along: f64) -> [f64; LIGHT_NODES] {
    let x = 2.0 * along - 1.0;
    [0.5 * x * (x - 1.0), 1.0 - x * x, 0.5 * x * (x + 1.0)]
}

/// The radiance of a patch of reflectance `colour` at a height of 0 to 1 of it, at `LIGHT_NODES`
/// points across.
#[inline(always)]
pub(super) fn patch_across(
    light: &PatchLight,
    colour: &[f64; 3],
    up: f64,
) -> [[f64; 3]; LIGHT_NODES] {
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

/// The radiance of a patch of reflectance `colour` at a place of 0 to 1 of it along both sides.
#[inline(always)]
pub(super) fn patch_at(light: &PatchLight, colour: &[f64; 3], [across, up]: [f64; 2]) -> [f64; 3] {
    parabola(&patch_across(light, colour, up), across)
}

/// At a place of 0 to 1 across a patch.
#[inline(always)]
pub(super) fn parabola(light: &[[f64; 3]; LIGHT_NODES], along: f64) -> [f64; 3] {
    let [a, b, c] = parabola_weights(along);
    std::array::from_fn(|i| a * light[0][i] + b * light[1][i] + c * light[2][i])
}

/// Digits beyond those that count at which the lobe's tail is cut.
const TAIL_DIGITS: f64 = 1.0;

/// Lobes that reach farther in the slope plane than this have no window.
const WINDOW_REACH_MAX: f64 = 1.2;

/// Points along each side of a lobe's reach at which the window is measured.
const BOUNDARY_STEPS: u32 = 4;

/// What is added to a window on either side, as a share of it.
const WINDOW_MARGIN: f64 = 0.05;

/// The directions that a lobe reaches, as a box of sines from the plane across x and of angles
/// beta in it, and its widths there.
pub(super) struct Window {
    pub low: [f64; 2],
    pub high: [f64; 2],
    pub width: [f64; 2],
}

impl Window {
    /// The box around what the lobe reaches from `position` toward `wo`.
    fn new(
        position: Vec3,
        wo: Vec3,
        reflectance: &Reflectance,
        panel: &Panel,
        fineness: Fineness,
    ) -> Self {
        debug_assert!(panel.x.x == 1.0 && position.z == 0.0);
        let lobe = &reflectance.lobe;
        let (reach_p, reach_q) = (
            fineness.reach(lobe.n_u, TAIL_DIGITS),
            fineness.reach(lobe.n_v, TAIL_DIGITS),
        );
        // Beyond it, the directions are no box about the mirror direction any more.
        let wide = reflectance.specular_share < 1.0 || reach_p.max(reach_q) > WINDOW_REACH_MAX;
        // One width is about 1/sqrt(n) of a slope: twice that of an angle up and down, and sideways
        // less, the more so the lower the viewer stands.
        let width = 2.0 / lobe.n_u.sqrt();
        let mut window = Self {
            low: [-1.0, 0.0],
            high: [1.0, PI],
            width: [width * wo.z.max(0.05), width],
        };
        if wide {
            return window;
        }
        let slopes = Slopes::new(lobe.to_lobe(wo), lobe);
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for step in 0..4 * BOUNDARY_STEPS {
            // Around the square of side 2.
            let along = 2.0 * f64::from(step % BOUNDARY_STEPS) / f64::from(BOUNDARY_STEPS) - 1.0;
            let (p, q) = match step / BOUNDARY_STEPS {
                0 => (along, -1.0),
                1 => (1.0, along),
                2 => (-along, 1.0),
                _ => (-1.0, -along),
            };
            let wi = lobe.to_surface(slopes.light(p * reach_p, q * reach_q));
            if wi.z < 0.0 {
                (low[1], high[1]) = (0.0, PI);
            }
            let place = [wi.x, libm::atan2(wi.z.max(0.0), wi.y)];
            for axis in 0..2 {
                low[axis] = low[axis].min(place[axis]);
                high[axis] = high[axis].max(place[axis]);
            }
        }
        for axis in 0..2 {
            let reach = high[axis] - low[axis];
            window.width[axis] = window.width[axis].min(reach / fineness.reach_widths(TAIL_DIGITS));
            // Between the points of its boundary it may reach farther.
            window.low[axis] = window.low[axis].max(low[axis] - WINDOW_MARGIN * reach);
            window.high[axis] = window.high[axis].min(high[axis] + WINDOW_MARGIN * reach);
        }
        window
    }
}

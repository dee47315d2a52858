//! The chart as the sample sees it: light off its patches, reflected toward a viewer.

use super::gauss::GaussRule;
use super::slopes::{Slopes, lobe_reach, points};
use crate::reflectance::Reflectance;
use crate::vector::Vec3;
use std::f64::consts::PI;

/// The panel with its patches and their light.
#[derive(Clone, Debug)]
pub struct LitChart {
    /// The panel.
    pub panel: Panel,
    /// Reflectance times what `light` gives is a patch's radiance.
    pub patches: Vec<[f64; 3]>,
    /// Irradiance over pi, in units of white, at `LIGHT_NODES` by `LIGHT_NODES` equidistant points
    /// of each patch, corners included.
    pub light: Vec<[[[f64; 3]; LIGHT_NODES]; LIGHT_NODES]>,
}

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
    /// Whether a narrow lobe at `position` toward `wo` may reach the panel.
    pub fn in_reach(&self, position: Vec3, wo: Vec3, reflectance: &Reflectance) -> bool {
        let panel = &self.panel;
        let window = Window::new(position, wo, reflectance, panel);
        let [width, height] = panel.size();
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for [a, b] in [[0.0, 0.0], [width, 0.0], [width, height], [0.0, height]] {
            let direction = (panel.point(a, b) - position).normalized();
            let place = [direction.x, libm::atan2(direction.z, direction.y)];
            for axis in 0..2 {
                low[axis] = low[axis].min(place[axis]);
                high[axis] = high[axis].max(place[axis]);
            }
        }
        (0..2).all(|axis| {
            let margin = window.width[axis];
            window.low[axis] - margin <= high[axis] && window.high[axis] + margin >= low[axis]
        })
    }

    /// The radiance that arrives at `position` against `wi`, `None` where it meets no patch.
    pub fn seen(&self, position: Vec3, wi: Vec3) -> Option<[f64; 3]> {
        let hit = self.panel.meet(position, wi)?;
        Some(self.radiance(self.patch(hit)?, hit))
    }

    /// The index of the patch at (a, b), `None` off the panel.
    fn patch(&self, [a, b]: [f64; 2]) -> Option<usize> {
        let place = [a, b].map(|along| (along / self.panel.pitch).floor());
        let inside = |place: f64, count: u32| (0.0..f64::from(count)).contains(&place);
        (inside(place[0], self.panel.columns) && inside(place[1], self.panel.rows)).then(|| {
            // The list begins with the far row.
            let row = self.panel.rows - 1 - place[1] as u32;
            (row * self.panel.columns + place[0] as u32) as usize
        })
    }

    /// The radiance of a patch at (a, b) of the panel.
    fn radiance(&self, patch: usize, [a, b]: [f64; 2]) -> [f64; 3] {
        let weights = [a, b].map(|along| {
            let place = along / self.panel.pitch;
            // -1 to 1 across the patch.
            let x = 2.0 * (place - place.floor()) - 1.0;
            [0.5 * x * (x - 1.0), 1.0 - x * x, 0.5 * x * (x + 1.0)]
        });
        let mut light = [0.0; 3];
        for (line, v) in self.light[patch].iter().zip(weights[1]) {
            for (value, u) in line.iter().zip(weights[0]) {
                for channel in 0..3 {
                    light[channel] += value[channel] * u * v;
                }
            }
        }
        std::array::from_fn(|channel| self.patches[patch][channel] * light[channel])
    }

    /// The chart's light off the sample at `position` toward `wo` (unit, the world's frame), in
    /// units of white, and how many evaluations it took; for a lobe that is no thin sheet.
    ///
    /// A product rule on each patch: directions are (w, beta), the cosine from the panel's x axis
    /// and the angle about it, in which d wi = dw dbeta. Rows of patches are intervals of beta; at
    /// a beta, columns are intervals of w. Nothing grows where the sample comes close to the chart.
    pub fn reflected(
        &self,
        position: Vec3,
        wo: Vec3,
        reflectance: &Reflectance,
        density: f64,
    ) -> ([f64; 3], u32) {
        let panel = &self.panel;
        let response = reflectance.tint_response(wo.z);
        let window = Window::new(position, wo, reflectance, panel);
        let angle = |row: u32| {
            let line = panel.point(0.0, f64::from(row) * panel.pitch) - position;
            libm::atan2(line.z, line.y)
        };
        let height = panel.z.dot(panel.corner - position);
        let (mut total, mut evaluations) = ([0.0; 3], 0);
        for row in 0..panel.rows {
            let [from, to] = window.cut(1, angle(row), angle(row + 1));
            if from >= to {
                continue;
            }
            let rule = GaussRule::of(window.points(1, to - from, density));
            for (beta, weight_beta) in rule.on(from, to) {
                let (sin, cos) = libm::sincos(beta);
                // From the sample's point to the panel, across its x axis.
                let reach = height / (panel.z.y * cos + panel.z.z * sin);
                let edge = |column: u32| {
                    let along = panel.corner.x + f64::from(column) * panel.pitch - position.x;
                    along / libm::hypot(along, reach)
                };
                for column in 0..panel.columns {
                    let [from, to] = window.cut(0, edge(column), edge(column + 1));
                    if from >= to {
                        continue;
                    }
                    let patch = ((panel.rows - 1 - row) * panel.columns + column) as usize;
                    let rule = GaussRule::of(window.points(0, to - from, density));
                    for (w, weight_w) in rule.on(from, to) {
                        let across = (1.0 - w * w).sqrt();
                        let wi = Vec3::new(w, across * cos, across * sin);
                        let hit = position + wi * (reach / across) - panel.corner;
                        let at = self.clamped(patch, [hit.dot(panel.x), hit.dot(panel.y)]);
                        let light = self.radiance(patch, at);
                        let reflected = reflectance.evaluate_with(&response, wi, wo);
                        let weight = weight_beta * weight_w * wi.z;
                        for channel in 0..3 {
                            total[channel] += weight * light[channel] * reflected[channel];
                        }
                        evaluations += 1;
                    }
                }
            }
        }
        (total, evaluations)
    }
}

/// The directions that a lobe reaches, as a box of (w, beta), and its widths there.
struct Window {
    low: [f64; 2],
    high: [f64; 2],
    width: [f64; 2],
}

impl Window {
    /// The box around what the lobe reaches from `position` toward `wo`.
    fn new(position: Vec3, wo: Vec3, reflectance: &Reflectance, panel: &Panel) -> Self {
        debug_assert!(panel.x.x == 1.0 && position.z == 0.0);
        let lobe = &reflectance.lobe;
        let (reach_p, reach_q) = (lobe_reach(lobe.n_u), lobe_reach(lobe.n_v));
        // Beyond it, the directions are no box about the mirror direction any more.
        let wide = reflectance.specular_share < 1.0 || reach_p.max(reach_q) > 0.5;
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
        for (p, q) in [
            (-1.0, -1.0),
            (-1.0, 0.0),
            (-1.0, 1.0),
            (0.0, 1.0),
            (1.0, 1.0),
            (1.0, 0.0),
            (1.0, -1.0),
            (0.0, -1.0),
        ] {
            let (p, q) = (p * reach_p, q * reach_q);
            let wi = lobe.to_surface(slopes.light(p, q, &slopes.at(p, q)));
            let place = [wi.x, libm::atan2(wi.z, wi.y)];
            for axis in 0..2 {
                low[axis] = low[axis].min(place[axis]);
                high[axis] = high[axis].max(place[axis]);
            }
        }
        for axis in 0..2 {
            // The reach is 6.6 widths on either side.
            window.width[axis] = (high[axis] - low[axis]) / 13.0;
            window.low[axis] = low[axis].max(window.low[axis]);
            window.high[axis] = high[axis].min(window.high[axis]);
        }
        window
    }

    fn cut(&self, axis: usize, from: f64, to: f64) -> [f64; 2] {
        [from.max(self.low[axis]), to.min(self.high[axis])]
    }

    fn points(&self, axis: usize, length: f64, density: f64) -> usize {
        points(length / self.width[axis], 3.0, density)
    }
}

impl LitChart {
    /// (a, b) moved into a patch, if only just.
    fn clamped(&self, patch: usize, hit: [f64; 2]) -> [f64; 2] {
        let column = patch as u32 % self.panel.columns;
        let row = self.panel.rows - 1 - patch as u32 / self.panel.columns;
        let mut place = hit;
        for (along, index) in place.iter_mut().zip([column, row]) {
            let low = f64::from(index) * self.panel.pitch;
            let high = low + self.panel.pitch;
            *along = along.clamp(low, high.next_down());
        }
        place
    }
}

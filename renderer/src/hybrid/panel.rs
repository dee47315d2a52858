//! The chart's panel and its patches on the film.

use super::chart::{LIGHT_NODES, LitChart, Panel, patch_at};
use super::polygon::Polygon;
use super::tiling::Region;
use crate::scene::PinholeCamera;
use crate::vector::Vec3;

/// The chart as a camera sees it.
#[derive(Debug)]
pub struct PanelOnFilm {
    /// Its place.
    pub panel: Panel,
    /// Its outline on the film.
    pub outline: Polygon,
    /// Reflectances of the patches, the far row first.
    pub patches: Vec<[f64; 3]>,
}

impl PanelOnFilm {
    /// The patches on the film, each with its reflectance.
    pub fn regions(&self, camera: &PinholeCamera) -> impl Iterator<Item = Region> {
        self.patches
            .iter()
            .enumerate()
            .filter_map(|(index, &factor)| {
                let outline = project(camera, self.corners(index))?;
                Some(Region { outline, factor })
            })
    }

    /// The corners of a patch.
    fn corners(&self, index: usize) -> [Vec3; 4] {
        let ([a, b], pitch) = (self.low_corner(index), self.panel.pitch);
        [[0.0, 0.0], [pitch, 0.0], [pitch, pitch], [0.0, pitch]]
            .map(|[da, db]| self.panel.point(a + da, b + db))
    }

    /// (a, b) of a patch's lower left corner; the list begins with the far row.
    fn low_corner(&self, index: usize) -> [f64; 2] {
        let (row, column) = (
            index as u32 / self.panel.columns,
            index as u32 % self.panel.columns,
        );
        [column, self.panel.rows - 1 - row].map(|step| f64::from(step) * self.panel.pitch)
    }

    /// Into how many parts a patch's side has to be cut for the parabolas of [`PanelOnFilm::lit`] to
    /// tell radiance to `allowed`, and what they then miss of it.
    pub fn parts(&self, allowed: f64, irradiance: impl Fn([f64; 2]) -> [f64; 3]) -> (u32, f64) {
        let mut parts = 1;
        loop {
            let missed = self.missed(&self.lit(parts, &irradiance), &irradiance);
            let more = (2 * parts) * (2 * parts) * self.patches.len() as u32;
            if missed <= allowed || more > PATCHES_MAX {
                return (parts, missed);
            }
            parts *= 2;
        }
    }

    /// The chart under the light that `irradiance` (over pi) gives, each patch parted into `parts` by
    /// `parts`.
    pub fn lit(&self, parts: u32, irradiance: impl Fn([f64; 2]) -> [f64; 3]) -> LitChart {
        let mut panel = self.panel;
        panel.pitch /= f64::from(parts);
        panel.columns *= parts;
        panel.rows *= parts;
        let step = panel.pitch / (LIGHT_NODES - 1) as f64;
        let (mut patches, mut light) = (Vec::new(), Vec::new());
        for row in (0..panel.rows).rev() {
            for column in 0..panel.columns {
                let whole = (self.panel.rows - 1 - row / parts) * self.panel.columns;
                patches.push(self.patches[(whole + column / parts) as usize]);
                let [a, b] = [column, row].map(|index| f64::from(index) * panel.pitch);
                light.push(std::array::from_fn(|j| {
                    std::array::from_fn(|i| irradiance([a + step * i as f64, b + step * j as f64]))
                }));
            }
        }
        LitChart {
            panel,
            patches,
            light,
        }
    }

    /// A bound of what the parabolas of a chart miss, from where a cubic term shows most.
    fn missed(&self, chart: &LitChart, irradiance: &impl Fn([f64; 2]) -> [f64; 3]) -> f64 {
        let Panel {
            pitch,
            columns,
            rows,
            ..
        } = chart.panel;
        let mut missed = 0.0f64;
        for row in 0..rows {
            for column in 0..columns {
                let patch = chart.patch(column, row);
                let colour = &chart.patches[patch];
                for [across, up] in PROBES {
                    let at = [f64::from(column) + across, f64::from(row) + up];
                    let exact = irradiance(at.map(|at| at * pitch));
                    let found = patch_at(&chart.light[patch], colour, [across, up]);
                    for channel in 0..3 {
                        let off = found[channel] - colour[channel] * exact[channel];
                        missed = missed.max(off.abs());
                    }
                }
            }
        }
        MISSED_MARGIN * missed
    }
}

/// The most patches that a chart is parted into where its light bends.
const PATCHES_MAX: u32 = 4096;

/// Where a parabola through 0, 1/2 and 1 misses most of a cubic: at (1 -+ 1/sqrt(3))/2.
const PROBES: [[f64; 2]; 4] = {
    const LOW: f64 = 0.211_324_865_405_187_13;
    const HIGH: f64 = 1.0 - LOW;
    [[LOW, LOW], [HIGH, LOW], [LOW, HIGH], [HIGH, HIGH]]
};

/// What is missed between the probes is at most this many times what is missed at them.
const MISSED_MARGIN: f64 = 1.5;

/// The outline of a quadrilateral on the film; `None` where it reaches behind the camera.
pub fn project(camera: &PinholeCamera, corners: [Vec3; 4]) -> Option<Polygon> {
    let mut film = [[0.0; 2]; 4];
    for (place, corner) in film.iter_mut().zip(corners) {
        *place = camera.project(corner)?;
    }
    Some(Polygon::quadrilateral(film))
}

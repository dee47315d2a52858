//! The chart's panel and its patches on the film.

use super::chart::{LIGHT_NODES, LitChart, Panel};
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

    /// The chart under the light that `irradiance` (over pi) gives.
    pub fn lit(&self, irradiance: impl Fn([f64; 2]) -> [f64; 3]) -> LitChart {
        let light = (0..self.patches.len())
            .map(|index| {
                let [a, b] = self.low_corner(index);
                let step = self.panel.pitch / (LIGHT_NODES - 1) as f64;
                std::array::from_fn(|j| {
                    std::array::from_fn(|i| irradiance([a + step * i as f64, b + step * j as f64]))
                })
            })
            .collect();
        LitChart {
            panel: self.panel,
            patches: self.patches.clone(),
            light,
        }
    }
}

/// The outline of a quadrilateral on the film; `None` where it reaches behind the camera.
pub fn project(camera: &PinholeCamera, corners: [Vec3; 4]) -> Option<Polygon> {
    let mut film = [[0.0; 2]; 4];
    for (place, corner) in film.iter_mut().zip(corners) {
        *place = camera.project(corner)?;
    }
    Some(Polygon::quadrilateral(film))
}

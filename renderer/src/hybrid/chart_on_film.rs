//! The colour chart's plane and its patches on the film.

use crate::film::tiling::Region;
use crate::numerics::polygon::Polygon;
use crate::scene::{Chart, Panel, PinholeCamera};
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
    /// The chart; `None` where it reaches behind the camera.
    pub fn new(chart: &Chart, camera: &PinholeCamera) -> Option<Self> {
        let panel = chart.panel();
        let [width, height] = panel.size();
        let corners = [[0.0, 0.0], [width, 0.0], [width, height], [0.0, height]];
        let outline = project(camera, corners.map(|[a, b]| panel.point(a, b)))?;
        Some(Self {
            panel,
            outline,
            patches: chart.patches().to_vec(),
        })
    }

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

    /// (a, b) of a patch's lower left corner.
    fn low_corner(&self, index: usize) -> [f64; 2] {
        let steps = self.panel.cell(index);
        steps.map(|step| f64::from(step) * self.panel.pitch)
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

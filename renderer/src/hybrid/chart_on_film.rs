//! The colour chart's plane and its patches on the film.

use crate::film::outline::Outline;
use crate::film::region::Region;
use crate::numerics::polygon::Polygon;
use crate::scene::{Chart, ChartPlane, PinholeCamera};
use crate::vector::Vec3;

/// The chart as a camera sees it.
#[derive(Debug)]
pub struct ChartOnFilm {
    /// Its plane.
    pub plane: ChartPlane,
    /// Its outline on the film.
    pub outline: Outline,
    /// Reflectances of the patches, the far row first.
    pub patches: Vec<[f64; 3]>,
}

impl ChartOnFilm {
    /// The chart on a film of so many columns and rows; `None` where it reaches behind the camera.
    pub fn new(chart: &Chart, camera: &PinholeCamera, size: [u32; 2]) -> Option<Self> {
        let plane = chart.plane();
        let [width, height] = plane.size();
        let corners = [[0.0, 0.0], [width, 0.0], [width, height], [0.0, height]];
        let outline = project(camera, corners.map(|[a, b]| plane.point(a, b)))?;
        Some(Self {
            plane,
            outline: Outline::new(outline, size),
            patches: chart.patches().to_vec(),
        })
    }

    /// The patches on the film, each with its reflectance.
    pub fn regions(&self, camera: &PinholeCamera) -> impl Iterator<Item = Region<'static>> {
        self.patches
            .iter()
            .enumerate()
            .filter_map(|(index, &factor)| {
                let outline = project(camera, self.corners(index))?;
                Some(Region {
                    outline,
                    by_pixel: None,
                    factor,
                })
            })
    }

    /// The corners of a patch.
    fn corners(&self, index: usize) -> [Vec3; 4] {
        let ([a, b], pitch) = (self.low_corner(index), self.plane.pitch);
        [[0.0, 0.0], [pitch, 0.0], [pitch, pitch], [0.0, pitch]]
            .map(|[da, db]| self.plane.point(a + da, b + db))
    }

    /// (a, b) of a patch's lower left corner.
    fn low_corner(&self, index: usize) -> [f64; 2] {
        let steps = self.plane.cell(index);
        steps.map(|step| f64::from(step) * self.plane.pitch)
    }
}

/// The outline of a quadrilateral on the film; `None` where it reaches behind the camera.
pub fn project(camera: &PinholeCamera, corners: [Vec3; 4]) -> Option<Polygon> {
    let mut film = [[0.0; 2]; 4];
    for (point, corner) in film.iter_mut().zip(corners) {
        *point = camera.project(corner)?;
    }
    Some(Polygon::quadrilateral(film))
}

//! The pinhole camera.

use crate::geometry::Ray;
use crate::vector::Vec3;
use dataset::ViewGeometry;
use dataset::specification::Specification;

/// The least cosine from the camera's axis of what is projected.
const NEAREST_DEPTH: f64 = 1e-3;

/// The rays of a pinhole camera.
#[derive(Clone, Copy, Debug)]
pub struct PinholeCamera {
    /// The pinhole.
    pub position: Vec3,
    forward: Vec3,
    /// A pixel to the right, at unit distance.
    column_step: Vec3,
    /// A pixel down, at unit distance.
    row_step: Vec3,
    /// The film's width and height in pixels.
    size: [u32; 2],
}

impl PinholeCamera {
    /// The camera of a view.
    pub(super) fn new(specification: &Specification, placement: &ViewGeometry) -> Self {
        let axis = |index: usize| {
            Vec3::from(std::array::from_fn(|row| {
                placement.world_from_camera[row][index]
            }))
        };
        let pixel =
            2.0 * specification.camera.film_half_width / f64::from(specification.image.width);
        Self {
            position: placement.camera_position.into(),
            forward: -axis(2),
            column_step: axis(0) * pixel,
            row_step: -axis(1) * pixel,
            size: [specification.image.width, specification.image.height],
        }
    }

    /// The same camera with `times` as many pixels along either side of the film.
    pub fn finer(&self, times: u32) -> Self {
        let step = 1.0 / f64::from(times);
        Self {
            column_step: self.column_step * step,
            row_step: self.row_step * step,
            size: self.size.map(|side| side * times),
            ..*self
        }
    }

    /// The film's width and height in pixels.
    pub fn size(&self) -> [u32; 2] {
        self.size
    }

    /// The ray through the film point (column, row) in pixels from the upper left corner.
    pub fn ray(&self, column: f64, row: f64) -> Ray {
        Ray {
            origin: self.position,
            direction: self.direction(column, row).normalized(),
        }
    }

    /// From the camera to the film point at unit depth: linear in column and row.
    pub fn direction(&self, column: f64, row: f64) -> Vec3 {
        let [width, height] = self.size.map(f64::from);
        self.forward
            + self.column_step * (column - 0.5 * width)
            + self.row_step * (row - 0.5 * height)
    }

    /// The film point (column, row) that sees a point; `None` for one that is not in front of the
    /// camera.
    pub fn project(&self, point: Vec3) -> Option<[f64; 2]> {
        let offset = point - self.position;
        let depth = offset.dot(self.forward);
        if depth <= NEAREST_DEPTH * offset.length() {
            return None;
        }
        let scale = 1.0 / (depth * self.pixel_size() * self.pixel_size());
        let [width, height] = self.size.map(f64::from);
        Some([
            0.5 * width + offset.dot(self.column_step) * scale,
            0.5 * height + offset.dot(self.row_step) * scale,
        ])
    }

    /// The film point (column, row) that an offset from the camera points to, times its depth, and
    /// its depth: linear in the offset, and negative behind the camera.
    pub fn homogeneous(&self, offset: Vec3) -> [f64; 3] {
        let depth = offset.dot(self.forward);
        let scale = 1.0 / (self.pixel_size() * self.pixel_size());
        let [width, height] = self.size.map(f64::from);
        [
            0.5 * width * depth + offset.dot(self.column_step) * scale,
            0.5 * height * depth + offset.dot(self.row_step) * scale,
            depth,
        ]
    }

    /// A pixel's side at unit distance.
    pub fn pixel_size(&self) -> f64 {
        self.column_step.length()
    }

    /// Whether a sphere may be on the film, or between the film and what it sees.
    pub fn may_see(&self, centre: Vec3, radius: f64) -> bool {
        let offset = centre - self.position;
        let distance = offset.length();
        if distance <= radius {
            return true;
        }
        let [width, height] = self.size.map(f64::from);
        let corner = 0.5 * self.pixel_size() * libm::hypot(width, height);
        let angle = libm::acos((offset.dot(self.forward) / distance).clamp(-1.0, 1.0));
        angle <= libm::atan(corner) + libm::asin(radius / distance)
    }
}

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

    /// The box on the film around a sphere; `None` for one that is not in front of the camera as a whole.
    ///
    /// The rays that touch it make a cone, whose largest slope along an axis is that of a circle's tangent.
    pub fn sphere_box(&self, centre: Vec3, radius: f64) -> Option<[[f64; 2]; 2]> {
        let offset = centre - self.position;
        let depth = offset.dot(self.forward);
        if depth - radius <= NEAREST_DEPTH * offset.length() {
            return None;
        }
        let pixel = self.pixel_size();
        let scale = 1.0 / ((depth + radius) * (depth - radius) * pixel);
        let ends = [self.column_step, self.row_step].map(|step| {
            let along = offset.dot(step) / pixel;
            let tangent = (along * along + (depth + radius) * (depth - radius)).sqrt();
            [-radius, radius].map(|radius| (along * depth + radius * tangent) * scale)
        });
        let [columns, rows] = self.size.map(|side| 0.5 * f64::from(side));
        let [[left, right], [top, bottom]] = ends;
        Some([
            [columns + left, rows + top],
            [columns + right, rows + bottom],
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::BackendChoice;
    use crate::scene::Scene;
    use proptest::prelude::*;

    proptest! {
        /// Points of the sphere lie in its box, and some next to each of its sides.
        #[test]
        fn the_box_fits_the_sphere(
            azimuth in 0.0..std::f64::consts::TAU,
            height in -1.0..1.0f64,
            distance in 0.0..0.3f64,
            radius in 0.001..0.15f64,
        ) {
            let camera = Scene::new(&Specification::preset(), 0, BackendChoice::Native)
                .expect("a view")
                .expect("native geometry")
                .camera;
            let on_unit_sphere = |azimuth: f64, height: f64| {
                let (sin, cos) = libm::sincos(azimuth);
                let beside = (1.0 - height * height).sqrt();
                Vec3::new(beside * cos, beside * sin, height)
            };
            let centre = on_unit_sphere(azimuth, height) * distance;
            let [low, high] = camera.sphere_box(centre, radius).expect("in front of the camera");
            let (mut least, mut most) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
            for i in 0..100 {
                for j in 0..100 {
                    let [azimuth, height] = [f64::from(i) * 0.063, f64::from(j) / 49.5 - 1.0];
                    let at = centre + on_unit_sphere(azimuth, height) * radius;
                    let at = camera.project(at).expect("in front of the camera");
                    for axis in 0..2 {
                        least[axis] = least[axis].min(at[axis]);
                        most[axis] = most[axis].max(at[axis]);
                    }
                }
            }
            for axis in 0..2 {
                let side = high[axis] - low[axis];
                prop_assert!(low[axis] <= least[axis] && most[axis] <= high[axis]);
                prop_assert!(least[axis] - low[axis] < 1e-2 * side);
                prop_assert!(high[axis] - most[axis] < 1e-2 * side);
            }
        }
    }

    #[test]
    fn a_sphere_about_the_camera_has_no_box() {
        let camera = Scene::new(&Specification::preset(), 0, BackendChoice::Native)
            .expect("a view")
            .expect("native geometry")
            .camera;
        assert_eq!(camera.sphere_box(Vec3::new(0.0, 0.0, 0.0), 1.0), None);
        let behind = camera.position - camera.forward;
        assert_eq!(camera.sphere_box(behind, 0.1), None);
    }
}

//! A view as the parts of the hybrid integrator see it.

use super::budget::{Budget, Limit};
use super::chart_on_film::project;
use crate::film::outline::Outline;
use crate::numerics::instructions::Instructions;
use crate::scene::{Bulb, ChartPlane, PinholeCamera, Scene};
use crate::vector::Vec3;
use dataset::specification::Specification;

/// A view without its chart.
#[derive(Clone, Debug)]
pub struct View {
    /// Where from.
    pub camera: PinholeCamera,
    /// The light.
    pub bulb: Bulb,
    /// Half the sample's side in metres.
    pub sample_half: f64,
    /// The sample on the film.
    pub sample: Outline,
    /// The film's width and height in pixels.
    pub size: [u32; 2],
    /// The longest path's hits.
    pub bounces_max: u32,
    /// What its parts may miss.
    pub budget: Budget,
    /// What kernels are worked out with.
    pub instructions: Instructions,
}

impl View {
    /// The view; `None` where the sample reaches behind the camera.
    pub fn new(scene: &Scene, specification: &Specification) -> Option<Self> {
        let half = 0.5 * specification.sample.side_m;
        let size = [specification.image.width, specification.image.height];
        Some(Self {
            camera: scene.camera,
            bulb: scene.bulb,
            sample_half: half,
            sample: sample_outline(&scene.camera, half, size)?,
            size,
            bounces_max: specification.integrator.max_bounces,
            budget: Budget::new(&specification.accuracy),
            instructions: Instructions::widest(),
        })
    }

    /// The same view on a film with `times` as many pixels along either side; `None` where the sample
    /// reaches behind the camera.
    pub fn finer(&self, times: u32) -> Option<Self> {
        let camera = self.camera.finer(times);
        let size = self.size.map(|side| side * times);
        Some(Self {
            camera,
            sample: sample_outline(&camera, self.sample_half, size)?,
            size,
            ..self.clone()
        })
    }

    /// The point of the sample's plane on the film, and the direction to the camera from it.
    pub fn sample_point(&self, [column, row]: [f64; 2]) -> (Vec3, Vec3) {
        let ray = self.camera.ray(column, row);
        let mut position = ray.at(-ray.origin.z / ray.direction.z);
        position.z = 0.0;
        (position, -ray.direction)
    }

    /// The bulb's irradiance over pi at (a, b) of the chart, in front of which it stands as a whole.
    pub fn bulb_on_chart(&self, plane: &ChartPlane, [a, b]: [f64; 2]) -> f64 {
        let offset = self.bulb.centre - plane.point(a, b);
        let distance2 = offset.length_squared();
        let cosine = offset.dot(plane.z) / distance2.sqrt();
        let Bulb {
            radiance, radius, ..
        } = self.bulb;
        radiance * radius * radius / distance2 * cosine
    }

    /// The limit on evaluations for a part of the view.
    pub fn evaluations_max(&self, limit: Limit) -> u64 {
        self.budget.evaluations_max(limit, self.size)
    }

    /// How many pixels at the origin a range of slopes covers, for a light at a distance: a light moves
    /// over the sample by twice its slope over the sum of the inverse distances.
    pub fn slope_pixels(&self, slope: f64, distance: f64) -> f64 {
        let camera = self.camera.position.length();
        let metres = 2.0 * slope / (1.0 / camera + 1.0 / distance);
        // At the origin; a row spans more of a sample that is seen at a slant.
        let pixel_metres = self.camera.pixel_size() * camera;
        let foreshortening = self.camera.position.z / camera;
        metres / pixel_metres * foreshortening
    }
}

/// The sample on the film, `None` where it reaches behind the camera.
fn sample_outline(camera: &PinholeCamera, half: f64, size: [u32; 2]) -> Option<Outline> {
    let corners = [[-half, -half], [half, -half], [half, half], [-half, half]];
    let polygon = project(camera, corners.map(|[x, y]| Vec3::new(x, y, 0.0)))?;
    Some(Outline::new(polygon, size))
}

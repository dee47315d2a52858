//! An independent estimate of one pixel, by sampling.
//!
//! It shares the reflectance model, the scene and the geometry with the renderer and nothing else.
//! Paths of two and more surface hits come from the path tracer. The bulb's light that has touched
//! the sample alone does not: a narrow lobe meets the bulb on a share of a pixel that no uniform
//! sample finds. Three ways of drawing a pair of film point and direction to the bulb are combined
//! by the balance heuristic instead:
//!
//! 1. a film point, then a direction of the cone that the bulb fills;
//! 2. a film point, then a direction drawn from the reflectance;
//! 3. a point of the bulb and a half vector of the lobe, then the film point that sees that bulb
//!    point by that half vector, found by Newton's method. It finds the bulb's image however small.
//!
//! On a sphere or a cylinder plain paths are the whole estimate. Half of them start where a [`Guide`] finds the bulb's
//! light in the pixel.

use crate::guide::Guide;
use crate::plain_path;
use dataset::{Specification, specification::Shape};
use renderer::{
    geometry::{BackendChoice, Ray},
    reflectance::Reflectance,
    sampler::{Dimension, Sampler},
    scene::{Encounter, PinholeCamera, Scene},
    vector::Vec3,
};
use std::f64::consts::PI;

/// Independent scrambles; their spread is the standard error.
pub const REPLICATES: u32 = 32;

/// A pixel's mean and standard error, a channel.
pub type Estimate = [(f64, f64); 3];

/// The scene of one view as the reference sees it.
pub struct Reference {
    pub scene: Scene,
    reflectance: Reflectance,
    is_flat: bool,
    sample_half: f64,
    bounces_max: u32,
}

/// A point of the sample seen from the camera.
#[derive(Clone, Copy)]
struct Seen {
    position: Vec3,
    wo: Vec3,
}

/// The points of one scramble.
///
/// Those on the film are shifted around the pixel, too: an edge along it, just beside a multiple of 1 / samples, has
/// the same points on its bright side in every scramble, and their spread says nothing of what it is off by (draw 1048
/// of seed 20261133 of the search).
struct Scramble {
    sampler: Sampler,
    shift: [f64; 2],
}

impl Scramble {
    fn new(sampler: Sampler) -> Self {
        let shift = sampler.part(0).point(Dimension::Film, 0);
        Self { sampler, shift }
    }

    /// Where in the pixel.
    fn film(&self, index: u32) -> [f64; 2] {
        let point = self.sampler.point(Dimension::Film, index);
        [0, 1].map(|axis| (point[axis] + self.shift[axis]).fract())
    }
}

impl Reference {
    /// Of the specification's only view.
    pub fn new(specification: &Specification, reflectance: Reflectance) -> Self {
        let scene = Scene::new(specification, 0, BackendChoice::Native)
            .expect("a view")
            .expect("native geometry");
        Self {
            scene,
            reflectance,
            is_flat: specification.sample.shape == Shape::Square,
            sample_half: 0.5 * specification.sample.side_m,
            bounces_max: specification.integrator.max_bounces,
        }
    }

    /// Pixel (column, row) with this many samples in each replicate; `key` names the scrambles.
    pub fn pixel(&self, [column, row]: [u32; 2], samples: u32, key: u64) -> Estimate {
        let pixel = [column, row].map(f64::from);
        let guide = (!self.is_flat).then(|| Guide::new(&self.scene, &self.reflectance, pixel));
        let mut means = [[0.0; 3]; REPLICATES as usize];
        for (replicate, mean) in (0..).zip(&mut means) {
            // The film is at most 512 pixels wide.
            let scramble = Scramble::new(Sampler::new(key, row << 12 | column, replicate));
            for index in 0..samples {
                let parts = [
                    self.scattered(pixel, guide.as_ref(), &scramble, index),
                    self.bulb_off_sample(pixel, &scramble, index),
                ];
                for part in parts {
                    for (mean, channel) in mean.iter_mut().zip(part) {
                        *mean += channel / f64::from(samples);
                    }
                }
            }
        }
        let count = f64::from(REPLICATES);
        std::array::from_fn(|channel| {
            let mean = means.iter().map(|mean| mean[channel]).sum::<f64>() / count;
            let squares: f64 = means
                .iter()
                .map(|one| (one[channel] - mean) * (one[channel] - mean))
                .sum();
            (mean, (squares / (count - 1.0) / count).sqrt())
        })
    }

    /// What that many samples of a pixel in each replicate may all have missed, at one chance in a
    /// million. Each way of sampling is weighed against the others, so no path carries more than the
    /// bulb's radiance, or twice that with a guide. Light m a pixel is found by at least a share
    /// m / carried of all samples, and all of them miss it with probability exp(-samples m / carried).
    pub fn unseen(&self, samples: u32) -> f64 {
        const LOG_MILLION: f64 = 13.8;
        let carried = if self.is_flat { 1.0 } else { 2.0 } * self.scene.bulb.radiance;
        LOG_MILLION * carried / (f64::from(samples) * f64::from(REPLICATES))
    }

    /// Everything but the bulb's light that touches a flat sample alone, along one path.
    fn scattered(
        &self,
        [column, row]: [f64; 2],
        guide: Option<&Guide>,
        scramble: &Scramble,
        index: u32,
    ) -> [f64; 3] {
        let film = scramble.film(index);
        let ([x, y], counts) = guide.map_or((film, 1.0), |guide| guide.point(film));
        let ray = self.scene.camera.ray(column + x, row + y);
        let on_flat_sample = self.is_flat
            && matches!(
                self.scene.encounter(&ray, None),
                Some(Encounter::Surface(surface)) if surface.patch.is_none()
            );
        let trace = |bounces_max| {
            plain_path::radiance(
                &self.scene,
                &self.reflectance,
                ray,
                &scramble.sampler,
                index,
                bounces_max,
            )
        };
        if !on_flat_sample {
            return trace(self.bounces_max).map(|channel| channel * counts);
        }
        if self.bounces_max == 1 {
            return [0.0; 3];
        }
        // The same points give the same first hit, which cancels.
        let (all, first) = (trace(self.bounces_max), trace(1));
        std::array::from_fn(|channel| all[channel] - first[channel])
    }

    /// The bulb's light off a flat sample, by one sample of each of the three ways.
    fn bulb_off_sample(&self, pixel: [f64; 2], scramble: &Scramble, index: u32) -> [f64; 3] {
        let mut sum = [0.0; 3];
        if !self.is_flat {
            return sum;
        }
        let sampler = &scramble.sampler;
        let [x, y] = scramble.film(index);
        if let Some(seen) = self.see([pixel[0] + x, pixel[1] + y]) {
            let (_, narrow) = self.cone(seen.position);
            let from_cone = self.cone_direction(
                seen.position,
                narrow,
                sampler.point(Dimension::Light(0), index),
            );
            self.add(&mut sum, pixel, seen, from_cone);
            let point = sampler.point(Dimension::Scatter(0), index);
            if let Some(drawn) = self.reflectance.sample(seen.wo, point) {
                self.add(&mut sum, pixel, seen, drawn.wi);
            }
        }
        let on_bulb = sphere(sampler.point(Dimension::Light(1), index));
        let target = self.scene.bulb.centre + on_bulb * self.scene.bulb.radius;
        let half = self
            .reflectance
            .lobe
            .sample(sampler.point(Dimension::Scatter(1), index));
        let slopes = [half.x / half.z, half.y / half.z];
        if let Some(position) = self.solve(target, slopes) {
            let inside = self
                .scene
                .camera
                .project(position)
                .is_some_and(|film| (0..2).all(|i| (0.0..1.0).contains(&(film[i] - pixel[i]))));
            let wi = target - position;
            // The far side of the bulb is not seen.
            if inside && on_bulb.dot(wi) < 0.0 {
                let wo = (self.scene.camera.position - position).normalized();
                let seen = Seen { position, wo };
                self.add(&mut sum, pixel, seen, wi.normalized());
            }
        }
        sum
    }

    /// Adds what a film point and a direction contribute, over the sum of the three densities.
    fn add(&self, sum: &mut [f64; 3], pixel: [f64; 2], seen: Seen, wi: Vec3) {
        let Seen { position, wo } = seen;
        if wi.z <= 0.0 || position.x.abs().max(position.y.abs()) > self.sample_half {
            return;
        }
        let Some(distance) = self.intersect_bulb(position, wi) else {
            return;
        };
        if !self.is_clear(seen, wi) {
            return;
        }
        let (_, narrow) = self.cone(position);
        let cone = 1.0 / (2.0 * PI * narrow);
        let density = cone
            + self.reflectance.density(wi, wo)
            + self.half_vector_density(pixel, seen, wi, distance);
        let scale = self.scene.bulb.radiance * wi.z / density;
        let value = self.reflectance.evaluate(wi, wo);
        for (sum, channel) in sum.iter_mut().zip(value) {
            *sum += scale * channel;
        }
    }

    /// Whether nothing stands between the camera and the point, or between it and the bulb.
    fn is_clear(&self, Seen { position, wo }: Seen, wi: Vec3) -> bool {
        let from_camera = Ray {
            origin: self.scene.camera.position,
            direction: -wo,
        };
        let Some(Encounter::Surface(sample)) = self.scene.encounter(&from_camera, None) else {
            return false;
        };
        let to_bulb = Ray {
            origin: position,
            direction: wi,
        };
        let met = self.scene.encounter(&to_bulb, Some(sample.primitive));
        sample.patch.is_none() && matches!(met, Some(Encounter::Bulb))
    }

    /// The density of the third way, a pixel and steradian.
    fn half_vector_density(&self, pixel: [f64; 2], seen: Seen, wi: Vec3, distance: f64) -> f64 {
        let Seen { position, wo } = seen;
        let target = position + wi * distance;
        let half = wi + wo;
        let slopes = [half.x / half.z, half.y / half.z];
        // The third way must be able to come here.
        let found = self.solve(target, slopes);
        let reach = (self.scene.camera.position - position)
            .length()
            .min(distance);
        if found.is_none_or(|found| (found - position).length() > 1e-6 * reach) {
            return 0.0;
        }
        let bulb = &self.scene.bulb;
        let facing = (bulb.centre - target).dot(wi) / bulb.radius;
        if facing <= 0.0 {
            return 0.0;
        }
        let per_steradian = distance * distance / (facing * 4.0 * PI * bulb.radius * bulb.radius);
        let (_, derivatives) = self.slopes(target, position);
        let per_position = determinant(derivatives).abs();
        let cos = half.z / half.length();
        let lobe = self.reflectance.lobe.density(half) * cos * cos * cos;
        let density = lobe * per_position * per_steradian * self.position_per_film(position, pixel);
        if density.is_finite() { density } else { 0.0 }
    }

    /// The area of the sample's plane that a pixel's worth of film sees about `position`.
    fn position_per_film(&self, position: Vec3, pixel: [f64; 2]) -> f64 {
        let camera: &PinholeCamera = &self.scene.camera;
        let Some([column, row]) = camera.project(position) else {
            return 0.0;
        };
        let [left, top] = pixel;
        let direction = camera.direction(column, row);
        let corner = camera.direction(left, top);
        let steps = [
            camera.direction(left + 1.0, top) - corner,
            camera.direction(left, top + 1.0) - corner,
        ];
        let height = camera.position.z;
        // The camera's ray meets the plane at its position - height direction / direction.z.
        let moved = steps.map(|step| {
            let along = (step - direction * (step.z / direction.z)) * (-height / direction.z);
            [along.x, along.y]
        });
        determinant(moved).abs()
    }

    /// The slopes of the half vector at a point of the plane toward a point of the bulb and the
    /// camera, and their derivatives by x and by y.
    fn slopes(&self, target: Vec3, position: Vec3) -> ([f64; 2], [[f64; 2]; 2]) {
        let (to_target, to_camera) = (target - position, self.scene.camera.position - position);
        let (far, near) = (to_target.length(), to_camera.length());
        let (u, w) = (to_target * (1.0 / far), to_camera * (1.0 / near));
        let half = u + w;
        let [p, q] = [half.x / half.z, half.y / half.z];
        let derivatives = [0, 1].map(|axis| {
            let unit = [Vec3::new(1.0, 0.0, 0.0), Vec3::new(0.0, 1.0, 0.0)][axis];
            let change = (u * u[axis] - unit) * (1.0 / far) + (w * w[axis] - unit) * (1.0 / near);
            [
                (change.x - p * change.z) / half.z,
                (change.y - q * change.z) / half.z,
            ]
        });
        ([p, q], derivatives)
    }

    /// The point of the sample's plane where the half vector has these slopes, by Newton's method
    /// from the mirror image on; `None` where it does not converge.
    fn solve(&self, target: Vec3, wanted: [f64; 2]) -> Option<Vec3> {
        const STEPS_MAX: u32 = 60;
        let camera = self.scene.camera.position;
        let share = camera.z / (camera.z + target.z);
        let mut position = camera + (target - camera) * share;
        position.z = 0.0;
        let residual = |found: [f64; 2]| libm::hypot(found[0] - wanted[0], found[1] - wanted[1]);
        let (mut found, mut derivatives) = self.slopes(target, position);
        let scale = 1.0 + libm::hypot(wanted[0], wanted[1]);
        for _ in 0..STEPS_MAX {
            let missed = residual(found);
            if missed <= 1e-14 * scale {
                return Some(position);
            }
            let [[px, qx], [py, qy]] = derivatives;
            let determinant = determinant(derivatives);
            let (dp, dq) = (wanted[0] - found[0], wanted[1] - found[1]);
            let step = Vec3::new(
                (dp * qy - dq * py) / determinant,
                (px * dq - qx * dp) / determinant,
                0.0,
            );
            let mut length = 1.0;
            loop {
                let next = position + step * length;
                let (next_found, next_derivatives) = self.slopes(target, next);
                if residual(next_found) < missed {
                    (position, found, derivatives) = (next, next_found, next_derivatives);
                    break;
                }
                length *= 0.5;
                // As near as rounding allows, or stuck.
                if length < 1e-3 {
                    return (missed <= 1e-12 * scale).then_some(position);
                }
            }
        }
        None
    }

    /// The sample's plane from a film point.
    fn see(&self, [column, row]: [f64; 2]) -> Option<Seen> {
        let ray = self.scene.camera.ray(column, row);
        if ray.direction.z >= 0.0 {
            return None;
        }
        let mut position = ray.at(-ray.origin.z / ray.direction.z);
        position.z = 0.0;
        let wo = -ray.direction;
        let inside = position.x.abs().max(position.y.abs()) <= self.sample_half;
        inside.then_some(Seen { position, wo })
    }

    /// The axis of the cone that the bulb fills, and one minus the cosine of its half angle.
    fn cone(&self, position: Vec3) -> (Vec3, f64) {
        let offset = self.scene.bulb.centre - position;
        let distance = offset.length();
        let sin = self.scene.bulb.radius / distance;
        let sin2 = sin * sin;
        (
            offset * (1.0 / distance),
            sin2 / (1.0 + (1.0 - sin2).sqrt()),
        )
    }

    fn cone_direction(&self, position: Vec3, narrow: f64, [azimuth, height]: [f64; 2]) -> Vec3 {
        let (axis, _) = self.cone(position);
        let across = if axis.x.abs() < 0.7 {
            Vec3::new(1.0, 0.0, 0.0)
        } else {
            Vec3::new(0.0, 1.0, 0.0)
        };
        let x = across.cross(axis).normalized();
        let y = axis.cross(x);
        let low = narrow * height;
        let sin = (low * (2.0 - low)).sqrt();
        let (sin_azimuth, cos_azimuth) = libm::sincos(2.0 * PI * azimuth);
        x * (sin * cos_azimuth) + y * (sin * sin_azimuth) + axis * (1.0 - low)
    }

    /// How far the bulb is from a point outside it along a unit direction.
    fn intersect_bulb(&self, position: Vec3, wi: Vec3) -> Option<f64> {
        let bulb = &self.scene.bulb;
        let offset = bulb.centre - position;
        let along = offset.dot(wi);
        let across = offset - wi * along;
        let left = bulb.radius * bulb.radius - across.length_squared();
        (along > 0.0 && left > 0.0).then(|| along - left.sqrt())
    }
}

/// A direction, all alike.
fn sphere([azimuth, height]: [f64; 2]) -> Vec3 {
    let z = 2.0 * height - 1.0;
    let radius = (1.0 - z * z).max(0.0).sqrt();
    let (sin, cos) = libm::sincos(2.0 * PI * azimuth);
    Vec3::new(radius * cos, radius * sin, z)
}

fn determinant([[a, b], [c, d]]: [[f64; 2]; 2]) -> f64 {
    a * d - b * c
}

//! A plain path tracer, the oracle of the tests: it shares with either integrator only the model, the
//! scene and the geometry.
//!
//! At each surface hit the bulb is sampled over the cone it fills (next-event estimation) and the
//! path goes on along a sampled direction; where that direction meets the bulb, both ways of
//! finding it are weighed by the balance heuristic (Veach and Guibas 1995).

use renderer::bsdf::Bsdf;
use renderer::geometry::Ray;
use renderer::reflectance::Reflectance;
use renderer::sampler::{Dimension, Sampler};
use renderer::scene::{Encounter, Scene, Surface};
use renderer::vector::Vec3;
use renderer::warp::Cone;

/// The radiance that one sampled path carries along `camera_ray`, in units of white. `index` is
/// the path's number in its replicate, `bounces_max` the most surfaces it may touch.
pub fn radiance(
    scene: &Scene,
    reflectance: &Reflectance,
    camera_ray: Ray,
    sampler: &Sampler,
    index: u32,
    bounces_max: u32,
) -> [f64; 3] {
    let mut sum = [0.0; 3];
    let mut throughput = [1.0; 3];
    let mut surface = match scene.encounter(&camera_ray, None) {
        Some(Encounter::Surface(surface)) => surface,
        Some(Encounter::Bulb) => return [scene.bulb.radiance; 3],
        Some(Encounter::Black) | None => return sum,
    };
    let mut direction = camera_ray.direction;
    for bounce in 0..bounces_max {
        let bsdf = match surface.patch {
            Some(colour) => Bsdf::Diffuse(colour),
            None => Bsdf::Material(reflectance),
        };
        let wo = surface.frame.to_local(-direction);
        let cone = Cone::new(surface.position, scene.bulb.centre, scene.bulb.radius);
        if let Some(cone) = &cone {
            let point = sampler.point(Dimension::Light(bounce), index);
            let direct = direct(scene, &surface, &bsdf, wo, cone, point);
            accumulate(&mut sum, throughput, direct);
        }
        let Some(scattered) = bsdf.sample(wo, sampler.point(Dimension::Scatter(bounce), index))
        else {
            break;
        };
        for (channel, weight) in throughput.iter_mut().zip(scattered.weight) {
            *channel *= weight;
        }
        direction = surface.frame.to_world(scattered.wi);
        if surface.is_behind(direction) {
            break;
        }
        let ray = Ray {
            origin: surface.position,
            direction,
        };
        surface = match scene.encounter(&ray, Some(surface.primitive)) {
            Some(Encounter::Surface(next)) => next,
            Some(Encounter::Bulb) => {
                let light_density = cone.map_or(0.0, |cone| cone.density());
                let share = scattered.density / (scattered.density + light_density);
                accumulate(&mut sum, throughput, [scene.bulb.radiance * share; 3]);
                break;
            }
            Some(Encounter::Black) | None => break,
        };
    }
    sum
}

/// The bulb's light by one sampled point of it, weighed against sampling the surface.
fn direct(
    scene: &Scene,
    surface: &Surface,
    bsdf: &Bsdf<'_>,
    wo: Vec3,
    cone: &Cone,
    point: [f64; 2],
) -> [f64; 3] {
    let direction = cone.sample(point);
    let wi = surface.frame.to_local(direction);
    if wi.z <= 0.0 || surface.is_behind(direction) {
        return [0.0; 3];
    }
    let ray = Ray {
        origin: surface.position,
        direction,
    };
    let met = scene.encounter(&ray, Some(surface.primitive));
    if !matches!(met, Some(Encounter::Bulb)) {
        return [0.0; 3];
    }
    // f cos L / density times density / (density + other): the light's own density cancels.
    let scale = scene.bulb.radiance * wi.z / (cone.density() + bsdf.density(wi, wo));
    bsdf.evaluate(wi, wo).map(|channel| channel * scale)
}

fn accumulate(sum: &mut [f64; 3], throughput: [f64; 3], radiance: [f64; 3]) {
    for ((sum, throughput), radiance) in sum.iter_mut().zip(throughput).zip(radiance) {
        *sum += throughput * radiance;
    }
}

/// A pixel by plain paths all over it, 32 times `paths` of them: the mean of each channel and its standard
/// error.
#[allow(dead_code, reason = "not every test asks for a whole pixel")]
pub fn pixel(
    scene: &Scene,
    reflectance: &Reflectance,
    pixel: [u32; 2],
    [key, paths]: [u32; 2],
) -> [[f64; 2]; 3] {
    const REPLICATES: u32 = 32;
    let means: Vec<[f64; 3]> = (0..REPLICATES)
        .map(|replicate| {
            let sampler = Sampler::new(key.into(), pixel[0] << 8 | pixel[1], replicate);
            let mut sum = [0.0; 3];
            for index in 0..paths {
                let [x, y] = sampler.point(Dimension::Film, index);
                let ray = scene
                    .camera
                    .ray(f64::from(pixel[0]) + x, f64::from(pixel[1]) + y);
                let found = radiance(scene, reflectance, ray, &sampler, index, 4);
                for (sum, channel) in sum.iter_mut().zip(found) {
                    *sum += channel / f64::from(paths);
                }
            }
            sum
        })
        .collect();
    std::array::from_fn(|channel| {
        let count = f64::from(REPLICATES);
        let mean = means.iter().map(|mean| mean[channel]).sum::<f64>() / count;
        let squares = means
            .iter()
            .map(|of| (of[channel] - mean) * (of[channel] - mean));
        [mean, (squares.sum::<f64>() / (count - 1.0) / count).sqrt()]
    })
}

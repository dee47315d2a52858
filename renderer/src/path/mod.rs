//! The path tracer: the oracle that every other integrator has to agree with.
//!
//! Its estimators leave no rare events, so that few samples know their own error:
//!
//! - Each surface, and the bulb, is sampled on the part of the pixel that it may fill
//!   (`footprint`), and where the bulb shows small in the sample (`highlight`) there are paths of
//!   its own.
//! - At each hit the bulb is sampled over the cone that it fills from a diffuse surface, and over
//!   the half vectors that turn to it, by the lobe, from a glossy one (`glint`). A scattered ray
//!   that meets the bulb adds nothing.
//! - From one surface a path can only go on to the other. Some directions follow the surface's own
//!   density and some are aimed at the other surface, weighed by the balance heuristic (Veach and
//!   Guibas 1995).
//!
//! `interval` states the error.

mod footprint;
mod glint;
mod highlight;
mod interval;

use crate::bsdf::Bsdf;
use crate::film::{Film, FilmPixel};
use crate::geometry::{PrimitiveId, Ray, Rectangle};
use crate::reflectance::Reflectance;
use crate::sampler::{Dimension, Sampler};
use crate::scene::{Bulb, Encounter, SAMPLE, Scene, Surface};
use crate::vector::Vec3;
use crate::warp::Cone;
use dataset::Specification;
use footprint::{Area, Outline};
use glint::Window;
use interval::REPLICATES;
use rayon::prelude::*;

/// Traces paths over the film; also returns how many. `key` names the image.
pub fn render(
    scene: &Scene,
    reflectance: &Reflectance,
    specification: &Specification,
    key: u64,
) -> (Film, u64) {
    let (image, integrator) = (&specification.image, &specification.integrator);
    let paths = integrator.samples_per_pixel;
    let tracer = Tracer::new(scene, reflectance, integrator.max_bounces);
    let pixel = |column: u32, row: u32| {
        let footprint = tracer.footprint(column, row);
        let mut means = [[0.0; 3]; REPLICATES as usize];
        let mut reach = Reach::NONE;
        for (replicate, mean) in (0..).zip(&mut means) {
            let sampler = Sampler::new(key, row * image.width + column, replicate);
            let of_replicate;
            (*mean, of_replicate) = tracer.trace(&footprint, &sampler, paths / REPLICATES);
            reach = reach.or(of_replicate);
        }
        let unseen = tracer.bulb_gap(&footprint) + tracer.chart_max * reach.unseen(paths);
        let parts = footprint.parts.len() as u8;
        (interval::estimate(&means, unseen), parts)
    };
    let (width, height) = (image.width as usize, image.height as usize);
    let mut pixels = vec![FilmPixel::default(); width * height];
    let mut parts = vec![0; width * height];
    pixels
        .par_chunks_mut(width)
        .zip(parts.par_chunks_mut(width))
        .zip(0..image.height)
        .for_each(|((line, parts), row)| {
            for ((sample, parts), column) in line.iter_mut().zip(parts).zip(0..) {
                (*sample, *parts) = pixel(column, row);
            }
        });
    interval::add_unseen(&mut pixels, width, paths, |index| parts[index] == 0);
    let film = Film {
        width: image.width,
        height: image.height,
        pixels,
    };
    let parts: u64 = parts.into_iter().map(u64::from).sum();
    (film, parts * u64::from(paths))
}

/// Whether any of some paths went on from the sample to the chart, and how far from the lobe's
/// centre the chart began for them.
#[derive(Clone, Copy, Debug)]
struct Reach {
    hit: bool,
    /// The least negative logarithm of the lobe on the chart, over its peak.
    log_lobe: f64,
}

impl Reach {
    const NONE: Self = Self {
        hit: false,
        log_lobe: f64::INFINITY,
    };

    fn or(self, other: Self) -> Self {
        Self {
            hit: self.hit || other.hit,
            log_lobe: self.log_lobe.min(other.log_lobe),
        }
    }

    /// At most the share of a pixel's light that goes to the chart, `paths` paths not having met it.
    fn unseen(&self, paths: u32) -> f64 {
        if self.hit {
            0.0
        } else {
            interval::UNSEEN / f64::from(paths) * libm::exp(-self.log_lobe)
        }
    }
}

/// Traces paths of one view of one material.
#[derive(Debug)]
pub struct Tracer<'a> {
    scene: &'a Scene,
    reflectance: &'a Reflectance,
    /// The most surfaces that a path may touch.
    bounces_max: u32,
    /// Everything that the camera can see.
    outlines: Vec<(Target, Outline)>,
    /// A polygon inside the bulb's outline.
    inside_bulb: Outline,
    /// The bulb's highlight on the sample.
    highlight: Outline,
    /// At most the radiance of the chart by the bulb's light.
    chart_max: f64,
}

/// What the paths of a footprint begin with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Target {
    Bulb,
    /// The sample or the chart.
    Surface(PrimitiveId),
}

/// What one pixel sees.
#[derive(Debug)]
pub struct Footprint {
    parts: Vec<Part>,
}

/// The part of a pixel that a target may fill.
#[derive(Debug)]
struct Part {
    target: Target,
    area: Area,
    /// How much of `area` may not see the bulb, which is of another shape.
    gap: f64,
    /// The bulb's highlight, where it is a small share of `area`. Half the paths start there.
    highlight: Option<Area>,
}

impl Part {
    /// A film point and its weight, from a point of the open unit square.
    fn point(&self, [x, y]: [f64; 2]) -> ([f64; 2], f64) {
        let Some(highlight) = &self.highlight else {
            return (self.area.point([x, y]), self.area.size());
        };
        let point = if x < 0.5 {
            self.area.point([2.0 * x, y])
        } else {
            highlight.point([2.0 * x - 1.0, y])
        };
        let holds = |area: &Area| {
            if area.holds(point) {
                1.0 / area.size()
            } else {
                0.0
            }
        };
        // The highlight may reach beyond the sample's edge, where nothing is met.
        (point, 2.0 / (1.0 / self.area.size() + holds(highlight)))
    }
}

/// The share of paths aimed at the other surface at their first hit, and later, where less light
/// is left and a path that meets nothing costs little.
const AIMED: f64 = 0.5;
const AIMED_LATER: f64 = 0.25;

/// The share of a pixel's part below which the bulb's highlight gets paths of its own.
const HIGHLIGHT_SHARE_MAX: f64 = 0.25;

impl<'a> Tracer<'a> {
    /// A tracer of paths that touch at most `bounces_max` surfaces.
    pub fn new(scene: &'a Scene, reflectance: &'a Reflectance, bounces_max: u32) -> Self {
        let camera = &scene.camera;
        let Bulb {
            centre,
            radius,
            radiance,
        } = scene.bulb;
        let [bulb, inside_bulb] = Outline::of_sphere(camera, centre, radius);
        let highlight = highlight::outline(camera, &scene.bulb, &reflectance.lobe);
        let mut outlines = vec![(Target::Bulb, bulb)];
        for (id, rectangle) in scene.rectangles() {
            let outline = Outline::of_polygon(camera, &rectangle.corners());
            outlines.push((Target::Surface(id), outline));
        }
        let chart_max = scene.chart.as_ref().map_or(0.0, |chart| {
            let plane = chart.plane();
            let offset = centre - plane.corner;
            let beside = [plane.x, plane.y].map(|axis| offset.dot(axis));
            let [width, height] = plane.size();
            let nearest = plane.point(beside[0].clamp(0.0, width), beside[1].clamp(0.0, height));
            let distance = (centre - nearest).length();
            let patches = chart.patches().iter().flatten();
            let ratio = radius / distance;
            radiance * ratio * ratio * patches.fold(0.0, |max, &patch| patch.max(max))
        });
        Self {
            scene,
            reflectance,
            bounces_max,
            outlines,
            inside_bulb,
            highlight,
            chart_max,
        }
    }

    /// What the pixel sees.
    pub fn footprint(&self, column: u32, row: u32) -> Footprint {
        let part = |(target, outline): &(Target, Outline)| {
            let area = outline.within_pixel(column, row)?;
            let highlight = match *target {
                Target::Surface(SAMPLE) => self.highlight.within_pixel(column, row),
                _ => None,
            };
            let small = |highlight: &Area| highlight.size() < HIGHLIGHT_SHARE_MAX * area.size();
            let gap = match *target {
                Target::Bulb => {
                    let inside = self.inside_bulb.within_pixel(column, row);
                    area.size() - inside.map_or(0.0, |inside| inside.size())
                }
                Target::Surface(_) => 0.0,
            };
            Some(Part {
                target: *target,
                gap,
                highlight: highlight.filter(small),
                area,
            })
        };
        Footprint {
            parts: self.outlines.iter().filter_map(part).collect(),
        }
    }

    /// At most what a pixel is off by because no path met the gap about the bulb.
    fn bulb_gap(&self, footprint: &Footprint) -> f64 {
        let gaps = footprint.parts.iter().map(|part| part.gap);
        self.scene.bulb.radiance * gaps.sum::<f64>().max(0.0)
    }

    /// A pixel's mean radiance, in units of white, by `count` paths to each thing it sees.
    pub fn replicate(&self, footprint: &Footprint, sampler: &Sampler, count: u32) -> [f64; 3] {
        self.trace(footprint, sampler, count).0
    }

    fn trace(&self, footprint: &Footprint, sampler: &Sampler, count: u32) -> ([f64; 3], Reach) {
        let mut sum = [0.0; 3];
        let mut reach = Reach::NONE;
        for (number, part) in (0..).zip(&footprint.parts) {
            let sampler = sampler.part(number);
            for index in 0..count {
                let ([column, row], weight) = part.point(sampler.point(Dimension::Film, index));
                let ray = self.scene.camera.ray(column, row);
                let radiance = match (part.target, self.scene.encounter(&ray, None)) {
                    (Target::Bulb, Some(Encounter::Bulb)) => [self.scene.bulb.radiance; 3],
                    (Target::Surface(id), Some(Encounter::Surface(surface)))
                        if surface.primitive == id =>
                    {
                        self.radiance(surface, -ray.direction, &sampler, index, &mut reach)
                    }
                    _ => continue,
                };
                accumulate(&mut sum, [weight / f64::from(count); 3], radiance);
            }
        }
        (sum, reach)
    }

    /// The radiance that one sampled path carries from `surface` toward `viewer`.
    fn radiance(
        &self,
        mut surface: Surface,
        mut viewer: Vec3,
        sampler: &Sampler,
        index: u32,
        reach: &mut Reach,
    ) -> [f64; 3] {
        let mut sum = [0.0; 3];
        let mut throughput = [1.0; 3];
        for bounce in 0..self.bounces_max {
            let bsdf = match surface.patch {
                Some(colour) => Bsdf::Diffuse(colour),
                None => Bsdf::Material(self.reflectance),
            };
            let wo = surface.frame.to_local(viewer);
            let point = sampler.point(Dimension::Light(bounce), index);
            accumulate(
                &mut sum,
                throughput,
                self.direct(&surface, &bsdf, wo, point),
            );
            let Some(facing) = self.scene.facing(surface.primitive) else {
                break;
            };
            if bounce + 1 == self.bounces_max {
                break;
            }
            let point = sampler.point(Dimension::Scatter(bounce), index);
            let continuation = Continuation::new(&surface, &bsdf, facing, wo, bounce);
            if bounce == 0 {
                reach.log_lobe = reach.log_lobe.min(continuation.log_lobe());
            }
            let Some((wi, weight)) = continuation.sample(wo, point) else {
                break;
            };
            for (channel, weight) in throughput.iter_mut().zip(weight) {
                *channel *= weight;
            }
            let ray = Ray {
                origin: surface.position,
                direction: surface.frame.to_world(wi),
            };
            let Some(Encounter::Surface(next)) =
                self.scene.encounter(&ray, Some(surface.primitive))
            else {
                // The bulb's light has been counted.
                break;
            };
            reach.hit |= bounce == 0;
            viewer = -ray.direction;
            surface = next;
        }
        sum
    }

    /// The bulb's light by one sampled point of it.
    fn direct(&self, surface: &Surface, bsdf: &Bsdf<'_>, wo: Vec3, point: [f64; 2]) -> [f64; 3] {
        let bulb = &self.scene.bulb;
        let Some(cone) = Cone::new(surface.position, bulb.centre, bulb.radius) else {
            return [0.0; 3];
        };
        let over_cone = || {
            let wi = surface.frame.to_local(cone.sample(point));
            (wi, cone.density())
        };
        let (wi, density) = match bsdf {
            Bsdf::Diffuse(_) => over_cone(),
            Bsdf::Material(reflectance) => {
                let axis = surface.frame.to_local(cone.axis());
                let narrow = cone.one_minus_cos_max();
                glint::sample(&reflectance.lobe, wo, axis, narrow, point)
                    .map_or_else(over_cone, |glint| (glint.wi, glint.density))
            }
        };
        if wi.z <= 0.0 {
            return [0.0; 3];
        }
        let ray = Ray {
            origin: surface.position,
            direction: surface.frame.to_world(wi),
        };
        let distance = cone.distance(ray.direction);
        if self.scene.shadowed(&ray, surface.primitive, distance) {
            return [0.0; 3];
        }
        let scale = bulb.radiance * wi.z / density;
        bsdf.evaluate(wi, wo).map(|channel| channel * scale)
    }
}

/// How paths go on from a surface to the one that it faces.
struct Continuation<'a> {
    surface: &'a Surface,
    bsdf: &'a Bsdf<'a>,
    facing: &'a Rectangle,
    /// At the first hit on the sample.
    window: Option<Window<'a>>,
    /// The share of paths that are aimed at `facing`: about the half vectors that see it, or at its
    /// area. The others follow the surface's own density.
    aimed: f64,
}

impl<'a> Continuation<'a> {
    fn new(
        surface: &'a Surface,
        bsdf: &'a Bsdf<'a>,
        facing: &'a Rectangle,
        wo: Vec3,
        bounce: u32,
    ) -> Self {
        let window = match bsdf {
            Bsdf::Material(reflectance) if bounce == 0 => {
                let corner = surface.frame.to_local(facing.corner - surface.position);
                let sides = [
                    surface.frame.to_local(facing.u_axis * facing.u_length),
                    surface.frame.to_local(facing.v_axis * facing.v_length),
                ];
                Window::new(&reflectance.lobe, wo, corner, sides)
            }
            _ => None,
        };
        Self {
            surface,
            bsdf,
            facing,
            window,
            aimed: if bounce == 0 { AIMED } else { AIMED_LATER },
        }
    }

    /// At most the negative logarithm of the lobe where it is largest on the other surface, over
    /// its peak: 0 for a surface that sends light everywhere.
    fn log_lobe(&self) -> f64 {
        match (self.bsdf, &self.window) {
            (Bsdf::Material(reflectance), Some(window)) if reflectance.specular_share == 1.0 => {
                window.log_lobe()
            }
            _ => 0.0,
        }
    }

    /// Draws a direction; also its weight f cos / density, by the balance heuristic.
    fn sample(&self, wo: Vec3, [x, y]: [f64; 2]) -> Option<(Vec3, [f64; 3])> {
        let own = 1.0 - self.aimed;
        if x < own {
            let scattered = self.bsdf.sample(wo, [x / own, y])?;
            let aimed = self.aimed * self.aimed_density(scattered.wi);
            let scale = scattered.density / (own * scattered.density + aimed);
            return Some((scattered.wi, scattered.weight.map(|weight| weight * scale)));
        }
        let (wi, density) = self.aim([(x - own) / self.aimed, y]);
        if wi.z <= 0.0 || density <= 0.0 {
            return None;
        }
        let scale = wi.z / (self.aimed * density + own * self.bsdf.density(wi, wo));
        let value = self.bsdf.evaluate(wi, wo);
        Some((wi, value.map(|channel| channel * scale)))
    }

    /// A direction aimed at the other surface, and its density.
    fn aim(&self, [x, y]: [f64; 2]) -> (Vec3, f64) {
        if let Some(window) = &self.window {
            let sample = window.sample([x, y]);
            return (sample.wi, sample.density);
        }
        let offset = self.facing.point(x, y) - self.surface.position;
        let wi = self.surface.frame.to_local(offset.normalized());
        (wi, self.aimed_density(wi))
    }

    fn aimed_density(&self, wi: Vec3) -> f64 {
        match &self.window {
            Some(window) => window.density(wi),
            None => {
                let direction = self.surface.frame.to_world(wi);
                self.facing.density(self.surface.position, direction)
            }
        }
    }
}

fn accumulate(sum: &mut [f64; 3], throughput: [f64; 3], radiance: [f64; 3]) {
    for ((sum, throughput), radiance) in sum.iter_mut().zip(throughput).zip(radiance) {
        *sum += throughput * radiance;
    }
}

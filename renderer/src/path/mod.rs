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
//!   Guibas 1995). Of these, half go to where a near bulb lights it (`lit`).
//!
//! `interval` states the error. For curved samples `counts` chooses how many paths a pixel gets, and
//! `worked_out` spares them the bulb.

mod cells;
mod continuation;
mod counts;
mod edge_slopes;
mod facets;
mod flank;
mod footprint;
mod glint;
mod grazing;
mod hidden_chart;
mod highlight;
mod interval;
mod lit;
mod reach;
mod seen;
mod slice;
mod streak;
mod strips;
mod trace;
mod visible_part;
mod window;
mod worked_out;

use crate::bsdf::Bsdf;
use crate::film::Film;
use crate::geometry::Ray;
use crate::hybrid::direct::SlopeBatch;
use crate::numerics::instructions::Instructions;
use crate::reflectance::Reflectance;
use crate::sampler::{Dimension, Sampler};
use crate::scene::{Bulb, Encounter, SampleSurface, Scene, SmoothSurface, Surface, Thing};
use crate::vector::Vec3;
use crate::warp::Cone;
use continuation::Continuation;
use counts::Counts;
use dataset::Specification;
use facets::Facets;
use footprint::{Area, Outline};
use glint::Glint;
use highlight::{BulbShows, Highlight};
use lit::Lit;
use reach::Reach;
use trace::Picture;
use worked_out::WorkedOut;

/// A film that was traced, and what it took.
#[derive(Debug)]
pub struct TracedFilm {
    /// The film.
    pub film: Film,
    /// Paths to each thing that a pixel sees.
    pub paths: u64,
    /// Evaluations of the reflectance by cubature.
    pub evaluations: u64,
}

/// Traces as many paths a pixel as the specification says. `key` names the image.
pub fn render(
    scene: &Scene,
    reflectance: &Reflectance,
    specification: &Specification,
    key: u64,
) -> TracedFilm {
    let integrator = &specification.integrator;
    let tracer = Tracer::new(scene, reflectance, integrator.max_bounces);
    let picture = Picture::new(specification, key);
    let counts = Counts::even(picture.pixels(), integrator.samples_per_pixel);
    counts.trace(&tracer, &picture)
}

/// Renders a view of a curved sample to the specification's accuracy, as far as the limit on paths lets
/// it: the bulb's light off what the camera sees is worked out, and the rest traced by as many paths as
/// each pixel takes.
pub fn render_to_accuracy(
    scene: &Scene,
    reflectance: &Reflectance,
    specification: &Specification,
    key: u64,
    instructions: Instructions,
) -> TracedFilm {
    let (integrator, accuracy) = (&specification.integrator, &specification.accuracy);
    let mut tracer = Tracer::new(scene, reflectance, integrator.max_bounces);
    tracer.worked_out = Some(WorkedOut::new(scene, reflectance, accuracy, instructions));
    let picture = Picture::new(specification, key);
    let samples = integrator.samples_per_pixel;
    let counts = counts::choose(&tracer, &picture, accuracy, samples);
    counts.trace(&tracer, &picture)
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
    /// Where the bulb shows in the sample.
    highlight: BulbShows,
    /// How many pixels the box about a curved sample has; `None` of another.
    curved_in: Option<f64>,
    /// The chart, and a flat sample, if the bulb lights them unevenly.
    lit: [Option<Lit>; 2],
    /// What each pixel may see of a mesh, where the sample is one.
    facets: Option<Facets>,
    /// At most the radiance of the chart by the bulb's light.
    chart_max: f64,
    /// The bulb's light where no path has to find it.
    worked_out: Option<WorkedOut<'a>>,
}

/// What tracing a pixel leaves behind.
#[derive(Default)]
struct Scratch {
    batch: SlopeBatch,
    reach: Reach,
    evaluations: u64,
    /// What the path's radiance is multiplied by.
    weight: f64,
    /// At most what the rule over the bulb is off by, times the weight of its path.
    rule_error: f64,
    /// The brightest light of the bulb that was met on a mesh, in any channel.
    brightest: f64,
    /// The most of the bulb's light that one path brought from one surface to another, in any channel.
    interreflected: f64,
}

/// What the paths of a footprint begin with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Target {
    Bulb,
    /// The sample or the chart.
    Surface(Thing),
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
    highlight: Option<Highlight>,
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
        let of_area = 1.0 / self.area.size();
        (point, 2.0 / (of_area + highlight.density(point)))
    }
}

/// Of a curved sample that fewer pixels see each pixel is looked at for how bright it is where, of a larger one those at
/// its limb: the neighbours of others show what lies beside them. Chosen.
const FEW_PIXELS: f64 = 1024.0;

/// So much of a pixel is all of it, but for rounding.
const WHOLE: f64 = 1.0 - 1e-9;

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
        let highlight = highlight::outlines(scene, &reflectance.lobe);
        let sample = sample_outline(scene);
        let box_size = sample.box_size().unwrap_or(f64::INFINITY);
        let is_curved = matches!(
            scene.sample,
            SampleSurface::Smooth(SmoothSurface::Sphere(_) | SmoothSurface::Cylinder(_))
        );
        let mut outlines = vec![(Target::Bulb, bulb)];
        outlines.push((Target::Surface(Thing::Sample), sample));
        outlines.extend(chart_outlines(scene));
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
        let sample = match &scene.sample {
            SampleSurface::Smooth(SmoothSurface::Square(square)) => Some(square),
            _ => None,
        };
        let lit = [scene.chart_rectangle(), sample]
            .map(|rectangle| rectangle.and_then(|rectangle| Lit::new(rectangle, &scene.bulb)));
        Self {
            scene,
            reflectance,
            bounces_max,
            outlines,
            inside_bulb,
            highlight,
            curved_in: is_curved.then_some(box_size),
            lit,
            facets: Facets::new(scene, reflectance),
            chart_max,
            worked_out: None,
        }
    }

    /// What the pixel sees.
    pub fn footprint(&self, column: u32, row: u32) -> Footprint {
        let sees_mesh = |facets: &Facets| facets.may_be_seen(column, row);
        let part = |(target, outline): &(Target, Outline)| {
            if *target == Target::Surface(Thing::Sample)
                && !self.facets.as_ref().is_none_or(sees_mesh)
            {
                return None;
            }
            let area = outline.within_pixel(column, row)?;
            let highlight = match *target {
                Target::Surface(Thing::Sample) => self.highlight_in(outline, &area),
                _ => None,
            };
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
                highlight,
                area,
            })
        };
        Footprint {
            parts: self.outlines.iter().filter_map(part).collect(),
        }
    }

    /// The bulb's highlight in the part of a pixel that sees the sample.
    fn highlight_in(&self, sample: &Outline, area: &Area) -> Option<Highlight> {
        let BulbShows {
            within,
            mirror_image,
            is_streak,
        } = &self.highlight;
        // A pixel may be lit on a sliver of a curved sample alone.
        let may_be_sliver = |box_size| box_size <= FEW_PIXELS || area.size() < WHOLE;
        if *is_streak && self.curved_in.is_some() {
            let streak = self.streak_in(area, *mirror_image);
            if streak.is_some() {
                return streak;
            }
        }
        match within {
            Some(outlines) if !self.curved_in.is_some_and(may_be_sliver) => {
                Highlight::within(outlines, area, HIGHLIGHT_SHARE_MAX * area.size())
            }
            _ => {
                let brightness = |at| self.brightness(at);
                cells::of(sample, area, *mirror_image, brightness).and_then(Highlight::new)
            }
        }
    }

    /// At most what a pixel is off by because no path met the gap about the bulb.
    fn bulb_gap(&self, footprint: &Footprint) -> f64 {
        let gaps = footprint.parts.iter().map(|part| part.gap);
        self.scene.bulb.radiance * gaps.sum::<f64>().max(0.0)
    }

    /// A pixel's mean radiance, in units of white, by `count` paths to each thing it sees.
    pub fn replicate(&self, footprint: &Footprint, sampler: &Sampler, count: u32) -> [f64; 3] {
        self.trace(footprint, sampler, count, &mut Scratch::default())
    }

    fn trace(
        &self,
        footprint: &Footprint,
        sampler: &Sampler,
        count: u32,
        scratch: &mut Scratch,
    ) -> [f64; 3] {
        let mut sum = [0.0; 3];
        for (number, part) in (0..).zip(&footprint.parts) {
            let sampler = sampler.part(number);
            for index in 0..count {
                let ([column, row], weight) = part.point(sampler.point(Dimension::Film, index));
                scratch.weight = weight;
                let ray = self.scene.camera.ray(column, row);
                let radiance = match (part.target, self.scene.encounter(&ray, None)) {
                    (Target::Bulb, Some(Encounter::Bulb)) => [self.scene.bulb.radiance; 3],
                    (Target::Surface(thing), Some(Encounter::Surface(surface)))
                        if surface.thing == thing =>
                    {
                        self.radiance(surface, -ray.direction, &sampler, index, scratch)
                    }
                    _ => continue,
                };
                accumulate(&mut sum, [weight / f64::from(count); 3], radiance);
            }
        }
        sum
    }

    /// The radiance that one sampled path carries from `surface` toward `viewer`.
    fn radiance(
        &self,
        mut surface: Surface,
        mut viewer: Vec3,
        sampler: &Sampler,
        index: u32,
        scratch: &mut Scratch,
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
            let path = [bounce, index];
            let direct = self.bulb_light(&surface, &bsdf, wo, point, path, scratch);
            if bounce > 0 {
                let brought = throughput.iter().zip(direct).map(|(a, b)| a * b);
                scratch.interreflected = brought.fold(scratch.interreflected, f64::max);
            } else if surface.on_triangle.is_some() {
                scratch.brightest = direct.into_iter().fold(scratch.brightest, f64::max);
            }
            accumulate(&mut sum, throughput, direct);
            let Some(facing) = self.scene.facing(surface.thing) else {
                break;
            };
            if bounce + 1 == self.bounces_max {
                break;
            }
            let point = sampler.point(Dimension::Scatter(bounce), index);
            let lit = self.lit_facing(surface.thing);
            let continuation = Continuation::new(&surface, &bsdf, facing, lit, wo, bounce);
            let Some(continuation) = continuation else {
                break;
            };
            if bounce == 0 {
                scratch.reach.note(continuation.unmet());
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
            if surface.is_behind(ray.direction) {
                break;
            }
            let Some(Encounter::Surface(next)) =
                self.scene.encounter(&ray, Some(surface.primitive))
            else {
                // The bulb's light has been counted.
                break;
            };
            let meets_chart = surface.thing == Thing::Chart || next.thing == Thing::Chart;
            if bounce == 0 && meets_chart {
                scratch.reach.met = scratch.reach.met.max(continuation.carried(wi));
            }
            viewer = -ray.direction;
            surface = next;
        }
        sum
    }

    /// What faces a surface, if the bulb lights it unevenly.
    fn lit_facing(&self, thing: Thing) -> Option<&Lit> {
        let [chart, sample] = &self.lit;
        match thing {
            Thing::Sample => chart.as_ref(),
            _ => sample.as_ref(),
        }
    }

    /// The bulb's light off a surface: worked out where that is possible, and else by one sampled point of
    /// the bulb. What is worked out knows of no shadow. On a mesh, a sampled point that is hidden takes its
    /// light away, so nothing is sampled where all of the bulb is seen. Where the bulb's centre is hidden,
    /// most of the bulb is, and fewer points add than would take away: nothing is worked out there.
    fn bulb_light(
        &self,
        surface: &Surface,
        bsdf: &Bsdf<'_>,
        wo: Vec3,
        point: [f64; 2],
        path: [u32; 2],
        scratch: &mut Scratch,
    ) -> [f64; 3] {
        let may_be_hidden = surface.on_triangle.is_some();
        let worked_out = match &self.worked_out {
            Some(_) if may_be_hidden && path[0] > 0 => None,
            Some(_) if may_be_hidden && self.is_centre_hidden(surface) => None,
            Some(worked_out) => worked_out.toward(surface, wo, path, scratch),
            None => None,
        };
        if !may_be_hidden && let Some(light) = worked_out {
            return light;
        }
        let sampled = self.sampled_bulb(surface, bsdf, wo, point);
        match (worked_out, sampled) {
            (None, Some(SampledBulb::Seen(light))) => light,
            (None, _) => [0.0; 3],
            (Some(light), Some(SampledBulb::Hidden(hidden))) => {
                std::array::from_fn(|channel| light[channel] - hidden[channel])
            }
            (Some(light), _) => light,
        }
    }

    /// Whether the bulb's centre is hidden from a surface.
    fn is_centre_hidden(&self, surface: &Surface) -> bool {
        let offset = self.scene.bulb.centre - surface.position;
        let distance = offset.length();
        let ray = Ray {
            origin: surface.position,
            direction: offset * (1.0 / distance),
        };
        surface.is_behind(ray.direction) || self.scene.shadowed(&ray, surface.primitive, distance)
    }

    /// The bulb's light by one sampled point of it; `None` where it is below the horizon.
    fn sampled_bulb(
        &self,
        surface: &Surface,
        bsdf: &Bsdf<'_>,
        wo: Vec3,
        point: [f64; 2],
    ) -> Option<SampledBulb> {
        let bulb = &self.scene.bulb;
        let cone = Cone::new(surface.position, bulb.centre, bulb.radius)?;
        let (wi, density) = to_bulb(surface, bsdf, &cone, wo, point)?;
        if wi.z <= 0.0 {
            return None;
        }
        let ray = Ray {
            origin: surface.position,
            direction: surface.frame.to_world(wi),
        };
        let distance = cone.distance(ray.direction);
        let scale = bulb.radiance * wi.z / density;
        let light = bsdf.evaluate(wi, wo).map(|channel| channel * scale);
        let is_hidden = surface.is_behind(ray.direction)
            || self.scene.shadowed(&ray, surface.primitive, distance);
        Some(if is_hidden {
            SampledBulb::Hidden(light)
        } else {
            SampledBulb::Seen(light)
        })
    }
}

/// The bulb's light off a surface by one point of the bulb, which something hides or not.
enum SampledBulb {
    Seen([f64; 3]),
    Hidden([f64; 3]),
}

/// A direction to the bulb, in the frame of the surface, and its density; `None` where there is none.
fn to_bulb(
    surface: &Surface,
    bsdf: &Bsdf<'_>,
    cone: &Cone,
    wo: Vec3,
    point: [f64; 2],
) -> Option<(Vec3, f64)> {
    let over_cone = || {
        let wi = surface.frame.to_local(cone.sample(point));
        (wi, cone.density())
    };
    let [lowest, highest] = cone.heights(surface.frame.z);
    if highest <= 0.0 {
        return None;
    }
    let Bsdf::Material(reflectance) = bsdf else {
        return Some(over_cone());
    };
    if lowest < 0.0 {
        return grazing::sample(surface, reflectance, cone, wo, point);
    }
    let axis = surface.frame.to_local(cone.axis());
    let glint = Glint::new(&reflectance.lobe, wo, axis, cone.one_minus_cos_max());
    let glint = glint.and_then(|glint| glint.sample(point));
    Some(glint.map_or_else(over_cone, |glint| (glint.wi, glint.density)))
}

/// The most patches that are sampled each by itself: a pixel that sees them all has so many times its
/// paths.
const PATCHES_MAX: usize = 100;

/// What the chart may fill of the film. Beside a curved sample each of its patches is sampled by itself,
/// if they are not too many, so that no path has to find their edges.
fn chart_outlines(scene: &Scene) -> Vec<(Target, Outline)> {
    let (Some(rectangle), Some(chart)) = (scene.chart_rectangle(), &scene.chart) else {
        return Vec::new();
    };
    let polygons = match scene.sample {
        SampleSurface::Smooth(SmoothSurface::Square(_)) => vec![rectangle.corners()],
        _ if chart.patches().len() > PATCHES_MAX => vec![rectangle.corners()],
        _ => chart.plane().outlines(),
    };
    let outlines = polygons.iter().map(|corners| {
        let outline = Outline::of_polygon(&scene.camera, corners);
        (Target::Surface(Thing::Chart), outline)
    });
    outlines.collect()
}

/// What the sample may fill of the film.
fn sample_outline(scene: &Scene) -> Outline {
    let camera = &scene.camera;
    match &scene.sample {
        SampleSurface::Smooth(SmoothSurface::Square(square)) => {
            Outline::of_polygon(camera, &square.corners())
        }
        SampleSurface::Smooth(SmoothSurface::Sphere(sphere)) => {
            let [around, _] = Outline::of_sphere(camera, sphere.centre, sphere.radius);
            around
        }
        SampleSurface::Smooth(SmoothSurface::Cylinder(cylinder)) => {
            Outline::of_cylinder(camera, cylinder)
        }
        SampleSurface::Mesh(mesh) => Outline::of_box(camera, mesh.bounds()),
    }
}

fn accumulate(sum: &mut [f64; 3], throughput: [f64; 3], radiance: [f64; 3]) {
    for ((sum, throughput), radiance) in sum.iter_mut().zip(throughput).zip(radiance) {
        *sum += throughput * radiance;
    }
}

#[cfg(test)]
mod tests;

//! A view as the parts of the hybrid integrator see it: its geometry, and how fine they are.

use super::chart_on_film::project;
use crate::numerics::instructions::Instructions;
use crate::numerics::polygon::Polygon;
use crate::numerics::tolerance::Tolerance;
use crate::reflectance::Reflectance;
use crate::scene::{Bulb, ChartPlane, PinholeCamera, Scene};
use crate::vector::Vec3;
use dataset::specification::{Accuracy, Specification};

/// The target for which limits on work are made: the preset's.
const ORDINARY: f64 = 1e-3;

/// The limit on evaluations for a part of a view, for each pixel, and the least limit on small films.
/// Nothing is refined beyond it. It takes about a second of a core at 128 x 128.
pub const EVALUATIONS_PER_PIXEL: u64 = 1_200;
pub const BULB_EVALUATIONS_MIN: u64 = 20_000_000;

/// The same on small films for the chart, each of whose evaluations takes longer.
pub const CHART_EVALUATIONS_MIN: u64 = 2_000_000;

/// The same for the chart off a glossy lobe, where each takes three times as long.
pub const GLOSSY_EVALUATIONS_PER_PIXEL: u64 = 800;
pub const GLOSSY_EVALUATIONS_MIN: u64 = 5_000_000;

/// Tiles are as long as this many features of the function on them.
pub const FEATURES_PER_TILE: f64 = 3.0;

/// The shares of the target that the bulb's light and the chart's may miss.
///
/// The bulb's costs next to nothing, so that even pixels far below white are right to a fraction of
/// the relative target.
const BULB_SHARE: f64 = 0.1;
const CHART_SHARE: f64 = 0.4;

/// What is too faint for the relative target, as a share of the absolute one.
const BULB_FAINT: f64 = 1e-4;

/// The shares of the target that the rules at a point of the film may miss.
const BULB_RULE_SHARE: f64 = 1e-2;
const CHART_RULE_SHARE: f64 = 0.01;

/// Tiles of the chart in the sample are so many times longer: the nodes are dense at their ends.
const CHART_TILE: f64 = 2.0;

/// The same two for the chart off a glossy lobe, which is smooth but where an edge of a patch runs
/// along the lobe's wide axis.
const GLOSSY_RULE_SHARE: f64 = 0.05;
pub const GLOSSY_TILE: f64 = 6.0;

/// The same two where the target is at least `COARSE`: a third of the work, and the stated errors
/// still hold.
const COARSE: f64 = 1e-2;
const CHART_RULE_SHARE_COARSE: f64 = 0.1;
const CHART_TILE_COARSE: f64 = 3.0;

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
    pub sample: Polygon,
    /// The film's width and height in pixels.
    pub size: [u32; 2],
    /// The longest path's hits.
    pub bounces_max: u32,
    /// The error that is asked for where a pixel's value is 1.
    target: f64,
    /// The targets of the parts that add up to a pixel, and how fine they are worked out.
    pub bulb_accuracy: Accuracy,
    /// That of the bulb's light at a point.
    pub bulb_tolerance: Tolerance,
    /// The target of the chart, seen straight and in the sample.
    pub chart_accuracy: Accuracy,
    /// That of the chart's light at a point.
    pub chart_tolerance: Tolerance,
    /// The same off a glossy lobe.
    pub glossy_tolerance: Tolerance,
    /// How long the tiles of the chart in the sample are: see [`CHART_TILE`].
    pub chart_tile: f64,
    /// What kernels are worked out with.
    pub instructions: Instructions,
}

impl View {
    /// The view; `None` where the sample reaches behind the camera.
    pub fn new(scene: &Scene, specification: &Specification) -> Option<Self> {
        let half = 0.5 * specification.sample.side_m;
        let accuracy = &specification.accuracy;
        let target = accuracy.relative.max(accuracy.absolute);
        let (chart_rule_share, chart_tile) = if target < COARSE {
            (CHART_RULE_SHARE, CHART_TILE)
        } else {
            (CHART_RULE_SHARE_COARSE, CHART_TILE_COARSE)
        };
        Some(Self {
            camera: scene.camera,
            bulb: scene.bulb,
            sample_half: half,
            sample: sample_outline(&scene.camera, half)?,
            size: [specification.image.width, specification.image.height],
            bounces_max: specification.integrator.max_bounces,
            target,
            bulb_accuracy: Accuracy {
                absolute: BULB_SHARE * BULB_FAINT * accuracy.absolute,
                relative: BULB_SHARE * accuracy.relative,
            },
            bulb_tolerance: Tolerance::new(BULB_RULE_SHARE * target),
            chart_accuracy: Accuracy {
                absolute: CHART_SHARE * accuracy.absolute,
                relative: CHART_SHARE * accuracy.relative,
            },
            chart_tolerance: Tolerance::new(chart_rule_share * target),
            glossy_tolerance: Tolerance::new(GLOSSY_RULE_SHARE * target),
            chart_tile,
            instructions: Instructions::widest(),
        })
    }

    /// The same view on a film with `times` as many pixels along either side; `None` where the sample
    /// reaches behind the camera.
    pub fn finer(&self, times: u32) -> Option<Self> {
        let camera = self.camera.finer(times);
        Some(Self {
            camera,
            sample: sample_outline(&camera, self.sample_half)?,
            size: self.size.map(|side| side * times),
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

    /// The limit on evaluations for a part of the view. It rises with the root of the inverse of a
    /// relative target below [`ORDINARY`].
    pub fn evaluations_max(&self, per_pixel: u64, least: u64) -> u64 {
        let [width, height] = self.size.map(u64::from);
        let finer = (ORDINARY / self.target).max(1.0).sqrt();
        (finer * least.max(per_pixel * width * height) as f64) as u64
    }

    /// How many pixels a tile may span. A light that spans `half_slope` in the slope plane, blurred
    /// by the lobe, moves over the sample by twice its slope over the sum of the inverse distances.
    pub fn feature_pixels(&self, half_slope: f64, distance: f64, reflectance: &Reflectance) -> f64 {
        let blur2 = 1.0 / reflectance.lobe.n_u;
        let slope = (half_slope * half_slope + blur2).sqrt();
        (FEATURES_PER_TILE * self.slope_pixels(slope, distance)).max(4.0)
    }

    /// How many pixels at the origin a range of slopes covers, for a light at a distance.
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
fn sample_outline(camera: &PinholeCamera, half: f64) -> Option<Polygon> {
    let corners = [[-half, -half], [half, -half], [half, half], [-half, half]];
    project(camera, corners.map(|[x, y]| Vec3::new(x, y, 0.0)))
}

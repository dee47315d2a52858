//! The hybrid integrator: nothing is traced that can be worked out.
//!
//! A scene of a flat sample, a bulb and a chart in front of which the bulb stands has no shadows.
//! So the bulb's light off the sample is a cubature over the bulb ([`bulb`]), the bulb's light on
//! the chart a closed form, what the chart sends to the sample a cubature over its patches
//! ([`chart`]), and what the sample sends to the chart one over the sample ([`exchange`]). Each is a
//! smooth function of the film, or one with edges at known scales, and pixels are its integrals
//! ([`tiling`]).
//!
//! A view that is not of this kind goes to the path tracer: see [`Stage::new`].

mod bulb;
pub(crate) mod chart;
mod chebyshev;
mod exchange;
mod gauss;
mod lobe_samples;
mod pixel;
mod polygon;
mod slopes;
mod tiling;

use crate::film::{Film, FilmPixel};
use crate::reflectance::Reflectance;
use crate::scene::{PinholeCamera, Scene};
use crate::stage_time::{StageTime, timed};
use crate::vector::Vec3;
use bulb::BulbView;
use chart::{LIGHT_NODES, LitChart, Panel};
use dataset::specification::{Accuracy, Specification};
use exchange::Exchange;
use lobe_samples::LobeSampler;
use polygon::Polygon;
use rayon::prelude::*;
use tiling::{Canvas, Demand, Region};

/// Points of the film at which a part of a view is worked out before nothing is refined any more.
const CALLS_MAX: u64 = 2_000_000;

/// Evaluations after which nothing of the chart in the sample is refined any more: a few seconds.
const CHART_EVALUATIONS_MAX: u64 = 20_000_000;

/// The most of a sample's hemisphere that the chart fills, weighted by the cosine.
const VIEW_FACTOR_MAX: f64 = 0.5;

/// Tiles are as long as this many features of the function on them.
const FEATURES_PER_TILE: f64 = 3.0;

/// What a cubature rule of the least density misses, as a fraction of its value.
const RULE_ERROR: f64 = 1e-5;

/// A view that the hybrid integrator can render.
#[derive(Debug)]
pub struct Stage {
    camera: PinholeCamera,
    bulb_centre: Vec3,
    bulb_radius: f64,
    bulb_radiance: f64,
    sample_half: f64,
    sample: Polygon,
    panel: Option<PanelOnFilm>,
    bounces_max: u32,
    size: [u32; 2],
    /// The target of each of the parts that add up to a pixel.
    accuracy: Accuracy,
    /// Points of cubature rules against the usual number.
    density: f64,
}

#[derive(Debug)]
struct PanelOnFilm {
    panel: Panel,
    outline: Polygon,
    patches: Vec<[f64; 3]>,
}

impl Stage {
    /// The stage of a view, `None` where the view is not of the kind that can be worked out: the
    /// sample or the chart reaches behind the camera, or the camera sees the bulb itself.
    pub fn new(scene: &Scene, specification: &Specification) -> Option<Self> {
        let size = [specification.image.width, specification.image.height];
        if scene.camera.may_see(scene.bulb.centre, scene.bulb.radius) {
            return None;
        }
        let half = 0.5 * specification.sample.side_m;
        let sample = project(
            &scene.camera,
            [[-half, -half], [half, -half], [half, half], [-half, half]]
                .map(|[x, y]| Vec3::new(x, y, 0.0)),
        )?;
        let panel = match &scene.chart {
            None => None,
            Some(chart) => {
                let panel = chart.panel();
                let [width, height] = panel.size();
                let outline = project(
                    &scene.camera,
                    [[0.0, 0.0], [width, 0.0], [width, height], [0.0, height]]
                        .map(|[a, b]| panel.point(a, b)),
                )?;
                Some(PanelOnFilm {
                    panel,
                    outline,
                    patches: chart.patches().to_vec(),
                })
            }
        };
        let accuracy = &specification.accuracy;
        Some(Self {
            camera: scene.camera,
            bulb_centre: scene.bulb.centre,
            bulb_radius: scene.bulb.radius,
            bulb_radiance: scene.bulb.radiance,
            sample_half: half,
            sample,
            panel,
            bounces_max: specification.integrator.max_bounces,
            size,
            accuracy: Accuracy {
                absolute: 0.4 * accuracy.absolute,
                relative: 0.4 * accuracy.relative,
            },
            density: density(accuracy.relative.max(accuracy.absolute)),
        })
    }

    /// Renders the view, counts evaluations of the reflectance, and times the stages. `key` names
    /// the image, for what is sampled.
    pub fn render(&self, reflectance: &Reflectance, key: u64) -> (Film, u64, Vec<StageTime>) {
        let [width, height] = self.size;
        let mut pixels = vec![FilmPixel::default(); width as usize * height as usize];
        let mut canvas = Canvas {
            width,
            height,
            pixels: &mut pixels,
        };
        let mut evaluations = 0;
        let mut stages = Vec::new();
        timed(&mut stages, "bulb", || {
            self.add_bulb(&mut canvas, reflectance, &mut evaluations);
        });
        if let Some(panel) = &self.panel {
            let exchange = timed(&mut stages, "exchange", || {
                Exchange::new(self, panel, reflectance, &mut evaluations)
            });
            timed(&mut stages, "chart", || {
                self.add_chart(&mut canvas, panel, &exchange);
            });
            if self.bounces_max > 1 {
                timed(&mut stages, "reflected chart", || {
                    self.add_reflected_chart(
                        &mut canvas,
                        panel,
                        &exchange,
                        reflectance,
                        key,
                        &mut evaluations,
                    );
                });
            }
        }
        let rule_error = RULE_ERROR * libm::pow(10.0, -2.0 * (self.density - 1.5));
        for pixel in &mut pixels {
            // A series that interpolates darkness swings about it, within its bound.
            pixel.value = pixel.value.map(|channel| channel.max(0.0));
            let [r, g, b] = pixel.value;
            pixel.error += rule_error * r.max(g).max(b);
        }
        let film = Film {
            width,
            height,
            pixels,
        };
        (film, evaluations, stages)
    }

    /// The bulb's light off the sample.
    fn add_bulb(&self, canvas: &mut Canvas<'_>, reflectance: &Reflectance, evaluations: &mut u64) {
        let distance = self.bulb_centre.length();
        let half_angle = self.bulb_radius / distance;
        let demand = Demand {
            accuracy: &self.accuracy,
            side_max: self.feature_pixels(0.5 * half_angle, distance, reflectance),
            calls_max: CALLS_MAX,
            function_error: 0.0,
        };
        let regions = [Region {
            outline: self.sample,
            factor: [1.0; 3],
        }];
        tiling::integrate(canvas, &self.sample, &regions, &demand, |column, row| {
            let (position, wo) = self.sample_point(column, row);
            let (radiance, spent) = self.bulb_off_sample(position, wo, reflectance);
            *evaluations += u64::from(spent);
            radiance
        });
    }

    /// The chart itself.
    fn add_chart(&self, canvas: &mut Canvas<'_>, panel: &PanelOnFilm, exchange: &Exchange) {
        let regions: Vec<Region> = panel
            .regions(&self.camera)
            .filter(|region| {
                region
                    .outline
                    .bounds()
                    .intersection(&canvas.bounds())
                    .is_some()
            })
            .collect();
        let demand = Demand {
            accuracy: &self.accuracy,
            side_max: f64::from(self.size[0]),
            calls_max: CALLS_MAX,
            function_error: exchange.error(),
        };
        tiling::integrate(canvas, &panel.outline, &regions, &demand, |column, row| {
            let ray = self.camera.ray(column, row);
            let at = panel
                .panel
                .meet(ray.origin, ray.direction)
                .unwrap_or([0.0; 2]);
            let indirect = exchange.on_chart(at);
            let direct = self.bulb_on_chart(panel, at);
            indirect.map(|channel| channel + direct)
        });
    }

    /// The chart in the sample.
    fn add_reflected_chart(
        &self,
        canvas: &mut Canvas<'_>,
        panel: &PanelOnFilm,
        exchange: &Exchange,
        reflectance: &Reflectance,
        key: u64,
        evaluations: &mut u64,
    ) {
        let chart = panel.lit(|at| {
            let direct = self.bulb_on_chart(panel, at);
            exchange
                .on_chart_for_sample(at)
                .map(|channel| channel + direct)
        });
        let camera = self.camera.position;
        if lobe_samples::wanted(reflectance, camera.z / camera.length()) {
            *evaluations += self.add_sampled_chart(canvas, &chart, reflectance, key);
            return;
        }
        let [width, height_px] = self.size.map(f64::from);
        let (middle, toward) = self.sample_point(0.5 * width, 0.5 * height_px);
        let (_, a_call) = chart.reflected(middle, toward, reflectance, self.density);
        let [_, height] = panel.panel.size();
        let distance = 0.5 * (panel.panel.corner.y.abs() + height);
        let half_angle = 0.5 * panel.panel.pitch / distance;
        let demand = Demand {
            accuracy: &self.accuracy,
            side_max: self.feature_pixels(0.5 * half_angle, distance, reflectance),
            calls_max: CHART_EVALUATIONS_MAX / u64::from(a_call.max(1)),
            function_error: VIEW_FACTOR_MAX * exchange.error(),
        };
        let regions = [Region {
            outline: self.sample,
            factor: [1.0; 3],
        }];
        tiling::integrate(canvas, &self.sample, &regions, &demand, |column, row| {
            let (position, wo) = self.sample_point(column, row);
            let (radiance, spent) = chart.reflected(position, wo, reflectance, self.density);
            *evaluations += u64::from(spent);
            radiance
        });
    }

    /// The chart in a smooth sample; returns evaluations.
    fn add_sampled_chart(
        &self,
        canvas: &mut Canvas<'_>,
        chart: &LitChart,
        reflectance: &Reflectance,
        key: u64,
    ) -> u64 {
        let Some(bounds) = self.sample.bounds().intersection(&canvas.bounds()) else {
            return 0;
        };
        let width = self.size[0];
        let places: Vec<(u32, u32)> = bounds.pixels().collect();
        let sampler = LobeSampler {
            chart,
            reflectance,
            accuracy: &self.accuracy,
            key,
        };
        let before = &*canvas.pixels;
        let sampled: Vec<_> = places
            .par_iter()
            .map(|&(column, row)| {
                let surface = |column, row| {
                    let (position, wo) = self.sample_point(column, row);
                    let covered = position.x.abs().max(position.y.abs()) < self.sample_half;
                    (position, wo, covered)
                };
                let index = row * width + column;
                let before = before[index as usize].value;
                sampler.pixel(before, (column, row), index, surface)
            })
            .collect();
        let mut evaluations = 0;
        for (place, (pixel, spent)) in places.into_iter().zip(sampled) {
            canvas.add(place, pixel.value, pixel.error);
            evaluations += spent;
        }
        evaluations
    }

    /// The point of the sample's plane on the film, and the direction to the camera from it.
    fn sample_point(&self, column: f64, row: f64) -> (Vec3, Vec3) {
        let ray = self.camera.ray(column, row);
        let mut position = ray.at(-ray.origin.z / ray.direction.z);
        position.z = 0.0;
        (position, -ray.direction)
    }

    /// The bulb's light off the sample at `position` toward `wo`, and evaluations spent.
    fn bulb_off_sample(
        &self,
        position: Vec3,
        wo: Vec3,
        reflectance: &Reflectance,
    ) -> ([f64; 3], u32) {
        let offset = self.bulb_centre - position;
        let distance = offset.length();
        let sine = self.bulb_radius / distance;
        let view = BulbView {
            wo: reflectance.lobe.to_lobe(wo),
            centre: reflectance.lobe.to_lobe(offset * (1.0 / distance)),
            sin2: sine * sine,
        };
        let share = reflectance.specular_share;
        let (specular, spent) = if share > 0.0 {
            bulb::specular(
                &view,
                reflectance,
                &reflectance.tint_response(wo.z),
                self.density,
            )
        } else {
            ([0.0; 3], 0)
        };
        // The bulb stands above the horizon as a whole: its Lambertian light is a closed form.
        let diffuse = (1.0 - share) * view.sin2 * view.centre.z;
        let radiance = std::array::from_fn(|channel| {
            self.bulb_radiance * (share * specular[channel] + diffuse * reflectance.rgb0[channel])
        });
        (radiance, spent)
    }

    /// The bulb's irradiance over pi at (a, b) of the chart, in front of which it stands as a whole.
    fn bulb_on_chart(&self, panel: &PanelOnFilm, [a, b]: [f64; 2]) -> f64 {
        let offset = self.bulb_centre - panel.panel.point(a, b);
        let distance2 = offset.length_squared();
        let cosine = offset.dot(panel.panel.z) / distance2.sqrt();
        self.bulb_radiance * self.bulb_radius * self.bulb_radius / distance2 * cosine
    }

    /// How many pixels a tile may span. A light that spans `half_slope` in the slope plane, blurred
    /// by the lobe, moves over the sample by twice its slope over the sum of the inverse distances.
    fn feature_pixels(&self, half_slope: f64, distance: f64, reflectance: &Reflectance) -> f64 {
        let blur2 = 1.0 / reflectance.lobe.n_u;
        let slope = (half_slope * half_slope + blur2).sqrt();
        let camera = self.camera.position.length();
        let metres = 2.0 * slope / (1.0 / camera + 1.0 / distance);
        // At the origin; a row spans more of a sample that is seen at a slant.
        let pixel_metres = self.camera.pixel_size() * camera;
        let foreshortening = self.camera.position.z / camera;
        (FEATURES_PER_TILE * metres / pixel_metres * foreshortening).max(4.0)
    }
}

impl PanelOnFilm {
    /// The patches on the film, each with its reflectance.
    fn regions(&self, camera: &PinholeCamera) -> impl Iterator<Item = Region> {
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

    /// (a, b) of a patch's lower left corner; the list begins with the far row.
    fn low_corner(&self, index: usize) -> [f64; 2] {
        let (row, column) = (
            index as u32 / self.panel.columns,
            index as u32 % self.panel.columns,
        );
        [column, self.panel.rows - 1 - row].map(|step| f64::from(step) * self.panel.pitch)
    }

    /// The chart under the light that `irradiance` (over pi) gives.
    fn lit(&self, irradiance: impl Fn([f64; 2]) -> [f64; 3]) -> LitChart {
        let light = (0..self.patches.len())
            .map(|index| {
                let [a, b] = self.low_corner(index);
                let step = self.panel.pitch / (LIGHT_NODES - 1) as f64;
                std::array::from_fn(|j| {
                    std::array::from_fn(|i| irradiance([a + step * i as f64, b + step * j as f64]))
                })
            })
            .collect();
        LitChart {
            panel: self.panel,
            patches: self.patches.clone(),
            light,
        }
    }
}

/// The outline of a quadrilateral on the film; `None` where it reaches behind the camera.
fn project(camera: &PinholeCamera, corners: [Vec3; 4]) -> Option<Polygon> {
    let mut film = [[0.0; 2]; 4];
    for (place, corner) in film.iter_mut().zip(corners) {
        *place = camera.project(corner)?;
    }
    Some(Polygon::quadrilateral(film))
}

/// How many times the usual number of points a relative target takes.
fn density(target: f64) -> f64 {
    let digits = libm::log10(1e-3 / target);
    (1.5 + 0.5 * digits).clamp(1.5, 4.0)
}

//! The hybrid integrator: nothing is traced that can be worked out.
//!
//! A scene of a flat sample, a bulb and a chart in front of which the bulb stands has no shadows.
//! So the bulb's light off the sample is a cubature over the bulb ([`bulb`]), the bulb's light on
//! the chart a closed form, what the chart sends to the sample a cubature over its patches
//! ([`chart`]), and what the sample sends to the chart one over the sample ([`interreflection`]). Each is a
//! smooth function of the film, or one with edges at known scales, and pixels are its integrals
//! ([`tiling`]).
//!
//! A view that is not of this kind goes to the path tracer: see [`Stage::new`].

mod batch;
mod bulb;
mod bulb_on_film;
pub(crate) mod chart;
mod chebyshev;
mod elementary;
mod gather;
mod gauss;
mod glossy;
mod interreflection;
mod light;
mod log_tile;
mod log_tiling;
mod mirror;
mod panel;
mod pixel;
mod polygon;
mod slopes;
mod tiling;

use crate::film::{Film, FilmPixel};
use crate::instructions::Instructions;
use crate::reflectance::Reflectance;
use crate::scene::{Bulb, PinholeCamera, Scene};
use crate::stage_time::{StageTime, timed};
use crate::vector::Vec3;
use bulb_on_film::BulbOffSample;
use chart::{LitChart, Panel};
use dataset::specification::{Accuracy, Specification};
use glossy::GlossyChart;
pub use interreflection::{Interreflection, Unresolved};
use light::{ChartItself, ChartOffGlossySample, ChartOffSample};
use mirror::MirroredChart;
use panel::{PanelOnFilm, project};
use polygon::Polygon;
use slopes::Fineness;
use tiling::{Canvas, Demand, Region};

/// The target for which limits on work are made: the preset's.
const ORDINARY: f64 = 1e-3;

/// The limit on evaluations for a part of a view, for each pixel, and the least limit on small films.
/// Nothing is refined beyond it. It takes about a second of a core at 128 x 128.
const EVALUATIONS_PER_PIXEL: u64 = 1_200;
const BULB_EVALUATIONS_MIN: u64 = 20_000_000;

/// The same on small films for the chart, each of whose evaluations takes longer.
const CHART_EVALUATIONS_MIN: u64 = 2_000_000;

/// The same for the chart off a narrow lobe, where each takes three times as long.
const GLOSSY_EVALUATIONS_PER_PIXEL: u64 = 800;
const GLOSSY_EVALUATIONS_MIN: u64 = 5_000_000;

/// Tiles are as long as this many features of the function on them.
const FEATURES_PER_TILE: f64 = 3.0;

/// Up to this exponent a lobe is so wide that the light itself is as smooth as its logarithm, and
/// its integrals over pixels are closed forms.
const ROUGH_EXPONENT: f64 = 400.0;

/// A lobe narrower than this many pixels makes edges that no tile follows: where the bulb's image
/// itself is large on the film, pixels on its edge are integrated one by one.
const SHARP_WIDTH: f64 = 0.25;

/// But neither holds where a tile of that light would be shorter than this many pixels: a coarse film's nodes
/// could miss a feature that its logarithm cannot.
const FEATURE_MIN: f64 = 12.0;

/// Nor for such edges where a tile would be shorter than this: there the film is rendered finer. The
/// bulb's image is then four pixels across, and nodes lie less than 1.2 pixels apart.
const SHARP_FEATURE_MIN: f64 = 6.0;

/// Where pixels are closed forms the rule at a point is the largest error: it is made so much less.
const LINEAR_RULE_SHARE: f64 = 0.1;

/// The most pixels of a finer film for such edges.
const FINER_PIXELS_MAX: f64 = 1_048_576.0;

/// The shares of the target that the bulb's light and the chart's may miss.
///
/// The bulb's costs next to nothing, so that even pixels far below white are right to a fraction of
/// the relative target.
const BULB_SHARE: f64 = 0.1;
const CHART_SHARE: f64 = 0.4;

/// The chart's reflection is at least so much of white where its relative target counts.
const FAINT_CHART: f64 = 0.1;

/// What is too faint for the relative target, as a share of the absolute one.
const BULB_FAINT: f64 = 1e-4;

/// The shares of the target that the rules at a point of the film may miss.
const BULB_RULE_SHARE: f64 = 1e-2;
const CHART_RULE_SHARE: f64 = 0.01;

/// Tiles of the chart in the sample are so many times longer: the nodes are dense at their ends.
const CHART_TILE: f64 = 2.0;

/// The same two for the chart off a narrow lobe, which is smooth but where an edge of a patch runs
/// along the lobe's wide axis.
const GLOSSY_RULE_SHARE: f64 = 0.05;
const GLOSSY_TILE: f64 = 6.0;

/// The same two where the target is at least `COARSE`: a third of the work, and the stated errors
/// still hold.
const COARSE: f64 = 1e-2;
const CHART_RULE_SHARE_COARSE: f64 = 0.1;
const CHART_TILE_COARSE: f64 = 3.0;

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
    /// The error that is asked for where a pixel's value is 1.
    target: f64,
    /// The targets of the parts that add up to a pixel, and how fine they are worked out.
    bulb_accuracy: Accuracy,
    bulb_fineness: Fineness,
    chart_accuracy: Accuracy,
    chart_fineness: Fineness,
    glossy_fineness: Fineness,
    /// How long the tiles of the chart in the sample are: see [`CHART_TILE`].
    chart_tile: f64,
    instructions: Instructions,
}

/// The sample on the film, `None` where it reaches behind the camera.
fn sample_outline(camera: &PinholeCamera, half: f64) -> Option<Polygon> {
    let corners = [[-half, -half], [half, -half], [half, half], [-half, half]];
    project(camera, corners.map(|[x, y]| Vec3::new(x, y, 0.0)))
}

/// A stage whose film has `times` as many pixels along either side.
struct FinerStage {
    stage: Stage,
    times: u32,
}

impl FinerStage {
    /// Adds the bulb's light off the sample to the coarser film: each of its pixels is the mean of
    /// those that it covers.
    fn add_bulb_to(&self, canvas: &mut Canvas<'_>, reflectance: &Reflectance) -> u64 {
        let [width, height] = self.stage.size;
        let mut pixels = vec![FilmPixel::default(); width as usize * height as usize];
        let mut fine = Canvas {
            width,
            height,
            pixels: &mut pixels,
        };
        let evaluations = self.stage.add_bulb(&mut fine, reflectance);
        let share = 1.0 / f64::from(self.times * self.times);
        for (index, pixel) in (0..).zip(&pixels) {
            let place = (index % width / self.times, index / width / self.times);
            canvas.add(
                place,
                pixel.value.map(|channel| share * channel),
                share * pixel.error,
            );
        }
        evaluations
    }
}

impl Stage {
    /// The stage of a view, `None` where the view is not of the kind that can be worked out: the
    /// sample or the chart reaches behind the camera, the camera sees the bulb itself, or the bulb
    /// stands between chart and sample.
    pub fn new(scene: &Scene, specification: &Specification) -> Option<Self> {
        let size = [specification.image.width, specification.image.height];
        if scene.camera.may_see(scene.bulb.centre, scene.bulb.radius) {
            return None;
        }
        let half = 0.5 * specification.sample.side_m;
        let sample = sample_outline(&scene.camera, half)?;
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
        if let Some(panel) = &panel
            && !stands_clear(&scene.bulb, half, &panel.panel)
        {
            return None;
        }
        let accuracy = &specification.accuracy;
        let target = accuracy.relative.max(accuracy.absolute);
        let (chart_rule_share, chart_tile) = if target < COARSE {
            (CHART_RULE_SHARE, CHART_TILE)
        } else {
            (CHART_RULE_SHARE_COARSE, CHART_TILE_COARSE)
        };
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
            target,
            bulb_accuracy: Accuracy {
                absolute: BULB_SHARE * BULB_FAINT * accuracy.absolute,
                relative: BULB_SHARE * accuracy.relative,
            },
            bulb_fineness: Fineness::new(BULB_RULE_SHARE * target),
            chart_accuracy: Accuracy {
                absolute: CHART_SHARE * accuracy.absolute,
                relative: CHART_SHARE * accuracy.relative,
            },
            chart_fineness: Fineness::new(chart_rule_share * target),
            glossy_fineness: Fineness::new(GLOSSY_RULE_SHARE * target),
            chart_tile,
            instructions: Instructions::widest(),
        })
    }

    /// The same on another instruction set: the same bits, sooner or later.
    pub fn with_instructions(self, instructions: Instructions) -> Self {
        Self {
            instructions,
            ..self
        }
    }

    /// What sample and chart send each other: the same for all views with one light and one turn of
    /// the sample. `None` for a view without chart.
    ///
    /// # Errors
    /// When the lobe is too narrow for it to be worked out. The path tracer renders such a view.
    pub fn interreflection(
        &self,
        reflectance: &Reflectance,
    ) -> Result<Option<Interreflection>, Unresolved> {
        let panel = self.panel.as_ref();
        panel
            .map(|panel| Interreflection::new(self, panel, reflectance))
            .transpose()
    }

    /// Renders the view, counts evaluations of the reflectance, and times the stages.
    /// `interreflection` is that of [`Stage::interreflection`]; if it is not at hand it is worked
    /// out as a stage. `key` names the image, for what is sampled.
    ///
    /// # Errors
    /// Those of [`Stage::interreflection`].
    pub fn render(
        &self,
        reflectance: &Reflectance,
        interreflection: Option<&Interreflection>,
        key: u64,
    ) -> Result<(Film, u64, Vec<StageTime>), Unresolved> {
        let [width, height] = self.size;
        let mut pixels = vec![FilmPixel::default(); width as usize * height as usize];
        let mut canvas = Canvas {
            width,
            height,
            pixels: &mut pixels,
        };
        let mut stages = Vec::new();
        let mut evaluations = timed(&mut stages, "bulb", || {
            self.add_bulb(&mut canvas, reflectance)
        });
        if let Some(panel) = &self.panel {
            let mut own = None;
            let interreflection = match interreflection {
                Some(interreflection) => interreflection,
                None => timed(&mut stages, "interreflection", || {
                    Interreflection::new(self, panel, reflectance).map(|made| own.insert(made))
                })?,
            };
            // Counted with every view, so that an image's label does not tell what was at hand.
            evaluations += interreflection.evaluations();
            timed(&mut stages, "chart", || {
                self.add_chart(&mut canvas, panel, interreflection);
            });
            if self.bounces_max > 1 {
                evaluations += timed(&mut stages, "reflected chart", || {
                    self.add_reflected_chart(&mut canvas, panel, interreflection, reflectance, key)
                });
            }
        }
        for pixel in &mut pixels {
            // A series that interpolates darkness swings about it, within its bound.
            pixel.value = pixel.value.map(|channel| channel.max(0.0));
        }
        let film = Film {
            width,
            height,
            pixels,
        };
        Ok((film, evaluations, stages))
    }

    /// The bulb's light off the sample.
    fn add_bulb(&self, canvas: &mut Canvas<'_>, reflectance: &Reflectance) -> u64 {
        let shade = BulbOffSample {
            stage: self,
            reflectance,
        };
        let distance = self.bulb_centre.length();
        let half_angle = self.bulb_radius / distance;
        let blur2 = 1.0 / reflectance.lobe.n_u;
        let slope = (0.25 * half_angle * half_angle + blur2).sqrt();
        let feature = FEATURES_PER_TILE * self.slope_pixels(slope, distance);
        let width = self.slope_pixels(1.0 / reflectance.lobe.n_u.sqrt(), distance);
        let is_sharp = width <= SHARP_WIDTH;
        let is_small = feature
            < if is_sharp {
                SHARP_FEATURE_MIN
            } else {
                FEATURE_MIN
            };
        if let (true, true, Some(finer)) = (is_sharp, is_small, self.finer_for(feature)) {
            return finer.add_bulb_to(canvas, reflectance);
        }
        let is_glossy = reflectance.lobe.n_u > ROUGH_EXPONENT && !is_sharp;
        if is_glossy || is_small {
            let demand = log_tiling::Demand {
                accuracy: &self.bulb_accuracy,
                evaluations_max: self.evaluations_max(EVALUATIONS_PER_PIXEL, BULB_EVALUATIONS_MIN),
                fineness: self.bulb_fineness,
                instructions: self.instructions,
            };
            return log_tiling::integrate(canvas, &self.sample, &demand, &shade);
        }
        let demand = Demand {
            accuracy: &self.bulb_accuracy,
            faint: self.chart_accuracy.absolute,
            side_max: feature,
            evaluations_max: self.evaluations_max(EVALUATIONS_PER_PIXEL, BULB_EVALUATIONS_MIN),
            fineness: Fineness::new(LINEAR_RULE_SHARE * self.bulb_fineness.error()),
            function_error: 0.0,
        };
        let regions = [Region {
            outline: self.sample,
            factor: [1.0; 3],
        }];
        tiling::integrate(canvas, &self.sample, &regions, &demand, &shade)
    }

    /// The same stage on a film so fine that a tile of `feature` pixels is at least
    /// [`SHARP_FEATURE_MIN`] long; `None` where this one is, or where that one would be too large.
    fn finer_for(&self, feature: f64) -> Option<FinerStage> {
        let times = (SHARP_FEATURE_MIN / feature).ceil();
        let pixels = times * times * f64::from(self.size[0]) * f64::from(self.size[1]);
        if times <= 1.0 || pixels.is_nan() || pixels > FINER_PIXELS_MAX {
            return None;
        }
        let times = times as u32;
        let camera = self.camera.finer(times);
        let stage = Self {
            camera,
            sample: sample_outline(&camera, self.sample_half)?,
            panel: None,
            size: self.size.map(|side| side * times),
            bulb_accuracy: self.bulb_accuracy.clone(),
            chart_accuracy: self.chart_accuracy.clone(),
            ..*self
        };
        Some(FinerStage { stage, times })
    }

    /// The chart itself.
    fn add_chart(
        &self,
        canvas: &mut Canvas<'_>,
        panel: &PanelOnFilm,
        interreflection: &Interreflection,
    ) {
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
            accuracy: &self.chart_accuracy,
            faint: self.chart_accuracy.absolute,
            side_max: f64::from(self.size[0]),
            evaluations_max: self.evaluations_max(EVALUATIONS_PER_PIXEL, CHART_EVALUATIONS_MIN),
            fineness: self.chart_fineness,
            function_error: interreflection.error(),
        };
        let shade = ChartItself {
            stage: self,
            panel,
            interreflection,
        };
        tiling::integrate(canvas, &panel.outline, &regions, &demand, &shade);
    }

    /// The chart in the sample.
    fn add_reflected_chart(
        &self,
        canvas: &mut Canvas<'_>,
        panel: &PanelOnFilm,
        interreflection: &Interreflection,
        reflectance: &Reflectance,
        key: u64,
    ) -> u64 {
        // Only the bulb's own light can need smaller parts: what the sample sends is a few hundredths
        // of it, and its part shows in `light_error`.
        let least = self.chart_accuracy.absolute;
        let allowed = least.max(self.chart_accuracy.relative * FAINT_CHART);
        let (parts, missed) = panel.parts(allowed, |at| [self.bulb_on_chart(panel, at); 3]);
        let irradiance = |at: [f64; 2]| {
            let direct = self.bulb_on_chart(panel, at);
            interreflection
                .on_chart_for_sample(at)
                .map(|channel| channel + direct)
        };
        let chart = panel.lit(parts, irradiance);
        if !glossy::wanted(reflectance) && mirror::wanted(reflectance) {
            let chart_error = interreflection.error() + missed;
            return self.add_mirrored_chart(canvas, &chart, chart_error, reflectance, key);
        }
        let finer = panel.lit(2 * parts, irradiance);
        let [_, height] = panel.panel.size();
        let distance = 0.5 * (panel.panel.corner.y.abs() + height);
        let feature = self.feature_pixels(0.0, distance, reflectance);
        let mut demand = Demand {
            accuracy: &self.chart_accuracy,
            faint: self.chart_accuracy.absolute,
            // What is as fine as the blur of a patch's edge shows at a tile's nodes.
            side_max: self.chart_tile * feature,
            evaluations_max: self.evaluations_max(EVALUATIONS_PER_PIXEL, CHART_EVALUATIONS_MIN),
            fineness: self.chart_fineness,
            // A sample reflects at most all of the light that it receives.
            function_error: interreflection.error(),
        };
        let regions = [Region {
            outline: self.sample,
            factor: [1.0; 3],
        }];
        if glossy::wanted(reflectance) {
            demand.side_max = GLOSSY_TILE * feature;
            demand.evaluations_max =
                self.evaluations_max(GLOSSY_EVALUATIONS_PER_PIXEL, GLOSSY_EVALUATIONS_MIN);
            demand.fineness = self.glossy_fineness;
            let glossy = [&chart, &finer]
                .map(|chart| GlossyChart::new(chart, reflectance, self.instructions));
            let shade = ChartOffGlossySample {
                stage: self,
                glossy: &glossy[0],
                finer: &glossy[1],
            };
            return tiling::integrate(canvas, &self.sample, &regions, &demand, &shade);
        }
        let shade = ChartOffSample {
            stage: self,
            chart: &chart,
            finer: &finer,
            reflectance,
        };
        tiling::integrate(canvas, &self.sample, &regions, &demand, &shade)
    }

    /// The chart, known to `chart_error`, in a smooth sample; returns evaluations.
    fn add_mirrored_chart(
        &self,
        canvas: &mut Canvas<'_>,
        chart: &LitChart,
        chart_error: f64,
        reflectance: &Reflectance,
        key: u64,
    ) -> u64 {
        let Some(bounds) = self.sample.bounds().intersection(&canvas.bounds()) else {
            return 0;
        };
        let bounds = bounds.rounded_out();
        let mirrored = MirroredChart {
            chart,
            reflectance,
            camera: &self.camera,
            outline: &self.sample,
            accuracy: &self.chart_accuracy,
            key,
            instructions: self.instructions,
        };
        let (pixels, evaluations) =
            mirrored.render(&bounds, |column, row| canvas.value((column, row)));
        for (place, pixel) in bounds.pixels().zip(pixels) {
            // A mirror passes on what its chart is off by, where it shows anything of it.
            let shown = pixel.value.iter().any(|&channel| channel > 0.0);
            let inherited = if shown { chart_error } else { 0.0 };
            canvas.add(place, pixel.value, pixel.error + inherited);
        }
        evaluations
    }

    /// The limit on evaluations for a part of the view. It rises with the root of the inverse of a
    /// relative target below [`ORDINARY`].
    fn evaluations_max(&self, per_pixel: u64, least: u64) -> u64 {
        let [width, height] = self.size.map(u64::from);
        let finer = (ORDINARY / self.target).max(1.0).sqrt();
        (finer * least.max(per_pixel * width * height) as f64) as u64
    }

    /// How many pixels a tile may span. A light that spans `half_slope` in the slope plane, blurred
    /// by the lobe, moves over the sample by twice its slope over the sum of the inverse distances.
    fn feature_pixels(&self, half_slope: f64, distance: f64, reflectance: &Reflectance) -> f64 {
        let blur2 = 1.0 / reflectance.lobe.n_u;
        let slope = (half_slope * half_slope + blur2).sqrt();
        (FEATURES_PER_TILE * self.slope_pixels(slope, distance)).max(4.0)
    }

    /// How many pixels at the origin a range of slopes covers, for a light at a distance.
    fn slope_pixels(&self, slope: f64, distance: f64) -> f64 {
        let camera = self.camera.position.length();
        let metres = 2.0 * slope / (1.0 / camera + 1.0 / distance);
        // At the origin; a row spans more of a sample that is seen at a slant.
        let pixel_metres = self.camera.pixel_size() * camera;
        let foreshortening = self.camera.position.z / camera;
        metres / pixel_metres * foreshortening
    }
}

/// Whether the bulb stands beyond every line between a sample of half side `half` and the chart.
///
/// All of them lie below the plane through the sample's far edge and the chart's upper one, which
/// both run along x, as seen from the side where the bulb stands in front of the chart.
fn stands_clear(bulb: &Bulb, half: f64, panel: &Panel) -> bool {
    let far = Vec3::new(0.0, -half, 0.0);
    let [_, height] = panel.size();
    let rise = panel.point(0.0, height) - far;
    let upward = Vec3::new(0.0, -rise.z, rise.y);
    upward.dot(bulb.centre - far) > bulb.radius * upward.length()
}

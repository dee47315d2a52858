//! What sample and chart send each other.
//!
//! The light on the chart is a smooth function of the place on it. Of the light that has touched
//! the sample once before (bulb, sample, chart) up to four hundredths of white arrive near the
//! sample; of the light that went to and fro (bulb, chart, sample, chart) up to 2e-4, and of what
//! goes from the first of these to and fro again a few 1e-5. Bulb and chart both stand on the +y
//! side of the sample,
//! so the half vectors between them have slopes of about 1: a lobe that is narrow along both axes
//! sends nothing to the chart (5e-7 at an exponent of 37).

pub(in crate::hybrid) mod small_bulb;

use super::Stage;
use super::chart::{LightBatch, LitChart};
use super::chebyshev::{Basis, Tile, add_scaled};
use super::gauss::GaussRule;
use super::panel::PanelOnFilm;
use super::polygon::Rectangle;
use super::slopes::Fineness;
use crate::reflectance::Reflectance;
use crate::vector::Vec3;
use rayon::prelude::*;
use std::f64::consts::FRAC_1_PI;

/// A lobe with larger exponents along both axes sends less than 1e-6 of white to the chart.
const EXPONENT_MAX: f64 = 36.0;

/// From this exponent on, along its narrow axis, a lobe that sends anything is a thin sheet.
const SHEET_EXPONENT: f64 = 300.0;

/// What a lobe that is a thin sheet sends to and fro is below this and is left out.
const SHEET_HIGHER_MAX: f64 = 3e-5;

/// A chart that comes closer to the sample counts as being this many metres away.
const GAP_MIN: f64 = 1e-3;

/// Points of the rule over the sample, along x and y, and of the next finer one; and where much is
/// allowed.
const ORDER_1_POINTS: [[usize; 2]; 2] = [[10, 10], [14, 14]];
const ORDER_1_POINTS_COARSE: [[usize; 2]; 2] = [[6, 6], [10, 10]];

/// The same for a lobe that is a thin sheet, whose light off the sample is a narrow band.
const SHEET_POINTS: [[usize; 2]; 2] = [[20, 20], [28, 28]];

/// The same for what goes to and fro.
const HIGHER_POINTS: [[usize; 2]; 2] = [[4, 6], [6, 8]];

/// Where so much of white is allowed to the chart, coarse rules do, and what goes to and fro may be
/// left out.
const COARSE_FROM: f64 = 2e-4;

/// What goes to and fro is less than this many times what it is at the middle of the chart's lower
/// edge: once for all the chart, and once for the light that has been off the sample before.
const HIGHER_MARGIN: f64 = 2.0;

/// How fine the light off a sheet is worked out, and what goes to and fro.
const SHEET_ERROR: f64 = 1e-3;
const HIGHER_ERROR: f64 = 1e-2;

/// Of what is allowed to the chart, the share for the light off the sample.
const ORDER_1_SHARE: f64 = 0.25;

/// Terms of the series for the light off the sample, and for what goes to and fro.
const ORDER_1_TERMS: usize = 8;
const HIGHER_TERMS: usize = 5;
const ORDER_1_TERMS_COARSE: usize = 5;

/// Tiles of the light off the sample are halved no more than this often, and of that off a sheet,
/// which takes a hundred times the work.
const HALVINGS_MAX: u32 = 6;
const SHEET_HALVINGS_MAX: u32 = 3;

/// Irradiance over pi on the chart, in units of white, by how it came. The tiles span a and
/// ln(1 + b/gap) with the gap between sample and chart: near the sample it changes fastest.
#[derive(Debug)]
pub struct Interreflection {
    /// From the bulb by way of the sample.
    order_1: Vec<Tile<ORDER_1_TERMS>>,
    /// From the bulb by way of the chart and the sample.
    order_2: Option<Tile<HIGHER_TERMS>>,
    /// From the bulb by way of the sample, the chart and the sample again.
    order_3: Option<Tile<HIGHER_TERMS>>,
    /// A bound of what the sum is off by.
    error: f64,
    evaluations: u64,
    gap: f64,
    /// The chart on the tiles.
    bounds: Rectangle,
    bounces_max: u32,
}

impl Interreflection {
    /// Works out what the paths of so many bounces take. It does not depend on the camera.
    pub(in crate::hybrid) fn new(
        stage: &Stage,
        panel: &PanelOnFilm,
        reflectance: &Reflectance,
    ) -> Self {
        let bounces_max = stage.bounces_max;
        let lobe = &reflectance.lobe;
        let receiver = Receiver {
            stage,
            panel,
            gap: (panel.panel.corner.y - stage.sample_half).max(GAP_MIN),
        };
        let mut interreflection = Self {
            order_1: Vec::new(),
            order_2: None,
            order_3: None,
            error: 0.0,
            evaluations: 0,
            gap: receiver.gap,
            bounds: receiver.bounds(),
            bounces_max,
        };
        if reflectance.specular_share == 1.0 && lobe.n_v > EXPONENT_MAX {
            return interreflection;
        }
        let sheet = lobe.n_u > SHEET_EXPONENT;
        let [width, height] = panel.panel.size();
        let direct = stage.bulb_on_chart(panel, [0.5 * width, 0.5 * height]);
        let accuracy = &stage.chart_accuracy;
        let allowed = ORDER_1_SHARE * accuracy.absolute.max(accuracy.relative * direct);
        let coarse = allowed >= COARSE_FROM;
        if bounces_max > 1 {
            let (tiles, error, spent) = if sheet {
                let fineness = Fineness::new(SHEET_ERROR);
                let rule = (SHEET_POINTS, SHEET_HALVINGS_MAX);
                receiver.adaptive::<ORDER_1_TERMS, _>(allowed, rule, |batch, positions| {
                    sum_over(positions, |position, toward| {
                        stage.bulb_off_sample(position, toward, reflectance, fineness, batch)
                    })
                })
            } else {
                let bulb = stage.small_bulb();
                let off_sample = |batch: &mut _, positions: &[Sent]| {
                    bulb.off_sample(reflectance, stage.instructions, positions, batch)
                };
                if coarse {
                    let rule = (ORDER_1_POINTS_COARSE, HALVINGS_MAX);
                    receiver.adaptive::<ORDER_1_TERMS_COARSE, _>(allowed, rule, off_sample)
                } else {
                    let rule = (ORDER_1_POINTS, HALVINGS_MAX);
                    receiver.adaptive::<ORDER_1_TERMS, _>(allowed, rule, off_sample)
                }
            };
            interreflection.error += error;
            interreflection.order_1 = tiles;
            interreflection.evaluations += spent;
        }
        if bounces_max > 2 && sheet {
            interreflection.error += SHEET_HIGHER_MAX;
        } else if bounces_max > 2 {
            let direct = panel.lit(|at| [stage.bulb_on_chart(panel, at); 3]);
            if coarse {
                let lower_edge = [0.5 * width, 0.0];
                let points = receiver.points(lower_edge, HIGHER_POINTS[0]);
                let batch = &mut LightBatch::default();
                let ([r, g, b], spent) =
                    receiver.higher_order_at(&direct, reflectance, &points, batch);
                let most = HIGHER_MARGIN * r.max(g).max(b);
                interreflection.evaluations += spent;
                if most <= allowed {
                    interreflection.error += most;
                    return interreflection;
                }
            }
            let (tile, error, spent) = receiver.higher_order(&direct, reflectance);
            interreflection.error += error;
            interreflection.order_2 = Some(tile);
            interreflection.evaluations += spent;
            if bounces_max > 3 {
                let indirect =
                    panel.lit(|at| interreflection.order_1_at(place(at, interreflection.gap)));
                let (tile, error, spent) = receiver.higher_order(&indirect, reflectance);
                interreflection.error += error;
                interreflection.order_3 = Some(tile);
                interreflection.evaluations += spent;
            }
        }
        interreflection
    }

    /// How many evaluations it took.
    pub fn evaluations(&self) -> u64 {
        self.evaluations
    }

    /// How far [`Interreflection::on_chart`] may be off.
    pub fn error(&self) -> f64 {
        self.error
    }

    /// What reaches the chart at (a, b) before it goes to the camera.
    pub fn on_chart(&self, at: [f64; 2]) -> [f64; 3] {
        self.sum(at, self.bounces_max)
    }

    /// What reaches it before it goes to the camera by way of the sample, one bounce more.
    pub fn on_chart_for_sample(&self, at: [f64; 2]) -> [f64; 3] {
        self.sum(at, self.bounces_max - 1)
    }

    fn sum(&self, at: [f64; 2], bounces_max: u32) -> [f64; 3] {
        let at = place(at, self.gap);
        let mut sum = [0.0; 3];
        if bounces_max > 1 {
            sum = self.order_1_at(at);
        }
        if let (Some(tile), true) = (&self.order_2, bounces_max > 2) {
            add_scaled(&mut sum, tile.value(at), 1.0);
        }
        if let (Some(tile), true) = (&self.order_3, bounces_max > 3) {
            add_scaled(&mut sum, tile.value(at), 1.0);
        }
        sum.map(|channel| channel.max(0.0))
    }

    fn order_1_at(&self, at: [f64; 2]) -> [f64; 3] {
        let Rectangle { low, high } = self.bounds;
        // Rounding can lead off the chart.
        let at: [f64; 2] = std::array::from_fn(|axis| at[axis].clamp(low[axis], high[axis]));
        let holds = |tile: &&Tile<ORDER_1_TERMS>| {
            let Rectangle { low, high } = tile.rectangle;
            (0..2).all(|axis| at[axis] >= low[axis] && at[axis] <= high[axis])
        };
        let tile = self.order_1.iter().find(holds);
        tile.map_or([0.0; 3], |tile| tile.value(at))
    }
}

/// The place on the tiles of (a, b).
fn place([a, b]: [f64; 2], gap: f64) -> [f64; 2] {
    [a, libm::log1p(b.max(0.0) / gap)]
}

/// A point of the sample that sends light to a point of the chart.
#[derive(Clone, Copy)]
pub struct Sent {
    /// Where from.
    pub position: Vec3,
    /// To the point of the chart, unit.
    pub toward: Vec3,
    /// What its radiance adds to irradiance over pi.
    pub weight: f64,
}

/// The weighted sum over points, and evaluations, of a function of each point by itself.
fn sum_over(
    points: &[Sent],
    mut radiance: impl FnMut(Vec3, Vec3) -> ([f64; 3], u32),
) -> ([f64; 3], u64) {
    let (mut sum, mut evaluations) = ([0.0; 3], 0);
    for point in points {
        let (radiance, spent) = radiance(point.position, point.toward);
        add_scaled(&mut sum, radiance, point.weight);
        evaluations += u64::from(spent);
    }
    (sum, evaluations)
}

/// The chart as what receives light off the sample.
struct Receiver<'a> {
    stage: &'a Stage,
    panel: &'a PanelOnFilm,
    gap: f64,
}

impl Receiver<'_> {
    /// All of the chart.
    fn bounds(&self) -> Rectangle {
        let [width, height] = self.panel.panel.size();
        let [_, top] = place([0.0, height], self.gap);
        Rectangle {
            low: [0.0; 2],
            high: [width, top],
        }
    }

    /// The points of a rule over the sample, `points` along x (half of them on either side) and y,
    /// for a node of a tile.
    fn points(&self, [a, s]: [f64; 2], points: [usize; 2]) -> Vec<Sent> {
        let half = self.stage.sample_half;
        let panel = &self.panel.panel;
        let receiver = panel.point(a, self.gap * libm::expm1(s));
        let middle = receiver.x.clamp(-0.9 * half, 0.9 * half);
        let mut sent = Vec::with_capacity(points[0] * points[1]);
        // Squares of the integration variables gather points where the chart is near.
        for (s, weight_y) in GaussRule::of(points[1]).on(0.0, 1.0) {
            let y = half - 2.0 * half * s * s;
            let measure_y = 4.0 * half * s * weight_y;
            for reach in [half - middle, -half - middle] {
                for (t, weight_x) in GaussRule::of(points[0] / 2).on(0.0, 1.0) {
                    let position = Vec3::new(middle + reach * t * t, y, 0.0);
                    let measure = measure_y * 2.0 * reach.abs() * t * weight_x;
                    let offset = receiver - position;
                    let distance2 = offset.length_squared();
                    let toward = offset * (1.0 / distance2.sqrt());
                    let arriving = -toward.dot(panel.z);
                    if toward.z <= 0.0 || arriving <= 0.0 {
                        continue;
                    }
                    sent.push(Sent {
                        position,
                        toward,
                        weight: FRAC_1_PI * measure * toward.z * arriving / distance2,
                    });
                }
            }
        }
        sent
    }

    /// The irradiance over pi in tiles as small as `allowed` asks for, the error and evaluations.
    fn adaptive<const TERMS: usize, B: Default>(
        &self,
        allowed: f64,
        (points, halvings_max): ([[usize; 2]; 2], u32),
        off_sample: impl Fn(&mut B, &[Sent]) -> ([f64; 3], u64) + Sync,
    ) -> (Vec<Tile<ORDER_1_TERMS>>, f64, u64) {
        let basis = Basis::<TERMS>::new();
        let (mut tiles, mut error, mut evaluations) = (Vec::new(), 0.0f64, 0);
        let mut open = vec![(self.bounds(), 0)];
        while !open.is_empty() {
            let fits: Vec<_> = open
                .par_iter()
                .map(|(rectangle, depth)| {
                    let fit = self.fit(&basis, rectangle, points, &off_sample);
                    (*rectangle, *depth, fit)
                })
                .collect();
            open.clear();
            for (rectangle, depth, (tile, fit, missed, spent)) in fits {
                evaluations += spent;
                if fit.error <= allowed || depth >= halvings_max {
                    error = error.max(fit.error + missed);
                    tiles.push(tile.widened());
                    continue;
                }
                let steep = usize::from(fit.tails[1] > fit.tails[0]);
                let middle = 0.5 * (rectangle.low[steep] + rectangle.high[steep]);
                let (mut first, mut second) = (rectangle, rectangle);
                first.high[steep] = middle;
                second.low[steep] = middle;
                open.extend([(first, depth + 1), (second, depth + 1)]);
            }
        }
        (tiles, error, evaluations)
    }

    /// The irradiance over pi that light off `chart` by way of the sample comes to, in one tile.
    fn higher_order(
        &self,
        chart: &LitChart,
        reflectance: &Reflectance,
    ) -> (Tile<HIGHER_TERMS>, f64, u64) {
        let off_sample = |batch: &mut LightBatch, points: &[Sent]| {
            self.higher_order_at(chart, reflectance, points, batch)
        };
        let (tile, fit, missed, spent) =
            self.fit(&Basis::new(), &self.bounds(), HIGHER_POINTS, &off_sample);
        (tile, fit.error + missed, spent)
    }

    /// The same at one place of the chart, that of `points`, and evaluations.
    fn higher_order_at(
        &self,
        chart: &LitChart,
        reflectance: &Reflectance,
        points: &[Sent],
        batch: &mut LightBatch,
    ) -> ([f64; 3], u64) {
        let fineness = Fineness::new(HIGHER_ERROR);
        let instructions = self.stage.instructions;
        sum_over(points, |position, toward| {
            chart.reflected(position, toward, reflectance, fineness, instructions, batch)
        })
    }

    /// A tile, its fit, what the rule over the sample missed at the tile's middle, and evaluations.
    fn fit<const TERMS: usize, B: Default>(
        &self,
        basis: &Basis<TERMS>,
        rectangle: &Rectangle,
        [coarse, fine]: [[usize; 2]; 2],
        off_sample: &(impl Fn(&mut B, &[Sent]) -> ([f64; 3], u64) + Sync),
    ) -> (Tile<TERMS>, super::chebyshev::Fit, f64, u64) {
        let nodes: Vec<[f64; 2]> = basis.nodes(rectangle).collect();
        let values: Vec<([f64; 3], u64)> = nodes
            .into_par_iter()
            .map_init(B::default, |batch, node| {
                off_sample(batch, &self.points(node, coarse))
            })
            .collect();
        let mut batch = B::default();
        let middle = [0, 1].map(|axis| 0.5 * (rectangle.low[axis] + rectangle.high[axis]));
        let [(rough, first), (better, second)] =
            [coarse, fine].map(|points| off_sample(&mut batch, &self.points(middle, points)));
        let missed = super::pixel::largest_difference(rough, better);
        let spent = values.iter().map(|(_, spent)| spent).sum::<u64>() + first + second;
        let (tile, fit) = basis.fit(*rectangle, values.into_iter().map(|(value, _)| value));
        (tile, fit, missed, spent)
    }
}

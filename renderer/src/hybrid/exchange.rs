//! What sample and chart send each other.
//!
//! The light on the chart is a smooth function of the place on it. Of the light that has touched
//! the sample once before (bulb, sample, chart) up to four hundredths of white arrive near the
//! sample; of the light that went to and fro (bulb, chart, sample, chart) up to 2e-4. What goes on
//! from the first of these to and fro again is at most a few 1e-5: it is left out, and its bound
//! counts as error. Bulb and chart both stand on the +y side of the sample,
//! so the half vectors between them have slopes of about 1: a lobe that is narrow along both axes
//! sends nothing to the chart (5e-7 at an exponent of 37).

use super::chebyshev::{Fit, Tile, add_scaled};
use super::gauss::GaussRule;
use super::polygon::Rectangle;
use super::{PanelOnFilm, Stage};
use crate::reflectance::Reflectance;
use crate::vector::Vec3;
use std::f64::consts::FRAC_1_PI;

/// A lobe with larger exponents along both axes sends less than 1e-6 of white to the chart.
const EXPONENT_MAX: f64 = 36.0;

/// From this exponent on, along its narrow axis, a lobe that sends anything is a thin sheet.
const SHEET_EXPONENT: f64 = 300.0;

/// What a lobe that is a thin sheet sends to and fro is below this and is left out.
const SHEET_TWICE_MAX: f64 = 3e-5;

/// Of what goes to and fro, the share that its coarse rule may miss.
const TWICE_ERROR: f64 = 0.1;

/// Points of the rule over the sample, along x and y.
const ONCE_POINTS: [usize; 2] = [8, 10];

/// The same for a lobe that is a thin sheet, whose light off the sample is a narrow band.
const SHEET_POINTS: [usize; 2] = [28, 28];

/// The same for what goes to and fro.
const TWICE_POINTS: [usize; 2] = [4, 4];

/// Irradiance over pi on the chart, in units of white, by how it came. The tiles span a and the
/// square root of b over the chart's height: near the sample it changes fastest.
pub struct Exchange {
    /// From the bulb by way of the sample.
    once: Option<Tile<11>>,
    /// From the bulb by way of the chart and the sample.
    twice: Option<Tile<4>>,
    /// A bound of what the sum is off by.
    error: f64,
    height: f64,
    bounces_max: u32,
}

impl Exchange {
    /// Works out what the paths of so many bounces take.
    pub(super) fn new(
        stage: &Stage,
        panel: &PanelOnFilm,
        reflectance: &Reflectance,
        evaluations: &mut u64,
    ) -> Self {
        let bounces_max = stage.bounces_max;
        let lobe = &reflectance.lobe;
        let mut exchange = Self {
            once: None,
            twice: None,
            error: 0.0,
            height: panel.panel.size()[1],
            bounces_max,
        };
        if reflectance.specular_share == 1.0 && lobe.n_v > EXPONENT_MAX {
            return exchange;
        }
        let sheet = lobe.n_u > SHEET_EXPONENT;
        let mut once_largest = 0.0;
        if bounces_max > 1 {
            let radiance = |position: Vec3, toward: Vec3| {
                let (radiance, spent) = stage.bulb_off_sample(position, toward, reflectance);
                *evaluations += u64::from(spent);
                radiance
            };
            let points = if sheet { SHEET_POINTS } else { ONCE_POINTS };
            let (tile, fit) = irradiance(stage, panel, points, radiance);
            exchange.once = Some(tile);
            exchange.error += fit.error;
            once_largest = fit.largest;
        }
        if bounces_max > 2 && sheet {
            exchange.error += SHEET_TWICE_MAX;
        } else if bounces_max > 2 {
            let chart = panel.lit(|at| [stage.bulb_on_chart(panel, at); 3]);
            let radiance = |position: Vec3, toward: Vec3| {
                let (radiance, spent) = chart.reflected(position, toward, reflectance, 0.6);
                *evaluations += u64::from(spent);
                radiance
            };
            let (tile, fit) = irradiance(stage, panel, TWICE_POINTS, radiance);
            exchange.error += fit.error + TWICE_ERROR * fit.largest;
            if bounces_max > 3 {
                // The chart sends on its first indirect light as it does the bulb's.
                let direct = stage.bulb_on_chart(panel, [0.5 * panel.panel.size()[0], 0.0]);
                exchange.error += fit.largest * once_largest / direct;
            }
            exchange.twice = Some(tile);
        }
        exchange
    }

    /// How far [`Exchange::on_chart`] may be off.
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

    fn sum(&self, [a, b]: [f64; 2], bounces_max: u32) -> [f64; 3] {
        let at = [a, (b / self.height).max(0.0).sqrt()];
        let mut sum = [0.0; 3];
        if let (Some(tile), true) = (&self.once, bounces_max > 1) {
            add_scaled(&mut sum, tile.value(at), 1.0);
        }
        if let (Some(tile), true) = (&self.twice, bounces_max > 2) {
            add_scaled(&mut sum, tile.value(at), 1.0);
        }
        sum.map(|channel| channel.max(0.0))
    }
}

/// The irradiance over pi on the chart from a sample of which `radiance` leaves a point in a
/// direction, with a rule of `points` along x (half of them on either side) and y.
fn irradiance<const TERMS: usize>(
    stage: &Stage,
    panel: &PanelOnFilm,
    points: [usize; 2],
    mut radiance: impl FnMut(Vec3, Vec3) -> [f64; 3],
) -> (Tile<TERMS>, Fit) {
    let half = stage.sample_half;
    let [width, height] = panel.panel.size();
    let rectangle = Rectangle {
        low: [0.0; 2],
        high: [width, 1.0],
    };
    Tile::fit(rectangle, |a, w| {
        let b = height * w * w;
        let receiver = panel.panel.point(a, b);
        let middle = receiver.x.clamp(-0.9 * half, 0.9 * half);
        let mut sum = [0.0; 3];
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
                    let arriving = -toward.dot(panel.panel.z);
                    if toward.z <= 0.0 || arriving <= 0.0 {
                        continue;
                    }
                    let scale = FRAC_1_PI * measure * toward.z * arriving / distance2;
                    add_scaled(&mut sum, radiance(position, toward), scale);
                }
            }
        }
        sum
    })
}

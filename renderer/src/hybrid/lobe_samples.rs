//! The chart in a smooth sample, by sampling the lobe.
//!
//! A narrow lobe mirrors the chart with edges as fine as a pixel, too many for tiles. But what a
//! sampled direction carries is a patch's radiance times a weight that hardly changes: the sum over
//! a pixel is all but exact inside a patch, and only edges cost samples. A pilot tells how many; it
//! is thrown away, since stopping by the samples that are kept would bias them.

use super::chart::LitChart;
use crate::film::{FilmPixel, target};
use crate::reflectance::Reflectance;
use crate::replicates::{REPLICATES, estimate};
use crate::sampler::{Dimension, Sampler};
use crate::vector::Vec3;
use dataset::specification::Accuracy;

/// From this exponent on a lobe mirrors edges about as fine as a pixel, were it along one axis only.
const SHARP_EXPONENT: f64 = 5000.0;

/// From this exponent on, along both axes, or along one where the camera stands low and stretches
/// the lobe, a cubature over the chart takes more than samples do.
const NARROW_EXPONENT: f64 = 300.0;

/// The sine of an elevation below which a camera stands low.
const LOW: f64 = 0.6;

/// Whether the chart in a sample of this material is sampled, for a camera at an elevation of this
/// sine.
pub fn wanted(reflectance: &Reflectance, sin_elevation: f64) -> bool {
    let lobe = &reflectance.lobe;
    lobe.n_u > SHARP_EXPONENT
        || lobe.n_v > NARROW_EXPONENT
        || (lobe.n_u > NARROW_EXPONENT && sin_elevation < LOW)
}

/// Samples a replicate of the pilot takes.
const PILOT: u32 = 8;

/// What a path that meets the chart may carry, in units of white: where none of n samples has met
/// it, 3/n of this bounds what was missed with 95 percent confidence.
const BRIGHTNESS: f64 = 0.3;

/// An edge across a pixel takes k or k + 1 of a replicate's n stratified points. Where the k + 1
/// come with a chance below this, all eight replicates agree on k one time in twenty, and their
/// spread says nothing of the difference.
const UNSEEN: f64 = 0.3;

/// The fewest samples a replicate takes.
const SAMPLES_MIN: u32 = 16;

/// The most.
const SAMPLES_MAX: u32 = 128;

/// The share of a pixel's error that falls when samples are doubled is at least that of this power:
/// half for independent points, three quarters for an edge in a net.
const CONVERGENCE: f64 = 0.75;

/// What all pixels of a view share.
pub struct LobeSampler<'a> {
    /// What is reflected.
    pub chart: &'a LitChart,
    /// What reflects it.
    pub reflectance: &'a Reflectance,
    /// The target.
    pub accuracy: &'a Accuracy,
    /// Names the image.
    pub key: u64,
}

impl LobeSampler<'_> {
    /// Sums up one pixel of the chart reflected toward the camera, the pixel of that column, row
    /// and index, which holds `before` already. `surface` gives the point of the sample's plane
    /// seen through a film point, the direction back, and whether the sample covers it. Returns
    /// what is to be added and how many samples it took.
    pub fn pixel(
        &self,
        before: [f64; 3],
        (column, row): (u32, u32),
        index: u32,
        surface: impl Fn(f64, f64) -> (Vec3, Vec3, bool),
    ) -> (FilmPixel, u64) {
        let corners = [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0), (0.5, 0.5)];
        let reached = corners.into_iter().any(|(x, y)| {
            let (position, wo, _) = surface(f64::from(column) + x, f64::from(row) + y);
            self.chart.in_reach(position, wo, self.reflectance)
        });
        if !reached {
            return (FilmPixel::default(), 0);
        }
        let path = |sampler: &Sampler, sample: u32| -> Option<[f64; 3]> {
            let [x, y] = sampler.point(Dimension::Film, sample);
            let (position, wo, covered) = surface(f64::from(column) + x, f64::from(row) + y);
            if !covered {
                return None;
            }
            let scattered = self
                .reflectance
                .sample(wo, sampler.point(Dimension::Scatter(0), sample))?;
            let light = self.chart.seen(position, scattered.wi)?;
            Some(std::array::from_fn(|channel| {
                scattered.weight[channel] * light[channel]
            }))
        };
        let run = |purpose: u64, count: u32| {
            let mut means = [[0.0; 3]; REPLICATES as usize];
            let (mut least, mut largest) = ([f64::INFINITY; 3], [0.0f64; 3]);
            for (replicate, mean) in (0..).zip(&mut means) {
                let sampler = Sampler::new(self.key ^ purpose, index, replicate);
                for sample in 0..count {
                    let radiance = path(&sampler, sample).unwrap_or_default();
                    for channel in 0..3 {
                        least[channel] = least[channel].min(radiance[channel]);
                        largest[channel] = largest[channel].max(radiance[channel]);
                        mean[channel] += radiance[channel] / f64::from(count);
                    }
                }
            }
            let mut pixel = estimate(&means);
            let contrast = (0..3)
                .map(|channel| largest[channel] - least[channel])
                .fold(0.0, f64::max);
            pixel.error = pixel.error.max(UNSEEN * contrast / f64::from(count));
            if contrast == 0.0 {
                pixel.error = 3.0 * BRIGHTNESS / f64::from(REPLICATES * count);
            }
            pixel
        };
        let pilot = run(PILOT_PURPOSE, PILOT);
        let value = std::array::from_fn(|channel| before[channel] + pilot.value[channel]);
        let excess = pilot.error / target(self.accuracy, value);
        let wanted = f64::from(PILOT) * libm::pow(excess.max(1e-3), 1.0 / CONVERGENCE);
        let count = (wanted.min(f64::from(SAMPLES_MAX)) as u32)
            .clamp(SAMPLES_MIN, SAMPLES_MAX)
            .next_power_of_two();
        let spent = u64::from(REPLICATES) * u64::from(PILOT + count);
        (run(0, count), spent)
    }
}

/// Keeps the pilot's points apart from the others.
const PILOT_PURPOSE: u64 = 0x70_696c_6f74;

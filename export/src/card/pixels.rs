//! What the pixels of an export are like, channel by channel: what a network's inputs are normalised by.

use super::Described;
use crate::error::ExportError;
use dataset::{CompletedView, PixelStatistics};
use half::f16;
use imagestore::validation::decode;

/// The most images that are read for it.
const IMAGES_MAX: usize = 4096;

/// The percentiles that are told.
pub(super) const PERCENT: [u32; 5] = [1, 25, 50, 75, 99];

/// The pixels of the sample in the images that were read.
pub(super) struct Pixels {
    /// Images read.
    pub images: u64,
    /// Images of the export.
    pub images_all: u64,
    /// Red, green and blue.
    pub channels: [Channel; 3],
}

/// One channel of them.
pub(super) struct Channel {
    /// Mean, in units of white.
    pub mean: f64,
    /// Standard deviation, in units of white.
    pub deviation: f64,
    /// Mean of ln(1 + value).
    pub log1p_mean: f64,
    /// Standard deviation of ln(1 + value).
    pub log1p_deviation: f64,
    /// The smallest values that at least [`PERCENT`] of the pixels do not exceed; of 32-bit films the
    /// nearest 16-bit numbers.
    pub percentiles: [f64; 5],
    /// The largest value.
    pub max: f64,
}

/// How often each 16-bit number occurs, and sums.
struct Sums {
    counts: Vec<u64>,
    count: u64,
    value: Moments,
    log1p: Moments,
    max: f64,
}

/// Mean and squared deviations, added to one number at a time (Welford 1962).
#[derive(Default)]
struct Moments {
    count: f64,
    mean: f64,
    squares: f64,
}

impl Pixels {
    /// Reads all images of the export, or those of materials at equal distances where there are more
    /// than [`IMAGES_MAX`].
    pub(super) fn of(described: &Described<'_>) -> Result<Self, ExportError> {
        let (store, chosen) = (described.store, described.chosen);
        let specification = store.specification();
        let masks: Vec<Vec<bool>> = chosen
            .views
            .iter()
            .map(|&view| PixelStatistics::mask(specification, view).unwrap_or_default())
            .collect();
        let all = chosen.materials.len();
        let read = all.min((IMAGES_MAX / chosen.views.len().max(1)).max(1));
        let mut sums = [(); 3].map(|()| Sums::new());
        for place in 0..read {
            let material = chosen.materials[place * all / read];
            let files = chosen.files_of(store, material)?;
            let done: Vec<CompletedView> = files.into_iter().map(|(_, done)| done).collect();
            for ((file, mask), bytes) in done.iter().zip(&masks).zip(store.read_images(&done)) {
                let faulty = |reason| ExportError::Image {
                    path: store.image_path(&file.digest),
                    reason,
                };
                let bytes = bytes.map_err(|fault| faulty(fault.to_string()))?;
                let decoded = decode(&bytes, specification);
                let pixels = decoded
                    .map_err(|rejection| faulty(rejection.to_string()))?
                    .pixels;
                let of_sample = pixels.iter().zip(mask).filter(|(_, is_sample)| **is_sample);
                for (pixel, _) in of_sample {
                    for (sums, value) in sums.iter_mut().zip(pixel) {
                        sums.add(*value);
                    }
                }
            }
        }
        Ok(Self {
            images: (read * chosen.views.len()) as u64,
            images_all: chosen.images(),
            channels: sums.map(|sums| sums.channel()),
        })
    }
}

impl Sums {
    fn new() -> Self {
        Self {
            counts: vec![0; 1 << 16],
            count: 0,
            value: Moments::default(),
            log1p: Moments::default(),
            max: 0.0,
        }
    }

    fn add(&mut self, value: f32) {
        self.counts[usize::from(f16::from_f32_const(value).to_bits())] += 1;
        self.count += 1;
        let value = f64::from(value);
        self.value.add(value);
        self.log1p.add(libm::log1p(value));
        self.max = self.max.max(value);
    }

    fn channel(&self) -> Channel {
        Channel {
            mean: self.value.mean,
            deviation: self.value.deviation(),
            log1p_mean: self.log1p.mean,
            log1p_deviation: self.log1p.deviation(),
            percentiles: PERCENT.map(|percent| self.percentile(percent)),
            max: self.max,
        }
    }

    /// Pixels are not negative, so their 16-bit codes are in the order of their values.
    fn percentile(&self, percent: u32) -> f64 {
        let wanted = (self.count * u64::from(percent)).div_ceil(100);
        let mut below = 0;
        for (code, count) in (0..=u16::MAX).zip(&self.counts) {
            below += count;
            if below >= wanted && below > 0 {
                return f64::from(f16::from_bits(code).to_f32_const());
            }
        }
        0.0
    }
}

impl Moments {
    fn add(&mut self, value: f64) {
        self.count += 1.0;
        let off = value - self.mean;
        self.mean += off / self.count;
        self.squares += off * (value - self.mean);
    }

    fn deviation(&self) -> f64 {
        (self.squares / self.count.max(1.0)).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_are_those_of_the_definitions() {
        let mut sums = Sums::new();
        for value in [0.0, 0.25, 0.5, 4.0] {
            sums.add(value);
        }
        let channel = sums.channel();
        assert_eq!(channel.mean, 1.1875);
        // The squares of 1.1875, 0.9375, 0.6875 and 2.8125 have this mean.
        assert!((channel.deviation - 2.667_968_75f64.sqrt()).abs() < 1e-15);
        assert_eq!(channel.percentiles, [0.0, 0.0, 0.25, 0.5, 4.0]);
        assert_eq!(channel.max, 4.0);
        let logs = [1.0, 1.25, 1.5, 5.0].map(libm::log);
        assert!((channel.log1p_mean - logs.iter().sum::<f64>() / 4.0).abs() < 1e-15);
        let nothing = Sums::new().channel();
        assert_eq!(
            (nothing.mean, nothing.deviation, nothing.max),
            (0.0, 0.0, 0.0)
        );
    }
}

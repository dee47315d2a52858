//! What is in a store, in numbers: counts, parameters, errors, and brightness if asked for.

use crate::{
    error::ExportError,
    selection::{Chosen, Selection},
};
use dataset::{CompletedView, Digest, RENDERER_VERSION, Split, condition::Condition};
use datastore::ReadOnlyStore;
use imagestore::validation::decode;
use serde::Serialize;

/// Below it in every channel a pixel is dark, in units of white.
pub const DARK: f32 = 0.01;

/// A whole store, or some of its materials.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Statistics {
    /// The dataset's name.
    pub dataset: String,
    /// The specification's hash.
    pub specification: Digest,
    /// The renderer's version.
    pub renderer_version: &'static str,
    /// Materials wanted.
    pub materials: u32,
    /// Materials that are complete.
    pub materials_complete: u32,
    /// Images.
    pub images: u64,
    /// Bytes of all images.
    pub bytes: u64,
    /// Complete materials of each split.
    pub splits: [(Split, u32); 3],
    /// The ten parameters, over complete materials.
    pub parameters: Vec<Spread>,
    /// Each view, over complete materials.
    pub views: Vec<ViewStatistics>,
}

/// How a parameter spreads.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Spread {
    /// The parameter.
    pub name: &'static str,
    /// The smallest value.
    pub least: f64,
    /// The mean.
    pub mean: f64,
    /// The largest value.
    pub greatest: f64,
}

/// One view of all materials.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct ViewStatistics {
    /// The view's index.
    pub view: u32,
    /// Bytes of an image, mean.
    pub bytes_mean: f64,
    /// Estimated error of a pixel, mean over images and pixels, in units of white.
    pub error_mean: f64,
    /// Estimated error of a pixel, largest.
    pub error_max: f64,
    /// Fraction of pixels within target.
    pub within_target: f64,
    /// Light paths and evaluations of the model an image, mean.
    pub cost_mean: f64,
    /// Brightness, where pixels were read.
    pub brightness: Option<Brightness>,
}

/// The pixels of one view of all materials.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Brightness {
    /// Fraction of images none of whose pixels reaches [`DARK`].
    pub dark: f64,
    /// Fraction of images with a pixel above white.
    pub above_white: f64,
    /// The brightest channel.
    pub brightest: f32,
}

/// Counts and measures the complete materials of a store, those that a condition holds for; reads the
/// images themselves only for `pixels`. `progress` is told how many materials were looked at.
///
/// # Errors
/// When a record or an image cannot be read.
pub fn statistics(
    store: &ReadOnlyStore,
    condition: Option<Condition>,
    pixels: bool,
    progress: &dyn Fn(u64),
) -> Result<Statistics, ExportError> {
    let selection = Selection {
        partial: true,
        condition,
        ..Selection::default()
    };
    let chosen = selection.choose(store)?;
    let specification = store.specification();
    let split = |split| {
        let materials = chosen.materials.iter();
        let count = materials.filter(|material| specification.split(**material) == split);
        (split, count.count() as u32)
    };
    let mut found = Statistics {
        dataset: specification.name.clone(),
        specification: store.specification_hash(),
        renderer_version: RENDERER_VERSION,
        materials: chosen.materials.len() as u32 + chosen.materials_missing,
        materials_complete: chosen.materials.len() as u32,
        images: chosen.images(),
        bytes: 0,
        splits: [Split::Train, Split::Validation, Split::Test].map(split),
        parameters: spreads(store, &chosen),
        views: chosen
            .views
            .iter()
            .map(|&view| ViewStatistics {
                view,
                brightness: pixels.then(Brightness::default),
                ..ViewStatistics::default()
            })
            .collect(),
    };
    for (number, &material) in (1..).zip(&chosen.materials) {
        let images = chosen.images_of(store, material)?;
        let files: Vec<CompletedView> = images.iter().map(|image| image.done.clone()).collect();
        // Nothing is read but for pixels.
        let mut read = pixels
            .then(|| store.read_images(&files))
            .into_iter()
            .flatten();
        for (image, view) in images.iter().zip(&mut found.views) {
            found.bytes += image.done.bytes;
            view.add(&image.done);
            if let Some(brightness) = &mut view.brightness {
                let faulty = |reason| ExportError::Image {
                    path: store.image_path(&image.done.digest),
                    reason,
                };
                let Some(bytes) = read.next() else {
                    unreachable!("one is read for each image");
                };
                let bytes = bytes.map_err(|fault| faulty(fault.to_string()))?;
                let decoded = decode(&bytes, specification);
                let decoded = decoded.map_err(|rejection| faulty(rejection.to_string()))?;
                brightness.add(&decoded.pixels);
            }
        }
        progress(number);
    }
    for view in &mut found.views {
        view.divide(f64::from(found.materials_complete.max(1)));
    }
    Ok(found)
}

impl ViewStatistics {
    /// Adds an image; means are sums until they are divided.
    fn add(&mut self, image: &CompletedView) {
        let statistics = &image.statistics;
        self.bytes_mean += image.bytes as f64;
        self.error_mean += statistics.mean;
        self.error_max = self.error_max.max(statistics.max);
        self.within_target += statistics.within_target;
        self.cost_mean += (statistics.samples + statistics.evaluations) as f64;
    }

    fn divide(&mut self, count: f64) {
        self.bytes_mean /= count;
        self.error_mean /= count;
        self.within_target /= count;
        self.cost_mean /= count;
        if let Some(brightness) = &mut self.brightness {
            brightness.dark /= count;
            brightness.above_white /= count;
        }
    }
}

impl Brightness {
    fn add(&mut self, pixels: &[[f32; 3]]) {
        let channels = pixels.as_flattened().iter();
        let brightest = channels.copied().fold(0.0, f32::max);
        self.dark += f64::from(u8::from(brightest < DARK));
        self.above_white += f64::from(u8::from(brightest > 1.0));
        self.brightest = self.brightest.max(brightest);
    }
}

fn spreads(store: &ReadOnlyStore, chosen: &Chosen) -> Vec<Spread> {
    const NAMES: [&str; 10] = [
        "roughness",
        "anisotropy",
        "angle_deg",
        "ior",
        "L* at 0",
        "a* at 0",
        "b* at 0",
        "L* at 90",
        "a* at 90",
        "b* at 90",
    ];
    let mut spreads = NAMES.map(|name| Spread {
        name,
        least: f64::INFINITY,
        mean: 0.0,
        greatest: f64::NEG_INFINITY,
    });
    if chosen.materials.is_empty() {
        return Vec::new();
    }
    for &material in &chosen.materials {
        let sampled = store.specification().material(material);
        let [l0, a0, b0] = sampled.lab0();
        let [l90, a90, b90] = sampled.lab90();
        let dataset::Material {
            roughness,
            anisotropy,
            angle_deg,
            ior,
            ..
        } = sampled.material;
        let values = [
            roughness, anisotropy, angle_deg, ior, l0, a0, b0, l90, a90, b90,
        ];
        for (spread, value) in spreads.iter_mut().zip(values) {
            spread.least = spread.least.min(value);
            spread.mean += value / chosen.materials.len() as f64;
            spread.greatest = spread.greatest.max(value);
        }
    }
    spreads.to_vec()
}

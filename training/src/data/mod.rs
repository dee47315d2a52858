//! Pairs of rectified images with their labels, read from an export and held in memory.
//!
//! | module | what |
//! | --- | --- |
//! | `folder` | which pairs an export has, and what it says of them |
//! | `image` | one rectified image |
//! | `cache` | the pixels of all pairs in one file |

mod cache;
mod folder;
mod image;

use crate::error::TrainingError;
use crate::pixels::CHANNELS;
use cache::Cache;
use dataset::{Digest, Material, Specification, Split};
use folder::Folder;
use half::f16;
use inverse::Theta;
use rayon::prelude::*;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

/// Where pairs come from.
#[derive(Clone, Debug)]
pub struct Source {
    /// A finished export of layout `files` with rectified images of two views.
    pub folder: PathBuf,
    /// The two views, where the export has more.
    pub views: Option<[u32; 2]>,
    /// Pixels a side; the export's side is a multiple.
    pub side: u32,
}

/// One material's label.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Label {
    /// Its index in the dataset.
    pub index: u32,
    /// Whether it trains, validates or tests.
    pub split: Split,
    /// The ten parameters.
    pub material: Material,
}

/// What a network was trained on, and may be applied to.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Identity {
    /// Hash of the specification.
    pub specification: String,
    /// The renderer's version.
    pub renderer_version: String,
    /// The oblique view, then the one from above.
    pub views: [u32; 2],
    /// Pixels a side.
    pub side: u32,
}

/// All pairs of an export.
#[derive(Debug)]
pub struct Pairs {
    /// The specification that they were rendered under.
    pub specification: Specification,
    /// What they are.
    pub identity: Identity,
    /// One a material, in the dataset's order.
    pub labels: Vec<Label>,
    // By material: six planes of side x side, row by row, linear, in units of white.
    pixels: Vec<f16>,
}

impl Pairs {
    /// Reads an export, from its cache where there is one. `tell` hears how many of how many
    /// materials are read.
    ///
    /// # Errors
    /// When the export is unfinished, has other views or sides than are wanted, or when an image is
    /// missing, cut short, of another size or not finite.
    pub fn read(source: &Source, tell: &(dyn Fn(u64, u64) + Sync)) -> Result<Self, TrainingError> {
        let folder = Folder::open(source)?;
        let cache = Cache::new(&folder, source.side);
        let pixels = match cache.read(&folder)? {
            Some(pixels) => pixels,
            None => {
                let pixels = read_images(&folder, source.side, tell)?;
                cache.write(&folder, &pixels)?;
                pixels
            }
        };
        let identity = Identity {
            specification: folder.specification.hash().to_string(),
            renderer_version: folder.renderer_version,
            views: folder.views,
            side: source.side,
        };
        Self::new(folder.specification, identity, folder.labels, pixels)
    }

    /// Pairs in hand: one label a material, and for each six planes of side x side linear pixels,
    /// the oblique view's first.
    ///
    /// # Errors
    /// When the pixels are too many or too few.
    pub fn new(
        specification: Specification,
        identity: Identity,
        labels: Vec<Label>,
        pixels: Vec<f16>,
    ) -> Result<Self, TrainingError> {
        let wanted = labels.len() * CHANNELS * identity.side as usize * identity.side as usize;
        if pixels.len() != wanted {
            return Err(TrainingError::Input(format!(
                "{} pixels where {} materials have {wanted}",
                pixels.len(),
                labels.len()
            )));
        }
        Ok(Self {
            specification,
            identity,
            labels,
            pixels,
        })
    }

    /// Pixels a side.
    pub fn side(&self) -> usize {
        self.identity.side as usize
    }

    /// The positions, in [`Self::labels`], of a split.
    pub fn positions(&self, split: Split) -> Vec<usize> {
        let of_split = self.labels.iter().enumerate();
        let of_split = of_split.filter(|(_, label)| label.split == split);
        of_split.map(|(position, _)| position).collect()
    }

    /// The pixels of the material at a position: six planes, linear.
    pub fn pixels(&self, position: usize) -> &[f16] {
        let length = CHANNELS * self.side() * self.side();
        &self.pixels[position * length..][..length]
    }

    /// The name of the pixels and labels in hand: two sets of one name train to the same network.
    pub fn digest(&self) -> Digest {
        let mut bytes = Vec::with_capacity(self.labels.len() * 8);
        for label in &self.labels {
            bytes.extend(label.index.to_le_bytes());
            bytes.extend(label.split.name().bytes());
            for value in Theta::of(&label.material).0 {
                bytes.extend(value.to_le_bytes());
            }
        }
        bytes.extend(self.pixels.iter().flat_map(|pixel| pixel.to_le_bytes()));
        Digest::of(&bytes)
    }
}

fn read_images(
    folder: &Folder,
    side: u32,
    tell: &(dyn Fn(u64, u64) + Sync),
) -> Result<Vec<f16>, TrainingError> {
    let length = CHANNELS * side as usize * side as usize;
    let mut pixels = vec![f16::ZERO; folder.labels.len() * length];
    let (read, count) = (AtomicU64::new(0), folder.labels.len() as u64);
    pixels
        .par_chunks_exact_mut(length)
        .zip(&folder.images)
        .try_for_each(|(pixels, images)| {
            for (view, image) in pixels.chunks_exact_mut(length / 2).zip(images) {
                image::read(image, folder.side, side, view)?;
            }
            tell(read.fetch_add(1, Ordering::Relaxed) + 1, count);
            Ok::<(), TrainingError>(())
        })?;
    Ok(pixels)
}

/// The folder that holds what was made of an export's images.
fn cache_folder(export: &Path) -> PathBuf {
    export.join("cache")
}

//! The pixels of all pairs in one safetensors file beside the export, so that the next training
//! begins at once.

use super::cache_folder;
use super::folder::Folder;
use crate::error::TrainingError;
use crate::pixels::CHANNELS;
use dataset::Digest;
use export::file::{sync_folder, unable, write_bytes};
use half::f16;
use safetensors::tensor::{Dtype, SafeTensors, TensorView, serialize};
use std::collections::HashMap;
use std::fs;
use std::io::ErrorKind;
use std::path::PathBuf;

const TENSOR: &str = "pixels";
const DIGEST: &str = "blake3";

/// A file for each set of images and each side.
pub(super) struct Cache {
    path: PathBuf,
    side: usize,
}

impl Cache {
    pub fn new(folder: &Folder, side: u32) -> Self {
        let digest = folder.digest.to_string();
        let [oblique, above] = folder.views;
        let name = format!(
            "pairs-{}-{oblique}-{above}-{side}.safetensors",
            &digest[..16]
        );
        Self {
            path: cache_folder(&folder.path).join(name),
            side: side as usize,
        }
    }

    fn shape(&self, folder: &Folder) -> [usize; 4] {
        [folder.labels.len(), CHANNELS, self.side, self.side]
    }

    /// The pixels; `None` where there is no such file. One that is damaged counts as none, with a
    /// warning: it is made anew.
    pub fn read(&self, folder: &Folder) -> Result<Option<Vec<f16>>, TrainingError> {
        let bytes = match fs::read(&self.path) {
            Ok(bytes) => bytes,
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(None),
            Err(error) => return Err(unable("read", &self.path)(error).into()),
        };
        let pixels = self.decode(folder, &bytes);
        if pixels.is_none() {
            tracing::warn!(path = %self.path.display(), "the cache is damaged and is made anew");
        }
        Ok(pixels)
    }

    fn decode(&self, folder: &Folder, bytes: &[u8]) -> Option<Vec<f16>> {
        let (_, header) = SafeTensors::read_metadata(bytes).ok()?;
        let stated = header.metadata().as_ref()?.get(DIGEST)?.clone();
        let tensors = SafeTensors::deserialize(bytes).ok()?;
        let tensor = tensors.tensor(TENSOR).ok()?;
        let sound = tensor.dtype() == Dtype::F16
            && tensor.shape() == self.shape(folder)
            && Digest::of(tensor.data()).to_string() == stated;
        sound.then(|| {
            let halves = tensor.data().chunks_exact(2);
            halves
                .map(|two| f16::from_le_bytes([two[0], two[1]]))
                .collect()
        })
    }

    pub fn write(&self, folder: &Folder, pixels: &[f16]) -> Result<(), TrainingError> {
        let parent = cache_folder(&folder.path);
        fs::create_dir_all(&parent).map_err(unable("make", &parent))?;
        let bytes: Vec<u8> = pixels
            .iter()
            .flat_map(|pixel| pixel.to_le_bytes())
            .collect();
        let metadata = HashMap::from([(DIGEST.to_owned(), Digest::of(&bytes).to_string())]);
        let tensor = TensorView::new(Dtype::F16, self.shape(folder).to_vec(), &bytes)
            .map_err(|error| TrainingError::Weights(error.to_string()))?;
        let file = serialize([(TENSOR, tensor)], Some(metadata))
            .map_err(|error| TrainingError::Weights(error.to_string()))?;
        write_bytes(&self.path, &file)?;
        Ok(sync_folder(&parent)?)
    }
}

//! The pixels of all pairs in one safetensors file beside the export, so that the next training
//! begins at once.

use super::cache_folder;
use super::folder::Folder;
use crate::error::TrainingError;
use crate::pixels::CHANNELS;
use dataset::Digest;
use export::file::{sync_folder, unable};
use half::f16;
use safetensors::tensor::{Dtype, SafeTensors, TensorView, serialize};
use std::collections::HashMap;
use std::fs;
use std::io::{ErrorKind, Write};
use std::os::unix::fs::PermissionsExt;
use std::path::PathBuf;

const TENSOR: &str = "pixels";
const DIGEST: &str = "blake3";

/// Whoever may read the export may read its cache: the mode before the umask.
const MODE: u32 = 0o666;

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
        self.publish(&file)?;
        Ok(sync_folder(&parent)?)
    }

    /// Several trainings that begin at once may write the same cache: each writes a file of its own,
    /// and the last name counts.
    fn publish(&self, bytes: &[u8]) -> Result<(), TrainingError> {
        let unable = || unable("write", &self.path);
        let parent = self.path.parent().unwrap_or(&self.path);
        let mut file = tempfile::Builder::new()
            .prefix("pairs-")
            .suffix(".new")
            .permissions(fs::Permissions::from_mode(MODE))
            .tempfile_in(parent)
            .map_err(unable())?;
        file.write_all(bytes)
            .and_then(|()| file.as_file().sync_all())
            .map_err(unable())?;
        file.persist(&self.path)
            .map_err(|failed| unable()(failed.error))?;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn many_who_write_at_once_do_not_disturb_each_other() {
        let folder = tempfile::tempdir().unwrap();
        let cache = Cache {
            path: folder.path().join("pairs-0-1-32.safetensors"),
            side: 32,
        };
        let content = vec![7; 1 << 16];
        for _ in 0..20 {
            std::thread::scope(|scope| {
                let writers: Vec<_> = (0..8)
                    .map(|_| scope.spawn(|| cache.publish(&content)))
                    .collect();
                for writer in writers {
                    writer.join().unwrap().unwrap();
                }
            });
            assert!(fs::read(&cache.path).unwrap() == content);
        }
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }
}

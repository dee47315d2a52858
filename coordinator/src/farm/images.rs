//! Taking images in: which are missing, and whether one that comes is accepted.

use super::{Farm, FarmError};
use crate::upload_slots::Interrupted;
use dataset::Digest;
use imagestore::{
    FileError,
    blobs::Blobs,
    staging::{Stage, StagedImage},
    validation,
};
use jobstore::ledger::BlobPlace;
use std::{sync::Arc, time::Instant};
use tokio::task;

impl Farm {
    /// Which of the digests are neither staged nor in the store.
    pub async fn find_missing(&self, digests: Vec<Digest>) -> Result<Vec<Digest>, FarmError> {
        let unstaged: Vec<Digest> = {
            let staging = self.context.staging();
            digests
                .into_iter()
                .filter(|digest| !staging.contains(digest))
                .collect()
        };
        let places = self.stored(unstaged).await?;
        Ok(places
            .into_iter()
            .filter(|(_, place)| place.is_none())
            .map(|(digest, _)| digest)
            .collect())
    }

    /// Takes an image in, unless it is staged: checks digest, layout and every pixel.
    pub async fn put_blob(
        &self,
        digest: Digest,
        size: u64,
        data: impl AsRef<[u8]> + Send + 'static,
    ) -> Result<(), FarmError> {
        if self.context.blobs.objects().is_some() {
            return Err(FarmError::ByUrl);
        }
        let received = data.as_ref().len() as u64;
        if received != size {
            return Err(FarmError::Invalid(format!(
                "the image was sent as {size} bytes and has {received}"
            )));
        }
        if size > limits::protocol::BLOB_BYTES_MAX {
            return Err(FarmError::Invalid(format!(
                "the image has {size} bytes, more than {}",
                limits::protocol::BLOB_BYTES_MAX
            )));
        }
        let shared = Arc::clone(&self.shared);
        let context = Arc::clone(&self.context);
        let film = self.specification.image.clone();
        // What is begun runs to its end even when the caller goes away, so what it reserves it also
        // gives back. Whether the image is in the store already is not looked up: a worker asks
        // before it sends, and a second copy is dropped when it grows old.
        let take_in = move || {
            context.blobs.check_room()?;
            {
                let mut staging = context.staging();
                if staging.contains(&digest) {
                    return Ok(());
                }
                if !staging.reserve(size) {
                    return Err(FarmError::StagingFull(limits::STAGED_BYTES_MAX));
                }
            }
            let bytes = data.as_ref();
            let staged = validation::check_digest(bytes, digest)
                .and_then(|()| validation::inspect(bytes, &film))
                .map_err(FarmError::from)
                .and_then(|header| Ok((header, context.blobs.stage(digest, bytes)?)));
            match staged {
                Ok((header, file)) => {
                    let image = StagedImage {
                        file,
                        bytes: size,
                        header,
                        since: shared.now(),
                        stage: Stage::Waiting,
                    };
                    let unused = context.staging().insert(image);
                    if let Some(unused) = unused {
                        context.blobs.discard(&unused);
                    }
                    Ok(())
                }
                Err(error) => {
                    context.staging().release(size);
                    Err(error)
                }
            }
        };
        let arrived = Instant::now();
        let taken = self.uploads.run(take_in).await;
        taken.map_err(|Interrupted| FarmError::Interrupted)??;
        self.metrics.note_upload(arrived.elapsed());
        Ok(())
    }

    /// Of images that are not staged, which are in the store: known to the ledger, and on the disk
    /// with the right size.
    pub(super) async fn stored(
        &self,
        digests: Vec<Digest>,
    ) -> Result<Vec<(Digest, Option<BlobPlace>)>, FarmError> {
        if digests.is_empty() {
            return Ok(Vec::new());
        }
        let places = self.job_store.places(&digests).await?;
        if places.iter().all(Option::is_none) {
            // Nothing to look for: waking a thread costs as much as a small image.
            return Ok(digests.into_iter().zip(places).collect());
        }
        let blobs = self.context.blobs.clone();
        task::spawn_blocking(move || {
            let known: Vec<Digest> = digests
                .iter()
                .zip(&places)
                .filter_map(|(digest, place)| place.map(|_| *digest))
                .collect();
            let sizes = blobs
                .sizes(&known)
                .map_err(|error| blobs_away(&blobs, error))?;
            let mut places: Vec<(Digest, Option<BlobPlace>)> =
                digests.into_iter().zip(places).collect();
            let known = places.iter_mut().filter(|(_, place)| place.is_some());
            for ((_, place), size) in known.zip(sizes) {
                *place = place.filter(|place| size == Some(place.bytes));
            }
            Ok(places)
        })
        .await
        .map_err(|_| FarmError::Interrupted)?
    }
}

/// An error of the place that images are in. A bucket may answer again at any time; a disk that
/// fails is another matter.
pub(super) fn blobs_away(blobs: &Blobs, error: FileError) -> FarmError {
    match blobs.objects() {
        Some(_) => FarmError::Bucket(error),
        None => FarmError::File(error),
    }
}

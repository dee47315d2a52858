//! Taking images in: which are missing, and whether one that comes is accepted.

use super::{Farm, FarmError};
use crate::upload_slots::Interrupted;
use bytes::Bytes;
use dataset::{Digest, ImageHeader};
use futures_util::future::try_join_all;
use imagestore::{
    FileError,
    blobs::Blobs,
    inspector::Likely,
    staging::{Credential, LeaseOf, Sender},
    validation,
};
use jobstore::ledger::BlobPlace;
use std::{
    sync::Arc,
    time::{Duration, Instant},
};
use tokio::task;

/// What the images of a material have to be.
pub(super) struct Expected {
    /// What they say of themselves, view by view.
    pub headers: Vec<ImageHeader>,
    /// The text in the file of the last view: no other view's is longer.
    last_text: String,
    /// The size of the largest, bytes.
    pub bytes_max: u64,
}

impl Farm {
    /// What the images of a material have to be.
    pub(super) fn expected(&self, material: u32) -> Arc<Expected> {
        let specification = &self.specification;
        let headers =
            validation::expected_headers(specification, self.specification_hash, material);
        // They differ in the view's number alone, and the last has most digits.
        let last_text = headers.last().map(ImageHeader::to_json).unwrap_or_default();
        Arc::new(Expected {
            bytes_max: self.inspector.image_bytes_max(last_text.len()),
            headers,
            last_text,
        })
    }

    /// Which of the digests are neither staged nor in the store. Of a sender the images that are
    /// staged are kept for its lease, and room for the others is reserved.
    pub async fn find_missing(
        &self,
        of: Option<(LeaseOf, Credential)>,
        digests: Vec<Digest>,
    ) -> Result<Vec<Digest>, FarmError> {
        let sender = match of {
            Some((lease, credential)) if !self.takes_uploads_by_url() => {
                let wait = limits::STAGING_WAIT;
                Some(self.reserve(lease, credential, wait).await?)
            }
            _ => None,
        };
        let unstaged: Vec<Digest> = {
            let now = self.shared.now();
            let mut staging = self.context.staging();
            let mut is_staged = |digest: &Digest| match sender {
                Some(sender) => staging.name(sender, digest, now).is_some(),
                None => staging.contains(digest),
            };
            digests
                .into_iter()
                .filter(|digest| !is_staged(digest))
                .collect()
        };
        let places = self.stored(unstaged).await?;
        Ok(places
            .into_iter()
            .filter(|(_, place)| place.is_none())
            .map(|(digest, _)| digest)
            .collect())
    }

    /// Takes an image of a leased material in, unless it is staged: checks digest, header, layout
    /// and every pixel.
    pub async fn put_blob(
        &self,
        lease: LeaseOf,
        credential: Credential,
        digest: Digest,
        size: u64,
        data: impl AsRef<[u8]> + Send + 'static,
    ) -> Result<(), FarmError> {
        if self.takes_uploads_by_url() {
            return Err(FarmError::ByUrl);
        }
        let received = data.as_ref().len() as u64;
        if received != size {
            return Err(FarmError::Invalid(format!(
                "the image was sent as {size} bytes and has {received}"
            )));
        }
        // The image is here: it waits for room nowhere, but is sent again.
        let sender = self.reserve(lease, credential, Duration::ZERO).await?;
        let expected = self.expected(lease.material);
        self.take_in(sender, expected, digest, data).await
    }

    /// Takes images in that came along with the completion of a lease that is current.
    pub(super) async fn take_in_brought(
        &self,
        sender: Sender,
        expected: &Arc<Expected>,
        images: Vec<(Digest, u64, Bytes)>,
    ) -> Result<(), FarmError> {
        if images.is_empty() {
            return Ok(());
        }
        if self.takes_uploads_by_url() {
            return Err(FarmError::ByUrl);
        }
        if let Some((_, size, data)) = images
            .iter()
            .find(|(_, size, data)| *size != data.len() as u64)
        {
            let received = data.len();
            return Err(FarmError::Invalid(format!(
                "the image was sent as {size} bytes and has {received}"
            )));
        }
        let bytes = images.iter().map(|(_, size, _)| size).sum();
        let now = self.shared.now();
        let room = self.context.staging().reserve_at_once(sender, bytes, now);
        if !room {
            return Err(FarmError::StagingFull(sender.lease.material));
        }
        let images = images.into_iter();
        let taken_in = images
            .map(|(digest, _, data)| self.take_in(sender, Arc::clone(expected), digest, data));
        try_join_all(taken_in).await.map(drop)
    }

    /// Checks an image and puts it into the room of its lease.
    async fn take_in(
        &self,
        sender: Sender,
        expected: Arc<Expected>,
        digest: Digest,
        data: impl AsRef<[u8]> + Send + 'static,
    ) -> Result<(), FarmError> {
        let shared = Arc::clone(&self.shared);
        let context = Arc::clone(&self.context);
        let inspector = Arc::clone(&self.inspector);
        let material = sender.lease.material;
        // What is begun runs to its end even when the caller goes away. Whether the image is in the
        // store already is not looked up: a worker asks before it sends.
        let take_in = move || -> Result<(), FarmError> {
            context.blobs.check_room()?;
            let is_staged = {
                let mut staging = context.staging();
                staging.name(sender, &digest, shared.now()).is_some()
            };
            if is_staged {
                return Ok(());
            }
            let bytes = data.as_ref();
            let size = bytes.len() as u64;
            validation::check_size_max(size, expected.bytes_max)?;
            validation::check_digest(bytes, digest)?;
            let headers = &expected.headers;
            let likely = headers.last().map(|header| Likely {
                header,
                text: &expected.last_text,
            });
            let header = inspector.inspect(bytes, likely.as_ref())?;
            let expected = headers.get(header.view as usize).unwrap_or(&headers[0]);
            validation::check_identity(&header, expected)?;
            let file = context.blobs.stage(digest, bytes)?;
            let now = shared.now();
            let inserted = context
                .staging()
                .insert(sender.lease, file, size, header, now);
            let surplus = inserted.surplus.iter();
            surplus.for_each(|file| context.blobs.discard(file));
            if !inserted.counts {
                return Err(FarmError::StagingFull(material));
            }
            Ok(())
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

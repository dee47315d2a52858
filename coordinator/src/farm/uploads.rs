//! Images that workers send straight to a bucket.
//!
//! A worker asks for URLs, puts its images to `staging/`, below a name that its lease gives, and
//! reports the material complete. Then the coordinator asks the server what is there, has it copy
//! what counts to `blobs/`, and only after that lets the ledger name it. No byte of an image comes
//! here, and a copy that was answered is as durable as a sync.
//!
//! What is believed, and why. The URL's signature covers an MD5, so the server itself refuses bytes
//! that were damaged or cut short on their way; where the server's entity tags are MD5s they are
//! compared again. That the bytes have the BLAKE3 digest that they are called by is the worker's
//! word, as it is its word that it rendered them rightly: every reader checks it, `verify` checks
//! all. When a second worker renders a material again, its MD5s have to fit too. Azure signs no MD5
//! and tells none, nor does S3 where it encrypts with keys of its own: there the coordinator reads
//! the objects that a second worker vouches for and checks their digests.
//!
//! What a lying worker cannot do is to replace an image that somebody else vouches for. An upload
//! lies below a lease's own name. A digest that the ledger knows of another image, or whose object
//! has other bytes than this worker's, is contested: then, and only then, the coordinator reads the
//! upload, and it gets the name only as a whole and sound image of this very material and view.
//!
//! A kill between the steps leaves uploads, or objects that nothing names: the same worker
//! completes them, somebody renders them again, or `gc` removes them.

use super::{Farm, FarmError, RenderedImage, RenderedMaterial, Shared};
use dataset::{Digest, ImageHeader, Specification, blob_path};
use futures_util::{StreamExt, TryStreamExt, stream};
use imagestore::{
    FileError,
    blobs::{Objects, staging_key},
    bucket::{Bucket, UploadUrl},
    staging::LeaseOf,
    validation::{self, Rejection},
};
use jobqueue::token::Token;
use jobstore::ledger::BlobPlace;
use std::sync::Arc;
use tokio::{sync::watch, task};

/// The MD5 of an image.
pub(crate) type Md5 = [u8; limits::protocol::MD5_BYTES];

/// The uploads of a completion, under their names.
pub(super) struct Settled {
    /// Every view's image, and what it is recorded as; `None` where it has to be sent (again).
    pub stored: Vec<(Digest, Option<BlobPlace>)>,
    bucket: Bucket,
    // Uploads that were copied.
    keys: Vec<String>,
    // Dropped when they are removed: `Farm::uploads_cleared` waits for that.
    under_way: watch::Receiver<()>,
    // Held until the ledger says whose the names are.
    _settling: Exclusive,
}

/// One view's image on its way to its name.
struct Claim {
    objects: Objects,
    digest: Digest,
    md5: Md5,
    // What it would be recorded as, and what the digest is recorded as now.
    place: BlobPlace,
    known: Option<BlobPlace>,
    // Where its upload is.
    staged: String,
    specification: Arc<Specification>,
    header: ImageHeader,
}

/// What became of a claim.
enum Settling {
    /// It was there before.
    There,
    /// It is there now, from its upload.
    Copied,
    /// It has to be sent.
    Missing,
}

impl Farm {
    /// Whether images go to a bucket and not through here.
    pub fn takes_uploads_by_url(&self) -> bool {
        self.context.blobs.objects().is_some()
    }

    /// URLs for images of a material, in the order asked, for whoever has its lease.
    pub async fn upload_urls(
        &self,
        token: Token,
        material: u32,
        uploads: &[(Digest, Md5)],
    ) -> Result<Vec<UploadUrl>, FarmError> {
        let Some(objects) = self.context.blobs.objects() else {
            return Err(FarmError::NotByUrl);
        };
        self.lease_holder(LeaseOf { material, token }).await?;
        let valid = self.policy.lease * limits::UPLOAD_URL_LEASES;
        let lease = lease_name(token);
        let bucket = objects.bucket().clone();
        let asked: Vec<(String, Md5)> = uploads
            .iter()
            .map(|(digest, md5)| (staging_key(&lease, digest), *md5))
            .collect();
        let signed = objects.bucket().run(async move {
            let mut urls = Vec::with_capacity(asked.len());
            for (key, md5) in asked {
                urls.push(bucket.upload_url(&key, md5, valid).await?);
            }
            Ok(urls)
        });
        let signed = signed.await.map_err(|_| FarmError::Interrupted)?;
        signed.map_err(FarmError::Bucket)
    }

    /// Gives the uploads of a completion their names.
    pub(super) async fn settle(
        &self,
        objects: &Objects,
        token: Token,
        rendered: &RenderedMaterial,
    ) -> Result<Settled, FarmError> {
        let images = rendered.images.iter();
        let digests: Vec<Digest> = images.map(|image| image.view.digest).collect();
        let settling = Exclusive::new(&self.shared, digests.clone())?;
        let known = self.job_store.places(&digests).await?;
        let claims = self.claims(objects, token, rendered, known)?;
        let bucket = objects.bucket().clone();
        let settled = objects.bucket().run(async move {
            let settled = claims.into_iter().map(|claim| async move {
                let what = claim.settle().await?;
                Ok::<_, FarmError>((claim.digest, claim.place, claim.staged, what))
            });
            let settled = stream::iter(settled).buffered(limits::BUCKET_REQUESTS_AT_ONCE);
            settled.try_collect::<Vec<_>>().await
        });
        let settled = settled.await.map_err(|_| FarmError::Interrupted)??;
        let mut all = Settled {
            stored: Vec::with_capacity(settled.len()),
            bucket,
            keys: Vec::new(),
            under_way: self.shared.clearing.subscribe(),
            _settling: settling,
        };
        for (digest, place, staged, what) in settled {
            let is_there = !matches!(what, Settling::Missing);
            all.stored.push((digest, is_there.then_some(place)));
            if matches!(what, Settling::Copied) {
                all.keys.push(staged);
            }
        }
        Ok(all)
    }

    /// Ends when the uploads of every completion so far are removed.
    pub async fn uploads_cleared(&self) {
        self.shared.clearing.closed().await;
    }

    fn claims(
        &self,
        objects: &Objects,
        token: Token,
        rendered: &RenderedMaterial,
        known: Vec<Option<BlobPlace>>,
    ) -> Result<Vec<Claim>, FarmError> {
        let material = rendered.material;
        let headers =
            validation::expected_headers(&self.specification, self.specification_hash, material);
        let lease = lease_name(token);
        let images = rendered.images.iter().zip(headers).zip(known);
        images
            .map(|((RenderedImage { view, md5, .. }, header), known)| {
                let size = validation::check_size(view.bytes, &self.specification, &header);
                size.map_err(|reason| FarmError::Image {
                    view: header.view,
                    reason,
                })?;
                let missing = || FarmError::Invalid("a view has no MD5".to_owned());
                Ok(Claim {
                    objects: objects.clone(),
                    digest: view.digest,
                    md5: md5.ok_or_else(missing)?,
                    place: BlobPlace {
                        material,
                        view: header.view,
                        bytes: view.bytes,
                    },
                    known,
                    staged: staging_key(&lease, &view.digest),
                    specification: Arc::clone(&self.specification),
                    header,
                })
            })
            .collect()
    }
}

impl Claim {
    async fn settle(&self) -> Result<Settling, FarmError> {
        let bucket = self.objects.bucket();
        let name = blob_path(&self.digest);
        let mut contested = self.known.is_some_and(|known| known != self.place);
        if self.known == Some(self.place)
            && let Some(object) = bucket.head(&name).await.map_err(FarmError::Bucket)?
            && object.bytes == self.place.bytes
        {
            let is_right = match self.objects.md5_by_server(&object) {
                Some(found) => found == self.md5,
                None => self.has_the_digest(&name).await?,
            };
            if is_right {
                return Ok(Settling::There);
            }
            contested = true;
        }
        let staged = bucket.head(&self.staged).await.map_err(FarmError::Bucket)?;
        let arrived = staged.is_some_and(|object| {
            let by_server = self.objects.md5_by_server(&object);
            object.bytes == self.place.bytes && by_server.is_none_or(|found| found == self.md5)
        });
        if !arrived {
            return Ok(Settling::Missing);
        }
        let named = if contested {
            tracing::warn!(digest = %self.digest, "two workers disagree on an image: it is read");
            let bytes = self.read_and_check().await?;
            bucket.write(&name, bytes).await.map(|_| ())
        } else {
            bucket.copy(&self.staged, &name).await
        };
        named.map_err(FarmError::Bucket)?;
        Ok(Settling::Copied)
    }

    /// Whether an object of this claim's size is what the digest says. It is read: the server does
    /// not tell.
    async fn has_the_digest(&self, name: &str) -> Result<bool, FarmError> {
        let read = self.objects.bucket().read(name, self.place.bytes);
        let bytes = read.await.map_err(FarmError::Bucket)?;
        let digest = self.digest;
        let checked = task::spawn_blocking(move || validation::check_digest(&bytes, digest));
        let checked = checked.await.map_err(|_| FarmError::Interrupted)?;
        Ok(checked.is_ok())
    }

    /// The upload, if it is the image that it is called.
    async fn read_and_check(&self) -> Result<Vec<u8>, FarmError> {
        let read = self.objects.bucket().read(&self.staged, self.place.bytes);
        let bytes = read.await.map_err(FarmError::Bucket)?;
        let (digest, header) = (self.digest, self.header.clone());
        let specification = Arc::clone(&self.specification);
        let checked = task::spawn_blocking(move || {
            validation::check_digest(&bytes, digest)?;
            validation::check_identity(&validation::inspect(&bytes, &specification)?, &header)?;
            Ok::<_, Rejection>(bytes)
        });
        let checked = checked.await.map_err(|_| FarmError::Interrupted)?;
        checked.map_err(|reason| FarmError::Image {
            view: self.header.view,
            reason,
        })
    }
}

impl Settled {
    /// Which images have to be sent (again).
    pub fn missing(&self) -> Vec<Digest> {
        let missing = self.stored.iter().filter(|(_, place)| place.is_none());
        missing.map(|(digest, _)| *digest).collect()
    }

    /// Removes uploads that are no longer needed, some time soon; what stays, `gc` finds. A
    /// coordinator that stops waits for it, for a while.
    pub fn clear(self) {
        if self.keys.is_empty() {
            return;
        }
        // The names are free again at once.
        let Self {
            bucket,
            keys,
            under_way,
            ..
        } = self;
        task::spawn(async move {
            let cleared = bucket.clone();
            let removed = bucket.run(async move { cleared.remove(keys).await }).await;
            if let Ok(Err(error)) = removed {
                let error: FileError = error;
                tracing::warn!(%error, "uploads that are no longer needed stay");
            }
            drop(under_way);
        });
    }
}

/// Digests that no other completion settles meanwhile: of two that claim one name at the same
/// instant, the one that comes later has to see what the ledger says of the other.
struct Exclusive {
    shared: Arc<Shared>,
    digests: Vec<Digest>,
}

impl Exclusive {
    /// Whoever comes second is told to try again.
    fn new(shared: &Arc<Shared>, mut digests: Vec<Digest>) -> Result<Self, FarmError> {
        digests.sort_unstable();
        digests.dedup();
        let mut state = shared.lock();
        if digests.iter().any(|digest| state.settling.contains(digest)) {
            return Err(FarmError::Interrupted);
        }
        state.settling.extend(&digests);
        drop(state);
        let shared = Arc::clone(shared);
        Ok(Self { shared, digests })
    }
}

impl Drop for Exclusive {
    fn drop(&mut self) {
        let mut state = self.shared.lock();
        for digest in &self.digests {
            state.settling.remove(digest);
        }
    }
}

/// What a lease's uploads are called after: nobody who lists the bucket learns the token.
fn lease_name(token: Token) -> String {
    let digest = Digest::of(&token.to_message()).to_string();
    digest[..32].to_owned()
}

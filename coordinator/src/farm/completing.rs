//! Recording completions.

use super::{
    Farm, FarmError, Md5,
    events::{Event, EventKind},
    random,
};
use bytes::Bytes;
use dataset::{CompletedView, Digest, ImageHeader, PixelStatistics};
use imagestore::{
    staging::{Credential, Holder, LeaseOf, Sender, StagedImage},
    validation::{self, Rejection},
};
use jobqueue::{
    Completion, Standing, Verdict,
    token::{Token, WorkerId},
};
use jobstore::{Decision, Delivery, JobStoreError, PublishError, ledger::BlobPlace};

/// What became of a completion.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum Outcome {
    /// It counts: as a first rendering, a second or a third.
    Recorded,
    Repeated,
    Missing(Vec<Digest>),
}

/// A material as its worker reports it.
pub(crate) struct RenderedMaterial {
    pub material: u32,
    /// In the order of the specification's views.
    pub images: Vec<RenderedImage>,
    pub seconds: f64,
    /// Who reports it.
    pub by: Credential,
}

/// An image as its worker reports it.
pub(crate) struct RenderedImage {
    pub view: CompletedView,
    /// Where images are in a bucket.
    pub md5: Option<Md5>,
    /// Its bytes where they came along, empty where they did not.
    pub data: Bytes,
}

impl RenderedMaterial {
    /// What is recorded of it. Who rendered it is filled in by the job store.
    fn completion(&self) -> Completion {
        Completion {
            material: self.material,
            views: self.images.iter().map(|image| image.view.clone()).collect(),
            seconds: self.seconds,
            worker: String::new(),
        }
    }

    /// Its images that came along, with the sizes that they were reported with.
    fn brought(&self) -> Vec<(Digest, u64, Bytes)> {
        let came = self.images.iter().filter(|image| !image.data.is_empty());
        let came =
            came.map(|RenderedImage { view, data, .. }| (view.digest, view.bytes, data.clone()));
        came.collect()
    }
}

impl Farm {
    /// Records a material as complete, durably, if its token is the current lease's and every image
    /// is here and is what it should be. Images that came along are taken in first, unless the lease
    /// is over.
    pub async fn complete(
        &self,
        token: Token,
        rendered: RenderedMaterial,
    ) -> Result<Outcome, FarmError> {
        let completion = rendered.completion();
        self.check_completion(&completion)?;
        let (material, bytes, seconds) =
            (completion.material, completion.bytes(), completion.seconds);
        let fingerprint = completion.fingerprint();
        // Held until the ledger says whose the names are.
        let mut uploads = None;
        let sender = Sender {
            lease: LeaseOf { material, token },
            holder: Holder {
                credential: rendered.by,
                worker: None,
            },
        };
        let standing = self
            .job_store
            .standing(material, token, fingerprint)
            .await?;
        if let Standing::Current { records } = standing {
            let expected = self.expected(material);
            self.take_in_brought(sender, &expected, rendered.brought())
                .await?;
            let missing = match self.context.blobs.objects() {
                None => {
                    let headers = &expected.headers;
                    self.missing_images(sender, &completion, headers).await?
                }
                Some(objects) => {
                    let settled = self.settle(objects, token, &rendered).await?;
                    let missing = settled.missing();
                    uploads = Some(settled);
                    missing
                }
            };
            if !missing.is_empty() {
                return Ok(Outcome::Missing(missing));
            }
            if records && let Some(missing) = self.publish_images(sender, &completion).await? {
                return Ok(Outcome::Missing(missing));
            }
        }
        let decision = match self.record(sender, completion).await? {
            Ok(decision) => decision,
            Err(missing) => return Ok(Outcome::Missing(missing)),
        };
        if let Some(settled) = uploads {
            settled.clear();
        }
        // Whatever was decided, the lease is over.
        self.end_staging(&[sender.lease]);
        self.drop_ended(&decision.changes).await;
        if decision.verdict.records()
            && let Some(holder) = &decision.holder
        {
            self.metrics.note_completion(bytes, seconds);
            self.count_images(holder.worker);
        }
        self.tell_decision(material, token, &decision);
        Ok(match decision.verdict {
            Verdict::Repeated => Outcome::Repeated,
            _ => Outcome::Recorded,
        })
    }

    /// Hands a completion to the job store, whose images have their names. Where one of those has
    /// vanished meanwhile returns all that are to be sent again.
    async fn record(
        &self,
        sender: Sender,
        completion: Completion,
    ) -> Result<Result<Decision, Vec<Digest>>, FarmError> {
        let draw = u64::from_ne_bytes(random()?) % 1_000_000;
        let delivery = Delivery {
            token: sender.lease.token,
            completion,
            check: draw < u64::from(self.redundant_per_million),
        };
        loop {
            match self.job_store.complete(delivery.clone()).await {
                // Sent again while it was about to be recorded.
                Err(JobStoreError::Unpublished(_)) => {
                    let published = self.publish_images(sender, &delivery.completion);
                    if let Some(missing) = published.await? {
                        return Ok(Err(missing));
                    }
                }
                decision => return Ok(Ok(decision?)),
            }
        }
    }

    /// Counts a completed material's images, for the rate and for its worker.
    fn count_images(&self, worker: WorkerId) {
        let mut state = self.shared.lock();
        let images = self.specification.views.len() as u64;
        state.images_completed.count(images, self.shared.now());
        state.presence.note_completion(worker);
    }

    /// Gives the staged images of a completion their names. Where one has vanished from the disk
    /// returns all that are to be sent again.
    async fn publish_images(
        &self,
        sender: Sender,
        completion: &Completion,
    ) -> Result<Option<Vec<Digest>>, FarmError> {
        match self.publisher.publish(completion).await {
            Ok(()) => Ok(None),
            Err(PublishError::Gone(error)) => {
                let material = completion.material;
                tracing::error!(material, %error, "a staged image is gone, and is asked for again");
                let headers = &self.expected(material).headers;
                let missing = self.missing_images(sender, completion, headers).await?;
                Ok((!missing.is_empty()).then_some(missing))
            }
            Err(PublishError::File(error)) => Err(FarmError::File(error)),
            Err(PublishError::Stopped) => Err(FarmError::Interrupted),
        }
    }

    /// Which images of a completion are neither staged nor in the store.
    ///
    /// # Errors
    /// When one is here and is not what it should be.
    async fn missing_images(
        &self,
        sender: Sender,
        completion: &Completion,
        headers: &[ImageHeader],
    ) -> Result<Vec<Digest>, FarmError> {
        let material = completion.material;
        let mut unstaged = Vec::new();
        {
            let now = self.shared.now();
            let mut staging = self.context.staging();
            for (header, view) in headers.iter().zip(&completion.views) {
                let Some(image) = staging.name(sender, &view.digest, now) else {
                    let place = BlobPlace {
                        material,
                        view: header.view,
                        bytes: view.bytes,
                    };
                    unstaged.push((view.digest, place));
                    continue;
                };
                check_image(image, view.bytes, header).map_err(|reason| FarmError::Image {
                    view: header.view,
                    reason,
                })?;
            }
        }
        let digests = unstaged.iter().map(|(digest, _)| *digest).collect();
        let places = self.stored(digests).await?;
        let missing = unstaged.into_iter().zip(places);
        let missing = missing.filter(|((_, place), (_, found))| *found != Some(*place));
        Ok(missing.map(|((digest, _), _)| digest).collect())
    }

    fn tell_decision(&self, material: u32, token: Token, decision: &Decision) {
        let (kind, text) = match &decision.verdict {
            Verdict::Repeated => return,
            Verdict::Recorded => (EventKind::Completed, String::new()),
            Verdict::Agreed => (EventKind::RedundantAgreed, String::new()),
            Verdict::Disputed => {
                let text = "its images or statistics are not those delivered before: a third worker, or \
                            the operator, decides";
                (EventKind::Disputed, text.to_owned())
            }
            verdict @ (Verdict::Upheld(_) | Verdict::Overturned(_) | Verdict::Ruled(_)) => {
                let again = decision.changes.retracted.len();
                let text = format!(
                    "{} delivered wrong images or statistics; {again} of its materials are rendered \
                     again",
                    verdict.liars().join(" and ")
                );
                (EventKind::Settled, text)
            }
            Verdict::Undecided => {
                let text = "three workers rendered three different sets of images";
                (EventKind::Settled, text.to_owned())
            }
        };
        let mut event = Event::new(kind).material(material).text(text);
        if let Some(holder) = &decision.holder {
            event = event.worker(&holder.name).lease(token);
        }
        self.emit(event);
        self.tell_troubles(&decision.changes);
    }

    fn check_completion(&self, completion: &Completion) -> Result<(), FarmError> {
        let (expected, found) = (self.specification.views.len(), completion.views.len());
        if found != expected {
            return Err(FarmError::Invalid(format!(
                "a material has {expected} views, and {found} were reported"
            )));
        }
        if !(completion.seconds.is_finite() && completion.seconds >= 0.0) {
            return Err(FarmError::Invalid(format!(
                "a rendering took {} seconds: that is no time",
                completion.seconds
            )));
        }
        for (view, image) in completion.views.iter().enumerate() {
            let pixels = image.pixels.as_ref();
            let checked = image.statistics.check();
            let checked = checked.and_then(|()| pixels.map_or(Ok(()), PixelStatistics::check));
            if let Err(reason) = checked {
                return Err(FarmError::Invalid(format!("view {view}: {reason}")));
            }
        }
        Ok(())
    }
}

fn check_image(image: &StagedImage, bytes: u64, expected: &ImageHeader) -> Result<(), Rejection> {
    if image.bytes != bytes {
        return Err(Rejection::Identity {
            what: "size in bytes",
            found: image.bytes.to_string(),
            expected: bytes.to_string(),
        });
    }
    validation::check_identity(&image.header, expected)
}

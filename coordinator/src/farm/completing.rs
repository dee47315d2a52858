//! Recording completions.

use super::{
    Farm, FarmError, Md5,
    events::{Event, EventKind},
    random,
};
use crate::{
    acceptance::{self, Rejection},
    commit::{Pending, Transition},
    completion::Completion,
    ledger::BlobPlace,
    queue::{Changes, Holder, Standing, Verdict},
    staging::StagedImage,
    token::Token,
};
use dataset::{Digest, ImageHeader};

/// What became of a completion.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum Outcome {
    /// It counts: as a first rendering, a second or a third.
    Recorded,
    Repeated,
    Missing(Vec<Digest>),
}

/// A completion on its way to the disk.
struct Judged {
    verdict: Verdict,
    holder: Option<Holder>,
    changes: Changes,
}

impl Farm {
    /// Records a completion, durably, if its token is the current lease's and every image is here
    /// and is what it should be. Who rendered it is filled in here. `md5s` are those of the views
    /// in order, where images are in a bucket.
    pub async fn complete(
        &self,
        token: Token,
        completion: Completion,
        md5s: &[Option<Md5>],
    ) -> Result<Outcome, FarmError> {
        self.check_completion(&completion)?;
        let material = completion.material;
        let unstaged = self.unstaged_images(token, &completion)?;
        let uploads = match self.blobs.objects() {
            Some(objects) if !unstaged.is_empty() => {
                Some(self.settle(objects, token, &completion, md5s).await?)
            }
            _ => None,
        };
        let stored = match &uploads {
            Some(settled) => settled.stored.clone(),
            None => self.stored(unstaged).await?,
        };
        let (judged, pending) = match self.judge(token, completion, &stored)? {
            Ok(judged) => judged,
            Err(missing) => return Ok(Outcome::Missing(missing)),
        };
        pending.durable().await?;
        if let Some(settled) = uploads {
            settled.clear();
        }
        self.tell_judged(material, &judged);
        Ok(match judged.verdict {
            Verdict::Repeated => Outcome::Repeated,
            _ => Outcome::Recorded,
        })
    }

    fn unstaged_images(
        &self,
        token: Token,
        completion: &Completion,
    ) -> Result<Vec<Digest>, FarmError> {
        let state = self.shared.lock();
        let fingerprint = completion.fingerprint();
        match state
            .queue
            .standing(completion.material, token, fingerprint)?
        {
            Standing::Repeated => Ok(Vec::new()),
            Standing::Current => {
                let digests = completion.views.iter().map(|view| view.digest);
                Ok(digests
                    .filter(|digest| !state.staging.contains(digest))
                    .collect())
            }
        }
    }

    /// The transition itself, all under one lock; or which images are missing. Even where nothing
    /// changes something is submitted: the first of two equal completions may still be on its way
    /// to the disk, and the second has to wait for it.
    fn judge(
        &self,
        token: Token,
        mut completion: Completion,
        stored: &[(Digest, Option<BlobPlace>)],
    ) -> Result<Result<(Judged, Pending), Vec<Digest>>, FarmError> {
        let material = completion.material;
        let fingerprint = completion.fingerprint();
        let headers =
            acceptance::expected_headers(&self.specification, self.specification_hash, material);
        let draw = u64::from_ne_bytes(random()?) % 1_000_000;
        let check = draw < u64::from(self.checks_per_million);
        let mut state = self.shared.lock();
        if state.queue.standing(material, token, fingerprint)? == Standing::Current {
            let mut missing = Vec::new();
            for (header, view) in headers.iter().zip(&completion.views) {
                let place = BlobPlace {
                    material,
                    view: header.view,
                    bytes: view.bytes,
                };
                if let Some(image) = state.staging.get(&view.digest) {
                    check_image(image, view.bytes, header).map_err(|reason| FarmError::Image {
                        view: header.view,
                        reason,
                    })?;
                } else if !stored.contains(&(view.digest, Some(place))) {
                    missing.push(view.digest);
                }
            }
            if !missing.is_empty() {
                return Ok(Err(missing));
            }
        }
        let now = self.shared.now();
        let holder = state.queue.holder(material).cloned();
        let (verdict, changes) = state
            .queue
            .complete(material, token, fingerprint, check, now)?;
        let mut transition = Transition {
            changes: changes.clone(),
            ..Transition::default()
        };
        if let (Verdict::Recorded | Verdict::Overturned(_), Some(holder)) = (&verdict, &holder) {
            state.bytes_received += completion.bytes();
            self.metrics
                .note_completion(completion.bytes(), completion.seconds);
            let images = completion.views.len() as u64;
            state.images_completed.count(images, now);
            state.roster.note_completion(holder.worker);
            transition.images = completion
                .views
                .iter()
                .filter_map(|view| state.staging.begin_publishing(&view.digest))
                .collect();
            completion.worker = holder.name.clone();
            transition.completion = Some(completion);
        }
        self.after(&state, &changes);
        let pending = self.committer.submit(transition);
        let judged = Judged {
            verdict,
            holder,
            changes,
        };
        Ok(Ok((judged, pending)))
    }

    fn tell_judged(&self, material: u32, judged: &Judged) {
        let (kind, text) = match &judged.verdict {
            Verdict::Repeated => return,
            Verdict::Recorded => (EventKind::Completed, String::new()),
            Verdict::Agreed => (EventKind::CheckAgreed, String::new()),
            Verdict::Disputed => {
                let text = "its images are not those delivered before: a third worker decides";
                (EventKind::Disputed, text.to_owned())
            }
            Verdict::Upheld(liar) | Verdict::Overturned(liar) => {
                let again = judged.changes.retracted.len();
                let text = format!("{liar} was wrong; {again} of its materials are rendered again");
                (EventKind::Settled, text)
            }
            Verdict::Undecided => {
                let text = "three workers rendered three different sets of images";
                (EventKind::Settled, text.to_owned())
            }
        };
        let mut event = Event::new(kind).material(material).text(text);
        if let Some(holder) = &judged.holder {
            event = event.worker(&holder.name).lease(holder.token);
        }
        self.tell(event);
        self.tell_troubles(&judged.changes);
    }

    fn check_completion(&self, completion: &Completion) -> Result<(), FarmError> {
        let (expected, found) = (self.specification.views.len(), completion.views.len());
        if found != expected {
            return Err(FarmError::Invalid(format!(
                "a material has {expected} views, and {found} were reported"
            )));
        }
        let mut numbers = completion.views.iter().flat_map(|view| {
            let statistics = &view.statistics;
            [
                statistics.mean,
                statistics.p95,
                statistics.max,
                statistics.within_target,
            ]
        });
        let sane = |number: f64| number.is_finite() && number >= 0.0;
        if !sane(completion.seconds) || !numbers.all(sane) {
            return Err(FarmError::Invalid(
                "a time or an error statistic is negative or not finite".to_owned(),
            ));
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
    acceptance::check_identity(&image.header, expected)
}

//! Recording completions.

use super::{Farm, FarmError};
use crate::{
    acceptance::{self, Rejection},
    commit::{Pending, Transition},
    completion::Completion,
    ledger::BlobPlace,
    queue::Standing,
    staging::StagedImage,
    token::Token,
};
use dataset::{Digest, ImageHeader};

/// What became of a completion.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum Outcome {
    Recorded,
    Repeated,
    Missing(Vec<Digest>),
}

impl Farm {
    /// Records a completion, durably, if its token is the current lease's and every image is here
    /// and is what it should be. Who rendered it is filled in here.
    pub async fn complete(
        &self,
        token: Token,
        completion: Completion,
    ) -> Result<Outcome, FarmError> {
        self.check_completion(&completion)?;
        let unstaged = self.unstaged_images(token, &completion)?;
        let stored = self.stored(unstaged).await?;
        let (outcome, pending) = self.record(token, completion, &stored)?;
        pending.durable().await?;
        Ok(outcome)
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

    /// The transition itself, all under one lock. Even where nothing is recorded something is
    /// submitted: the first of two equal completions may still be on its way to the disk, and the
    /// second has to wait for it.
    fn record(
        &self,
        token: Token,
        mut completion: Completion,
        stored: &[(Digest, Option<BlobPlace>)],
    ) -> Result<(Outcome, Pending), FarmError> {
        let material = completion.material;
        let fingerprint = completion.fingerprint();
        let headers =
            acceptance::expected_headers(&self.specification, self.specification_hash, material);
        let mut state = self.shared.lock();
        let nothing = || self.committer.submit(Transition::default());
        if state.queue.standing(material, token, fingerprint)? == Standing::Repeated {
            return Ok((Outcome::Repeated, nothing()));
        }
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
            return Ok((Outcome::Missing(missing), nothing()));
        }
        if let Some(worker) = state.queue.holder(material) {
            completion.worker = state.roster.name(worker);
        }
        let now = self.shared.now();
        let change = state.queue.complete(material, token, fingerprint, now)?;
        state.bytes_received += completion.bytes();
        let images = completion
            .views
            .iter()
            .filter_map(|view| state.staging.begin_publishing(&view.digest))
            .collect();
        self.after_change(&state);
        let pending = self.committer.submit(Transition {
            changes: change.into_iter().collect(),
            completion: Some(completion),
            images,
        });
        Ok((Outcome::Recorded, pending))
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

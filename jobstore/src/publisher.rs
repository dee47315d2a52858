//! Gives staged images their names, durably, before the completion that names them is recorded.
//!
//! One order, whatever keeps the jobs: images get their names, then their completion is recorded.
//! So a record names no image that a power loss can take, and a transaction waits for no image's
//! sync. What is published and never recorded is garbage.

use crate::{JobStoreContext, Meter};
use imagestore::{FileError, blobs::StagedFile};
use jobqueue::Completion;
use std::{io, panic, sync::Arc};
use thiserror::Error;
use tokio::{
    sync::{mpsc, oneshot},
    task,
    time::{Instant, sleep_until},
};

/// Why images did not get their names.
#[derive(Debug, Error)]
pub enum PublishError {
    /// A staged file is not there any more: the images are to be sent again.
    #[error("a staged image is gone: {0}")]
    Gone(FileError),
    /// The system would not do it now.
    #[error(transparent)]
    File(FileError),
    /// The coordinator is stopping.
    #[error("the coordinator is stopping")]
    Stopped,
}

type Answer = Result<(), PublishError>;

struct Request {
    files: Vec<StagedFile>,
    answer: oneshot::Sender<Answer>,
}

/// The address of whoever publishes images.
pub struct Publisher {
    context: Arc<JobStoreContext>,
    requests: mpsc::UnboundedSender<Request>,
}

impl Publisher {
    /// A publisher, and the task that does its work until the publisher is dropped.
    pub fn new(
        context: Arc<JobStoreContext>,
        meter: Arc<dyn Meter>,
    ) -> (Self, impl Future<Output = ()> + Send + 'static) {
        let (requests, waiting) = mpsc::unbounded_channel();
        let task = run(Arc::clone(&context), meter, waiting);
        (Self { context, requests }, task)
    }

    /// Gives the staged images of a completion their names; returns when that is durable. An error
    /// is this completion's own.
    ///
    /// # Errors
    /// When one of them is gone, or the disk fails.
    pub async fn publish(&self, completion: &Completion) -> Answer {
        let files = self.context.staging().begin_publishing(completion);
        if files.is_empty() {
            return Ok(());
        }
        let (answer, answered) = oneshot::channel();
        let sent = self.requests.send(Request { files, answer });
        sent.map_err(|_| PublishError::Stopped)?;
        answered.await.map_err(|_| PublishError::Stopped)?
    }
}

async fn run(
    context: Arc<JobStoreContext>,
    meter: Arc<dyn Meter>,
    mut waiting: mpsc::UnboundedReceiver<Request>,
) {
    let most = limits::COMMIT_BATCH_MAX;
    let mut batch = Vec::new();
    while waiting.recv_many(&mut batch, most).await > 0 {
        let began = Instant::now();
        let (groups, answers): (Vec<_>, Vec<_>) = batch
            .drain(..)
            .map(|request| (request.files, request.answer))
            .unzip();
        let around = Arc::clone(&context);
        let published = task::spawn_blocking(move || publish(&around, &groups)).await;
        let published = match published {
            Ok(published) => published,
            Err(error) if error.is_panic() => panic::resume_unwind(error.into_panic()),
            Err(_) => return,
        };
        meter.note_publication(began.elapsed());
        for (answer, published) in answers.into_iter().zip(published) {
            // Whoever asked may have gone; the images have their names.
            let _ = answer.send(published);
        }
        // As for transitions: batches of a few cost nearly as much as those of many.
        sleep_until(began + limits::COMMIT_INTERVAL).await;
    }
}

/// Publishes the images of several completions; each has an answer of its own.
fn publish(context: &JobStoreContext, groups: &[Vec<StagedFile>]) -> Vec<Answer> {
    let published = match context.blobs.publish_each(groups) {
        Ok(published) => published,
        Err(error) => {
            // After a failed sync nobody knows what is on the disk, and the next one that succeeds
            // says nothing of these: they are to be sent again.
            for files in groups {
                context.drop_staged(files);
            }
            let again = |_| Err(PublishError::File(error.repeat()));
            return groups.iter().map(again).collect();
        }
    };
    let answers = groups.iter().zip(published);
    answers
        .map(|(files, published)| match published {
            Ok(()) => {
                context.staging().published(files);
                Ok(())
            }
            Err(error) if error.source.kind() == io::ErrorKind::NotFound => {
                context.drop_staged(files);
                Err(PublishError::Gone(error))
            }
            Err(error) => {
                let surplus = context.staging().not_published(files);
                surplus.iter().for_each(|file| context.blobs.discard(file));
                Err(PublishError::File(error))
            }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use dataset::{Digest, Specification};
    use imagestore::{
        blobs::Blobs,
        staging::{Holder, LeaseOf, Sender},
        validation,
    };
    use jobqueue::token::Token;
    use std::{fs, time::Duration};

    /// Stages an image of this material's, and completes it with that one view.
    fn staged(context: &JobStoreContext, material: u32) -> Completion {
        let specification = Specification::preset();
        let hash = specification.hash();
        let headers = validation::expected_headers(&specification, hash, material);
        let bytes = material.to_be_bytes();
        let completion = Completion::sample(material, &bytes);
        let digest = Digest::of(&bytes);
        let file = context.blobs.stage(digest, &bytes).unwrap();
        let lease = LeaseOf {
            material,
            token: Token::from_bytes([1; 16]),
        };
        let sender = Sender {
            lease,
            holder: Holder {
                credential: None,
                worker: None,
            },
        };
        let now = Duration::ZERO;
        let mut staging = context.staging();
        assert!(staging.reserve(sender, 4, now));
        let inserted = staging.insert(lease, file, 4, headers[0].clone(), now);
        assert!(inserted.counts && inserted.surplus.is_empty());
        completion
    }

    #[tokio::test]
    async fn a_missing_file_is_its_own_completions_error() {
        let folder = tempfile::tempdir().unwrap();
        let blobs = Blobs::new(folder.path());
        blobs.prepare().unwrap();
        let context = Arc::new(JobStoreContext::new(blobs.clone(), |_, _| {}));
        let (publisher, task) = Publisher::new(Arc::clone(&context), Arc::new(()));
        let task = tokio::spawn(task);
        let good = staged(&context, 1);
        let bad = staged(&context, 2);
        let mut paths: Vec<_> = fs::read_dir(folder.path().join("staging"))
            .unwrap()
            .map(|entry| entry.unwrap().path())
            .collect();
        paths.sort();
        fs::remove_file(&paths[1]).unwrap();
        let (one, two) = tokio::join!(publisher.publish(&good), publisher.publish(&bad));
        one.unwrap();
        assert!(matches!(two, Err(PublishError::Gone(_))), "{two:?}");
        assert_eq!(blobs.size(&good.views[0].digest).unwrap(), Some(4));
        // Who asks now is told that it is missing, and sends it again.
        assert!(!context.staging().contains(&bad.views[0].digest));
        assert!(context.staging().contains(&good.views[0].digest));
        let again = staged(&context, 2);
        publisher.publish(&again).await.unwrap();
        publisher.publish(&again).await.expect("nothing to do");
        drop(publisher);
        task.await.unwrap();
    }

    #[tokio::test]
    async fn images_that_cannot_get_their_names_now_stay_staged() {
        let folder = tempfile::tempdir().unwrap();
        let blobs = Blobs::new(folder.path());
        blobs.prepare().unwrap();
        let context = Arc::new(JobStoreContext::new(blobs.clone(), |_, _| {}));
        let (publisher, task) = Publisher::new(Arc::clone(&context), Arc::new(()));
        tokio::spawn(task);
        let completion = staged(&context, 3);
        // A file where the image's folder has to be.
        let digest = completion.views[0].digest;
        let place = blobs.path(&digest).parent().unwrap().to_owned();
        fs::write(&place, "in the way").unwrap();
        let error = publisher.publish(&completion).await.unwrap_err();
        assert!(matches!(error, PublishError::File(_)), "{error:?}");
        fs::remove_file(&place).unwrap();
        publisher.publish(&completion).await.unwrap();
        assert_eq!(blobs.size(&digest).unwrap(), Some(4));
    }
}

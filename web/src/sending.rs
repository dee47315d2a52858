//! Answers on their way out: readers take them as slowly as they like, so the memory of all answers
//! under way is bounded.

use crate::problem::Problem;
use axum::body::Body;
use bytes::Bytes;
use futures_util::stream;
use limits::web::SENDING_BYTES_MAX;
use std::{convert::Infallible, sync::Arc};
use tokio::sync::Semaphore;

/// Bytes that are counted together.
const UNIT: usize = 4096;

/// What is handed to a connection at one time.
const PIECE: usize = 64 << 10;

/// Room for answers under way.
pub struct Sending(Arc<Semaphore>);

impl Default for Sending {
    fn default() -> Self {
        Self(Arc::new(Semaphore::new(SENDING_BYTES_MAX / UNIT)))
    }
}

impl Sending {
    /// The body of an answer, which has its room until its last piece is handed to the connection.
    ///
    /// # Errors
    /// When too much is under way.
    pub fn body(&self, bytes: impl Into<Bytes>) -> Result<Body, Problem> {
        let bytes = bytes.into();
        let units = u32::try_from(bytes.len().div_ceil(UNIT)).unwrap_or(u32::MAX);
        let room = Arc::clone(&self.0).try_acquire_many_owned(units);
        let room = room.map_err(|_| Problem::busy("too many answers are under way"))?;
        let pieces = stream::unfold((bytes, room), |(mut left, room)| async move {
            if left.is_empty() {
                return None;
            }
            let piece = left.split_to(PIECE.min(left.len()));
            Some((Ok::<_, Infallible>(piece), (left, room)))
        });
        Ok(Body::from_stream(pieces))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn room_comes_back_when_an_answer_is_sent_or_given_up() {
        let sending = Sending::default();
        let half = || Bytes::from(vec![7; SENDING_BYTES_MAX / 2]);
        let (first, second) = (sending.body(half()).unwrap(), sending.body(half()).unwrap());
        assert!(sending.body(vec![0]).is_err());
        let sent = axum::body::to_bytes(first, usize::MAX).await.unwrap();
        assert_eq!(sent, half());
        drop(second);
        let whole = sending.body(vec![0; SENDING_BYTES_MAX]);
        assert!(whole.is_ok() && sending.body(vec![0]).is_err());
    }
}

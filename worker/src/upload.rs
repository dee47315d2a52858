//! Images straight to a bucket, to URLs that the coordinator signed.

use crate::connection::pause;
use bytes::Bytes;
use proto::UploadUrl;
use reqwest::{Client, StatusCode, redirect::Policy};
use std::sync::OnceLock;
use thiserror::Error;
use tokio::time::sleep;

/// Why an image is not in the bucket. Says nothing of the URL: whoever has it may write.
#[derive(Debug, Error)]
pub(crate) enum UploadError {
    /// The bucket says no to this URL, as when it came too late: another may do.
    #[error("the bucket refuses an upload: {0}")]
    Refused(StatusCode),
    /// The bucket cannot be reached, or cannot take anything now.
    #[error("the bucket does not take an upload: {0}")]
    Away(String),
}

/// Sends images to URLs. The client is made when the first one is sent: most farms have no bucket.
#[derive(Default)]
pub(crate) struct Uploader {
    client: OnceLock<Client>,
}

impl Uploader {
    /// Sends an image, again and again for a while where that can help.
    pub async fn put(&self, to: &UploadUrl, image: Bytes) -> Result<(), UploadError> {
        let mut attempt = 0;
        loop {
            let failure = match self.put_once(to, image.clone()).await {
                Ok(()) => return Ok(()),
                Err(failure @ UploadError::Refused(_)) => return Err(failure),
                Err(failure) => failure,
            };
            if attempt + 1 == limits::worker::UPLOAD_ATTEMPTS {
                return Err(failure);
            }
            sleep(pause(attempt)).await;
            attempt += 1;
        }
    }

    async fn put_once(&self, to: &UploadUrl, image: Bytes) -> Result<(), UploadError> {
        let mut request = self.client()?.put(&to.url).body(image);
        for header in &to.headers {
            request = request.header(&header.name, &header.value);
        }
        let response = request.send().await.map_err(away)?;
        let status = response.status();
        // The answer's text is left alone: it may quote the signature.
        match status {
            _ if status.is_success() => Ok(()),
            // Bytes that were damaged on their way are a bad request too.
            StatusCode::BAD_REQUEST
            | StatusCode::REQUEST_TIMEOUT
            | StatusCode::CONFLICT
            | StatusCode::TOO_MANY_REQUESTS => Err(UploadError::Away(status.to_string())),
            _ if status.is_server_error() => Err(UploadError::Away(status.to_string())),
            _ => Err(UploadError::Refused(status)),
        }
    }

    fn client(&self) -> Result<&Client, UploadError> {
        if let Some(client) = self.client.get() {
            return Ok(client);
        }
        // reqwest comes without cryptography, so that the program has ring's alone; whoever was
        // first to choose stays.
        let _ = rustls::crypto::ring::default_provider().install_default();
        let client = Client::builder()
            .connect_timeout(limits::protocol::CONNECT_DEADLINE)
            .timeout(limits::worker::UPLOAD_DEADLINE)
            .pool_idle_timeout(limits::worker::UPLOAD_CONNECTION_IDLE_MAX)
            .redirect(Policy::none())
            .build()
            .map_err(away)?;
        Ok(self.client.get_or_init(|| client))
    }
}

fn away(error: reqwest::Error) -> UploadError {
    let error = error.without_url();
    let mut text = error.to_string();
    let mut cause = std::error::Error::source(&error);
    while let Some(error) = cause {
        text = error.to_string();
        cause = error.source();
    }
    UploadError::Away(text)
}

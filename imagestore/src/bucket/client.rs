//! The clients of the three services.

use super::{
    UploadUrl,
    url::{BucketUrl, Service},
};
use base64::{Engine, prelude::BASE64_STANDARD};
use http::{HeaderValue, Method, header::HeaderName};
use object_store::{
    BackoffConfig, Error, ObjectStore, RetryConfig,
    aws::{AmazonS3Builder, Checksum},
    azure::MicrosoftAzureBuilder,
    gcp::GoogleCloudStorageBuilder,
    path::Path,
    signer::{SignedUrlOptions, Signer},
};
use std::{io, sync::Arc, time::Duration};

/// One client, as what stores and as what signs.
#[derive(Clone)]
pub(super) struct Client {
    service: Service,
    store: Arc<dyn ObjectStore>,
    signer: Arc<dyn Signer>,
}

impl Client {
    /// The client of a bucket, with what the environment says of keys and endpoints.
    pub(super) fn open(url: &BucketUrl) -> io::Result<Self> {
        // reqwest comes without cryptography, so that the program has ring's alone; whoever was
        // first to choose stays.
        let _ = rustls::crypto::ring::default_provider().install_default();
        let bucket = url.bucket_url();
        let (store, signer) = match url.service {
            Service::S3 => both(
                AmazonS3Builder::from_env()
                    .with_url(bucket)
                    .with_retry(retry())
                    .with_checksum_algorithm(Checksum::SHA256)
                    .build(),
            ),
            Service::Gcs => both(
                GoogleCloudStorageBuilder::from_env()
                    .with_url(bucket)
                    .with_retry(retry())
                    .build(),
            ),
            Service::Azure => both(
                MicrosoftAzureBuilder::from_env()
                    .with_url(bucket)
                    .with_retry(retry())
                    .build(),
            ),
        }?;
        Ok(Self {
            service: url.service,
            store,
            signer,
        })
    }

    /// What reads and writes.
    pub(super) fn store(&self) -> &dyn ObjectStore {
        &*self.store
    }

    /// Lets whoever has the answer write one object, for so long.
    pub(super) async fn upload_url(
        &self,
        path: &Path,
        md5: [u8; 16],
        valid: Duration,
    ) -> Result<UploadUrl, Error> {
        let md5 = BASE64_STANDARD.encode(md5);
        let mut headers = vec![("content-md5".to_owned(), md5.clone())];
        let signed = if self.service == Service::Azure {
            headers.push(("x-ms-blob-type".to_owned(), "BlockBlob".to_owned()));
            self.signer.signed_url(Method::PUT, path, valid).await
        } else {
            let name = HeaderName::from_static("content-md5");
            let Ok(value) = HeaderValue::from_str(&md5) else {
                unreachable!("base64 is plain text");
            };
            let options = SignedUrlOptions::new().with_signed_header(name, value);
            let signed = self
                .signer
                .signed_url_opts(Method::PUT, path, valid, &options);
            signed.await
        };
        Ok(UploadUrl {
            url: signed?.into(),
            headers,
        })
    }
}

type Both = (Arc<dyn ObjectStore>, Arc<dyn Signer>);

fn both<S: ObjectStore + Signer>(built: Result<S, Error>) -> Result<Both, Error> {
    let store = Arc::new(built?);
    Ok((Arc::clone(&store) as _, store))
}

fn retry() -> RetryConfig {
    RetryConfig {
        backoff: BackoffConfig {
            max_backoff: limits::BUCKET_BACKOFF_MAX,
            ..BackoffConfig::default()
        },
        max_retries: limits::BUCKET_RETRIES_MAX,
        retry_timeout: limits::BUCKET_RETRY_MAX,
    }
}

//! What names a bucket.

use object_store::path::Path;
use serde::{Deserialize, Serialize};
use std::{fmt, str::FromStr};
use url::Url;

/// A place in a bucket, such as `s3://bucket/prefix`. Has no slash at its end, and carries neither
/// names nor keys of anybody: those come from the environment.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct BucketUrl {
    pub(super) service: Service,
    pub(super) bucket: String,
    pub(super) prefix: Path,
}

/// Whose bucket it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Service {
    S3,
    Gcs,
    Azure,
}

impl BucketUrl {
    /// Whether a text is meant to name a bucket rather than a folder.
    pub fn is_meant(text: &str) -> bool {
        text.contains("://")
    }

    /// The URL of the bucket itself.
    pub(super) fn bucket_url(&self) -> String {
        format!("{}://{}", self.service.scheme(), self.bucket)
    }
}

impl Service {
    fn scheme(self) -> &'static str {
        match self {
            Self::S3 => "s3",
            Self::Gcs => "gs",
            Self::Azure => "az",
        }
    }
}

impl FromStr for BucketUrl {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || {
            "a bucket is named as s3://BUCKET/PREFIX, gs://BUCKET/PREFIX or az://CONTAINER/PREFIX, \
             without names, keys or queries"
                .to_owned()
        };
        if text.len() > limits::BUCKET_URL_BYTES_MAX {
            return Err(wrong());
        }
        let url = Url::parse(text).map_err(|_| wrong())?;
        let service = match url.scheme() {
            "s3" => Service::S3,
            "gs" => Service::Gcs,
            "az" => Service::Azure,
            _ => return Err(wrong()),
        };
        let plain = url.username().is_empty()
            && url.password().is_none()
            && url.port().is_none()
            && url.query().is_none()
            && url.fragment().is_none();
        let bucket = url.host_str().unwrap_or_default();
        if !plain || bucket.is_empty() {
            return Err(wrong());
        }
        let prefix = Path::from_url_path(url.path()).map_err(|_| wrong())?;
        Ok(Self {
            service,
            bucket: bucket.to_owned(),
            prefix,
        })
    }
}

impl fmt::Display for BucketUrl {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.bucket_url())?;
        if self.prefix.is_root() {
            return Ok(());
        }
        write!(f, "/{}", self.prefix)
    }
}

impl TryFrom<String> for BucketUrl {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        text.parse()
    }
}

impl From<BucketUrl> for String {
    fn from(url: BucketUrl) -> Self {
        url.to_string()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bucket_is_named_in_one_way_and_without_secrets() {
        for (text, kept) in [
            ("s3://bucket", "s3://bucket"),
            ("s3://bucket/", "s3://bucket"),
            ("gs://bucket/a/b/", "gs://bucket/a/b"),
            ("az://container/a", "az://container/a"),
        ] {
            assert_eq!(text.parse::<BucketUrl>().unwrap().to_string(), kept);
        }
        for text in [
            "",
            "bucket",
            "s3:bucket",
            "s3:///a",
            "file:///etc",
            "https://bucket.example/a",
            "s3://key:secret@bucket/a",
            "s3://key@bucket/a",
            "s3://bucket/a?b=c",
            "s3://bucket/a#b",
            "s3://bucket/a//b",
            &format!("s3://bucket/{}", "a".repeat(2000)),
        ] {
            assert!(text.parse::<BucketUrl>().is_err(), "{text}");
        }
    }
}

//! The clients of a program that was built without buckets: there are none.

use super::{UploadUrl, url::BucketUrl};
use object_store::{Error, ObjectStore, path::Path};
use std::{convert::Infallible, io, time::Duration};

/// A client that cannot exist.
#[derive(Clone)]
pub(super) struct Client(Infallible);

impl Client {
    /// Says how to get a program that has clients.
    pub(super) fn open(_: &BucketUrl) -> io::Result<Self> {
        let reason = "this program was built without buckets: build it with `--features cluster`, \
                      or take the Python package or the container, which have them";
        Err(io::Error::new(io::ErrorKind::Unsupported, reason))
    }

    pub(super) fn store(&self) -> &dyn ObjectStore {
        match self.0 {}
    }

    pub(super) async fn upload_url(
        &self,
        _: &Path,
        _: [u8; 16],
        _: Duration,
    ) -> Result<UploadUrl, Error> {
        match self.0 {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bucket_without_a_client_is_refused_with_a_way_out() {
        let url: BucketUrl = "s3://bucket/prefix".parse().unwrap();
        let refusal = Client::open(&url).err().unwrap();
        assert_eq!(refusal.kind(), io::ErrorKind::Unsupported);
        assert!(refusal.to_string().contains("--features cluster"));
    }
}

//! Images as objects in a bucket.
//!
//! ```text
//! store.json                       whose place this is: one store's, no other's
//! blobs/ab/<64 digits>.exr         images of completed materials
//! staging/<32 digits>/<64>.exr     uploads of one lease, until its material is complete
//! ```
//!
//! A write or a copy that the server has answered is durable; there is nothing to sync.

use super::{Entry, Name};
use crate::{
    FileError,
    bucket::{Bucket, Object},
};
use dataset::{Digest, blob_path};
use futures_util::{StreamExt, TryStreamExt, stream};
use md5::{Digest as _, Md5};
use serde::{Deserialize, Serialize};
use std::{
    io,
    path::PathBuf,
    sync::{Arc, OnceLock},
};

/// The object that says whose place it is.
const OWNER_KEY: &str = "store.json";

/// The folder of uploads.
const STAGING: &str = "staging";

/// The images of a store that keeps them in a bucket.
#[derive(Clone, Debug)]
pub struct Objects {
    bucket: Bucket,
    // Known once the place was claimed.
    tags_are_md5: Arc<OnceLock<bool>>,
}

#[derive(Serialize, Deserialize, PartialEq)]
struct Owner {
    store: String,
}

/// Whose a place in a bucket is.
#[derive(Debug, PartialEq, Eq)]
pub enum Claimed {
    /// This store's, now or since it was made.
    Ours,
    /// Another store's, or full of other things.
    Others,
}

impl Objects {
    pub(super) fn new(bucket: Bucket) -> Self {
        Self {
            bucket,
            tags_are_md5: Arc::default(),
        }
    }

    /// The place in the bucket.
    pub fn bucket(&self) -> &Bucket {
        &self.bucket
    }

    /// Makes sure that the place is this store's, `owner`: it says so, or is empty and is told so.
    /// Two stores that claim one place at the same instant both write, one is read back, and the
    /// other is refused at once or when it is opened next.
    ///
    /// The server's answer also shows whether it names content by MD5, as most do unless they
    /// encrypt with keys of their own.
    pub(super) fn claim(&self, owner: &str) -> Result<Claimed, FileError> {
        let ours = Owner {
            store: owner.to_owned(),
        };
        let Ok(text) = serde_json::to_vec(&ours) else {
            unreachable!("a string is JSON");
        };
        self.bucket.block_on(async {
            let mut found = self.bucket.head(OWNER_KEY).await?;
            if found.is_none() {
                if self.bucket.first().await?.is_none() {
                    self.bucket.write(OWNER_KEY, text.clone()).await?;
                }
                // What the listing showed may be the claim of another coordinator of this store,
                // which was started at the same instant.
                found = self.bucket.head(OWNER_KEY).await?;
            }
            if found.is_none() {
                return Ok(Claimed::Others);
            }
            let there = self
                .bucket
                .read(OWNER_KEY, limits::BUCKET_OWNER_BYTES_MAX)
                .await?;
            if serde_json::from_slice(&there).ok().as_ref() != Some(&ours) {
                return Ok(Claimed::Others);
            }
            let tag = found.and_then(|object| object.tag);
            let is_md5 = tag.and_then(|tag| md5_of_tag(&tag)) == Some(md5(&there));
            self.tags_are_md5.get_or_init(|| is_md5);
            Ok(Claimed::Ours)
        })
    }

    /// The MD5 of an object's content by the server's own count, where it tells.
    pub fn md5_by_server(&self, object: &Object) -> Option<[u8; 16]> {
        let tell = self.tags_are_md5.get().copied().unwrap_or(false);
        object.tag.as_deref().filter(|_| tell).and_then(md5_of_tag)
    }

    pub(super) fn path(&self, digest: &Digest) -> PathBuf {
        self.bucket.place(&blob_path(digest))
    }

    pub(super) fn sizes(&self, digests: &[Digest]) -> Result<Vec<Option<u64>>, FileError> {
        let heads = digests.iter().map(|digest| async move {
            let object = self.bucket.head(&blob_path(digest)).await?;
            Ok(object.map(|object| object.bytes))
        });
        let heads = stream::iter(heads).buffered(limits::BUCKET_REQUESTS_AT_ONCE);
        self.bucket.block_on(heads.try_collect())
    }

    pub(super) fn read(&self, images: &[(Digest, u64)]) -> Vec<Result<Vec<u8>, FileError>> {
        let keys = images
            .iter()
            .map(|(digest, bytes)| (blob_path(digest), *bytes));
        self.bucket.block_on(self.bucket.read_each(keys.collect()))
    }

    pub(super) fn put(&self, images: &[(Digest, Vec<u8>)]) -> Result<(), FileError> {
        let writes = images.iter().map(|(digest, bytes)| async move {
            let key = blob_path(digest);
            self.bucket.write(&key, bytes.clone()).await.map(|_| ())
        });
        let writes = stream::iter(writes).buffer_unordered(limits::BUCKET_REQUESTS_AT_ONCE);
        self.bucket.block_on(writes.try_collect())
    }

    pub(super) fn for_each(&self, look: &mut dyn FnMut(Entry)) -> Result<(), FileError> {
        self.bucket.block_on(async {
            for folder in ["blobs", STAGING] {
                let told = self.bucket.for_each(folder, |object| {
                    let name = match image_of_key(&object.key) {
                        _ if folder == STAGING => Name::Upload,
                        Some(digest) => Name::Image(digest),
                        None => Name::Other,
                    };
                    look(Entry {
                        path: self.bucket.place(&object.key),
                        bytes: object.bytes,
                        name,
                    });
                });
                told.await?;
            }
            Ok(())
        })
    }

    pub(super) fn remove(&self, paths: &[PathBuf]) -> Result<(), FileError> {
        let keys = paths.iter().map(|path| {
            let foreign = || io::Error::other("it is not in this bucket");
            let key = self.bucket.key(path);
            key.ok_or_else(|| FileError::new("remove", path)(foreign()))
        });
        let keys: Vec<String> = keys.collect::<Result<_, _>>()?;
        self.bucket.block_on(self.bucket.remove(keys))
    }
}

/// Where the uploads of a lease go, given what names it there.
pub fn staging_key(lease: &str, digest: &Digest) -> String {
    format!("{STAGING}/{lease}/{digest}.exr")
}

fn md5(bytes: &[u8]) -> [u8; 16] {
    Md5::digest(bytes).into()
}

fn image_of_key(key: &str) -> Option<Digest> {
    let digest = key.rsplit('/').next()?.strip_suffix(".exr")?.parse().ok()?;
    (blob_path(&digest) == key).then_some(digest)
}

/// An entity tag of 32 hex digits in quotes as the bytes that they are.
fn md5_of_tag(tag: &str) -> Option<[u8; 16]> {
    let hex = tag.strip_prefix('"')?.strip_suffix('"')?;
    if hex.len() != 32 || !hex.is_ascii() {
        return None;
    }
    let mut bytes = [0; 16];
    for (byte, digits) in bytes.iter_mut().zip(hex.as_bytes().chunks_exact(2)) {
        let digits = std::str::from_utf8(digits).ok()?;
        *byte = u8::from_str_radix(digits, 16).ok()?;
    }
    Some(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tags_and_keys_are_read_only_in_their_one_form() {
        let bytes = md5(b"a");
        let hex: String = bytes.iter().map(|byte| format!("{byte:02x}")).collect();
        assert_eq!(md5_of_tag(&format!("\"{hex}\"")), Some(bytes));
        for tag in [
            "",
            "\"\"",
            &hex,
            &format!("\"{hex}-2\""),
            &format!("W/\"{hex}\""),
        ] {
            assert_eq!(md5_of_tag(tag), None, "{tag}");
        }
        let digest = Digest::of(b"a");
        assert_eq!(image_of_key(&blob_path(&digest)), Some(digest));
        for key in [
            format!("blobs/{digest}.exr"),
            format!("x/{}", blob_path(&digest)),
        ] {
            assert_eq!(image_of_key(&key), None, "{key}");
        }
    }
}

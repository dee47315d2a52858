//! A place in a bucket of S3, Google Cloud Storage or Azure, through the crate `object_store`.
//!
//! The crate is asynchronous, and most of the store's callers are not: the command's own threads,
//! those that verify, the blocking pool. The seam is here. Whatever is done with a bucket is done
//! on one small runtime of this process, made with the first bucket and never dropped:
//! [`Bucket::block_on`] for threads that may block, [`Bucket::run`] for asynchronous callers. So
//! nobody has to hand a runtime down, connections outlive the runtime of whoever asked first, and a
//! `Bucket` can be dropped anywhere.
//!
//! Architecture invariant: nothing here depends on a conditional write, which some servers race.

#[cfg(feature = "buckets")]
mod client;
#[cfg(any(test, not(feature = "buckets")))]
#[cfg_attr(
    feature = "buckets",
    allow(dead_code, reason = "its test is all that runs of it")
)]
mod no_client;
mod object;
mod url;

pub use object::{ObjectReader, ObjectWriter};
pub use url::BucketUrl;

use crate::FileError;
#[cfg(feature = "buckets")]
use client::Client;
use futures_util::{StreamExt, TryStreamExt, stream};
#[cfg(not(feature = "buckets"))]
use no_client::Client;
use object_store::{Error, ObjectStoreExt, path::Path};
use std::{
    fmt, io,
    path::PathBuf,
    sync::{Mutex, PoisonError},
    time::Duration,
};
use tokio::runtime::{self, Runtime};

static IO: Mutex<Option<&'static Runtime>> = Mutex::new(None);

/// A place in a bucket. Cheap to clone.
#[derive(Clone)]
pub struct Bucket {
    url: BucketUrl,
    client: Client,
    runtime: &'static Runtime,
}

/// An object, as the server has it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Object {
    /// Its key, relative to the place.
    pub key: String,
    /// Its size.
    pub bytes: u64,
    /// What the server calls its content; on most the MD5 of what was sent at one time, in hex
    /// digits and quotes.
    pub tag: Option<String>,
}

/// Permission to write one object with one content, for a while. Whoever has it needs no other:
/// it is never logged.
#[derive(Clone, PartialEq, Eq)]
pub struct UploadUrl {
    /// Where to PUT the bytes.
    pub url: String,
    /// Headers that have to be sent with them, as they are.
    pub headers: Vec<(String, String)>,
}

impl fmt::Debug for UploadUrl {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("UploadUrl { .. }")
    }
}

impl fmt::Debug for Bucket {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Bucket({})", self.url)
    }
}

impl Bucket {
    /// The place that a URL names. Keys and endpoints come from the environment, as the crate
    /// `object_store` and the vendors' own tools read it (`AWS_ACCESS_KEY_ID`, `AWS_ENDPOINT_URL`,
    /// `AWS_ALLOW_HTTP`, `GOOGLE_APPLICATION_CREDENTIALS`, `AZURE_STORAGE_ACCOUNT_NAME`, ...). Asks
    /// nobody yet.
    ///
    /// # Errors
    /// When the environment makes no sense, and where the program was built without buckets.
    pub fn open(url: &BucketUrl) -> Result<Self, FileError> {
        let runtime = io_runtime().map_err(unable_io("start the threads for", url, ""))?;
        // Some clients look at the runtime while they are made.
        let _entered = runtime.enter();
        let client = Client::open(url).map_err(unable_io("use", url, ""))?;
        Ok(Self {
            url: url.clone(),
            client,
            runtime,
        })
    }

    /// What names it.
    pub fn url(&self) -> &BucketUrl {
        &self.url
    }

    /// Where an object is or would be, for people.
    pub fn place(&self, key: &str) -> PathBuf {
        place(&self.url, key)
    }

    /// The key of an object, given where it is.
    pub fn key(&self, place: &std::path::Path) -> Option<String> {
        let below = place.to_str()?.strip_prefix(&self.url.to_string())?;
        Some(below.strip_prefix('/')?.to_owned())
    }

    /// Waits for something that is done with this bucket. Only from threads that may block: inside
    /// a runtime this panics.
    pub fn block_on<F: Future>(&self, work: F) -> F::Output {
        self.runtime.block_on(work)
    }

    /// The same for asynchronous callers.
    ///
    /// # Errors
    /// When the work panicked.
    pub async fn run<F>(&self, work: F) -> Result<F::Output, tokio::task::JoinError>
    where
        F: Future + Send + 'static,
        F::Output: Send,
    {
        self.runtime.spawn(work).await
    }

    /// What is known of an object; `None` where it is missing.
    pub async fn head(&self, key: &str) -> Result<Option<Object>, FileError> {
        match self.client.store().head(&self.path(key)).await {
            Ok(meta) => Ok(Some(Object {
                key: key.to_owned(),
                bytes: meta.size,
                tag: meta.e_tag,
            })),
            Err(Error::NotFound { .. }) => Ok(None),
            Err(error) => Err(unable("look at", &self.url, key)(error)),
        }
    }

    /// Reads an object that should have `bytes` bytes, and at most one more: an object that grew
    /// shows, and costs no memory.
    pub async fn read(&self, key: &str, bytes: u64) -> Result<Vec<u8>, FileError> {
        let failed = |error| unable("read", &self.url, key)(error);
        let found = self
            .client
            .store()
            .get(&self.path(key))
            .await
            .map_err(failed)?;
        let bytes_max = usize::try_from(bytes)
            .unwrap_or(usize::MAX)
            .saturating_add(1);
        let mut content = Vec::with_capacity(found.meta.size.min(bytes + 1) as usize);
        let mut parts = found.into_stream();
        while let Some(part) = parts.try_next().await.map_err(failed)? {
            let room = bytes_max - content.len();
            content.extend_from_slice(&part[..part.len().min(room)]);
            if content.len() == bytes_max {
                break;
            }
        }
        Ok(content)
    }

    /// Reads objects in the order asked, several at one time.
    pub async fn read_each(&self, objects: Vec<(String, u64)>) -> Vec<Result<Vec<u8>, FileError>> {
        let reads = objects.into_iter();
        let reads = reads.map(|(key, bytes)| async move { self.read(&key, bytes).await });
        let reads = stream::iter(reads).buffered(limits::BUCKET_REQUESTS_AT_ONCE);
        reads.collect().await
    }

    /// Writes a whole object, durably: the server has it when this returns.
    pub async fn write(&self, key: &str, bytes: Vec<u8>) -> Result<Object, FileError> {
        let size = bytes.len() as u64;
        let written = self.client.store().put(&self.path(key), bytes.into()).await;
        let written = written.map_err(unable("write", &self.url, key))?;
        Ok(Object {
            key: key.to_owned(),
            bytes: size,
            tag: written.e_tag,
        })
    }

    /// Has the server copy an object; no byte comes here.
    pub async fn copy(&self, from: &str, to: &str) -> Result<(), FileError> {
        let copied = self
            .client
            .store()
            .copy(&self.path(from), &self.path(to))
            .await;
        copied.map_err(unable("write", &self.url, to))
    }

    /// Removes objects, many with one request where the server can. What is not there is no error.
    pub async fn remove(&self, keys: Vec<String>) -> Result<(), FileError> {
        let paths: Vec<_> = keys.iter().map(|key| Ok(self.path(key))).collect();
        let removed = self
            .client
            .store()
            .delete_stream(stream::iter(paths).boxed());
        let failed = |error| match error {
            Error::NotFound { .. } => Ok(()),
            error => Err(unable("remove objects of", &self.url, "")(error)),
        };
        removed
            .map(|removed| removed.map(|_| ()).or_else(failed))
            .try_for_each(async |()| Ok(()))
            .await
    }

    /// Tells every object whose key is below a folder, page after page, in the order of keys.
    pub async fn for_each(
        &self,
        folder: &str,
        mut look: impl FnMut(Object),
    ) -> Result<(), FileError> {
        let below = self.path(folder);
        let mut objects = self
            .client
            .store()
            .list((!below.is_root()).then_some(&below));
        while let Some(meta) = objects
            .try_next()
            .await
            .map_err(unable("list", &self.url, folder))?
        {
            look(Object {
                key: self.key_of(&meta.location),
                bytes: meta.size,
                tag: meta.e_tag,
            });
        }
        Ok(())
    }

    /// The key of some object that is there, if any is.
    pub async fn first(&self) -> Result<Option<String>, FileError> {
        let root = &self.url.prefix;
        let mut objects = self.client.store().list((!root.is_root()).then_some(root));
        let first = objects.try_next().await;
        let first = first.map_err(unable("list", &self.url, ""))?;
        Ok(first.map(|meta| self.key_of(&meta.location)))
    }

    /// Lets whoever has the answer write one object, once or more often, for so long. S3 and Google
    /// take no bytes but those of this MD5, which the signature covers; Azure checks it where it is
    /// sent.
    pub async fn upload_url(
        &self,
        key: &str,
        md5: [u8; 16],
        valid: Duration,
    ) -> Result<UploadUrl, FileError> {
        let signed = self.client.upload_url(&self.path(key), md5, valid).await;
        signed.map_err(unable("sign an upload to", &self.url, ""))
    }

    fn key_of(&self, path: &Path) -> String {
        let below = path.as_ref().get(self.url.prefix.as_ref().len()..);
        below.unwrap_or_default().trim_start_matches('/').to_owned()
    }

    fn path(&self, key: &str) -> Path {
        let parts = key.split('/').filter(|part| !part.is_empty());
        parts.fold(self.url.prefix.clone(), |path, part| path.join(part))
    }
}

fn io_runtime() -> io::Result<&'static Runtime> {
    let mut io = IO.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(runtime) = *io {
        return Ok(runtime);
    }
    let runtime = runtime::Builder::new_multi_thread()
        .worker_threads(limits::BUCKET_THREADS)
        .thread_name("bucket")
        .enable_all()
        .build()?;
    Ok(*io.insert(Box::leak(Box::new(runtime))))
}

fn place(url: &BucketUrl, key: &str) -> PathBuf {
    match key {
        "" => url.to_string().into(),
        key => format!("{url}/{key}").into(),
    }
}

/// For `map_err`: puts the action and the object to what the server said.
fn unable(
    action: &'static str,
    url: &BucketUrl,
    key: &str,
) -> impl FnOnce(Error) -> FileError + use<> {
    let name = unable_io(action, url, key);
    move |error| name(error.into())
}

fn unable_io(
    action: &'static str,
    url: &BucketUrl,
    key: &str,
) -> impl FnOnce(io::Error) -> FileError + use<> {
    FileError::new(action, &place(url, key))
}

//! Where an import comes from: a folder, or a place in a bucket.

use crate::file::unable;
use bytes::Bytes;
use imagestore::{
    FileError,
    bucket::{Bucket, ObjectReader},
};
use parquet::{
    errors::{ParquetError, Result as ParquetResult},
    file::reader::{ChunkReader, Length},
};
use std::{
    fs::File,
    io::{self, BufReader, Read, Seek, SeekFrom},
    path::{Path, PathBuf},
};

/// Bytes that are asked for at one time of a shard that is read from front to back.
const STREAM_BYTES: u64 = 8 << 20;

/// The same where a Parquet reader looks for the header of a page.
const HEADER_BYTES: u64 = 64 << 10;

/// Where an import comes from.
#[derive(Clone, Debug)]
pub enum Source {
    /// A folder.
    Folder(PathBuf),
    /// A place in a bucket.
    Bucket(Bucket),
}

/// A shard that is there.
#[derive(Debug)]
pub(super) enum Shard {
    File(PathBuf, File),
    Object(Bucket, String, u64),
}

impl From<&Path> for Source {
    fn from(folder: &Path) -> Self {
        Self::Folder(folder.to_owned())
    }
}

impl Source {
    /// Where a file of it is, for people.
    pub fn path(&self, file: &Path) -> PathBuf {
        match self {
            Self::Folder(folder) => folder.join(file),
            Self::Bucket(bucket) => bucket.place(&key(file)),
        }
    }

    /// Has a file of it as a file of this machine: a bucket's is fetched into `scratch`.
    ///
    /// # Errors
    /// When it is not there, or cannot be written.
    pub fn fetch(&self, file: &Path, scratch: &Path) -> Result<PathBuf, FileError> {
        match self {
            Self::Folder(folder) => Ok(folder.join(file)),
            Self::Bucket(_) => {
                let local = scratch.join(file.file_name().unwrap_or_default());
                let file = self.open(file)?;
                let mut from = file.read_from_start();
                let mut to = File::create(&local).map_err(unable("write", &local))?;
                io::copy(&mut from, &mut to).map_err(unable("fetch", &file.path()))?;
                Ok(local)
            }
        }
    }

    /// Reads files that should have this many bytes, and at most one more of each; those in a bucket
    /// several at a time.
    pub(super) fn read_each(&self, files: Vec<(&Path, u64)>) -> Vec<Result<Vec<u8>, FileError>> {
        match self {
            Self::Folder(folder) => {
                let files = files.into_iter();
                files
                    .map(|(file, bytes)| {
                        let path = folder.join(file);
                        let mut content = Vec::new();
                        File::open(&path)
                            .and_then(|file| file.take(bytes + 1).read_to_end(&mut content))
                            .map_err(unable("read", &path))?;
                        Ok(content)
                    })
                    .collect()
            }
            Self::Bucket(bucket) => {
                let files = files.into_iter().map(|(file, bytes)| (key(file), bytes));
                bucket.block_on(bucket.read_each(files.collect()))
            }
        }
    }

    pub(super) fn open(&self, shard: &Path) -> Result<Shard, FileError> {
        match self {
            Self::Folder(folder) => {
                let path = folder.join(shard);
                let file = File::open(&path).map_err(unable("read", &path))?;
                Ok(Shard::File(path, file))
            }
            Self::Bucket(bucket) => {
                let key = key(shard);
                let object = bucket.block_on(bucket.head(&key))?;
                let missing = || io::Error::from(io::ErrorKind::NotFound);
                let object =
                    object.ok_or_else(|| unable("read", &bucket.place(&key))(missing()))?;
                Ok(Shard::Object(bucket.clone(), key, object.bytes))
            }
        }
    }
}

impl Shard {
    pub fn path(&self) -> PathBuf {
        match self {
            Self::File(path, _) => path.clone(),
            Self::Object(bucket, key, _) => bucket.place(key),
        }
    }

    pub fn read_from_start(&self) -> Box<dyn Read + '_> {
        match self {
            Self::File(_, file) => Box::new(file),
            Self::Object(bucket, key, bytes) => {
                Box::new(ObjectReader::new(bucket, key, 0..*bytes, STREAM_BYTES))
            }
        }
    }
}

impl Length for Shard {
    fn len(&self) -> u64 {
        match self {
            Self::File(_, file) => file.metadata().map_or(0, |file| file.len()),
            Self::Object(_, _, bytes) => *bytes,
        }
    }
}

impl ChunkReader for Shard {
    type T = Box<dyn Read>;

    fn get_read(&self, start: u64) -> ParquetResult<Self::T> {
        match self {
            Self::File(_, file) => {
                let mut file = file.try_clone()?;
                file.seek(SeekFrom::Start(start))?;
                Ok(Box::new(BufReader::new(file)))
            }
            Self::Object(bucket, key, bytes) => {
                let read = ObjectReader::new(bucket, key, start..*bytes, HEADER_BYTES);
                Ok(Box::new(read))
            }
        }
    }

    fn get_bytes(&self, start: u64, length: usize) -> ParquetResult<Bytes> {
        let end = start.saturating_add(length as u64);
        if end > self.len() {
            return Err(ParquetError::EOF("a page ends behind the file".to_owned()));
        }
        let mut content = Vec::with_capacity(length);
        match self {
            Self::File(_, file) => {
                let mut file = file;
                file.seek(SeekFrom::Start(start))?;
                file.take(length as u64).read_to_end(&mut content)?;
            }
            Self::Object(bucket, key, _) => {
                let mut read = ObjectReader::new(bucket, key, start..end, STREAM_BYTES);
                read.read_to_end(&mut content)?;
            }
        }
        if content.len() != length {
            return Err(ParquetError::EOF("a page is cut short".to_owned()));
        }
        Ok(content.into())
    }
}

/// A manifest's path as a key.
fn key(file: &Path) -> String {
    file.to_string_lossy().into_owned()
}

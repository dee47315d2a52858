//! Objects as streams of bytes for threads that block.

use super::Bucket;
use bytes::Bytes;
use object_store::{MultipartUpload, ObjectStoreExt};
use std::{
    io::{self, Read, Write},
    ops::Range,
};

/// Bytes of one part of an object that is written part by part: 10,000 parts make 80 GB.
const PART_BYTES: usize = 8 << 20;

/// Reads an object from front to back, a range at a time, so that a connection is not held while
/// nobody reads.
pub struct ObjectReader {
    bucket: Bucket,
    key: String,
    at: u64,
    end: u64,
    ahead_bytes: u64,
    ahead: Bytes,
}

/// Writes an object part by part. It is there, whole, once [`ObjectWriter::finish`] has returned;
/// dropped before, nothing of it is.
pub struct ObjectWriter {
    bucket: Bucket,
    upload: Option<Box<dyn MultipartUpload>>,
    part: Vec<u8>,
}

impl ObjectReader {
    /// Reads a range of an object, asking for this many bytes at one time.
    pub fn new(bucket: &Bucket, key: &str, range: Range<u64>, ahead_bytes: u64) -> Self {
        Self {
            bucket: bucket.clone(),
            key: key.to_owned(),
            at: range.start,
            end: range.end,
            ahead_bytes: ahead_bytes.max(1),
            ahead: Bytes::new(),
        }
    }
}

impl Read for ObjectReader {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        if self.ahead.is_empty() {
            let until = self.end.min(self.at + self.ahead_bytes);
            if self.at >= until || into.is_empty() {
                return Ok(0);
            }
            let path = self.bucket.path(&self.key);
            let range = self.at..until;
            let read = self
                .bucket
                .block_on(self.bucket.client.store().get_range(&path, range));
            self.ahead = read?;
            self.at += self.ahead.len() as u64;
        }
        let count = into.len().min(self.ahead.len());
        into[..count].copy_from_slice(&self.ahead.split_to(count));
        Ok(count)
    }
}

impl ObjectWriter {
    /// Begins an object.
    ///
    /// # Errors
    /// When the server does not want it.
    pub fn new(bucket: &Bucket, key: &str) -> io::Result<Self> {
        let path = bucket.path(key);
        let upload = bucket.block_on(bucket.client.store().put_multipart(&path))?;
        Ok(Self {
            bucket: bucket.clone(),
            upload: Some(upload),
            part: Vec::new(),
        })
    }

    /// Ends the object: from now on it is there.
    ///
    /// # Errors
    /// When the server does not have all of it.
    pub fn finish(mut self) -> io::Result<()> {
        self.send()?;
        let Some(mut upload) = self.upload.take() else {
            unreachable!("an upload ends once");
        };
        self.bucket.block_on(upload.complete())?;
        Ok(())
    }

    fn send(&mut self) -> io::Result<()> {
        let part = std::mem::take(&mut self.part);
        if let (false, Some(upload)) = (part.is_empty(), &mut self.upload) {
            self.bucket.block_on(upload.put_part(part.into()))?;
        }
        Ok(())
    }
}

impl Write for ObjectWriter {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let count = bytes.len().min(PART_BYTES - self.part.len());
        self.part.extend_from_slice(&bytes[..count]);
        if self.part.len() == PART_BYTES {
            self.send()?;
        }
        Ok(count)
    }

    // A part is sent when it is full: servers take no small ones but the last.
    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Drop for ObjectWriter {
    fn drop(&mut self) {
        if let Some(mut upload) = self.upload.take() {
            // Servers forget what is never ended, by a rule of the bucket; this is sooner.
            let _ = self.bucket.block_on(upload.abort());
        }
    }
}

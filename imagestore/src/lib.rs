//! Images by digest, in files or in a bucket.
//!
//! | module | what |
//! | --- | --- |
//! | [`blobs`] | images under the names of their digests, in files or in a bucket |
//! | [`bucket`] | objects of S3, Google Cloud Storage or Azure |
//! | [`inspector`] | the same verdicts as [`validation`], for many images of one dataset |
//! | [`staging`] | which uploaded images wait for their completion |
//! | [`validation`] | what counts as an image of the dataset |

pub mod blobs;
pub mod bucket;
mod exact_file;
mod file_error;
pub mod inspector;
mod rejection;
pub mod room;
pub mod staging;
pub mod validation;

pub use bucket::{Bucket, BucketUrl};
pub use file_error::FileError;

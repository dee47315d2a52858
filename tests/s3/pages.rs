//! Listings page by page: `s3s-fs` walks its whole folder for every page, which a bucket of some
//! size does not bear. This one begins where the last page ended, and stops when it is full.

use s3s::dto::*;
use s3s::{S3, S3Request, S3Response, S3Result, s3_error};
use s3s_fs::FileSystem;
use std::future::Future;
use std::io;
use std::path::{Path, PathBuf};
use std::pin::Pin;

/// What S3 lists at one time.
const PAGE: usize = 1000;

/// Files served as `s3s-fs` does, but for listings.
pub struct PagedFiles {
    files: FileSystem,
    root: PathBuf,
}

impl PagedFiles {
    pub fn new(root: &Path) -> Self {
        Self {
            files: FileSystem::new(root).expect("a folder"),
            root: root.to_owned(),
        }
    }
}

/// What an asynchronous method of the trait returns.
type Answer<'a, Output> = Pin<Box<dyn Future<Output = S3Result<S3Response<Output>>> + Send + 'a>>;

macro_rules! as_s3s_fs_does {
    ($($call:ident: $input:ident => $output:ident;)*) => {$(
        fn $call<'life0, 'async_trait>(
            &'life0 self,
            request: S3Request<$input>,
        ) -> Answer<'async_trait, $output>
        where
            'life0: 'async_trait,
            Self: 'async_trait,
        {
            self.files.$call(request)
        }
    )*};
}

impl S3 for PagedFiles {
    as_s3s_fs_does! {
        put_object: PutObjectInput => PutObjectOutput;
        get_object: GetObjectInput => GetObjectOutput;
        head_object: HeadObjectInput => HeadObjectOutput;
        copy_object: CopyObjectInput => CopyObjectOutput;
        delete_object: DeleteObjectInput => DeleteObjectOutput;
        delete_objects: DeleteObjectsInput => DeleteObjectsOutput;
        create_multipart_upload: CreateMultipartUploadInput => CreateMultipartUploadOutput;
        upload_part: UploadPartInput => UploadPartOutput;
        complete_multipart_upload: CompleteMultipartUploadInput => CompleteMultipartUploadOutput;
        abort_multipart_upload: AbortMultipartUploadInput => AbortMultipartUploadOutput;
    }

    fn list_objects_v2<'life0, 'async_trait>(
        &'life0 self,
        request: S3Request<ListObjectsV2Input>,
    ) -> Answer<'async_trait, ListObjectsV2Output>
    where
        'life0: 'async_trait,
        Self: 'async_trait,
    {
        let input = request.input;
        if input.delimiter.is_some() {
            return Box::pin(async { Err(s3_error!(NotImplemented, "folders are not listed")) });
        }
        let bucket = self.root.join(&input.bucket);
        let prefix = input.prefix.clone().unwrap_or_default();
        let after = input.continuation_token.as_ref();
        let after = after.or(input.start_after.as_ref()).cloned();
        Box::pin(async move {
            let page = tokio::task::spawn_blocking(move || {
                let mut page = Page {
                    prefix,
                    after: after.unwrap_or_default(),
                    objects: Vec::new(),
                };
                page.fill(&bucket, "").map(|()| page.objects)
            });
            let page = page
                .await
                .map_err(|error| s3_error!(error, InternalError))?;
            let mut objects = page.map_err(|error| s3_error!(error, InternalError))?;
            let more = objects.len() > PAGE;
            objects.truncate(PAGE);
            let last = objects.last().and_then(|object| object.key.clone());
            Ok(S3Response::new(ListObjectsV2Output {
                key_count: i32::try_from(objects.len()).ok(),
                is_truncated: Some(more),
                next_continuation_token: last.filter(|_| more),
                contents: Some(objects),
                name: Some(input.bucket),
                prefix: input.prefix,
                ..Default::default()
            }))
        })
    }
}

/// Objects in the order of their keys, and one more than a page holds where there is one.
struct Page {
    prefix: String,
    after: String,
    objects: Vec<Object>,
}

impl Page {
    /// Adds what a folder holds, whose keys begin with `above`.
    fn fill(&mut self, folder: &Path, above: &str) -> io::Result<()> {
        let mut keys = Vec::new();
        for entry in folder.read_dir()? {
            let entry = entry?;
            let name = entry.file_name().into_string();
            let name = name.map_err(|name| io::Error::other(format!("{name:?} is no key")))?;
            let end = if entry.file_type()?.is_dir() { "/" } else { "" };
            keys.push((format!("{above}{name}{end}"), entry));
        }
        keys.sort_unstable_by(|(a, _), (b, _)| a.cmp(b));
        for (key, entry) in keys {
            if self.objects.len() > PAGE {
                break;
            }
            if key.ends_with('/') {
                let wanted = key.starts_with(&self.prefix) || self.prefix.starts_with(&key);
                if wanted && (key > self.after || self.after.starts_with(&key)) {
                    self.fill(&entry.path(), &key)?;
                }
            } else if key.starts_with(&self.prefix) && key > self.after {
                // What is removed meanwhile is listed no more.
                let Ok(found) = entry.metadata() else {
                    continue;
                };
                self.objects.push(Object {
                    key: Some(key),
                    last_modified: Some(found.modified()?.into()),
                    size: i64::try_from(found.len()).ok(),
                    ..Default::default()
                });
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pages_hold_every_key_once_and_in_order() {
        let root = tempfile::tempdir().expect("a folder");
        let mut keys = Vec::new();
        for name in ["a", "a-b", "a/b"] {
            for number in 0..700 {
                keys.push(format!("set/{name}{number}/x"));
                keys.push(format!("set/{name}{number}.x"));
            }
        }
        keys.push("other/x".to_owned());
        for key in &keys {
            let path = root.path().join(key);
            std::fs::create_dir_all(path.parent().expect("a folder")).expect("made");
            std::fs::write(path, "x").expect("written");
        }
        for prefix in ["", "set/", "set/a/", "set/a1", "none"] {
            let mut wanted: Vec<&String> =
                keys.iter().filter(|key| key.starts_with(prefix)).collect();
            wanted.sort();
            let mut listed = Vec::new();
            loop {
                let mut page = Page {
                    prefix: prefix.to_owned(),
                    after: listed.last().cloned().unwrap_or_default(),
                    objects: Vec::new(),
                };
                page.fill(root.path(), "").expect("listed");
                let more = page.objects.len() > PAGE;
                let objects = page.objects.into_iter().take(PAGE);
                listed.extend(objects.map(|object| object.key.expect("a key")));
                if !more {
                    break;
                }
            }
            assert_eq!(listed.iter().collect::<Vec<_>>(), wanted, "{prefix}");
        }
    }
}

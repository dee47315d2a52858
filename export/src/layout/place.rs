//! Where an export goes: a folder, or a place in a bucket.
//!
//! What is written appears under its name whole, in either: a file is renamed, an object is there
//! when its last part is. A bucket needs no room and no sync.

use crate::{
    error::ExportError,
    file::{unable, write_bytes, write_whole},
};
use imagestore::{
    FileError,
    bucket::{Bucket, ObjectWriter},
};
use std::{
    collections::BTreeMap,
    fs::{self, File},
    io::{self, Read, Write},
    path::{Path, PathBuf},
};

/// The largest file that is read back, bytes.
pub(super) const READ_BYTES_MAX: u64 = 1 << 20;

/// Where an export goes.
#[derive(Clone, Debug)]
pub enum Place {
    /// A folder, made where there is none.
    Folder(PathBuf),
    /// A place in a bucket.
    Bucket(Bucket),
}

impl From<&Path> for Place {
    fn from(folder: &Path) -> Self {
        Self::Folder(folder.to_owned())
    }
}

impl From<&PathBuf> for Place {
    fn from(folder: &PathBuf) -> Self {
        Self::Folder(folder.clone())
    }
}

impl Place {
    /// Its name, for people.
    pub fn name(&self) -> PathBuf {
        match self {
            Self::Folder(folder) => folder.clone(),
            Self::Bucket(bucket) => bucket.place(""),
        }
    }

    /// Where a part of it is, for people.
    pub(super) fn path(&self, part: &str) -> PathBuf {
        match self {
            Self::Folder(folder) => folder.join(part),
            Self::Bucket(bucket) => bucket.place(part),
        }
    }

    /// Makes the folder.
    pub(super) fn make(&self) -> Result<(), FileError> {
        match self {
            Self::Folder(folder) => fs::create_dir_all(folder).map_err(unable("make", folder)),
            Self::Bucket(_) => Ok(()),
        }
    }

    /// Reads a small file; `None` where there is none. A larger one comes cut off.
    pub(super) fn read(&self, part: &str) -> Result<Option<Vec<u8>>, FileError> {
        let read = match self {
            Self::Folder(folder) => {
                let path = folder.join(part);
                let mut content = Vec::new();
                File::open(&path)
                    .and_then(|file| file.take(READ_BYTES_MAX + 1).read_to_end(&mut content))
                    .map_err(unable("read", &path))
                    .map(|_| content)
            }
            Self::Bucket(bucket) => bucket.block_on(bucket.read(part, READ_BYTES_MAX)),
        };
        match read {
            Err(error) if error.source.kind() == io::ErrorKind::NotFound => Ok(None),
            read => read.map(Some),
        }
    }

    /// The first thing there but `besides`, if there is any.
    pub(super) fn occupant(&self, besides: &[&str]) -> Result<Option<String>, FileError> {
        match self {
            Self::Folder(folder) => {
                let mut entries = fs::read_dir(folder).map_err(unable("read", folder))?;
                Ok(entries.find_map(|entry| {
                    let name = entry.ok()?.file_name().to_string_lossy().into_owned();
                    (!besides.contains(&&*name)).then_some(name)
                }))
            }
            Self::Bucket(bucket) => bucket.block_on(bucket.first()),
        }
    }

    /// The sizes of all objects of a bucket, by key. A folder is looked at file by file.
    pub(super) fn objects(&self) -> Result<BTreeMap<String, u64>, FileError> {
        let mut found = BTreeMap::new();
        if let Self::Bucket(bucket) = self {
            bucket.block_on(bucket.for_each("", |object| {
                found.insert(object.key, object.bytes);
            }))?;
        }
        Ok(found)
    }

    /// Has `write` write a part of it, which is there when it is whole.
    pub(super) fn write<T>(
        &self,
        part: &str,
        write: impl FnOnce(&mut (dyn Write + Send)) -> Result<T, ExportError>,
    ) -> Result<T, ExportError> {
        match self {
            Self::Folder(folder) => {
                let path = folder.join(part);
                make_parent(&path)?;
                write_whole(&path, |file| write(file))
            }
            Self::Bucket(bucket) => {
                let failed = || unable("write", &bucket.place(part));
                let mut object = ObjectWriter::new(bucket, part).map_err(failed())?;
                let written = write(&mut object)?;
                object.finish().map_err(failed())?;
                Ok(written)
            }
        }
    }

    /// Writes bytes the same way.
    pub(super) fn write_bytes(&self, part: &str, bytes: &[u8]) -> Result<(), FileError> {
        match self {
            Self::Folder(folder) => write_bytes(&folder.join(part), bytes),
            Self::Bucket(bucket) => {
                let written = bucket.block_on(bucket.write(part, bytes.to_vec()));
                written.map(|_| ())
            }
        }
    }

    /// Moves finished files from a folder of this machine to where they belong, in this order. They
    /// are there already where the export goes to a folder.
    pub(super) fn take(&self, from: &Path, names: &[&str]) -> Result<(), ExportError> {
        if let Self::Bucket(_) = self {
            for name in names {
                let path = from.join(name);
                let mut file = File::open(&path).map_err(unable("read", &path))?;
                self.write(name, |object| {
                    io::copy(&mut file, object).map_err(unable("write", &self.path(name)))?;
                    Ok(())
                })?;
            }
        }
        Ok(())
    }
}

fn make_parent(path: &Path) -> Result<(), FileError> {
    match path.parent() {
        Some(parent) => fs::create_dir_all(parent).map_err(unable("make", parent)),
        None => Ok(()),
    }
}

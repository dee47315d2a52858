//! A store open for reading, beside coordinators at work or without one.
//!
//! Either kind is read through a completion log: a folder has one, and of a database a copy of what
//! is complete is made in one, when it is opened. So a reader holds a few bytes a material in
//! memory, and sees what was complete when it began.

use super::{
    StoreError, StoreName,
    identity::{log_path, open_blobs, read_specification},
    mesh_file,
};
use crate::shared;
use dataset::{CompletedView, Digest, Specification};
use imagestore::{
    FileError,
    blobs::Blobs,
    validation::{Rejection, check_digest},
};
use jobqueue::Completion;
use jobstore::completion_log::{Completions, Transcript};
use std::{
    io,
    path::{Path, PathBuf},
};
use thiserror::Error;

/// Why the file of a completed image is not as it was.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum ImageFault {
    /// It is absent.
    #[error("the image is missing")]
    Missing,
    /// The system would not read it.
    #[error("it cannot be read: {0}")]
    Unreadable(String),
    /// It has another size.
    #[error("it has {} than its {bytes} bytes", if *.more { "more" } else { "fewer" })]
    Size {
        /// The size recorded.
        bytes: u64,
        /// Whether the file is larger.
        more: bool,
    },
    /// It has another digest.
    #[error(transparent)]
    Digest(Rejection),
}

/// A store open for reading, beside coordinators at work or without one. Shows what was complete
/// when it was opened.
#[derive(Debug)]
pub struct ReadOnlyStore {
    name: StoreName,
    specification: Specification,
    specification_hash: Digest,
    completions: Option<Completions>,
    pub(crate) blobs: Blobs,
}

impl ReadOnlyStore {
    /// Opens a store. One in a database cannot be opened inside a runtime.
    pub fn open(name: impl Into<StoreName>) -> Result<Self, StoreError> {
        let name = name.into();
        match &name {
            StoreName::Folder(path) => Self::open_folder(path),
            StoreName::Database(url) => Self::open_database(url),
        }
    }

    fn open_folder(path: &Path) -> Result<Self, StoreError> {
        let specification = mesh_file::load(path, read_specification(path)?)?;
        let completions = match Completions::open(&log_path(path)) {
            Err(error) if error.source.kind() == io::ErrorKind::NotFound => None,
            completions => Some(completions?),
        };
        let blobs = open_blobs(path)?.0;
        let name = StoreName::Folder(path.to_owned());
        Ok(Self::of(name, specification, completions, blobs))
    }

    fn open_database(url: &str) -> Result<Self, StoreError> {
        let name = StoreName::Database(url.to_owned());
        let mut transcript = Transcript::begin(&records_place(&name))?;
        let (specification, blobs) = shared::read(url, &[], &mut |line| transcript.add(line))?;
        let specification = shared::load_mesh(url, specification)?;
        let completions = Some(transcript.read()?);
        Ok(Self::of(name, specification, completions, blobs))
    }

    fn of(
        name: StoreName,
        specification: Specification,
        completions: Option<Completions>,
        blobs: Blobs,
    ) -> Self {
        Self {
            name,
            specification_hash: specification.hash(),
            specification,
            completions,
            blobs,
        }
    }

    /// Its name.
    pub fn name(&self) -> &StoreName {
        &self.name
    }

    /// Where it is recorded what is complete, for people.
    pub fn records_place(&self) -> PathBuf {
        records_place(&self.name)
    }

    /// The specification; its number of materials is the largest ever asked for.
    pub fn specification(&self) -> &Specification {
        &self.specification
    }

    /// The specification's hash.
    pub fn specification_hash(&self) -> Digest {
        self.specification_hash
    }

    /// Where its images are.
    pub fn blobs(&self) -> &Blobs {
        &self.blobs
    }

    /// Looks for what was completed, or is complete no longer, since it was opened or refreshed.
    /// Returns the materials. Of a store in a database only new completions are seen: a material that
    /// was known goes on to be what it was. Cannot be called inside a runtime if it is one.
    ///
    /// # Errors
    /// When its records cannot be read.
    pub fn refresh(&mut self) -> Result<Vec<u32>, StoreError> {
        let path = match &self.name {
            StoreName::Folder(path) => path,
            StoreName::Database(url) => return refresh_database(url, self.completions.as_mut()),
        };
        let Some(completions) = &mut self.completions else {
            let log = Completions::open(&log_path(path));
            self.completions = match log {
                Err(error) if error.source.kind() == io::ErrorKind::NotFound => None,
                completions => Some(completions?),
            };
            return Ok(self.materials_complete().collect());
        };
        Ok(completions.read_on()?)
    }

    /// A material's completion, if it is complete.
    pub fn completion(&self, material: u32) -> Result<Option<Completion>, FileError> {
        match &self.completions {
            Some(completions) => completions.get(material),
            None => Ok(None),
        }
    }

    /// Whether a material is complete, as far as its record was whole when the store was opened.
    /// Reads nothing.
    pub fn is_complete(&self, material: u32) -> bool {
        self.completions
            .as_ref()
            .is_some_and(|completions| completions.contains(material))
    }

    /// How many of the specification's materials are not complete.
    pub fn materials_missing(&self) -> u32 {
        let complete = self.completions.iter().flat_map(Completions::materials);
        let materials = self.specification.materials;
        materials - complete.filter(|material| *material < materials).count() as u32
    }

    /// How many lines of the completion log, or rows of the database, are damaged. Opening a store
    /// in a folder for writing adds what lines said again where the ledger knows it.
    pub fn records_damaged(&self) -> u64 {
        self.completions
            .as_ref()
            .map_or(0, |completions| completions.bad_line_count)
    }

    /// The completed materials, in order, those too that nobody wants any more.
    pub fn materials_complete(&self) -> impl Iterator<Item = u32> {
        self.completions.iter().flat_map(Completions::materials)
    }

    /// Reads an image as it was completed, and checks its size and digest.
    ///
    /// # Errors
    /// Says what is wrong with its file.
    pub fn read_image(&self, image: &CompletedView) -> Result<Vec<u8>, ImageFault> {
        check_read(image, self.blobs.read(&image.digest, image.bytes))
    }

    /// The same for the images of one material: those in a bucket are read at one time.
    pub fn read_images<'a>(
        &'a self,
        images: &'a [CompletedView],
    ) -> impl Iterator<Item = Result<Vec<u8>, ImageFault>> + 'a {
        let named = images.iter().map(|image| (image.digest, image.bytes));
        let read = self.blobs.read_each(named.collect());
        let read = images.iter().zip(read);
        read.map(|(image, read)| check_read(image, read))
    }

    /// Where an image is, for people: a path, or a URL.
    pub fn image_path(&self, digest: &Digest) -> PathBuf {
        self.blobs.path(digest)
    }

    /// Whether the images are files of this machine, which can be linked to.
    pub fn has_files(&self) -> bool {
        self.blobs.objects().is_none()
    }
}

/// Adds what is complete in a database since to what was read of it.
fn refresh_database(
    url: &str,
    completions: Option<&mut Completions>,
) -> Result<Vec<u32>, StoreError> {
    let Some(completions) = completions else {
        return Ok(Vec::new());
    };
    let known: Vec<u32> = completions.materials().collect();
    let mut more = Vec::new();
    shared::read(url, &known, &mut |line| {
        more.push(line.to_owned());
        Ok(())
    })?;
    for json in more {
        completions.add_to_transcript(&json)?;
    }
    Ok(completions.read_on()?)
}

/// What was read as an image, if it is that image.
pub fn check_read(
    image: &CompletedView,
    read: Result<Vec<u8>, FileError>,
) -> Result<Vec<u8>, ImageFault> {
    let bytes = read.map_err(|error| match error.source.kind() {
        io::ErrorKind::NotFound => ImageFault::Missing,
        _ => ImageFault::Unreadable(error.source.to_string()),
    })?;
    if bytes.len() as u64 != image.bytes {
        return Err(ImageFault::Size {
            bytes: image.bytes,
            more: bytes.len() as u64 > image.bytes,
        });
    }
    check_digest(&bytes, image.digest).map_err(ImageFault::Digest)?;
    Ok(bytes)
}

fn records_place(name: &StoreName) -> PathBuf {
    match name {
        StoreName::Folder(folder) => log_path(folder),
        StoreName::Database(_) => format!("the completions of {name}").into(),
    }
}

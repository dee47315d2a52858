//! A store copied into another: folder or database, images in a folder or a bucket.
//!
//! What is copied is everything that outlives a coordinator: specification, records of jobs and of
//! workers, completions, images. Leases are not: both sides hold still, and a job that was with a
//! worker arrives as one that waits for one.
//!
//! Every image is read, compared with its recorded size and digest, written, and read back from
//! where it was written to, whatever the place says of it. Jobs follow their images, some at a
//! time; so a copy that was cut short goes on behind the last of them, and an image that is there
//! without its job is compared again. In the end all records are read anew on both sides and
//! compared.
//!
//! Until then the target is half of a store, and says so: in a folder `migration.json` stands
//! beside what is there, and `specification.json`, which makes a folder a store, comes last; in a
//! database a column names the source. Nobody opens such a store. The source is never changed, but
//! for what opening it mends.

mod database;
mod error;
mod folder;
mod images;
mod records;

use database::Database;
use dataset::Specification;
use datastore::{BlobsPlace, CopyError, SharedStoreError, StoreError, StoreName};
use folder::Folder;
use images::copy_images;
use imagestore::{FileError, blobs::Blobs};
use jobqueue::{Completion, WorkerRecord};
use jobstore::kept::{Entry, KeptFarm, Page};
use records::{Entries, compare, missing};
use std::{collections::BTreeMap, fs};

pub use error::MigrationError;

/// Jobs whose records are read at one time.
const PAGE_JOBS: usize = 256;

/// Materials that are made durable at one time, with their images.
const BATCH_MATERIALS: usize = 16;

/// Bytes of images that are in memory at one time, but for the last material's.
const BATCH_BYTES: u64 = 32 << 20;

/// What was copied.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Migrated {
    /// Jobs with a history, whatever became of them.
    pub jobs: u64,
    /// Those that are complete.
    pub materials: u64,
    /// Images of them.
    pub images: u64,
    /// Workers with a history.
    pub workers: u64,
    /// Images that this call wrote.
    pub images_written: u64,
    /// Bytes of them.
    pub bytes_written: u64,
}

/// A store that holds still: nobody else can change it.
trait FrozenStore {
    fn name(&self) -> &StoreName;

    fn blobs(&self) -> &Blobs;

    /// How many jobs are complete.
    fn completed(&mut self) -> Result<u32, MigrationError>;

    /// Jobs from one on, as many as fit a page.
    fn page(&mut self, from: u32) -> Result<Page, MigrationError>;

    fn farm(&mut self) -> Result<KeptFarm, MigrationError>;

    /// Writes records and completions over those that are there, durably. Their images are there.
    fn write(&mut self, entries: &[Entry]) -> Result<(), MigrationError>;

    /// The same of workers; one without a history is forgotten.
    fn write_farm(&mut self, farm: &KeptFarm) -> Result<(), MigrationError>;

    /// Reads anew what was written.
    fn reopen(self: Box<Self>) -> Result<Box<dyn FrozenStore>, MigrationError>;

    /// Notes that the copy is whole.
    fn finish(self: Box<Self>) -> Result<(), MigrationError>;
}

/// Copies a store into another, or goes on with that. `blobs` is where the images of the target are
/// to be: a folder keeps them itself where that is not given, a database has to be told.
/// `progress` is told of how many images it is known that they are there, of how many. Cannot be
/// called inside a runtime.
///
/// # Errors
/// At the first thing that is wrong; what was copied stays, and the same call goes on.
pub fn migrate(
    from: &StoreName,
    to: &StoreName,
    blobs: Option<&BlobsPlace>,
    progress: &dyn Fn(u64, u64),
) -> Result<Migrated, MigrationError> {
    let (from, to) = (absolute(from)?, absolute(to)?);
    if from == to {
        return Err(MigrationError::Same(from));
    }
    let (mut source, specification, place) = open_source(&from)?;
    if blobs.is_some_and(|given| is_same(given, &place)) {
        let place = Box::new(place);
        return Err(MigrationError::SamePlace { name: from, place });
    }
    let views = specification.views.len() as u64;
    let mut target = match open_target(&to, &specification, blobs, &from.to_string()) {
        Err(error) if is_taken(&error) => {
            return ended(source.as_mut(), &to, views)?.ok_or(error);
        }
        target => target?,
    };
    let total = u64::from(source.completed()?) * views;
    let mut migrated = Migrated::default();
    let mut next = Some(0);
    while let Some(first) = next {
        let page = source.page(first)?;
        let missing = missing(&page, first, target.as_mut(), &from, &mut migrated)?;
        let mut rest = &missing[..];
        progress(migrated.images, total);
        while !rest.is_empty() {
            let batch;
            (batch, rest) = rest.split_at(batch_length(rest));
            copy_images(source.blobs(), target.blobs(), batch, &mut migrated)?;
            target.write(batch)?;
            migrated.images += batch.iter().map(Entry::images).sum::<u64>();
            progress(migrated.images, total);
        }
        next = page.next;
    }
    let farm = source.farm()?;
    migrated.workers = farm.workers.len() as u64;
    copy_farm(&farm, target.as_mut())?;
    let mut target = target.reopen()?;
    compare(source.as_mut(), target.as_mut())?;
    target.finish()?;
    Ok(migrated)
}

/// A name that means the same from everywhere.
fn absolute(name: &StoreName) -> Result<StoreName, MigrationError> {
    let Some(folder) = name.folder() else {
        return Ok(name.clone());
    };
    let found = fs::canonicalize(folder).or_else(|_| std::path::absolute(folder));
    let found = found.map_err(FileError::new("find", folder))?;
    Ok(StoreName::Folder(found))
}

fn is_taken(error: &MigrationError) -> bool {
    let MigrationError::Store(
        StoreError::Copy(error) | StoreError::Shared(SharedStoreError::Copy(error)),
    ) = error
    else {
        return false;
    };
    matches!(error, CopyError::Taken(_))
}

/// What was copied, where a store that is there is the whole of this copy: whoever was killed at
/// the very end, and does not know, is told so.
fn ended(
    source: &mut dyn FrozenStore,
    to: &StoreName,
    views: u64,
) -> Result<Option<Migrated>, MigrationError> {
    let Ok((mut target, ..)) = open_source(to) else {
        return Ok(None);
    };
    match compare(source, target.as_mut()) {
        Err(MigrationError::Differs { .. }) => return Ok(None),
        compared => compared?,
    }
    let mut migrated = Migrated {
        materials: source.completed()?.into(),
        workers: source.farm()?.workers.len() as u64,
        ..Migrated::default()
    };
    migrated.images = migrated.materials * views;
    let mut jobs = Entries::new(source);
    while jobs.next()?.is_some() {
        migrated.jobs += 1;
    }
    Ok(Some(migrated))
}

fn is_same(given: &BlobsPlace, place: &BlobsPlace) -> bool {
    match given {
        BlobsPlace::Bucket(_) => given == place,
        // One that is not there yet is another.
        BlobsPlace::Folder(folder) => {
            fs::canonicalize(folder).is_ok_and(|folder| *place == BlobsPlace::Folder(folder))
        }
    }
}

type Source = (Box<dyn FrozenStore>, Specification, BlobsPlace);

fn open_source(name: &StoreName) -> Result<Source, MigrationError> {
    match name {
        StoreName::Folder(path) => {
            let (folder, specification, place) = Folder::source(path)?;
            Ok((Box::new(folder), specification, place))
        }
        StoreName::Database(url) => {
            let (database, specification, place) = Database::source(url)?;
            Ok((Box::new(database), specification, place))
        }
    }
}

fn open_target(
    name: &StoreName,
    specification: &Specification,
    blobs: Option<&BlobsPlace>,
    from: &str,
) -> Result<Box<dyn FrozenStore>, MigrationError> {
    match name {
        StoreName::Folder(path) => Ok(Box::new(Folder::target(path, specification, blobs, from)?)),
        StoreName::Database(url) => {
            Ok(Box::new(Database::target(url, specification, blobs, from)?))
        }
    }
}

/// How many of the entries are copied together.
fn batch_length(entries: &[Entry]) -> usize {
    let mut bytes = 0;
    let fit = entries.iter().take(BATCH_MATERIALS).take_while(|entry| {
        let fits = bytes < BATCH_BYTES;
        bytes += entry.completion.as_ref().map_or(0, Completion::bytes);
        fits
    });
    fit.count()
}

fn copy_farm(farm: &KeptFarm, target: &mut dyn FrozenStore) -> Result<(), MigrationError> {
    let there = target.farm()?;
    if there == *farm {
        return Ok(());
    }
    let gone = there.workers.into_keys();
    let gone = gone.filter(|name| !farm.workers.contains_key(name));
    let mut workers: BTreeMap<String, WorkerRecord> = farm.workers.clone();
    workers.extend(gone.map(|name| (name, WorkerRecord::default())));
    let mode = farm.mode;
    target.write_farm(&KeptFarm { workers, mode })
}

//! Two stores or manifests, image by image: labels, digests, pixels.

use crate::manifest::read::{ReadError, read};
use dataset::{CompletedView, manifest::Row};
use datastore::{ReadOnlyStore, StoreError, StoreName};
use imagestore::{FileError, validation::decode};
use serde::Serialize;
use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
    sync::mpsc,
    thread,
};
use thiserror::Error;

/// Rows that are read ahead of the comparison.
const ROWS_AHEAD: usize = 256;

/// What keeps dark pixels from dividing by nothing, in units of white squared.
const RELATIVE_FLOOR: f64 = 1e-4;

/// The images with the largest errors that are listed.
pub const WORST_LISTED: usize = 10;

/// Why two sets cannot be compared.
#[derive(Debug, Error)]
pub enum DiffError {
    /// A manifest cannot be read.
    #[error(transparent)]
    Manifest(#[from] ReadError),
    /// A store cannot be read.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// Rows do not stand in the order of materials and views.
    #[error("{}: the rows are not in the order of materials and views", .0.display())]
    Order(PathBuf),
    /// An image cannot be read.
    #[error("{}: {what}", path.display())]
    Image {
        /// The image's file.
        path: PathBuf,
        /// What is wrong.
        what: String,
    },
    /// A file cannot be read.
    #[error(transparent)]
    File(#[from] FileError),
}

/// An image whose pixels differ.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct PixelDifference {
    /// The material's index.
    pub material: u32,
    /// The view's index.
    pub view: u32,
    /// Mean over pixels and channels of (b - a)^2 / (a^2 + 1e-4), a and b in units of white.
    pub relative_mse: f64,
}

/// What differs.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Difference {
    /// Images in both.
    pub in_both: u64,
    /// Images in the first alone.
    pub only_in_a: u64,
    /// Images in the second alone.
    pub only_in_b: u64,
    /// Images in both whose digests differ.
    pub digests_differ: u64,
    /// Rows in both that differ, by the first column that does.
    pub columns: BTreeMap<&'static str, u64>,
    /// The mean relative MSE of the images that differ, where both are stores of one film.
    pub relative_mse_mean: Option<f64>,
    /// The worst of them.
    pub worst: Vec<PixelDifference>,
}

impl Difference {
    /// Whether both are the same set.
    pub fn is_empty(&self) -> bool {
        self.only_in_a + self.only_in_b == 0 && self.columns.is_empty()
    }
}

/// Compares two sets; each is a store, by its folder or its database's URL, or a manifest. Memory
/// does not grow with them.
///
/// # Errors
/// When either cannot be read, or a manifest is not in order.
pub fn diff(a: &Path, b: &Path) -> Result<Difference, DiffError> {
    let (a, b) = (Source::open(a)?, Source::open(b)?);
    thread::scope(|scope| {
        let (rows_a, rows_b) = (a.rows(scope), b.rows(scope));
        compare(&a, &b, rows_a, rows_b)
    })
}

type Rows = mpsc::Receiver<Result<Row, DiffError>>;

fn compare(a: &Source, b: &Source, rows_a: Rows, rows_b: Rows) -> Result<Difference, DiffError> {
    let mut difference = Difference::default();
    let mut sum = 0.0;
    let mut compared = 0u64;
    let next = |rows: &Rows| rows.recv().ok().transpose();
    let (mut row_a, mut row_b) = (next(&rows_a)?, next(&rows_b)?);
    loop {
        let order = match (&row_a, &row_b) {
            (None, None) => break,
            (Some(_), None) => std::cmp::Ordering::Less,
            (None, Some(_)) => std::cmp::Ordering::Greater,
            (Some(a), Some(b)) => a.image().cmp(&b.image()),
        };
        match order {
            std::cmp::Ordering::Less => {
                difference.only_in_a += 1;
                row_a = next(&rows_a)?;
            }
            std::cmp::Ordering::Greater => {
                difference.only_in_b += 1;
                row_b = next(&rows_b)?;
            }
            std::cmp::Ordering::Equal => {
                if let (Some(mine), Some(other)) = (&row_a, &row_b) {
                    difference.in_both += 1;
                    if let Some(column) = mine.first_difference(other) {
                        *difference.columns.entry(column.name).or_default() += 1;
                    }
                    if mine.value("digest") != other.value("digest") {
                        difference.digests_differ += 1;
                        if let Some(relative_mse) = relative_mse(a, b, mine, other)? {
                            compared += 1;
                            sum += relative_mse;
                            let (material, view) = mine.image();
                            note(
                                &mut difference.worst,
                                PixelDifference {
                                    material,
                                    view,
                                    relative_mse,
                                },
                            );
                        }
                    }
                }
                (row_a, row_b) = (next(&rows_a)?, next(&rows_b)?);
            }
        }
    }
    difference.relative_mse_mean = (compared > 0).then(|| sum / compared as f64);
    Ok(difference)
}

/// Keeps the worst, the very worst first.
fn note(worst: &mut Vec<PixelDifference>, difference: PixelDifference) {
    let place = worst.partition_point(|other| other.relative_mse >= difference.relative_mse);
    worst.insert(place, difference);
    worst.truncate(WORST_LISTED);
}

/// The relative MSE of an image's two versions; `None` where they cannot be compared pixel by
/// pixel.
fn relative_mse(a: &Source, b: &Source, mine: &Row, other: &Row) -> Result<Option<f64>, DiffError> {
    let (Source::Store(a), Source::Store(b)) = (a, b) else {
        return Ok(None);
    };
    let size = |store: &ReadOnlyStore| {
        let image = &store.specification().image;
        (image.width, image.height)
    };
    if size(a) != size(b) {
        return Ok(None);
    }
    let (a, b) = (pixels(a, mine)?, pixels(b, other)?);
    let pairs = a.as_flattened().iter().zip(b.as_flattened());
    let sum: f64 = pairs
        .map(|(&a, &b)| {
            let (a, b) = (f64::from(a), f64::from(b));
            (b - a) * (b - a) / (a * a + RELATIVE_FLOOR)
        })
        .sum();
    Ok(Some(sum / (3 * a.len()) as f64))
}

fn pixels(store: &ReadOnlyStore, row: &Row) -> Result<Vec<[f32; 3]>, DiffError> {
    let done: Option<CompletedView> = row.completed_view().ok();
    let Some(done) = done else {
        unreachable!("a store's rows have digests");
    };
    let path = store.image_path(&done.digest);
    let failed = |what: String| DiffError::Image { path, what };
    let bytes = match store.read_image(&done) {
        Ok(bytes) => bytes,
        Err(fault) => return Err(failed(fault.to_string())),
    };
    let decoded = decode(&bytes, store.specification());
    Ok(decoded
        .map_err(|rejection| failed(rejection.to_string()))?
        .pixels)
}

/// One of the two sets.
enum Source {
    Store(Box<ReadOnlyStore>),
    Manifest(PathBuf),
}

impl Source {
    fn open(path: &Path) -> Result<Self, DiffError> {
        match StoreName::from(path) {
            StoreName::Folder(path) if !path.is_dir() => Ok(Self::Manifest(path)),
            name => Ok(Self::Store(Box::new(ReadOnlyStore::open(name)?))),
        }
    }

    /// Reads the rows, in order, on a thread of its own. It stops when nobody listens.
    fn rows<'scope>(&'scope self, scope: &'scope thread::Scope<'scope, '_>) -> Rows {
        let (sender, receiver) = mpsc::sync_channel(ROWS_AHEAD);
        scope.spawn(move || {
            let sent = match self {
                Self::Store(store) => send_store(store, &sender),
                Self::Manifest(path) => send_manifest(path, &sender),
            };
            if let Err(Stopped::Failed(error)) = sent {
                // Whoever listened has gone.
                let _ = sender.send(Err(error));
            }
        });
        receiver
    }
}

/// Why reading ended before the last row.
enum Stopped {
    Unheard,
    Failed(DiffError),
}

impl From<ReadError> for Stopped {
    fn from(error: ReadError) -> Self {
        Self::Failed(error.into())
    }
}

type Sender = mpsc::SyncSender<Result<Row, DiffError>>;

fn send_store(store: &ReadOnlyStore, sender: &Sender) -> Result<(), Stopped> {
    let specification = store.specification();
    for material in 0..specification.materials {
        let completion = store
            .completion(material)
            .map_err(|error| Stopped::Failed(error.into()))?;
        let Some(completion) = completion else {
            continue;
        };
        let sampled = specification.material(material);
        let views = completion.views.iter().take(specification.views.len());
        for (view, done) in (0..).zip(views) {
            let row = Row::new(
                specification,
                store.specification_hash(),
                &sampled,
                view,
                done,
            );
            sender.send(Ok(row)).map_err(|_| Stopped::Unheard)?;
        }
    }
    Ok(())
}

fn send_manifest(path: &Path, sender: &Sender) -> Result<(), Stopped> {
    let mut last = None;
    read(path, |_, row| {
        if last >= Some(row.image()) {
            return Err(Stopped::Failed(DiffError::Order(path.to_owned())));
        }
        last = Some(row.image());
        sender.send(Ok(row)).map_err(|_| Stopped::Unheard)
    })
}

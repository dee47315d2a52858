//! A manifest and its images into a store, checked on the way in.
//!
//! Every row has to be the one that the specification gives for its image, column by column, and
//! every image has to be what its row says: size, digest, pixels, header. Whole materials come in,
//! and a store that has some of them already takes the rest.

use crate::{
    file::unable,
    manifest::read::{ReadError, read},
};
use arrow_array::{Array, BinaryArray, UInt32Array};
use coordinator::{
    Completion, FileError, ReadOnlyStore, Store, StoreError,
    acceptance::{check_digest, check_identity, expected_headers, inspect},
};
use dataset::{CompletedView, Digest, Specification, manifest::Row};
use parquet::arrow::{ProjectionMask, arrow_reader::ParquetRecordBatchReaderBuilder};
use std::{
    collections::{BTreeMap, BTreeSet},
    fs::File,
    io::Read,
    path::{Component, Path, PathBuf},
    sync::Mutex,
    thread,
};
use thiserror::Error;

/// Bytes of images that are checked and made durable together.
const BATCH_BYTES: u64 = 64 << 20;

/// Rows of a Parquet shard that are decoded together.
const SHARD_BATCH_ROWS: usize = 64;

/// Who imported materials are recorded as rendered by: the manifest does not say.
const WORKER: &str = "import";

/// Why nothing more was imported.
#[derive(Debug, Error)]
pub enum ImportError {
    /// The manifest cannot be read.
    #[error(transparent)]
    Manifest(#[from] ReadError),
    /// A row is not what the specification gives.
    #[error("row {row} of the manifest, material {material}, view {view}: {what}")]
    Row {
        /// Counted from 1.
        row: u64,
        /// The material's index.
        material: u32,
        /// The view's index.
        view: u32,
        /// What is wrong.
        what: String,
    },
    /// A material is there in part.
    #[error(
        "material {material} has {found} of its {views} views in the manifest: a store holds whole \
         materials; export all views"
    )]
    Views {
        /// The material's index.
        material: u32,
        /// Views in the manifest.
        found: usize,
        /// Views of the specification.
        views: usize,
    },
    /// An image is absent or not what its row says.
    #[error("{}, material {material}, view {view}: {what}", path.display())]
    Image {
        /// The file that holds it, or should.
        path: PathBuf,
        /// The material's index.
        material: u32,
        /// The view's index.
        view: u32,
        /// What is wrong.
        what: String,
    },
    /// A shard cannot be read.
    #[error("{}: {what}", path.display())]
    Shard {
        /// The shard.
        path: PathBuf,
        /// What is wrong.
        what: String,
    },
    /// The store cannot be written.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// A file cannot be read.
    #[error(transparent)]
    File(#[from] FileError),
}

/// What came in.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Imported {
    /// Materials added.
    pub materials: u32,
    /// Images added.
    pub images: u64,
    /// Materials that the store had already.
    pub materials_there: u32,
}

/// Imports the images that a manifest names, relative to `folder`, into the store at `path`, which
/// is made where there is none. `progress` is told how many images are in, of how many.
///
/// # Errors
/// At the first row or image that is wrong; what came in before stays, and the same call goes on.
pub fn import(
    specification: &Specification,
    manifest: &Path,
    folder: &Path,
    path: &Path,
    threads: usize,
    progress: &dyn Fn(u64, u64),
) -> Result<Imported, ImportError> {
    let mut wanted = read_manifest(specification, manifest)?;
    let mut store = Store::open_or_create(path, specification)?;
    let reader = ReadOnlyStore::open(path)?;
    let before = wanted.len();
    let mut kept = BTreeMap::new();
    for (material, images) in wanted {
        let there = reader.completion(material)?;
        let same = there.is_some_and(|there| {
            there
                .views
                .iter()
                .eq(images.iter().map(|image| &image.done))
        });
        if !same {
            kept.insert(material, images);
        }
    }
    wanted = kept;
    let mut imported = Imported {
        materials_there: (before - wanted.len()) as u32,
        ..Imported::default()
    };
    let total = wanted.values().map(|images| images.len() as u64).sum();
    let mut batch = Batch::default();
    let mut flush = |batch: &mut Batch| -> Result<(), ImportError> {
        imported.materials += batch.materials.len() as u32;
        imported.images += batch.images();
        batch.store(specification, &mut store, threads)?;
        progress(imported.images, total);
        Ok(())
    };
    for_each_material(&wanted, folder, &mut |material, bytes| {
        batch.add(material, &wanted[&material], bytes);
        if batch.bytes >= BATCH_BYTES {
            flush(&mut batch)?;
        }
        Ok(())
    })?;
    flush(&mut batch)?;
    Ok(imported)
}

/// An image that is to come in.
#[derive(Clone, Debug)]
struct Wanted {
    done: CompletedView,
    /// Where it is, relative to the folder.
    path: PathBuf,
}

/// The images of each material, in the order of views.
type WantedMaterials = BTreeMap<u32, Vec<Wanted>>;

fn read_manifest(
    specification: &Specification,
    manifest: &Path,
) -> Result<WantedMaterials, ImportError> {
    let hash = specification.hash();
    let views = specification.views.len();
    let mut found: BTreeMap<u32, BTreeMap<u32, Wanted>> = BTreeMap::new();
    read::<ImportError>(manifest, |number, row| {
        let (material, view) = row.image();
        let wrong = |what: String| ImportError::Row {
            row: number,
            material,
            view,
            what,
        };
        if material >= specification.materials || view as usize >= views {
            return Err(wrong("the specification has no such image".to_owned()));
        }
        let done = row
            .completed_view()
            .map_err(|error| wrong(error.to_string()))?;
        let sampled = specification.material(material);
        let expected = Row::new(specification, hash, &sampled, view, &done);
        if let Some(column) = row.first_difference(&expected) {
            let value = |row: &Row| row.value(column.name).map(ToString::to_string);
            let (found, expected) = (value(&row), value(&expected));
            return Err(wrong(format!(
                "{} is {}, and the specification gives {}",
                column.name,
                found.unwrap_or_default(),
                expected.unwrap_or_default()
            )));
        }
        let path = row.value("path").map(ToString::to_string);
        let path = relative(&path.unwrap_or_default())
            .ok_or_else(|| wrong("its path leaves the folder of the manifest".to_owned()))?;
        let images = found.entry(material).or_default();
        if images.insert(view, Wanted { done, path }).is_some() {
            return Err(wrong("the image is in the manifest twice".to_owned()));
        }
        Ok(())
    })?;
    found
        .into_iter()
        .map(|(material, images)| {
            if images.len() == views {
                Ok((material, images.into_values().collect()))
            } else {
                Err(ImportError::Views {
                    material,
                    found: images.len(),
                    views,
                })
            }
        })
        .collect()
}

/// A path that stays below the folder that it is relative to.
fn relative(text: &str) -> Option<PathBuf> {
    let path = Path::new(text);
    let below = path
        .components()
        .all(|component| matches!(component, Component::Normal(_)));
    (below && !text.is_empty()).then(|| path.to_owned())
}

type TakeMaterial<'a> = dyn FnMut(u32, Vec<Vec<u8>>) -> Result<(), ImportError> + 'a;

/// Hands over the files of every material; nothing is checked but that they are there.
fn for_each_material(
    wanted: &WantedMaterials,
    folder: &Path,
    take: &mut TakeMaterial<'_>,
) -> Result<(), ImportError> {
    let mut shards: BTreeSet<&Path> = BTreeSet::new();
    for (&material, images) in wanted {
        let is_shard = |path: &Path| {
            let ending = path.extension().and_then(|ending| ending.to_str());
            matches!(ending, Some("tar" | "parquet"))
        };
        let in_shards = images.iter().filter(|image| is_shard(&image.path));
        if in_shards.clone().count() > 0 {
            shards.extend(in_shards.map(|image| image.path.as_path()));
            continue;
        }
        let files = images.iter().zip(0..).map(|(image, view)| {
            let path = folder.join(&image.path);
            read_file(&path, image.done.bytes).map_err(|what| ImportError::Image {
                path,
                material,
                view,
                what,
            })
        });
        take(material, files.collect::<Result<_, _>>()?)?;
    }
    let mut gathering = Gathering {
        wanted,
        parts: BTreeMap::new(),
    };
    for shard in shards {
        let path = folder.join(shard);
        if shard.extension().is_some_and(|ending| ending == "tar") {
            read_tar(&path, &mut gathering, take)?;
        } else {
            read_parquet(&path, &mut gathering, take)?;
        }
    }
    match gathering.parts.iter().next() {
        None => Ok(()),
        Some((&material, parts)) => {
            let missing = parts.iter().position(Option::is_none).unwrap_or_default();
            Err(ImportError::Image {
                path: folder.join(&wanted[&material][missing].path),
                material,
                view: missing as u32,
                what: "the image is missing".to_owned(),
            })
        }
    }
}

/// Reads a file that should have so many bytes, and at most one more.
fn read_file(path: &Path, bytes: u64) -> Result<Vec<u8>, String> {
    let mut content = Vec::new();
    File::open(path)
        .and_then(|file| file.take(bytes + 1).read_to_end(&mut content))
        .map_err(|error| error.to_string())?;
    Ok(content)
}

/// Materials whose images come one by one.
struct Gathering<'a> {
    wanted: &'a WantedMaterials,
    parts: BTreeMap<u32, Vec<Option<Vec<u8>>>>,
}

impl Gathering<'_> {
    /// The size of an image, where it is wanted.
    fn bytes(&self, material: u32, view: u32) -> Option<u64> {
        let image = self.wanted.get(&material)?.get(view as usize)?;
        Some(image.done.bytes)
    }

    /// Adds an image that is wanted; hands its material over when that was the last.
    fn add(
        &mut self,
        material: u32,
        view: u32,
        bytes: Vec<u8>,
        take: &mut TakeMaterial<'_>,
    ) -> Result<(), ImportError> {
        let views = self.wanted[&material].len();
        let parts = self
            .parts
            .entry(material)
            .or_insert_with(|| vec![None; views]);
        parts[view as usize] = Some(bytes);
        if parts.iter().all(Option::is_some) {
            let parts = self.parts.remove(&material).unwrap_or_default();
            take(material, parts.into_iter().flatten().collect())?;
        }
        Ok(())
    }
}

fn read_tar(
    path: &Path,
    gathering: &mut Gathering<'_>,
    take: &mut TakeMaterial<'_>,
) -> Result<(), ImportError> {
    let failed = |error: std::io::Error| ImportError::Shard {
        path: path.to_owned(),
        what: error.to_string(),
    };
    let file = File::open(path).map_err(unable("read", path))?;
    let mut archive = tar::Archive::new(file);
    for entry in archive.entries().map_err(failed)? {
        let entry = entry.map_err(failed)?;
        let name = String::from_utf8_lossy(&entry.path_bytes()).into_owned();
        let Some((material, view)) = image_of_member(&name) else {
            continue;
        };
        let Some(bytes) = gathering.bytes(material, view) else {
            continue;
        };
        let mut content = Vec::new();
        entry
            .take(bytes + 1)
            .read_to_end(&mut content)
            .map_err(failed)?;
        gathering.add(material, view, content, take)?;
    }
    Ok(())
}

/// The material and view of a member such as `000123.v05.exr`.
fn image_of_member(name: &str) -> Option<(u32, u32)> {
    let (material, rest) = name.split_once(".v")?;
    let view = rest.strip_suffix(".exr")?;
    Some((material.parse().ok()?, view.parse().ok()?))
}

fn read_parquet(
    path: &Path,
    gathering: &mut Gathering<'_>,
    take: &mut TakeMaterial<'_>,
) -> Result<(), ImportError> {
    let failed = |what: String| ImportError::Shard {
        path: path.to_owned(),
        what,
    };
    let file = File::open(path).map_err(unable("read", path))?;
    let builder = ParquetRecordBatchReaderBuilder::try_new(file)
        .map_err(|error| failed(error.to_string()))?;
    let columns = ["material", "view", "exr"];
    let mask = ProjectionMask::columns(builder.parquet_schema(), columns);
    let batches = builder
        .with_projection(mask)
        .with_batch_size(SHARD_BATCH_ROWS)
        .build()
        .map_err(|error| failed(error.to_string()))?;
    for batch in batches {
        let batch = batch.map_err(|error| failed(error.to_string()))?;
        let number = |name: &str| {
            let column = batch.column_by_name(name)?;
            column.as_any().downcast_ref::<UInt32Array>()
        };
        let files = batch.column_by_name("exr");
        let files = files.and_then(|column| column.as_any().downcast_ref::<BinaryArray>());
        let (Some(materials), Some(views), Some(files)) =
            (number("material"), number("view"), files)
        else {
            return Err(failed(format!("it has no columns {columns:?} of images")));
        };
        for place in 0..batch.num_rows() {
            let (material, view) = (materials.value(place), views.value(place));
            if gathering.bytes(material, view).is_some() && files.is_valid(place) {
                gathering.add(material, view, files.value(place).to_vec(), take)?;
            }
        }
    }
    Ok(())
}

/// An image with its file.
type Image = (Wanted, Vec<u8>);

/// Materials that are checked and stored together.
#[derive(Default)]
struct Batch {
    materials: Vec<(u32, Vec<Image>)>,
    bytes: u64,
}

impl Batch {
    fn images(&self) -> u64 {
        self.materials
            .iter()
            .map(|(_, images)| images.len() as u64)
            .sum()
    }

    fn add(&mut self, material: u32, wanted: &[Wanted], files: Vec<Vec<u8>>) {
        self.bytes += files.iter().map(|file| file.len() as u64).sum::<u64>();
        let images = wanted.iter().cloned().zip(files).collect();
        self.materials.push((material, images));
    }

    /// Checks all images and makes them durable; leaves the batch empty.
    fn store(
        &mut self,
        specification: &Specification,
        store: &mut Store,
        threads: usize,
    ) -> Result<(), ImportError> {
        self.check(specification, threads)?;
        let mut completions = Vec::with_capacity(self.materials.len());
        let mut images: Vec<(Digest, Vec<u8>)> = Vec::new();
        for (material, views) in self.materials.drain(..) {
            completions.push(Completion {
                material,
                views: views
                    .iter()
                    .map(|(wanted, _)| wanted.done.clone())
                    .collect(),
                seconds: 0.0,
                worker: WORKER.to_owned(),
            });
            images.extend(
                views
                    .into_iter()
                    .map(|(wanted, file)| (wanted.done.digest, file)),
            );
        }
        self.bytes = 0;
        Ok(store.put(&completions, &images)?)
    }

    fn check(&self, specification: &Specification, threads: usize) -> Result<(), ImportError> {
        let share = self.materials.len().div_ceil(threads.max(1)).max(1);
        let failure: Mutex<Option<ImportError>> = Mutex::new(None);
        thread::scope(|scope| {
            for part in self.materials.chunks(share) {
                let failure = &failure;
                scope.spawn(move || {
                    let checked = part
                        .iter()
                        .try_for_each(|(material, images)| check(specification, *material, images));
                    if let Err(error) = checked {
                        let mut failure = failure.lock().unwrap_or_else(|lock| lock.into_inner());
                        failure.get_or_insert(error);
                    }
                });
            }
        });
        let failure = failure
            .into_inner()
            .unwrap_or_else(|lock| lock.into_inner());
        failure.map_or(Ok(()), Err)
    }
}

fn check(
    specification: &Specification,
    material: u32,
    images: &[Image],
) -> Result<(), ImportError> {
    let expected = expected_headers(specification, specification.hash(), material);
    for ((wanted, file), header) in images.iter().zip(&expected) {
        let wrong = |what: String| ImportError::Image {
            path: wanted.path.clone(),
            material,
            view: header.view,
            what,
        };
        if file.len() as u64 != wanted.done.bytes {
            return Err(wrong(format!("it has not {} bytes", wanted.done.bytes)));
        }
        check_digest(file, wanted.done.digest)
            .and_then(|()| inspect(file, &specification.image))
            .and_then(|found| check_identity(&found, header))
            .map_err(|rejection| wrong(rejection.to_string()))?;
    }
    Ok(())
}

//! A manifest and its images into a store, checked on the way in.
//!
//! Every row has to be the one that the specification gives for its image, column by column, and
//! every image has to be what its row says: size, digest, pixels, header. Whole materials come in,
//! and a store that has some of them already takes the rest.

mod batch;
mod images;
mod mesh;
mod source;

use crate::manifest::read::{ReadError, read};
use batch::Batch;
use dataset::{
    CompletedView, Specification,
    manifest::Row,
    specification::{Image, Pixel},
};
use datastore::{BlobsPlace, ReadOnlyStore, StoreError, StoreName, WritableStore};
pub use images::TakeMaterial;
use images::for_each_material;
use imagestore::FileError;
use limits::IMAGE_OVERHEAD_BYTES_MAX;
pub use source::Source;
use std::{
    collections::BTreeMap,
    path::{Component, Path, PathBuf},
};
use thiserror::Error;

/// Bytes of images that are checked and made durable together.
const BATCH_BYTES: u64 = 64 << 20;

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
    /// The store has the material already, and other images of it.
    #[error(
        "the store has other images of material {0} than the manifest: verify both, or choose \
         another store"
    )]
    Conflict(u32),
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
    /// The mesh of the sample is absent, or is not the one that the specification names.
    #[error(
        "{}: the mesh of the sample cannot be used: {reason}; put back this file, which every export of \
         the dataset has, or export the dataset again, or give the specification that it was made with, \
         beside the mesh (--spec)",
        path.display()
    )]
    Mesh {
        /// Its file, or where that should be.
        path: PathBuf,
        /// What is wrong.
        reason: String,
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

/// Imports the images that a manifest names, relative to `source`, into the store `name`, which is
/// made where there is none, with its images in `blobs` if that is given. `progress` is told how
/// many images are in, of how many. A mesh that the specification names and has not loaded is that of
/// `source`.
///
/// # Errors
/// Where the mesh is not there or is another, before a store is made. At the first row or image that is
/// wrong; what came in before stays, and the same call goes on.
pub fn import(
    specification: &Specification,
    manifest: &Path,
    source: &Source,
    name: impl Into<StoreName>,
    blobs: Option<&BlobsPlace>,
    threads: usize,
    progress: &dyn Fn(u64, u64),
) -> Result<Imported, ImportError> {
    let specification = &mesh::load(specification, source)?;
    let mut wanted = read_manifest(specification, manifest)?;
    let mut store = WritableStore::open_or_create(name, specification, blobs)?;
    let mut imported = Imported {
        materials_there: drop_what_is_there(&store.read()?, &mut wanted)?,
        ..Imported::default()
    };
    let total = wanted.values().map(|images| images.len() as u64).sum();
    let mut batch = Batch::default();
    let mut images_done = 0;
    let mut flush = |batch: &mut Batch| -> Result<(), ImportError> {
        images_done += batch.images();
        let added = batch.store(specification, &mut store, threads)?;
        imported.materials += added.materials;
        imported.images += added.images;
        imported.materials_there += added.materials_there;
        progress(images_done, total);
        Ok(())
    };
    for_each_material(&wanted, source, &mut |material, bytes| {
        batch.add(material, &wanted[&material], bytes);
        if batch.bytes >= BATCH_BYTES {
            flush(&mut batch)?;
        }
        Ok(())
    })?;
    flush(&mut batch)?;
    Ok(imported)
}

/// Reads a manifest and the files of the images that it names, and hands each material's over in
/// the order of views: what [`import`] does before it compares images with their rows.
///
/// # Errors
/// At the first row that is wrong or image that is absent, or when `take` fails.
pub fn read_images(
    specification: &Specification,
    manifest: &Path,
    source: &Source,
    take: &mut TakeMaterial<'_>,
) -> Result<(), ImportError> {
    let wanted = read_manifest(specification, manifest)?;
    for_each_material(&wanted, source, take)
}

/// Drops the materials that a store has already, and counts them.
fn drop_what_is_there(
    store: &ReadOnlyStore,
    wanted: &mut WantedMaterials,
) -> Result<u32, ImportError> {
    let before = wanted.len();
    for material in store.materials_complete() {
        let Some(images) = wanted.get(&material) else {
            continue;
        };
        let Some(there) = store.completion(material)? else {
            continue;
        };
        let mut pairs = there.views.iter().zip(images);
        let same = pairs.all(|(view, image)| view.agrees_with(&image.done));
        if there.views.len() != images.len() || !same {
            return Err(ImportError::Conflict(material));
        }
        wanted.remove(&material);
    }
    Ok((before - wanted.len()) as u32)
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
    let bytes_max = image_bytes_max(&specification.image);
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
        if done.bytes > bytes_max {
            return Err(wrong(format!(
                "no image of this film has {} bytes",
                done.bytes
            )));
        }
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

/// The largest file that an image can be: what does not compress is stored as it is.
fn image_bytes_max(film: &Image) -> u64 {
    let sample_bytes = match film.pixel {
        Pixel::Half => 2,
        Pixel::Float => 4,
    };
    3 * sample_bytes * u64::from(film.width) * u64::from(film.height) + IMAGE_OVERHEAD_BYTES_MAX
}

/// A path that stays below the folder that it is relative to.
fn relative(text: &str) -> Option<PathBuf> {
    let path = Path::new(text);
    let below = path
        .components()
        .all(|component| matches!(component, Component::Normal(_)));
    (below && !text.is_empty()).then(|| path.to_owned())
}

//! Images and metadata laid out so that stock loaders open them.
//!
//! | layout | images |
//! | --- | --- |
//! | files | `train/000123/v05.exr` |
//! | WebDataset | `train/train-000000.tar` with members `000123.v05.exr` and `000123.v05.json` |
//! | Hugging Face | `train/train-00000-of-00007.parquet` with labels and the files' bytes |
//!
//! Every layout has `manifest.parquet`, `specification.toml`, a dataset card (`README.md`) with
//! plots and `croissant.json` beside its folders of splits, and `DIGEST.mesh` where the sample is a
//! mesh: `specification.toml` names it by that digest, and so can be read from the export.
//!
//! An export is made of units, shards or folders of one material, that are there whole or not at
//! all; `export.json` says what the export is to be and goes first, the manifest goes last. So the
//! same command again goes on where it was stopped, and another one is refused.
//!
//! A bucket takes an export as a folder does. Shards are sent part by part while they are made, and
//! what of one was sent when it was stopped is no object: it is made again.

mod files;
mod huggingface;
mod place;
mod plan;
pub(crate) mod unit;
mod webdataset;

use crate::{
    card::{self, Publication},
    error::ExportError,
    file::{unable, write_bytes},
    manifest::{Exported, Format, export_chosen},
    product::{Factory, Kind, Product, Products},
    selection::{Chosen, ChosenImage, Selection},
};
use dataset::{CompletedView, Specification};
use datastore::ReadOnlyStore;
use plan::Plan;
use std::{
    cell::Cell,
    env,
    fs::{self, File},
    path::Path,
    sync::{
        Mutex, PoisonError,
        atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering},
    },
    thread,
};

pub use place::Place;
pub use unit::{Layout, Unit};

/// Bytes of a shard, about, unless asked for otherwise.
pub const SHARD_BYTES: u64 = 1_000_000_000;

/// What describes an export, beside the mesh of its sample, which comes first; the manifest last.
const DESCRIPTIONS: [&str; 6] = [
    "specification.toml",
    "examples.png",
    "parameters.svg",
    "README.md",
    "croissant.json",
    "manifest.parquet",
];

/// Room that metadata and the file system want beside the images.
const SPARE_BYTES: u64 = 64 << 20;

/// What is to be exported, and how.
#[derive(Clone, Debug)]
pub struct Options {
    /// How it is laid out.
    pub layout: Layout,
    /// Which images.
    pub selection: Selection,
    /// What is made of each.
    pub products: Products,
    /// Bytes of a shard, about: one has at least a material.
    pub shard_bytes: u64,
    /// Threads, at least one.
    pub threads: usize,
    /// What the dataset card says of the publication.
    pub publication: Publication,
    /// Whether another export in the same folder is replaced.
    pub overwrite: bool,
}

/// Exports a store into a folder or a bucket. `progress` is told, from any thread, how many images
/// are there. `examples` is the picture that the card shows, a PNG file.
///
/// # Errors
/// Refuses a store that is not complete unless `partial`, a folder that holds something else (another
/// export unless `overwrite`), and a disk with too little room. Whatever it ends with, the same call goes on from there.
pub fn export(
    store: &ReadOnlyStore,
    options: &Options,
    examples: &[u8],
    place: impl Into<Place>,
    progress: &(dyn Fn(u64) + Sync),
) -> Result<Exported, ExportError> {
    let place = place.into();
    let chosen = options.selection.choose(store)?;
    if chosen.images() == 0 {
        return Err(ExportError::Nothing);
    }
    let work = Work {
        factory: Factory::new(store.specification(), &chosen.views, &options.products)?,
        kinds: options.products.kinds(),
        store,
        place: &place,
        chosen,
        layout: options.layout,
    };
    let plan = Plan::new(&work, options)?;
    plan.claim(&place, options.overwrite)?;
    let undone = work.undone(&plan)?;
    if let Place::Folder(folder) = &place {
        let mesh = store.specification().sample.loaded_mesh();
        let mesh_bytes = mesh.map_or(0, |mesh| mesh.bytes().len() as u64);
        check_room(folder, SPARE_BYTES + mesh_bytes, &undone)?;
    }
    let images: u64 = undone.iter().map(|unit| work.images_of(unit)).sum();
    let there = AtomicU64::new(work.chosen.images() - images);
    progress(there.load(Ordering::Relaxed));
    let tell = || progress(there.fetch_add(1, Ordering::Relaxed) + 1);
    work.run(&undone, options.threads, &tell)?;
    match &place {
        Place::Folder(folder) => {
            sync_file_system(folder)?;
            let exported = work.finish(&plan, options, examples, folder)?;
            sync_file_system(folder)?;
            Ok(exported)
        }
        Place::Bucket(_) => {
            let scratch = env::temp_dir();
            let scratch = tempfile::tempdir().map_err(unable("make a folder in", &scratch))?;
            work.finish(&plan, options, examples, scratch.path())
        }
    }
}

/// One export under way.
struct Work<'a> {
    store: &'a ReadOnlyStore,
    chosen: Chosen,
    factory: Factory,
    kinds: Vec<Kind>,
    layout: Layout,
    place: &'a Place,
}

impl Work<'_> {
    fn images_of(&self, unit: &Unit) -> u64 {
        unit.materials.len() as u64 * self.chosen.views.len() as u64
    }

    /// The units that are not there yet.
    fn undone<'a>(&self, plan: &'a Plan) -> Result<Vec<&'a Unit>, ExportError> {
        let mut undone = Vec::new();
        let objects = self.place.objects()?;
        for unit in &plan.units {
            let there = match (self.layout, self.place) {
                (Layout::Files { .. }, Place::Folder(folder)) => {
                    files::is_there(self, unit, folder)?
                }
                (Layout::Files { .. }, Place::Bucket(_)) => {
                    files::are_objects(self, unit, &objects)?
                }
                (_, Place::Folder(folder)) => folder.join(&unit.path).is_file(),
                (_, Place::Bucket(_)) => objects.contains_key(&unit.path),
            };
            if !there {
                undone.push(unit);
            }
        }
        Ok(undone)
    }

    /// Makes units, several at a time; the first error stops all.
    fn run(
        &self,
        units: &[&Unit],
        threads: usize,
        tell: &(dyn Fn() + Sync),
    ) -> Result<(), ExportError> {
        let next = AtomicUsize::new(0);
        let stopped = AtomicBool::new(false);
        let failure = Mutex::new(None);
        let work = || {
            while !stopped.load(Ordering::Relaxed) {
                let Some(unit) = units.get(next.fetch_add(1, Ordering::Relaxed)) else {
                    return;
                };
                if let Err(error) = self.make(unit, tell) {
                    stopped.store(true, Ordering::Relaxed);
                    let mut failure = failure.lock().unwrap_or_else(PoisonError::into_inner);
                    failure.get_or_insert(error);
                }
            }
        };
        thread::scope(|scope| {
            for _ in 1..threads.min(units.len()) {
                scope.spawn(work);
            }
            work();
        });
        let failure = failure.into_inner();
        failure
            .unwrap_or_else(PoisonError::into_inner)
            .map_or(Ok(()), Err)
    }

    fn make(&self, unit: &Unit, tell: &(dyn Fn() + Sync)) -> Result<(), ExportError> {
        match self.layout {
            Layout::Files { links } => files::write(self, unit, links, tell),
            Layout::WebDataset => webdataset::write(self, unit, tell),
            Layout::HuggingFace => huggingface::write(self, unit, tell),
        }
    }

    /// The images of a material of a unit, their rows with the place where they are going.
    fn images(&self, unit: &Unit, material: u32) -> Result<Vec<ChosenImage>, ExportError> {
        let images = self.chosen.images_of(self.store, material)?.into_iter();
        let images = images.map(|image| {
            let path = self.layout.image_path(&unit.path, image.view);
            ChosenImage {
                row: image.row.with_path(path),
                ..image
            }
        });
        Ok(images.collect())
    }

    /// Hands out the images of a material of a unit with all that is made of each.
    fn each_image(
        &self,
        unit: &Unit,
        material: u32,
        mut take: impl FnMut(&ChosenImage, Vec<Product>) -> Result<(), ExportError>,
    ) -> Result<(), ExportError> {
        let images = self.images(unit, material)?;
        let files: Vec<CompletedView> = images.iter().map(|image| image.done.clone()).collect();
        for (image, read) in images.iter().zip(self.store.read_images(&files)) {
            take(image, self.factory.make(self.store, image, read)?)?;
        }
        Ok(())
    }

    /// Writes what describes the export, the manifest last; in `folder` first, where the export
    /// goes to a bucket.
    fn finish(
        &self,
        plan: &Plan,
        options: &Options,
        examples: &[u8],
        folder: &Path,
    ) -> Result<Exported, ExportError> {
        let specification = self.store.specification();
        let mesh = write_mesh(specification, folder)?;
        write_bytes(
            &folder.join("specification.toml"),
            specification.to_toml().as_bytes(),
        )?;
        write_bytes(&folder.join("examples.png"), examples)?;
        let manifest = folder.join("manifest.parquet");
        // Written beside first: its digest is part of what describes the export.
        let whole = folder.join("manifest.parquet.whole");
        let unit_of = plan.units_by_material();
        let within_target = Cell::new(0.0);
        let exported = export_chosen(
            self.store,
            &self.chosen,
            Format::Parquet,
            &whole,
            |material, image| {
                within_target.set(within_target.get() + image.done.statistics.within_target);
                let path = unit_of.get(&material).copied().unwrap_or_default();
                image
                    .row
                    .with_path(self.layout.image_path(path, image.view))
            },
        )?;
        let described = card::Described {
            store: self.store,
            chosen: &self.chosen,
            products: &options.products,
            layout: self.layout,
            shards: &plan.units,
            publication: &options.publication,
            within_target: within_target.get() / (exported.rows.max(1) as f64),
        };
        card::write(&described, folder, &whole)?;
        fs::rename(&whole, &manifest).map_err(unable("rename to", &manifest))?;
        let names = mesh.as_deref().into_iter().chain(DESCRIPTIONS);
        self.place.take(folder, &names.collect::<Vec<_>>())?;
        Ok(exported)
    }
}

/// Writes the mesh of the sample, where that is one, and returns the name of its file. The
/// specification follows: whatever names the mesh finds it.
fn write_mesh(specification: &Specification, folder: &Path) -> Result<Option<String>, ExportError> {
    let named = specification.sample.mesh.as_ref();
    let Some((mesh, loaded)) = named.and_then(|mesh| Some((mesh, mesh.loaded()?))) else {
        return Ok(None);
    };
    let name = mesh.file_name();
    write_bytes(&folder.join(&name), loaded.bytes())?;
    Ok(Some(name))
}

fn check_room(folder: &Path, spare_bytes: u64, undone: &[&Unit]) -> Result<(), ExportError> {
    let needed_bytes = spare_bytes + undone.iter().map(|unit| unit.bytes_max).sum::<u64>();
    let room = rustix::fs::statvfs(folder)
        .map_err(|error| unable("ask for room on the disk of", folder)(error.into()))?;
    let free_bytes = room.f_bavail.saturating_mul(room.f_frsize);
    if free_bytes < needed_bytes {
        return Err(ExportError::DiskFull {
            folder: folder.to_owned(),
            needed_bytes,
            free_bytes,
        });
    }
    Ok(())
}

fn sync_file_system(folder: &Path) -> Result<(), ExportError> {
    let synced = File::open(folder).and_then(|folder| Ok(rustix::fs::syncfs(folder)?));
    Ok(synced.map_err(unable("sync the file system of", folder))?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use dataset::Split;

    #[test]
    fn a_disk_with_too_little_room_is_refused_before_anything_is_written() {
        let folder = tempfile::tempdir().unwrap();
        let unit = |bytes_max| Unit {
            path: "train/000000".to_owned(),
            split: Split::Train,
            materials: vec![0],
            bytes_max,
        };
        let (small, huge) = (unit(1), unit(1 << 60));
        check_room(folder.path(), SPARE_BYTES, &[&small, &small]).unwrap();
        let refused = check_room(folder.path(), SPARE_BYTES, &[&small, &huge]).unwrap_err();
        assert!(matches!(
            refused,
            ExportError::DiskFull { needed_bytes, free_bytes, .. }
                if needed_bytes > huge.bytes_max && free_bytes < needed_bytes
        ));
    }
}

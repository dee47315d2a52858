//! Images and metadata laid out so that stock loaders open them.
//!
//! | layout | images |
//! | --- | --- |
//! | files | `train/000123/v05.exr` |
//! | WebDataset | `train/train-000000.tar` with members `000123.v05.exr` and `000123.v05.json` |
//! | Hugging Face | `train/train-00000-of-00007.parquet` with labels and the files' bytes |
//!
//! Every layout has `manifest.parquet`, `specification.toml`, a dataset card (`README.md`) with
//! plots and `croissant.json` beside its folders of splits.
//!
//! An export is made of units, shards or folders of one material, that are there whole or not at
//! all; `export.json` says what the export is to be and goes first, the manifest goes last. So the
//! same command again goes on where it was stopped, and another one is refused.

mod files;
mod huggingface;
mod plan;
mod webdataset;

use crate::{
    card::{self, Publication},
    error::ExportError,
    file::{unable, write_bytes},
    manifest::{Exported, Format, export_chosen},
    product::{Factory, Kind, Products},
    selection::{Chosen, ChosenImage, Selection},
};
use coordinator::ReadOnlyStore;
use plan::Plan;
use std::{
    fs::{self, File},
    path::Path,
    sync::{
        Mutex, PoisonError,
        atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering},
    },
    thread,
};

pub(crate) use huggingface::column_name;
pub use plan::{Layout, Unit};

/// Bytes of a shard, about, unless asked for otherwise.
pub const SHARD_BYTES: u64 = 1_000_000_000;

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
}

/// Exports a store into a folder. `progress` is told, from any thread, how many images are there.
/// `examples` is the picture that the card shows, a PNG file.
///
/// # Errors
/// Refuses a store that is not complete unless `partial`, a folder that holds something else, and a
/// disk with too little room. Whatever it ends with, the same call goes on from there.
pub fn export(
    store: &ReadOnlyStore,
    options: &Options,
    examples: &[u8],
    folder: &Path,
    progress: &(dyn Fn(u64) + Sync),
) -> Result<Exported, ExportError> {
    let chosen = options.selection.choose(store)?;
    if chosen.images() == 0 {
        return Err(ExportError::Nothing);
    }
    let work = Work {
        factory: Factory::new(store.specification(), &chosen.views, &options.products)?,
        kinds: options.products.kinds(),
        store,
        folder,
        chosen,
        layout: options.layout,
    };
    let plan = Plan::new(&work, options)?;
    plan.claim(folder)?;
    let undone = work.undone(&plan)?;
    check_room(folder, &undone)?;
    let images: u64 = undone.iter().map(|unit| work.images_of(unit)).sum();
    let there = AtomicU64::new(work.chosen.images() - images);
    progress(there.load(Ordering::Relaxed));
    let tell = || progress(there.fetch_add(1, Ordering::Relaxed) + 1);
    work.run(&undone, options.threads, &tell)?;
    sync_file_system(folder)?;
    let exported = work.finish(&plan, options, examples)?;
    sync_file_system(folder)?;
    Ok(exported)
}

/// One export under way.
struct Work<'a> {
    store: &'a ReadOnlyStore,
    chosen: Chosen,
    factory: Factory,
    kinds: Vec<Kind>,
    layout: Layout,
    folder: &'a Path,
}

impl Work<'_> {
    fn images_of(&self, unit: &Unit) -> u64 {
        unit.materials.len() as u64 * self.chosen.views.len() as u64
    }

    /// The units that are not there yet.
    fn undone<'a>(&self, plan: &'a Plan) -> Result<Vec<&'a Unit>, ExportError> {
        let mut undone = Vec::new();
        for unit in &plan.units {
            let there = match self.layout {
                Layout::Files { .. } => files::is_there(self, unit)?,
                Layout::WebDataset | Layout::HuggingFace => self.folder.join(&unit.path).is_file(),
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
        let path = self.folder.join(&unit.path);
        if let Some(parent) = path.parent() {
            fs::create_dir_all(parent).map_err(unable("make", parent))?;
        }
        match self.layout {
            Layout::Files { links } => files::write(self, unit, &path, links, tell),
            Layout::WebDataset => webdataset::write(self, unit, &path, tell),
            Layout::HuggingFace => huggingface::write(self, unit, &path, tell),
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

    /// Writes what describes the export; the manifest last.
    fn finish(
        &self,
        plan: &Plan,
        options: &Options,
        examples: &[u8],
    ) -> Result<Exported, ExportError> {
        let specification = self.store.specification();
        write_bytes(
            &self.folder.join("specification.toml"),
            specification.to_toml().as_bytes(),
        )?;
        write_bytes(&self.folder.join("examples.png"), examples)?;
        let manifest = self.folder.join("manifest.parquet");
        // Written beside first: its digest is part of what describes the export.
        let whole = self.folder.join("manifest.parquet.whole");
        let unit_of = plan.units_by_material();
        let exported = export_chosen(
            self.store,
            &self.chosen,
            Format::Parquet,
            &whole,
            |material, image| {
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
        };
        card::write(&described, self.folder, &whole)?;
        fs::rename(&whole, &manifest).map_err(unable("rename to", &manifest))?;
        Ok(exported)
    }
}

fn check_room(folder: &Path, undone: &[&Unit]) -> Result<(), ExportError> {
    let needed_bytes = SPARE_BYTES + undone.iter().map(|unit| unit.bytes_max).sum::<u64>();
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
        check_room(folder.path(), &[&small, &small]).unwrap();
        let refused = check_room(folder.path(), &[&small, &huge]).unwrap_err();
        assert!(matches!(
            refused,
            ExportError::DiskFull { needed_bytes, free_bytes, .. }
                if needed_bytes > huge.bytes_max && free_bytes < needed_bytes
        ));
    }
}

//! `brdfarm dataset import`.

use super::{StoreOptions, export::place};
use crate::failure::BadInput;
use crate::plural::count;
use crate::{cores, progress};
use clap::Args;
use dataset::Specification;
use datastore::BlobsPlace;
use export::import::{Source, import};
use export::layout::Place;
use export::manifest::{Format, read::read_specification};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// Check a manifest and its images, and put them into a store
///
/// DIR is an export of any layout, or any folder with a manifest and the images that it names. It can
/// also be a place in a bucket, such as s3://BUCKET/PREFIX. Every row is compared with the
/// specification, and every image with its row; a mesh is compared with its digest. A store that does
/// not exist is made; materials that an existing store has are not replaced.
#[derive(Debug, Args)]
pub struct Options {
    /// The folder that the manifest's paths are relative to
    #[arg(value_name = "DIR|URL")]
    folder: PathBuf,
    #[command(flatten)]
    store: StoreOptions,
    /// Where to keep images of a new store instead of in its folder, as in s3://BUCKET/PREFIX; if
    /// --store is a database, also a folder
    #[arg(long, value_name = "URL|DIR")]
    blobs: Option<BlobsPlace>,
    /// The manifest [default: manifest.parquet in DIR]
    #[arg(long, value_name = "FILE")]
    manifest: Option<PathBuf>,
    /// The specification [default: the one inside a Parquet manifest, or specification.toml in DIR]
    #[arg(long, value_name = "FILE")]
    spec: Option<PathBuf>,
    /// Threads; 0 takes one for each core
    #[arg(long, default_value_t = 0, value_name = "N",
          value_parser = clap::value_parser!(u64).range(..=cores::COUNT_MAX))]
    threads: u64,
}

/// The specification that an export in CSV or JSON Lines has beside it, at `path` on this machine. Its
/// mesh is beside it in a folder; that of a bucket is left to the import.
fn own_specification(source: &Source, path: &Path) -> anyhow::Result<Specification> {
    Ok(match source {
        Source::Folder(_) => Specification::load(path)?,
        Source::Bucket(_) => Specification::load_without_mesh(path)?,
    })
}

/// Imports.
pub fn execute(options: &Options) -> anyhow::Result<()> {
    let source = match place(&options.folder)? {
        Place::Folder(folder) => Source::Folder(folder),
        Place::Bucket(bucket) => Source::Bucket(bucket),
    };
    // Lives to the end: what is read more than once, or by its name, is fetched into it.
    let scratch = tempfile::tempdir()?;
    let fetch = |name: &str| source.fetch(Path::new(name), scratch.path());
    let manifest = match &options.manifest {
        Some(path) => path.clone(),
        None => fetch("manifest.parquet")?,
    };
    let format = Format::of(&manifest).map_err(|error| BadInput(error.to_string()))?;
    let specification = match (&options.spec, format) {
        (Some(path), _) => Specification::load(path)?,
        (None, Format::Parquet) => {
            read_specification(&manifest).map_err(|error| BadInput(error.to_string()))?
        }
        (None, _) => own_specification(&source, &fetch("specification.toml")?)?,
    };
    let bar = progress::bar(0, "images imported");
    let imported = import(
        &specification,
        &manifest,
        &source,
        &options.store.store,
        options.blobs.as_ref(),
        cores::count(options.threads),
        &|images, total| {
            bar.set_length(total);
            bar.set_position(images);
        },
    );
    bar.finish_and_clear();
    let imported = imported?;
    let mut out = io::stdout();
    write!(
        out,
        "{}: {} of {} imported",
        options.store.store,
        count(imported.images, "image"),
        count(imported.materials, "material")
    )?;
    if imported.materials_there > 0 {
        let there = count(imported.materials_there, "material");
        write!(out, ", {there} there before")?;
    }
    writeln!(out)?;
    Ok(())
}

//! `brdfarm dataset gc`.

use super::StoreOptions;
use crate::plural::count;
use clap::Args;
use datastore::garbage::{Unnamed, remove_unnamed, unnamed};
use datastore::{ReadOnlyStore, WritableStore};
use std::io::{self, Write};

/// List the images that no completed material names, or remove them
///
/// Interrupted or replaced completions leave such files behind. Without --delete nothing is changed.
/// Files whose names are not those of images are listed and never removed. With a database nothing is
/// removed while a worker has a lease, because its images may be about to be named.
#[derive(Debug, Args)]
pub struct Options {
    #[command(flatten)]
    store: StoreOptions,
    /// Remove them. If the store is a folder, no coordinator may be using it
    #[arg(long)]
    delete: bool,
}

/// Lists or removes them.
pub fn execute(options: &Options) -> anyhow::Result<()> {
    let name = &options.store.store;
    let mut out = io::stdout();
    if options.delete {
        let removed = remove_unnamed(&mut WritableStore::open(name)?)?;
        let bytes: u64 = removed.iter().map(|file| file.bytes).sum();
        for file in &removed {
            writeln!(out, "{}", file.path.display())?;
        }
        writeln!(
            out,
            "removed {}, {:.1} MB",
            count(removed.len() as u64, "image"),
            bytes as f64 / 1e6
        )?;
        return Ok(());
    }
    let (images, others): (Vec<_>, Vec<_>) = unnamed(&ReadOnlyStore::open(name)?)?
        .into_iter()
        .partition(Unnamed::is_image);
    for file in &images {
        writeln!(out, "{}", file.path.display())?;
    }
    for file in &others {
        writeln!(out, "{} (no image; it stays)", file.path.display())?;
    }
    let bytes: u64 = images.iter().map(|file| file.bytes).sum();
    writeln!(
        out,
        "--delete would remove {}, {:.1} MB",
        count(images.len() as u64, "image"),
        bytes as f64 / 1e6
    )?;
    Ok(())
}

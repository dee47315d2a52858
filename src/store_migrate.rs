//! `brdfarm store migrate`.

use crate::plural::count;
use crate::{progress, store_name};
use clap::{Args, Subcommand};
use datastore::{BlobsPlace, StoreName};
use migrate::migrate;
use serde_json::json;
use std::io::{self, Write};

/// What can be done with a store as a whole.
#[derive(Debug, Subcommand)]
pub enum Command {
    Migrate(Options),
}

/// Copy a store into another: folder or database, images in a folder or a bucket
///
/// Copies the specification, the labels, the images, and the history of each job and worker, but no
/// leases. No coordinator or worker may be using either store. Every image is checked when it is read,
/// and read back after it is written; in the end all records are compared. If the command is stopped,
/// give it again to resume. Until it is done no other command opens the copy. FROM stays as it is.
#[derive(Debug, Args)]
pub struct Options {
    /// The store to copy
    #[arg(value_name = store_name::VALUE, value_parser = store_name::parser())]
    from: StoreName,
    /// The copy: an empty or a new folder, an empty database, or an unfinished copy to resume
    #[arg(value_name = store_name::VALUE, value_parser = store_name::parser())]
    to: StoreName,
    /// Where to keep images of the copy: s3://BUCKET/PREFIX, gs://BUCKET/PREFIX or
    /// az://CONTAINER/PREFIX; for a database, also a folder [default: in the folder of the copy]
    #[arg(long, value_name = "URL|DIR")]
    blobs: Option<BlobsPlace>,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

/// Copies.
pub fn execute(Command::Migrate(options): &Command) -> anyhow::Result<()> {
    let Options {
        from,
        to,
        blobs,
        json,
    } = options;
    let bar = progress::bar(0, "images copied");
    let migrated = migrate(from, to, blobs.as_ref(), &|images, total| {
        bar.set_length(total);
        bar.set_position(images);
    });
    bar.finish_and_clear();
    let migrated = migrated?;
    let mut out = io::stdout();
    if *json {
        let told = json!({
            "materials": migrated.materials,
            "images": migrated.images,
            "jobs": migrated.jobs,
            "workers": migrated.workers,
            "images_written": migrated.images_written,
            "bytes_written": migrated.bytes_written,
        });
        serde_json::to_writer_pretty(&mut out, &told)?;
        writeln!(out)?;
        return Ok(());
    }
    writeln!(
        out,
        "{to}: {} of {}, {:.1} MB of them written now; {} and {} with a history; equal to {from}",
        count(migrated.images, "image"),
        count(migrated.materials, "material"),
        migrated.bytes_written as f64 / 1e6,
        count(migrated.jobs, "job"),
        count(migrated.workers, "worker"),
    )?;
    Ok(())
}

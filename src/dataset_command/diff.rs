//! `brdfarm dataset diff`.

use crate::plural::count;
use clap::Args;
use datastore::StoreName;
use export::diff::diff;
use export::file::write_bytes;
use std::io::{self, Write};
use std::path::PathBuf;

/// Compare two stores or manifests: labels, digests, pixels
///
/// Ends with 0 where both are the same set and with 1 where they differ. Pixels are compared where
/// both are stores: the relative MSE of an image is the mean of (b - a)^2 / (a^2 + 1e-4) over
/// pixels and channels, in units of white.
#[derive(Debug, Args)]
pub struct Options {
    /// A store, by its folder or its database's URL, or a manifest (.parquet, .csv, .jsonl)
    a: PathBuf,
    /// Another
    b: PathBuf,
    /// Write what differs as JSON
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
}

/// Compares.
pub fn execute(options: &Options) -> anyhow::Result<()> {
    let found = diff(&options.a, &options.b)?;
    if let Some(path) = &options.report {
        let mut json = serde_json::to_vec_pretty(&found)?;
        json.push(b'\n');
        write_bytes(path, &json)?;
    }
    let mut out = io::stdout();
    writeln!(out, "{} in both", count(found.in_both, "image"))?;
    for (images, side) in [(found.only_in_a, &options.a), (found.only_in_b, &options.b)] {
        if images > 0 {
            let side = StoreName::new(side);
            writeln!(out, "{} only in {side}", count(images, "image"))?;
        }
    }
    for (column, rows) in &found.columns {
        writeln!(out, "{} differ first in {column}", count(*rows, "row"))?;
    }
    if let Some(mean) = found.relative_mse_mean {
        let images = count(found.digests_differ, "image");
        writeln!(
            out,
            "{images} differ in pixels: relative MSE {mean:.3e} in the mean; worst"
        )?;
        for image in &found.worst {
            writeln!(
                out,
                "  material {}, view {}: {:.3e}",
                image.material, image.view, image.relative_mse
            )?;
        }
    }
    anyhow::ensure!(found.is_empty(), "the two differ");
    Ok(())
}

//! `brdfarm dataset stats`.

use super::StoreOptions;
use crate::progress;
use clap::Args;
use dataset::condition::Condition;
use datastore::ReadOnlyStore;
use export::statistics::{Statistics, statistics};
use std::io::{self, Write};

/// Show statistics of a store
///
/// Counts, sizes, the spread of the ten parameters, errors and cost of each view, over the
/// materials that are complete.
#[derive(Debug, Args)]
pub struct Options {
    #[command(flatten)]
    store: StoreOptions,
    /// Only materials whose labels satisfy this condition, as in "roughness < 20 and split == 'train'".
    /// `brdfarm dataset export --help` lists the labels
    #[arg(long = "where", value_name = "CONDITION")]
    condition: Option<Condition>,
    /// Also read all images and show their brightness
    #[arg(long)]
    pixels: bool,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

/// Counts and prints.
pub fn execute(options: &Options) -> anyhow::Result<()> {
    let store = ReadOnlyStore::open(&options.store.store)?;
    let bar = progress::bar(store.specification().materials.into(), "materials counted");
    let found = statistics(
        &store,
        options.condition.clone(),
        options.pixels,
        &|materials| bar.set_position(materials),
    );
    bar.finish_and_clear();
    let found = found?;
    let mut out = io::stdout();
    if options.json {
        serde_json::to_writer_pretty(&mut out, &found)?;
        writeln!(out)?;
    } else {
        print(&found, &mut out)?;
    }
    Ok(())
}

fn print(found: &Statistics, out: &mut impl Write) -> io::Result<()> {
    writeln!(out, "dataset        {}", found.dataset)?;
    writeln!(out, "specification  {}", found.specification)?;
    writeln!(out, "renderer       version {}", found.renderer_version)?;
    writeln!(
        out,
        "materials      {} of {} complete",
        found.materials_complete, found.materials
    )?;
    writeln!(
        out,
        "images         {}, {:.1} MB",
        found.images,
        found.bytes as f64 / 1e6
    )?;
    let splits = found
        .splits
        .iter()
        .map(|(split, count)| format!("{count} {split}"));
    writeln!(
        out,
        "splits         {}",
        splits.collect::<Vec<_>>().join(", ")
    )?;
    writeln!(out, "\nparameter       least     mean  greatest")?;
    for spread in &found.parameters {
        writeln!(
            out,
            "{:<12} {:>8.3} {:>8.3} {:>9.3}",
            spread.name, spread.least, spread.mean, spread.greatest
        )?;
    }
    write!(
        out,
        "\nview      kB  error mean  error max  in target       cost"
    )?;
    let bright = found.views.iter().any(|view| view.brightness.is_some());
    writeln!(
        out,
        "{}",
        if bright {
            "    dark  above 1  brightest"
        } else {
            ""
        }
    )?;
    for view in &found.views {
        write!(
            out,
            "{:>4} {:>7.1} {:>11.2e} {:>10.2e} {:>9.2}% {:>10.3e}",
            view.view,
            view.bytes_mean / 1e3,
            view.error_mean,
            view.error_max,
            100.0 * view.within_target,
            view.cost_mean
        )?;
        if let Some(brightness) = view.brightness {
            write!(
                out,
                " {:>6.1}% {:>7.1}% {:>10.3}",
                100.0 * brightness.dark,
                100.0 * brightness.above_white,
                brightness.brightest
            )?;
        }
        writeln!(out)?;
    }
    Ok(())
}

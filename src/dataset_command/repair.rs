//! `brdfarm dataset repair`.

use super::{StoreOptions, verify::CheckOptions};
use crate::plural::count;
use crate::progress;
use clap::Args;
use datastore::WritableStore;
use datastore::repair::{Outcome, repair};
use export::file::write_bytes;
use jobqueue::identity::identity;
use std::collections::BTreeMap;
use std::io::{self, Write};
use std::path::PathBuf;

/// Render again what verify finds
///
/// Renders each missing or damaged image again; it must have the recorded digest. A record is corrected
/// if the file that it names is intact but not an image of the dataset, or if log and ledger disagree.
/// With --rerender it is also corrected if the image renders differently: what this machine renders is
/// taken as correct, and the workers that delivered something else are named. What cannot be repaired
/// is listed, and is an error. If the store is a folder, no coordinator may be using it; coordinators
/// of a database may be running.
#[derive(Debug, Args)]
pub struct Options {
    #[command(flatten)]
    store: StoreOptions,
    #[command(flatten)]
    checks: CheckOptions,
    /// Write a report of what was done to this file, as JSON
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
}

/// Mends a store.
pub fn execute(options: &Options) -> anyhow::Result<()> {
    let mut store = WritableStore::open(&options.store.store)?;
    let reader = store.read()?;
    let renderer = options.checks.renderer(&reader)?;
    let checks = options.checks.checks(&reader, &renderer);
    let images = u64::from(checks.materials) * reader.specification().views.len() as u64;
    let bar = progress::bar(images, "images checked");
    let repairs = repair(
        &mut store,
        &checks,
        &renderer,
        &|looked_at| bar.set_position(looked_at),
        &|mended, faults| {
            bar.set_length(faults as u64);
            bar.set_message("faults mended");
            bar.set_position(mended as u64);
        },
    )?;
    bar.finish_and_clear();
    if let Some(path) = &options.report {
        let mut json = serde_json::to_vec_pretty(&repairs)?;
        json.push(b'\n');
        write_bytes(path, &json)?;
    }
    let mut out = io::stdout();
    let mut failed = 0;
    for repair in &repairs {
        match &repair.outcome {
            Outcome::Restored => writeln!(out, "{}: restored", repair.fault)?,
            Outcome::Corrected => {
                writeln!(out, "{}: restored, its record corrected", repair.fault)?
            }
            Outcome::Failed(why) => {
                failed += 1;
                writeln!(out, "{}: NOT REPAIRED: {why}", repair.fault)?;
            }
        }
    }
    let mut doubted: BTreeMap<&str, u64> = BTreeMap::new();
    for worker in repairs
        .iter()
        .filter_map(|repair| repair.delivered_by.as_deref())
    {
        *doubted.entry(identity(worker)).or_default() += 1;
    }
    for (by, wrong) in doubted {
        let mut materials = 0_u64;
        for material in 0..checks.materials {
            let completion = reader.completion(material)?;
            materials += u64::from(completion.is_some_and(|done| identity(&done.worker) == by));
        }
        writeln!(
            out,
            "{by} delivered {} wrong, and {} of this store: check them all with --rerender 100%",
            count(wrong, "image"),
            count(materials, "material")
        )?;
    }
    let faults = count(repairs.len() as u64, "fault");
    anyhow::ensure!(failed == 0, "{failed} of {faults} could not be repaired");
    match repairs.len() {
        0 => writeln!(out, "nothing to do: the store is sound")?,
        _ => writeln!(out, "mended {faults}")?,
    }
    Ok(())
}

//! `brdfarm dataset verify`.

use super::{StoreOptions, rerender::Again};
use crate::failure::BadInput;
use crate::plural::count;
use crate::{cores, progress};
use clap::Args;
use datastore::ReadOnlyStore;
use datastore::verify::{Checks, Fault, FaultKind, Report, verify};
use export::file::write_bytes;
use export::manifest::check::{RowFault, check_manifest};
use imagestore::FileError;
use renderer::geometry::BackendChoice;
use serde::Serialize;
use std::hash::{BuildHasher, RandomState};
use std::io::{self, Write};
use std::path::PathBuf;

/// Faults that are listed.
const FAULTS_SHOWN_MAX: usize = 100;

/// Check that every image is present, intact, finite and correctly labelled
///
/// Reads every image of a store: computes its digest, decodes it, and compares its header with the
/// specification, the ledger and the parameters that follow from the seed. Reports images that are
/// black where light must arrive. Changes nothing.
#[derive(Debug, Args)]
pub struct Options {
    #[command(flatten)]
    store: StoreOptions,
    #[command(flatten)]
    checks: CheckOptions,
    /// Also compare the rows of this manifest with the store
    #[arg(long, value_name = "FILE")]
    manifest: Option<PathBuf>,
    /// Write a report of what was found to this file, as JSON
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
}

/// How a store is checked.
#[derive(Debug, Args)]
pub struct CheckOptions {
    /// Render this share of the images again, chosen at random, and compare them byte for byte
    #[arg(long, default_value = "0%", value_name = "P%", value_parser = parse_share)]
    rerender: f64,
    /// The seed that chooses the images to render again [default: random, and printed]
    #[arg(long, value_name = "SEED")]
    rerender_seed: Option<u64>,
    /// What intersects rays with the scene when images are rendered again. The images are the same
    #[arg(long, default_value = "auto")]
    backend: BackendChoice,
    /// Threads; 0 takes one for each core
    #[arg(long, default_value_t = 0, value_name = "N",
          value_parser = clap::value_parser!(u64).range(..=cores::COUNT_MAX))]
    threads: u64,
}

/// What is written for machines.
#[derive(Serialize)]
struct FullReport<'a> {
    sound: bool,
    rerender_seed: u64,
    #[serde(flatten)]
    store: &'a Report,
    manifest_faults: &'a [RowFault],
}

fn parse_share(text: &str) -> Result<f64, String> {
    text.strip_suffix('%')
        .and_then(|number| number.parse().ok())
        .filter(|percent| (0.0..=100.0).contains(percent))
        .map(|percent: f64| percent / 100.0)
        .ok_or_else(|| match text.parse::<f64>() {
            Ok(_) => format!("a share is 0% to 100%: write {text}%"),
            Err(_) => "a share is 0% to 100%".to_owned(),
        })
}

impl CheckOptions {
    /// The checks of a whole store.
    pub fn checks<'a>(&self, store: &ReadOnlyStore, renderer: &'a Again) -> Checks<'a> {
        Checks {
            materials: store.specification().materials,
            threads: cores::count(self.threads),
            renderer: Some(renderer),
            rerender_share: self.rerender,
            // A hasher's keys are the standard library's chance.
            rerender_seed: self
                .rerender_seed
                .unwrap_or_else(|| RandomState::new().hash_one(0)),
        }
    }

    /// A renderer for a store.
    pub fn renderer(&self, store: &ReadOnlyStore) -> anyhow::Result<Again> {
        Again::new(store.specification(), self.backend)
    }
}

/// Checks a store.
pub fn execute(options: &Options) -> anyhow::Result<()> {
    let store = ReadOnlyStore::open(&options.store.store)?;
    let renderer = options.checks.renderer(&store)?;
    let checks = options.checks.checks(&store, &renderer);
    let report = look(&store, &checks)?;
    let rows = match &options.manifest {
        Some(path) => check_manifest(&store, path).map_err(|error| BadInput(error.to_string()))?,
        None => Vec::new(),
    };
    if let Some(path) = &options.report {
        let full = FullReport {
            sound: report.is_sound() && rows.is_empty(),
            rerender_seed: checks.rerender_seed,
            store: &report,
            manifest_faults: &rows,
        };
        let mut json = serde_json::to_vec_pretty(&full)?;
        json.push(b'\n');
        write_bytes(path, &json)?;
    }
    let mut out = io::stdout();
    let outcome = tell(&store, &report, &mut out);
    for fault in rows.iter().take(FAULTS_SHOWN_MAX) {
        writeln!(out, "{fault}")?;
    }
    if report.images_rerendered > 0 {
        let images = count(report.images_rerendered, "image");
        writeln!(
            out,
            "rendered {images} again, chosen with seed {}",
            checks.rerender_seed
        )?;
    }
    outcome?;
    anyhow::ensure!(
        rows.is_empty(),
        "{} in the manifest",
        count(rows.len() as u64, "fault")
    );
    Ok(())
}

/// Checks the first `materials` of a store with this many threads and says what was found; faults
/// are an error.
pub fn check(store: &ReadOnlyStore, materials: u32, threads: usize) -> anyhow::Result<()> {
    let renderer = Again::new(store.specification(), BackendChoice::Auto)?;
    let checks = Checks {
        materials,
        threads,
        renderer: Some(&renderer),
        rerender_share: 0.0,
        rerender_seed: 0,
    };
    tell(store, &look(store, &checks)?, &mut io::stdout())
}

fn look(store: &ReadOnlyStore, checks: &Checks<'_>) -> Result<Report, FileError> {
    let images = u64::from(checks.materials) * store.specification().views.len() as u64;
    let bar = progress::bar(images, "images checked");
    let report = verify(store, checks, &|looked_at| bar.set_position(looked_at));
    bar.finish_and_clear();
    report
}

/// Lists faults, as many as a person reads; materials that are not complete in one line.
pub fn list(faults: &[Fault], out: &mut impl Write) -> io::Result<()> {
    let (incomplete, others): (Vec<&Fault>, Vec<&Fault>) = faults
        .iter()
        .partition(|fault| fault.kind == FaultKind::Incomplete);
    if let [first, .., last] = incomplete[..] {
        writeln!(
            out,
            "materials {} to {}: {} of them are not complete",
            first.material,
            last.material,
            incomplete.len()
        )?;
    } else {
        incomplete
            .iter()
            .try_for_each(|fault| writeln!(out, "{fault}"))?;
    }
    for fault in others.iter().take(FAULTS_SHOWN_MAX) {
        writeln!(out, "{fault}")?;
    }
    if others.len() > FAULTS_SHOWN_MAX {
        writeln!(out, "and {} more", others.len() - FAULTS_SHOWN_MAX)?;
    }
    Ok(())
}

/// Says what was found; faults are an error.
fn tell(store: &ReadOnlyStore, report: &Report, out: &mut impl Write) -> anyhow::Result<()> {
    list(&report.faults, out)?;
    if report.records_damaged > 0 {
        let records = count(report.records_damaged, "record");
        writeln!(
            out,
            "{}: {records} damaged",
            store.records_place().display()
        )?;
    }
    for path in report.unnamed.iter().take(FAULTS_SHOWN_MAX) {
        writeln!(out, "{}: no completed material names it", path.display())?;
    }
    if report.unnamed_count > FAULTS_SHOWN_MAX as u64 {
        let more = report.unnamed_count - FAULTS_SHOWN_MAX as u64;
        writeln!(out, "and {more} more that no material names")?;
    }
    let images = u64::from(report.materials) * store.specification().views.len() as u64;
    anyhow::ensure!(
        report.is_sound(),
        "{}; {} of {} sound",
        count(report.faults.len() as u64, "fault"),
        report.images_sound,
        count(images, "image")
    );
    writeln!(
        out,
        "verified {} of {}, {:.1} MB",
        count(report.images_sound, "image"),
        count(report.materials, "material"),
        report.bytes_sound as f64 / 1e6
    )?;
    Ok(())
}

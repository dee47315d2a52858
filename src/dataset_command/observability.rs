//! `brdfarm dataset observability`.

use super::StoreOptions;
use crate::failure::BadInput;
use crate::plural::count;
use crate::{cores, output, progress};
use clap::Args;
use dataset::{IndexList, Specification};
use datastore::ReadOnlyStore;
use export::observability::{Finding, PARAMETERS, Parts, Plan, Row};
use inverse::information::WEIGHT_NOISE_SD;
use inverse::survey::{self, SIDE_MAX, Survey, Surveyed};
use inverse::{Encoding, NAMES};
use rayon::prelude::*;
use std::collections::BTreeSet;
use std::io::{self, Write};
use std::path::PathBuf;

/// The paper's pair of views, looked at together unless sets are given.
const PAIR: [u32; 2] = [5, 8];

/// Sets of views that one table may have.
const SETS_MAX: usize = 256;

/// The least noise: below it the squares of bounds lose their digits.
const NOISE_SD_MIN: f64 = 1e-12;

/// The most noise: images are then worth nothing.
const NOISE_SD_MAX: f64 = 1e6;

/// Write what images show about each material's parameters
///
/// Differentiates the images of every view by the ten parameters and writes a Parquet table: a row
/// for each material and view, and for each material and set of views. A row has the information
/// matrix J'J, Cramer-Rao bounds and observable weights, for linear, logarithmic and sRGB-coded
/// pixels. An infinite bound means that the images do not determine the parameter.
///
/// A view takes up to 81 renderings: the preset's 14 views together take about 7 s of a core and 40
/// kB a material. Only the specification of the store is read. If the command is stopped or killed,
/// the same command resumes.
#[derive(Debug, Args)]
pub struct Options {
    #[command(flatten)]
    store: StoreOptions,
    /// The file to write; unfinished parts are in FILE.parts until the table is complete
    #[arg(long, value_name = "FILE.parquet")]
    out: PathBuf,
    /// The materials, as in 0-99 [default: all of the specification]
    #[arg(long, value_name = "LIST")]
    materials: Option<IndexList>,
    /// The views [default: all]
    #[arg(long, value_name = "LIST")]
    views: Option<IndexList>,
    /// A set of views whose information is combined; can be repeated [default: 5,8 if these views
    /// exist]
    #[arg(long, value_name = "LIST")]
    sets: Vec<IndexList>,
    /// Pixels of the film's longer side. Information grows with the number of pixels: twice the
    /// side has four times the information and half the bounds
    #[arg(long, default_value_t = 32, value_name = "N",
          value_parser = clap::value_parser!(u32).range(1..=i64::from(SIDE_MAX)))]
    side: u32,
    /// The noise that bounds and weights are for: its standard deviation in each encoded channel,
    /// where white is 1 [default: 2/255]
    #[arg(long, value_name = "SD", value_parser = parse_noise)]
    noise_sd: Option<f64>,
    /// Threads; 0 takes one for each core
    #[arg(long, default_value_t = 0, value_name = "N",
          value_parser = clap::value_parser!(u64).range(..=cores::COUNT_MAX))]
    threads: u64,
}

/// Computes what is missing and writes the table.
pub fn execute(options: &Options) -> anyhow::Result<()> {
    output::ending("--out", &options.out, &["parquet"])?;
    let store = ReadOnlyStore::open(&options.store.store)?;
    let specification = store.specification();
    let views = views(options, specification)?;
    let sets = sets(options, specification, &views)?;
    let noise_sd = options.noise_sd.unwrap_or(WEIGHT_NOISE_SD);
    let film = survey::small(specification, options.side)?;
    let survey = Survey::new(&film, views.clone(), sets.clone(), noise_sd)?;
    let plan = Plan {
        specification: specification.clone(),
        materials: materials(options, specification)?,
        sets: views.iter().map(|&view| vec![view]).chain(sets).collect(),
        parameters: NAMES,
        encodings: Encoding::ALL.map(Encoding::name),
        film: [film.image.width, film.image.height],
        accuracy: film.accuracy,
        noise_sd,
    };
    rayon::ThreadPoolBuilder::new()
        .num_threads(cores::count(options.threads))
        .build_global()?;
    let (rows, materials) = (plan.rows(), plan.materials.len() as u64);
    if let Some(parts) = Parts::claim(plan, &options.out)? {
        compute(&parts, specification, &survey, materials)?;
        parts.join()?;
    }
    writeln!(
        io::stdout(),
        "{}: {}",
        options.out.display(),
        count(rows, "row")
    )?;
    Ok(())
}

/// Surveys the materials that have no part yet.
fn compute(
    parts: &Parts,
    specification: &Specification,
    survey: &Survey,
    total: u64,
) -> anyhow::Result<()> {
    let missing = parts.missing()?;
    let bar = progress::bar(total, "materials");
    bar.set_position(total - missing.len() as u64);
    bar.reset_eta();
    let computed = missing.par_iter().try_for_each(|&material| {
        let surveyed = survey.material(&specification.material(material).material)?;
        let rows: Vec<Row> = surveyed.iter().map(row).collect();
        parts.put(material, &rows)?;
        bar.inc(1);
        anyhow::Ok(())
    });
    bar.finish_and_clear();
    computed
}

fn row(surveyed: &Surveyed) -> Row {
    Row {
        views: surveyed.views.clone(),
        findings: surveyed.findings.each_ref().map(|finding| {
            let list = |of: &[f64]| -> [f64; PARAMETERS] { std::array::from_fn(|i| of[i]) };
            let matrix = finding.information.matrix();
            Finding {
                information: std::array::from_fn(|at| matrix[(at / PARAMETERS, at % PARAMETERS)]),
                uncertainty: list(finding.information.uncertainties()),
                bound: list(&finding.bounds),
                weight: list(&finding.weights),
            }
        }),
    }
}

/// The materials, in order.
fn materials(options: &Options, specification: &Specification) -> anyhow::Result<Vec<u32>> {
    let count = specification.materials;
    let Some(list) = &options.materials else {
        return Ok((0..count).collect());
    };
    Ok(in_order(list.below(count, "material")?))
}

/// The views, in order.
fn views(options: &Options, specification: &Specification) -> anyhow::Result<Vec<u32>> {
    let count = specification.views.len() as u32;
    let Some(list) = &options.views else {
        return Ok((0..count).collect());
    };
    Ok(in_order(list.below(count, "view")?))
}

/// The sets of views, each in order.
fn sets(
    options: &Options,
    specification: &Specification,
    views: &[u32],
) -> anyhow::Result<Vec<Vec<u32>>> {
    if options.sets.is_empty() {
        let has_pair = PAIR.iter().all(|view| views.contains(view));
        return Ok(Vec::from_iter(has_pair.then(|| PAIR.to_vec())));
    }
    if options.sets.len() > SETS_MAX {
        return Err(BadInput(format!("--sets may be given up to {SETS_MAX} times")).into());
    }
    let view_count = specification.views.len() as u32;
    let mut sets: Vec<Vec<u32>> = Vec::with_capacity(options.sets.len());
    for list in &options.sets {
        let set = in_order(list.below(view_count, "view")?);
        let refuse = |reason: &str| Err(BadInput(format!("--sets {list}: {reason}")).into());
        if set.len() < 2 {
            return refuse("a set has at least two views; each view has a row of its own");
        }
        if let Some(view) = set.iter().find(|view| !views.contains(view)) {
            return refuse(&format!("view {view} is not among --views"));
        }
        if sets.contains(&set) {
            return refuse("this set is given twice");
        }
        sets.push(set);
    }
    Ok(sets)
}

/// Each once, in ascending order.
fn in_order(indices: Vec<u32>) -> Vec<u32> {
    let indices: BTreeSet<u32> = indices.into_iter().collect();
    indices.into_iter().collect()
}

fn parse_noise(text: &str) -> Result<f64, String> {
    text.parse()
        .ok()
        .filter(|sd: &f64| (NOISE_SD_MIN..=NOISE_SD_MAX).contains(sd))
        .ok_or_else(|| format!("a standard deviation is {NOISE_SD_MIN:e} to {NOISE_SD_MAX:e}"))
}

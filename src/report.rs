//! `brdfarm report`: speed against error of both integrators.

use crate::failure::BadInput;
use crate::{cores, output, progress};
use clap::{Args, ValueEnum};
use dataset::{IndexList, Specification, specification::IntegratorKind, specification::limits};
use export::file::write_bytes;
use report::Report;
use report::plan::{NamedMaterial, Plan, Setting};
use std::io::{self, Write};
use std::ops::RangeInclusive;
use std::path::PathBuf;
use std::str::FromStr;

/// The film's side, in pixels: up to four times the preset's.
const SIZE_PIXELS_MAX: i64 = 512;

/// The finest reference: a tenth of it is the least absolute accuracy of a specification.
const REFERENCE_RELATIVE_MIN: f64 = 1e-8;

/// The most materials of a report: they are a table's rows.
const MATERIALS_MAX: usize = 100;

/// The accuracies that --quick leaves of the ladder.
const QUICK_ACCURACIES: RangeInclusive<f64> = 1e-4..=1e-2;

/// The most samples a pixel with --quick.
const QUICK_SAMPLES_MAX: u32 = 256;

/// The film's side with --quick, in pixels.
const QUICK_SIZE_PIXELS: u32 = 24;

/// The materials of --quick.
const QUICK_HARD_CASES: [&str; 3] = ["ordinary", "mirror", "half-lambert"];

/// The views of --quick: the two that training uses, and one without chart.
const QUICK_VIEWS: [u32; 3] = [5, 8, 9];

/// The accuracies at which shapes are compared with --quick.
const QUICK_SHAPE_ACCURACIES: [f64; 2] = [1e-1, 3e-2];

/// The reference's relative accuracy with --quick.
const QUICK_REFERENCE_RELATIVE: f64 = 1e-5;

/// Measure speed and error of the renderer, and write tables, plots and a page
///
/// Renders hard cases and materials of the preset's sequence in all views, over a range of settings of
/// both integrators, and compares each image with a far finer one. Writes CSV files, plots as SVG, and
/// report.html, which needs no other file. Takes many minutes; --quick takes seconds, and the other
/// options restrict what is measured.
#[derive(Debug, Args)]
pub struct Options {
    /// The materials: hard, names of hard cases, and indices of the preset's sequence, as in
    /// hard,0-3 or mirror,7 [default: hard,0-3]
    #[arg(long, value_name = "LIST")]
    materials: Option<MaterialList>,
    /// The views of the preset, as in 5,8-10 [default: all]
    #[arg(long, value_name = "LIST")]
    views: Option<IndexList>,
    /// The film's side in pixels [default: 64]
    #[arg(long, value_name = "PIXELS",
          value_parser = clap::value_parser!(u32).range(8..=SIZE_PIXELS_MAX))]
    size: Option<u32>,
    /// Only this integrator
    #[arg(long, value_enum, value_name = "NAME")]
    integrator: Option<Integrator>,
    /// The relative accuracy of the reference images [default: 1e-6]
    #[arg(long, value_name = "ACCURACY", value_parser = parse_reference)]
    reference: Option<f64>,
    /// Fewer settings on a small film: three hard cases and three views, unless others are given
    #[arg(long)]
    quick: bool,
    /// Views rendered at a time, each on one thread; 0 takes one for each core
    #[arg(long, default_value_t = 0, value_name = "N",
          value_parser = clap::value_parser!(u64).range(..=cores::COUNT_MAX))]
    threads: u64,
    /// The folder to write to
    #[arg(long, default_value = "brdfarm-report", value_name = "DIR")]
    out: PathBuf,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum Integrator {
    Hybrid,
    Path,
}

impl Integrator {
    fn kind(self) -> IntegratorKind {
        match self {
            Self::Hybrid => IntegratorKind::Hybrid,
            Self::Path => IntegratorKind::Path,
        }
    }
}

/// Materials named on the command line, none twice.
#[derive(Clone, Debug)]
struct MaterialList(Vec<NamedMaterial>);

impl FromStr for MaterialList {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let mut materials: Vec<NamedMaterial> = Vec::new();
        for part in text.split(',').map(str::trim) {
            let named: Box<dyn Iterator<Item = NamedMaterial>> = if part == "hard" {
                Box::new(NamedMaterial::hard())
            } else if part.starts_with(|first: char| first.is_ascii_digit()) {
                let indices = IndexList::from_str(part)
                    .and_then(|list| list.below(*limits::MATERIALS.end(), "material"))
                    .map_err(|error| error.to_string())?;
                Box::new(indices.into_iter().map(NamedMaterial::of_the_set))
            } else if let Some(case) = NamedMaterial::hard().find(|case| case.name == part) {
                Box::new(std::iter::once(case))
            } else {
                let names: Vec<_> = NamedMaterial::hard().map(|case| case.name).collect();
                return Err(format!(
                    "{part:?} is no material: write an index, hard, or one of {}",
                    names.join(", ")
                ));
            };
            for one in named {
                if materials.iter().all(|there| there.name != one.name) {
                    materials.push(one);
                }
                if materials.len() > MATERIALS_MAX {
                    return Err(format!("a report has at most {MATERIALS_MAX} materials"));
                }
            }
        }
        Ok(Self(materials))
    }
}

fn parse_reference(text: &str) -> Result<f64, String> {
    text.parse()
        .ok()
        .filter(|accuracy| (REFERENCE_RELATIVE_MIN..=1.0).contains(accuracy))
        .ok_or_else(|| format!("an accuracy is a number from {REFERENCE_RELATIVE_MIN:e} to 1"))
}

/// Renders, measures and writes.
pub fn execute(options: &Options) -> anyhow::Result<()> {
    let plan = plan(options)?;
    output::make_folder(&options.out)?;
    let bar = progress::bar(plan.renderings(), "renderings");
    let report = Report::make(plan, &|| bar.inc(1));
    bar.finish_and_clear();
    let files = report?.files()?;
    for file in &files {
        write_bytes(&options.out.join(file.name), file.text.as_bytes())?;
    }
    if let Some(page) = files.last() {
        writeln!(io::stdout(), "{}", options.out.join(page.name).display())?;
    }
    Ok(())
}

fn plan(options: &Options) -> Result<Plan, BadInput> {
    let mut plan = Plan::full(cores::count(options.threads));
    if options.quick {
        plan.materials
            .retain(|one| QUICK_HARD_CASES.contains(&one.name.as_str()));
        plan.views = QUICK_VIEWS.to_vec();
        plan.size_pixels = QUICK_SIZE_PIXELS;
        plan.settings.retain(|setting| match setting {
            Setting::Accuracy(relative) => QUICK_ACCURACIES.contains(relative),
            Setting::Samples(samples) => *samples <= QUICK_SAMPLES_MAX,
        });
        plan.reference_relative = QUICK_REFERENCE_RELATIVE;
        plan.shape_accuracies = QUICK_SHAPE_ACCURACIES.to_vec();
    }
    if let Some(MaterialList(materials)) = &options.materials {
        plan.materials.clone_from(materials);
    }
    if let Some(views) = &options.views {
        let listed = views.below(Specification::preset().views.len() as u32, "view");
        plan.views = listed.map_err(|error| BadInput(error.to_string()))?;
        let mut seen = Vec::new();
        plan.views.retain(|view| {
            let new = !seen.contains(view);
            seen.push(*view);
            new
        });
    }
    if let Some(size) = options.size {
        plan.size_pixels = size;
    }
    if let Some(only) = options.integrator {
        plan.settings
            .retain(|setting| setting.integrator() == only.kind());
        if only.kind() == IntegratorKind::Path {
            plan.shape_accuracies.clear();
        }
    }
    if let Some(reference) = options.reference {
        plan.reference_relative = reference;
    }
    Ok(plan)
}

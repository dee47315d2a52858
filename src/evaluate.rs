//! `brdfarm evaluate`.

use crate::failure::BadInput;
use crate::train::{model_file, two_views};
use crate::{cores, output, progress};
use clap::{Args, ValueEnum};
use dataset::{IndexList, Material, Specification, Split};
use export::file::write_bytes;
use export::observability::{self, Observed};
use std::collections::BTreeSet;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use training::TrainingError;
use training::data::{Pairs, Source};
use training::device::Accelerator;
use training::evaluation::page::{Bounds, Context, compose};
use training::evaluation::paired::groups;
use training::evaluation::refined::{Film, refine};
use training::evaluation::rerender::Rerenderer;
use training::evaluation::tables::{Summary, errors_csv, parameters_csv, summaries};
use training::evaluation::{Estimates, Judged, baselines, bounds, box_plot, judge, over_bound};
use training::fit::options::Options as TrainingOptions;
use training::labels::reading::Reading;
use training::model::Model;
use training::pixels::encoding::Encoding;
use training::pixels::noise::{CODE_STEPS, Noise};

/// The name of the built-in specification on the command line.
const PRESET: &str = "preset";

/// Evaluate trained networks on the test split
///
/// Every model estimates the test materials from their two photographs. The estimates are rendered in
/// all views and compared with the true images, beside estimators that learn nothing. Writes
/// errors.csv, parameters.csv, errors.svg and report.html.
#[derive(Debug, Args)]
pub struct Options {
    /// Models that `brdfarm train` wrote, or their folders. Each model has the name of its folder
    #[arg(value_name = "MODEL", value_parser = model_file())]
    models: Vec<PathBuf>,
    /// The export that they were trained on
    #[arg(long, value_name = "EXPORT")]
    data: PathBuf,
    /// The folder to write to
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// The specification whose views are rendered: a TOML file, or preset [default: that of the
    /// export]
    #[arg(long, value_name = "FILE")]
    spec: Option<PathBuf>,
    /// The number of materials of the test split, from its beginning; 0 takes all
    #[arg(long, default_value_t = 0, value_name = "N")]
    materials: usize,
    /// Estimators that learn nothing: the median of every parameter; the training material whose
    /// photographs are nearest; and the renderer itself, by least squares on the pixels of both films,
    /// exact, of 8 bits with noise, or taken a degree off, from the nearest material and the first
    /// model's estimate
    #[arg(
        long,
        value_enum,
        value_delimiter = ',',
        default_value = "guess,nearest"
    )]
    baselines: Vec<Baseline>,
    /// A table from `brdfarm dataset observability` of the same specification that has the two views
    /// as a set. Errors are then compared with the bounds: for the table's noise of sRGB codes, or for
    /// that of --noise
    #[arg(long, value_name = "FILE.parquet")]
    observability: Option<PathBuf>,
    /// Add a camera's noise to the photographs that models and nearest read: Gaussian, of this
    /// standard deviation in steps of an 8-bit code, of the codes that each of them reads
    #[arg(long, value_name = "STEPS", value_parser = noise_steps)]
    noise: Option<f32>,
    /// How a distribution over bins becomes a value
    #[arg(long, value_enum, default_value = "unbiased")]
    reading: ReadingName,
    /// The two views, where the export has more
    #[arg(long, value_name = "LIST")]
    views: Option<IndexList>,
    /// Pixels a side of the photographs if no model is given
    #[arg(long, default_value_t = 32, value_name = "N",
          value_parser = clap::value_parser!(u32).range(1..=2048))]
    side: u32,
    /// The device that computes: cpu, cuda, cuda:1, wgpu
    #[arg(long, default_value = "cpu", value_name = "DEVICE")]
    device: Accelerator,
    /// Threads; 0 takes one for each core
    #[arg(long, default_value_t = 0, value_name = "N",
          value_parser = clap::value_parser!(u64).range(..=cores::COUNT_MAX))]
    threads: u64,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, ValueEnum)]
enum Baseline {
    /// The median of every parameter
    Guess,
    /// The nearest training image's material
    Nearest,
    /// Least squares on exact films; takes 10 s of a core a material
    Refine,
    /// Least squares on films of 8 bits with noise of a standard deviation of 4 steps
    RefineNoisy,
    /// Least squares on films of 8 bits with noise of 2 steps, taken with cameras and light a degree
    /// lower than the specification says and the light 5 percent further away
    RefineOff,
    /// The same, fitting light and cameras too
    RefineOffFitted,
}

/// How distributions over bins become values.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum ReadingName {
    /// The most probable bin
    Argmax,
    /// The mean
    Mean,
    /// A mean without the bias of the ends of a range
    Unbiased,
}

/// Reads a standard deviation of noise, in steps of an 8-bit code.
fn noise_steps(text: &str) -> Result<f32, String> {
    let steps = text.parse().ok();
    steps
        .filter(|steps| (0.0..=CODE_STEPS).contains(steps))
        .ok_or_else(|| format!("a standard deviation is a number from 0 to {CODE_STEPS}"))
}

impl Options {
    /// The noise of the photographs.
    fn noise(&self) -> Noise {
        match self.noise.filter(|steps| *steps > 0.0) {
            Some(steps) => Noise::Camera { steps },
            None => Noise::Exact,
        }
    }

    /// Its standard deviation, where white is 1, if there is any.
    fn noise_sd(&self) -> Option<f64> {
        match self.noise() {
            Noise::Camera { steps } => Some(f64::from(steps) / f64::from(CODE_STEPS)),
            _ => None,
        }
    }
}

/// Evaluates.
pub fn execute(options: &Options) -> anyhow::Result<()> {
    rayon::ThreadPoolBuilder::new()
        .num_threads(cores::count(options.threads))
        .build_global()?;
    let device = options.device.open()?;
    let names = names(&options.models)?;
    let models = options.models.iter();
    let models = models
        .map(|path| Ok((path.as_path(), Model::read(path, &device)?)))
        .collect::<anyhow::Result<Vec<_>>>()?;
    output::make_folder(&options.out)?;
    let sides: BTreeSet<u32> = models
        .iter()
        .map(|(_, model)| model.options.identity.side)
        .collect();
    if sides.is_empty() {
        let data = read(options, options.side)?;
        return evaluate(options, &data, Vec::new(), Vec::new());
    }
    let mut all: Vec<Estimates> = Vec::new();
    let mut data = None;
    // Models of different sides read the same photographs at different sizes.
    for side in sides {
        let pairs = read(options, side)?;
        let positions = positions(&pairs, options)?;
        for ((path, model), name) in models.iter().zip(&names) {
            if model.options.identity.side == side {
                model.check(path, &pairs)?;
                let found = model.distributions(&pairs, &positions, options.noise(), &device)?;
                let reader = model.reader(options.reading.reading());
                let materials = found.iter();
                all.push(Estimates {
                    name: name.clone(),
                    materials: materials
                        .map(|found| model.material(found, &reader))
                        .collect(),
                });
            }
        }
        data = Some(pairs);
    }
    match data {
        Some(data) => {
            let trained = models
                .iter()
                .map(|(_, model)| model.options.training.clone());
            evaluate(
                options,
                &data,
                all,
                names.into_iter().zip(trained).collect(),
            )
        }
        None => unreachable!("there was a side"),
    }
}

fn read(options: &Options, side: u32) -> anyhow::Result<Pairs> {
    let views = options.views.as_ref().map(two_views).transpose()?;
    let bar = progress::bar(0, "materials read");
    let pairs = Pairs::read(
        &Source {
            folder: options.data.clone(),
            views,
            side,
        },
        &|done, count| {
            bar.set_length(count);
            bar.set_position(done);
        },
    );
    bar.finish_and_clear();
    Ok(pairs?)
}

fn positions(pairs: &Pairs, options: &Options) -> Result<Vec<usize>, BadInput> {
    let mut positions = pairs.positions(Split::Test);
    if options.materials > 0 {
        positions.truncate(options.materials);
    }
    if positions.is_empty() {
        return Err(BadInput(format!(
            "{}: the export has no material of the test split",
            options.data.display()
        )));
    }
    Ok(positions)
}

/// The models' names: those of their folders, which tables and plots tell them apart by.
fn names(paths: &[PathBuf]) -> Result<Vec<String>, BadInput> {
    let mut taken: BTreeSet<String> = Baseline::value_variants()
        .iter()
        .filter_map(ValueEnum::to_possible_value)
        .map(|baseline| baseline.get_name().to_owned())
        .collect();
    let names = paths.iter().map(|path| {
        let folder = path.parent().and_then(Path::file_name);
        let name = folder.or_else(|| path.file_stem()).unwrap_or_default();
        let name = name.to_string_lossy().into_owned();
        let plain = |c: char| c.is_alphanumeric() || "-_.+ ".contains(c);
        if !name.chars().all(plain) {
            return Err(BadInput(format!(
                "{}: a model is called as its folder, and {name:?} is more than letters, digits, \
                 spaces and -_.+: rename the folder",
                path.display()
            )));
        }
        if !taken.insert(name.clone()) {
            return Err(BadInput(format!(
                "{}: a model is called as its folder, and another estimator is called {name:?}: \
                 rename the folder",
                path.display()
            )));
        }
        Ok(name)
    });
    names.collect()
}

fn evaluate(
    options: &Options,
    pairs: &Pairs,
    models: Vec<Estimates>,
    networks: Vec<(String, TrainingOptions)>,
) -> anyhow::Result<()> {
    let positions = positions(pairs, options)?;
    let codes = noisy_codes(options, &networks);
    let observed = observed(options, pairs, &positions, codes)?;
    let nearest = || baselines::nearest(pairs, &positions, options.noise());
    let refined = |film| refined(pairs, &positions, nearest(), models.first(), film);
    let mut all = Vec::new();
    for baseline in BTreeSet::from_iter(&options.baselines) {
        all.push(match baseline {
            Baseline::Guess => baselines::guess(pairs, &positions),
            Baseline::Nearest => nearest(),
            Baseline::Refine => refined(Film::Exact)?,
            Baseline::RefineNoisy => refined(Film::Noisy)?,
            Baseline::RefineOff => refined(Film::Off { fitted: false })?,
            Baseline::RefineOffFitted => refined(Film::Off { fitted: true })?,
        });
    }
    all.extend(models);
    let specification = judging(options, pairs)?;
    let seen = seen_views(&specification, pairs);
    let rerenderer = Rerenderer::new(&specification)?;
    let bar = progress::bar(positions.len() as u64, "materials rendered again");
    let judged = judge(pairs, &positions, &all, &rerenderer, &|done| {
        bar.set_position(done);
    });
    bar.finish_and_clear();
    let judged = judged?;
    let found = Found {
        summaries: summaries(&all, &judged, &seen, observed.as_ref()),
        all,
        judged,
        seen,
        observed,
        codes,
        networks,
    };
    write(options, pairs, &found)?;
    print(&found.summaries)
}

/// What the evaluation found.
struct Found {
    all: Vec<Estimates>,
    judged: Vec<Vec<Judged>>,
    seen: Vec<u32>,
    observed: Option<Observed>,
    /// The codes whose noise the bounds are for.
    codes: Encoding,
    summaries: Vec<Summary>,
    networks: Vec<(String, TrainingOptions)>,
}

/// The codes whose noise bounds are for: sRGB codes, or where --noise adds it those that the networks
/// read, if all read the same.
fn noisy_codes(options: &Options, networks: &[(String, TrainingOptions)]) -> Encoding {
    let mut codes = networks.iter().map(|(_, network)| network.encoding);
    let first = codes.next().filter(|_| options.noise_sd().is_some());
    first
        .filter(|first| codes.all(|other| other == *first))
        .unwrap_or(Encoding::Srgb)
}

/// What photographs show of the materials that are judged, where a table says it.
fn observed(
    options: &Options,
    pairs: &Pairs,
    positions: &[usize],
    codes: Encoding,
) -> anyhow::Result<Option<Observed>> {
    let Some(path) = &options.observability else {
        return Ok(None);
    };
    let observed = observability::read(path, &pairs.identity.views, codes.name());
    let observed = observed.map_err(TrainingError::from)?;
    let observed = match options.noise_sd() {
        Some(noise_sd) => observed.at_noise(noise_sd),
        None => observed,
    };
    if observed.specification != pairs.identity.specification {
        return Err(BadInput(format!(
            "{}: the table is of another specification than the export",
            path.display()
        ))
        .into());
    }
    let judged = positions
        .iter()
        .map(|&position| pairs.labels[position].index);
    bounds::check(&observed, judged)?;
    Ok(Some(observed))
}

fn write(options: &Options, pairs: &Pairs, found: &Found) -> anyhow::Result<()> {
    let Found {
        all,
        judged,
        seen,
        observed,
        codes,
        summaries,
        networks,
    } = found;
    let samples: Vec<(String, Vec<f64>)> = all
        .iter()
        .zip(judged)
        .map(|(estimates, judged)| {
            let errors = judged.iter().flat_map(|one| &one.views);
            (
                estimates.name.clone(),
                errors.map(|error| error.srgb).collect(),
            )
        })
        .collect();
    let plot = box_plot::svg(&samples)?;
    let bounds = observed.as_ref().map(|observed| {
        let plot = over_bound::svg(all, judged, observed)?;
        let codes = codes.name();
        Ok::<_, TrainingError>(Bounds {
            noise_sd: observed.noise_sd,
            codes,
            plot,
        })
    });
    let context = Context {
        dataset: pairs.specification.name.clone(),
        materials: judged.first().map_or(0, Vec::len),
        seen: seen.clone(),
        noise: options.noise,
        machine: machine(),
        networks: networks.clone(),
        bounds: bounds.transpose()?,
    };
    let page = compose(&context, summaries, &groups(all, judged), &plot);
    for (name, text) in [
        ("errors.csv", errors_csv(all, judged, seen)),
        (
            "parameters.csv",
            parameters_csv(all, judged, observed.as_ref()),
        ),
        ("errors.svg", plot),
        ("report.html", page),
    ] {
        write_bytes(&options.out.join(name), text.as_bytes())?;
    }
    Ok(())
}

fn print(summaries: &[Summary]) -> anyhow::Result<()> {
    let mut out = io::stdout();
    writeln!(
        out,
        "{:<16} {:>10} {:>10} {:>10} {:>8} {:>8} {:>8} {:>8}",
        "estimator", "median MSE", "seen", "unseen", "R", "A", "psi", "N_d"
    )?;
    for summary in summaries {
        let [r, a, psi, n, ..] = summary.parameters;
        writeln!(
            out,
            "{:<16} {:>10.2e} {:>10.2e} {:>10.2e} {r:>8.2} {a:>8.3} {psi:>8.1} {n:>8.2}",
            summary.name, summary.all.median, summary.seen.median, summary.unseen.median
        )?;
    }
    Ok(())
}

impl ReadingName {
    /// The reading of this name.
    pub fn reading(self) -> Reading {
        match self {
            Self::Argmax => Reading::Argmax,
            Self::Mean => Reading::Mean,
            Self::Unbiased => Reading::Unbiased,
        }
    }
}

/// What the renderer finds from the nearest material and the first model's estimate.
fn refined(
    pairs: &Pairs,
    positions: &[usize],
    nearest: Estimates,
    model: Option<&Estimates>,
    film: Film,
) -> anyhow::Result<Estimates> {
    let nearest = nearest.materials.into_iter().enumerate();
    let starts: Vec<Vec<Material>> = nearest
        .map(|(place, nearest)| {
            let estimate = model.map(|model| model.materials[place]);
            estimate.into_iter().chain([nearest]).collect()
        })
        .collect();
    let bar = progress::bar(positions.len() as u64, "materials refined");
    let found = refine(pairs, positions, &starts, film, &|done| {
        bar.set_position(done)
    });
    bar.finish_and_clear();
    Ok(found?)
}

/// The specification in whose views estimates are judged.
fn judging(options: &Options, pairs: &Pairs) -> anyhow::Result<Specification> {
    Ok(match &options.spec {
        None => pairs.specification.clone(),
        Some(path) if path.as_os_str() == PRESET => Specification::preset(),
        Some(path) => Specification::load(path)?,
    })
}

/// Which of the judging specification's views are those that the estimators saw.
fn seen_views(judging: &Specification, pairs: &Pairs) -> Vec<u32> {
    let seen = pairs
        .identity
        .views
        .map(|view| pairs.specification.views.get(view as usize));
    let views = judging.views.iter().enumerate();
    views
        .filter(|(_, view)| seen.contains(&Some(view)))
        .map(|(number, _)| number as u32)
        .collect()
}

/// The processor and its cores.
fn machine() -> String {
    let facts = report::machine::facts();
    let named = facts
        .into_iter()
        .filter(|(name, _)| ["Processor", "Cores"].contains(name));
    let named: Vec<String> = named
        .map(|(name, value)| format!("{name} {value}"))
        .collect();
    named.join(", ")
}

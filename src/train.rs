//! `brdfarm train`.

use crate::{cores, progress};
use clap::builder::{PathBufValueParser, PossibleValuesParser, TypedValueParser};
use clap::{Args, ValueEnum};
use dataset::IndexList;
use export::observability;
use indicatif::{HumanDuration, ProgressBar};
use serde::de::DeserializeOwned;
use std::cell::Cell;
use std::io::{self, Write};
use std::path::PathBuf;
use std::time::{Duration, Instant};
use training::TrainingError;
use training::data::{Pairs, Source};
use training::device::Accelerator;
use training::fit::checkpoint::MODEL;
use training::fit::options::{LossWeights, MetricLoss, Options as TrainingOptions, Preset, Whiten};
use training::fit::state::EpochLine;
use training::fit::{Files, Progress, train};
use training::labels::axes::Colours;
use training::pixels::encoding::Encoding;
use training::variant::Variant;

/// Train the networks that estimate a material from two photographs
///
/// Reads an export of rectified pairs (`brdfarm dataset export EXPORT --layout files --views 5,8
/// --rectified 64`) and writes model.safetensors, log.csv and curves.svg. The same export, options
/// and seed give the same bytes on one processor. Epochs end with checkpoints: all epochs, unless
/// checkpoints would take more than a tenth of the time. If the training is stopped, the same command
/// resumes from the last checkpoint.
#[derive(Debug, Args)]
pub struct Options {
    /// The export
    #[arg(value_name = "EXPORT")]
    export: PathBuf,
    /// The folder to write to: a new or an empty one, or that of a training to resume
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Sizes, encoding, colours, optimiser and epochs: as in the paper (paper), or chosen for two
    /// processor cores (cpu) or a GPU (best)
    #[arg(long, default_value = "cpu", value_name = "PRESET",
          value_parser = named::<Preset>(&["paper", "cpu", "best"]))]
    preset: Preset,
    /// What is trained: one CNN on photographs as they are (cnn0) or whitened (cnnw), cnn0 with
    /// R, A, psi and N_d weighted twice (weights), the paper's nested blocks (nested), or a control: one
    /// block on the features of both CNNs (flat), or blocks without the others' results (separate)
    #[arg(long, default_value = "nested", value_name = "VARIANT",
          value_parser = named::<Variant>(
              &["cnn0", "cnnw", "weights", "nested", "flat", "separate"]))]
    variant: Variant,
    /// The two views, where the export has more
    #[arg(long, value_name = "LIST")]
    views: Option<IndexList>,
    /// The colour space of the labels [default: the preset's]
    #[arg(long, value_name = "COLOURS",
          value_parser = named::<Colours>(&["lab", "rgb", "scaled"]))]
    colours: Option<Colours>,
    /// The encoding of pixels [default: the preset's]
    #[arg(long, value_name = "ENCODING",
          value_parser = named::<Encoding>(&["srgb", "log"]))]
    encoding: Option<Encoding>,
    /// Whether CNN_w's photographs share one whitening, or have one each
    #[arg(long, default_value = "dataset", value_name = "WHICH",
          value_parser = named::<Whiten>(&["dataset", "image"]))]
    whiten: Whiten,
    /// The weight of each parameter's loss: the same for every material, as in the paper, or according
    /// to what the material's two photographs show about it, which needs --observability
    #[arg(
        long,
        value_enum,
        default_value = "paper",
        requires_if("observable", "observability")
    )]
    weights: WeightsName,
    /// Also teach networks not to change the two photographs: add SHARE times ln(1 + q) to the loss. q
    /// is how much the mean of what a network says would change them, squared, in standard deviations
    /// of noise of two steps of an 8-bit code; to second order. It needs --observability
    #[arg(long, value_name = "SHARE", value_parser = share, requires = "observability")]
    metric: Option<f64>,
    /// A table from `brdfarm dataset observability` that has the two views as a set
    #[arg(long, value_name = "FILE.parquet")]
    observability: Option<PathBuf>,
    /// Add a camera's noise while training: Gaussian, of a standard deviation of 0 to 4 steps of an
    /// 8-bit code, drawn for each material and epoch
    #[arg(long)]
    noise: bool,
    /// Seed of weights, order, noise and dropout
    #[arg(long, default_value_t = 0, value_name = "SEED")]
    seed: u64,
    /// Epochs of a CNN, at most [default: the preset's]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    epochs: Option<u32>,
    /// Epochs of a block, at most [default: the preset's]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    block_epochs: Option<u32>,
    /// A network is finished after this many epochs without a better excess on the validation split
    #[arg(long, value_name = "N", default_value_t = 20,
          value_parser = clap::value_parser!(u32).range(1..=100_000))]
    patience: u32,
    /// Reuse the finished CNNs in this folder of a training of another variant. All other options must
    /// be the same; the CNNs are then the same to the byte
    #[arg(long, value_name = "DIR")]
    cnns: Option<PathBuf>,
    /// Also write the log as TensorBoard's event files, into DIR/tensorboard
    #[arg(long)]
    tensorboard: bool,
    /// The device that computes: cpu; cuda or cuda:1 if the program was built with the feature cuda;
    /// wgpu, the GPU that Vulkan or Metal finds, if it was built with the feature wgpu
    #[arg(long, default_value = "cpu", value_name = "DEVICE")]
    device: Accelerator,
    /// Threads; 0 takes one for each core
    #[arg(long, default_value_t = 0, value_name = "N",
          value_parser = clap::value_parser!(u64).range(..=cores::COUNT_MAX))]
    threads: u64,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum WeightsName {
    /// The weights of the variant
    Paper,
    /// The observable weights of the two photographs
    Observable,
}

/// Reads how much a loss counts.
fn share(text: &str) -> Result<f64, String> {
    let share = text.parse().ok();
    share
        .filter(|share| *share > 0.0 && *share <= 1e3)
        .ok_or_else(|| "a share is a number above 0, up to 1000".to_owned())
}

/// A parser of the names that serde gives to the values of a type.
fn named<T>(names: &'static [&'static str]) -> impl TypedValueParser<Value = T>
where
    T: DeserializeOwned + Clone + Send + Sync + 'static,
{
    PossibleValuesParser::new(names)
        .try_map(|name| serde_json::from_value::<T>(serde_json::Value::String(name)))
}

/// A parser of the path of a model; a folder stands for the one that a training left in it.
pub fn model_file() -> impl TypedValueParser<Value = PathBuf> {
    PathBufValueParser::new().map(|path| match path.is_dir() {
        true => path.join(MODEL),
        false => path,
    })
}

/// Trains.
pub fn execute(options: &Options) -> anyhow::Result<()> {
    let mut training = chosen(options);
    // burn computes on rayon's global pool.
    rayon::ThreadPoolBuilder::new()
        .num_threads(cores::count(options.threads))
        .build_global()?;
    let device = options.device.open()?;
    let views = options.views.as_ref().map(two_views).transpose()?;
    let bar = progress::bar(0, "materials read");
    let pairs = Pairs::read(
        &Source {
            folder: options.export.clone(),
            views,
            side: training.architecture.side,
        },
        &|done, count| {
            bar.set_length(count);
            bar.set_position(done);
        },
    );
    bar.finish_and_clear();
    let pairs = pairs?;
    let table = options.observability.as_deref();
    let by_weight = options.weights == WeightsName::Observable;
    let table = table.filter(|_| by_weight || options.metric.is_some());
    let observed = table.map(|path| {
        let encoding = training.encoding.name();
        observability::read(path, &pairs.identity.views, encoding)
    });
    let observed = observed.transpose().map_err(TrainingError::from)?;
    if let Some(observed) = &observed {
        let table = observed.digest.to_string();
        training.metric = options.metric.map(|share| MetricLoss {
            share,
            table: table.clone(),
        });
        if by_weight {
            training.weights = LossWeights::Observable { table };
        }
    }
    let show = Show::new();
    let files = Files {
        out: &options.out,
        cnns: options.cnns.as_deref(),
        observed: observed.as_ref(),
        tensorboard: options.tensorboard,
    };
    let model = train(&pairs, &training, files, &device, &|event| {
        show.tell(&event);
    });
    show.bar.finish_and_clear();
    writeln!(io::stdout(), "{}", model?.display())?;
    Ok(())
}

fn chosen(options: &Options) -> TrainingOptions {
    let preset = options.preset.options(options.variant);
    TrainingOptions {
        colours: options.colours.unwrap_or(preset.colours),
        encoding: options.encoding.unwrap_or(preset.encoding),
        cnn_epochs: options.epochs.unwrap_or(preset.cnn_epochs),
        block_epochs: options.block_epochs.unwrap_or(preset.block_epochs),
        whiten: options.whiten,
        noise: options.noise,
        patience: options.patience,
        seed: options.seed,
        ..preset
    }
}

/// The two views that a list names.
pub fn two_views(list: &IndexList) -> anyhow::Result<[u32; 2]> {
    let views: Vec<u32> = list.below(u32::MAX, "view")?;
    <[u32; 2]>::try_from(views).map_err(|_| {
        crate::failure::BadInput("--views takes two views, as in 5,8".to_owned()).into()
    })
}

/// Shows how far a training is: a bar where there is a terminal, a line for each epoch.
struct Show {
    bar: ProgressBar,
    // When this process began an epoch, and how many it has finished since, of one network.
    begun: Cell<(Instant, u32)>,
}

impl Show {
    fn new() -> Self {
        Self {
            bar: progress::bar(0, "steps"),
            begun: Cell::new((Instant::now(), 0)),
        }
    }

    fn tell(&self, event: &Progress<'_>) {
        match event {
            Progress::Step {
                stage,
                epoch,
                epochs,
                done,
                steps,
            } => {
                if u64::from(*epoch) * steps + done == 1 {
                    self.bar.reset();
                    self.begun.set((Instant::now(), 0));
                }
                self.bar.set_length(u64::from(*epochs) * steps);
                self.bar.set_position(u64::from(*epoch) * steps + done);
                self.bar.set_message(format!("steps of {stage}"));
            }
            Progress::Epoch { line, epochs } => self.print(line, *epochs),
        }
    }

    fn print(&self, line: &EpochLine, epochs: u32) {
        let EpochLine {
            stage,
            epoch,
            loss,
            excess,
            ..
        } = line;
        let (start, before) = self.begun.get();
        self.begun.set((start, before + 1));
        let each = start.elapsed() / (before + 1);
        let left = each * epochs.saturating_sub(*epoch);
        let left = HumanDuration(Duration::from_secs(left.as_secs()));
        self.bar.suspend(|| {
            // A reader that has gone away does not stop the training.
            let _ = writeln!(
                io::stdout(),
                "{stage} epoch {epoch} of {epochs}: training loss {loss:.4}, validation excess \
                 {excess:.4} nats; about {left} left of {stage}"
            );
        });
    }
}

//! Training: stages one after the other, each with checkpoints, to one model file.
//!
//! | module | what |
//! | --- | --- |
//! | [`options`] | presets, and everything that decides the weights |
//! | [`inputs`] | what networks read |
//! | [`targets`] | what they are asked for |
//! | [`network`] | what a stage trains |
//! | [`stage`] | its epochs and steps |
//! | [`state`], [`checkpoint`] | what is left on the disk |
//! | `events` | the log as TensorBoard reads it |
//! | `cnns` | the CNNs of another training, taken instead of trained again |

pub mod checkpoint;
mod cnns;
mod curves;
mod events;
pub mod inputs;
pub mod network;
pub mod options;
pub mod stage;
mod stage_name;
pub mod state;
pub mod targets;

use crate::data::Pairs;
use crate::error::TrainingError;
use crate::labels::loss::softmax;
use crate::labels::target::SIGMA_RANGE_BINS;
use crate::labels::{BINS, PARAMETERS};
use crate::model::{Model, ModelOptions};
use crate::network::estimator::{Estimator, new_head};
use crate::network::head::Head;
use crate::network::trunk::Trunk;
use crate::pixels::noise::Noise;
use crate::pixels::normalisation::Normalisation;
use crate::variant::{HeadPlan, Variant};
use burn::module::Module;
use burn::tensor::Device;
use checkpoint::{Checkpoints, MODEL, Pace, State};
use cnns::take_cnns;
use dataset::Split;
use events::Events;
use export::file::write_bytes;
use export::observability::Observed;
use half::f16;
use inputs::{Codes, Features, Inputs, Joined, Photographs};
use network::{Cnn, Network};
use options::{Options, Whiten};
use stage::{Learner, Stage, logits_of, numbers, tensor, unpack};
use stage_name::StageName;
use std::path::{Path, PathBuf};
use targets::Targets;

/// What a training tells while it runs.
#[derive(Debug)]
pub enum Progress<'a> {
    /// A step is done.
    Step {
        /// The network's name.
        stage: &'a str,
        /// Epochs of the network before this one.
        epoch: u32,
        /// Epochs of the network, at most.
        epochs: u32,
        /// Steps of this epoch done.
        done: u64,
        /// Steps of an epoch.
        steps: u64,
    },
    /// An epoch is done, and its checkpoint written where one was due.
    Epoch {
        /// Its line of the log.
        line: &'a state::EpochLine,
        /// Epochs of the network, at most.
        epochs: u32,
    },
}

/// What a training reads and writes beside its pairs.
#[derive(Clone, Copy, Debug)]
pub struct Files<'a> {
    /// Its own folder.
    pub out: &'a Path,
    /// That of a training of another variant with the same other options, whose CNNs are taken
    /// instead of trained again. They are the same, to the byte.
    pub cnns: Option<&'a Path>,
    /// How much photographs show of each parameter, if losses count as much. The options have its
    /// digest.
    pub observed: Option<&'a Observed>,
    /// Whether the log is written as TensorBoard's event files too.
    pub tensorboard: bool,
}

/// Trains a variant on pairs into a folder, or goes on with the training that the folder holds.
/// Returns the path of the model file.
///
/// # Errors
/// When the folder holds another training, the training whose CNNs are taken has other options or
/// has not finished them, a file cannot be written, or the loss is not finite.
pub fn train(
    pairs: &Pairs,
    options: &Options,
    files: Files<'_>,
    device: &Device,
    tell: &dyn Fn(Progress<'_>),
) -> Result<PathBuf, TrainingError> {
    check(pairs, options)?;
    let checkpoints = Checkpoints::new(files.out)?;
    let fresh = State {
        options: options.clone(),
        identity: pairs.identity.clone(),
        pairs: pairs.digest().to_string(),
        finished: 0,
        stage: None,
        log: Vec::new(),
    };
    let state = checkpoints.resume_or(fresh, |state| match files.cnns {
        Some(cnns) => take_cnns(cnns, &checkpoints, state),
        None => Ok(()),
    })?;
    let names = options.colours.axes().map(|axis| axis.name);
    let folder = files.out.join(events::FOLDER);
    let events = files
        .tensorboard
        .then(|| Events::begin(&folder, names, &state.log));
    let codes = Codes::new(pairs, options.encoding);
    let mut training = Training {
        pairs,
        options,
        targets: Targets::new(pairs, options, files.observed)?,
        normalisations: normalisations(&codes, options),
        codes: &codes,
        device: device.clone().autodiff(),
        checkpoints,
        state,
        events: events.transpose()?,
        tell,
        number: 0,
    };
    let estimator = training.estimator()?;
    let model = Model {
        options: ModelOptions {
            training: options.clone(),
            identity: pairs.identity.clone(),
            pairs: training.state.pairs.clone(),
            normalisations: training.normalisations.clone(),
            specification: pairs.specification.to_json(),
        },
        estimator,
    };
    let path = training.checkpoints.path(MODEL);
    model.write(&path)?;
    training.checkpoints.write_log(&training.state)?;
    let curves = curves::svg(&training.state.log)?;
    write_bytes(&training.checkpoints.path("curves.svg"), curves.as_bytes())?;
    Ok(path)
}

fn check(pairs: &Pairs, options: &Options) -> Result<(), TrainingError> {
    let side = options.architecture.side;
    if side != pairs.identity.side || !side.is_multiple_of(4) || side == 0 {
        return Err(TrainingError::Input(format!(
            "the network reads photographs of {side} pixels a side, a multiple of 4, where the \
             pairs have {}",
            pairs.identity.side
        )));
    }
    for split in [Split::Train, Split::Validation] {
        if pairs.positions(split).is_empty() {
            return Err(TrainingError::Input(format!(
                "the export has no material of the {split} split: export all splits"
            )));
        }
    }
    if !options.smoothing.is_sound() {
        let [least, most] = SIGMA_RANGE_BINS;
        return Err(TrainingError::Input(format!(
            "the smoothing's standard deviation is {least} to {most} bins, not {}",
            options.smoothing.sigma_bins
        )));
    }
    Ok(())
}

/// How CNN_0's and CNN_w's photographs are normalised, for those that the variant has.
fn normalisations(codes: &Codes<'_>, options: &Options) -> [Option<Normalisation>; 2] {
    let moments = codes.moments();
    let [zero, whitened] = options.variant.trunks();
    [
        zero.then(|| moments.channels()),
        whitened.then(|| match options.whiten {
            Whiten::Dataset => Normalisation::Whitened(moments.whitening()),
            Whiten::Image => Normalisation::WhitenedByImage,
        }),
    ]
}

struct Training<'a> {
    pairs: &'a Pairs,
    options: &'a Options,
    targets: Targets,
    normalisations: [Option<Normalisation>; 2],
    codes: &'a Codes<'a>,
    device: Device,
    checkpoints: Checkpoints,
    state: State,
    events: Option<Events>,
    tell: &'a dyn Fn(Progress<'_>),
    // Of the next stage.
    number: u32,
}

impl Training<'_> {
    fn estimator(&mut self) -> Result<Estimator, TrainingError> {
        let variant = self.options.variant;
        let mut trunks: [Option<Trunk>; 2] = [None, None];
        let mut features: [Option<Features>; 2] = [None, None];
        let mut heads = Vec::new();
        for which in 0..2 {
            let Some(normalisation) = self.normalisations[which].clone() else {
                continue;
            };
            let photographs = Photographs {
                codes: self.codes,
                normalisation,
                noise: match self.options.noise {
                    true => Noise::Augmentation {
                        seed: self.options.seed,
                    },
                    false => Noise::Exact,
                },
            };
            let cnn = self.train_cnn(which, &photographs)?.valid();
            if variant.has_blocks() {
                features[which] = Some(self.features(&cnn, &photographs)?);
            } else {
                heads.push(cnn.head);
            }
            trunks[which] = Some(cnn.trunk);
        }
        if variant.has_blocks() {
            heads = self.train_blocks(&features)?;
        }
        let [trunk0, trunkw] = trunks;
        Ok(Estimator {
            trunk0,
            trunkw,
            heads,
        })
    }

    fn train_cnn(
        &mut self,
        which: usize,
        photographs: &Photographs<'_>,
    ) -> Result<Cnn, TrainingError> {
        // A CNN below blocks is the one that is trained alone, to the byte.
        let alone = [Variant::Cnn0, Variant::Cnnw][which];
        let fresh = Estimator::new(
            alone,
            self.options.architecture,
            self.options.seed,
            &self.device,
        );
        let trunk = [fresh.trunk0, fresh.trunkw]
            .into_iter()
            .nth(which)
            .flatten();
        let (Some(trunk), Some(head)) = (trunk, fresh.heads.into_iter().next()) else {
            unreachable!("a CNN has a trunk and a head");
        };
        let cnn = Cnn {
            trunk,
            head,
            side: self.pairs.side(),
        };
        let weights = self.options.variant.weights();
        let outputs = weights.into_iter().enumerate().collect();
        self.train_stage(StageName::Cnn(which), cnn, photographs, outputs)
    }

    /// What a frozen CNN's trunk finds in every material; with noise, in one draw of it.
    fn features(
        &self,
        cnn: &Cnn,
        photographs: &Photographs<'_>,
    ) -> Result<Features, TrainingError> {
        let device = self.device.clone().without_autodiff();
        let all: Vec<usize> = (0..self.pairs.labels.len()).collect();
        let mut rows = Vec::new();
        for positions in all.chunks(options::BATCH) {
            let inputs = photographs.rows(positions, Some(0));
            let inputs = tensor(inputs, [positions.len(), photographs.width()], &device);
            let found = numbers(cnn.features(inputs, None))?;
            rows.extend(found.into_iter().map(f16::from_f32_const));
        }
        Ok(Features::new(self.options.architecture.features(), rows))
    }

    fn train_blocks(
        &mut self,
        features: &[Option<Features>; 2],
    ) -> Result<Vec<Head>, TrainingError> {
        let mut told: Vec<Option<Features>> = (0..PARAMETERS).map(|_| None).collect();
        let mut heads = Vec::new();
        for (block, plan) in self.options.variant.heads().into_iter().enumerate() {
            let found = plan.features.into_iter().zip(features);
            let found = found.filter_map(|(wanted, found)| found.as_ref().filter(|_| wanted));
            let given = plan.given.iter().filter_map(|&p| told[p].as_ref());
            let inputs = Joined(found.chain(given).collect());
            let fresh = new_head(
                &plan,
                block,
                self.options.architecture,
                self.options.seed,
                &self.device,
            );
            let outputs = plan
                .outputs
                .iter()
                .map(|&parameter| (parameter, 1.0))
                .collect();
            let head = self
                .train_stage(StageName::Block(block), fresh, &inputs, outputs)?
                .valid();
            let probabilities = self.probabilities(&head, &plan, &inputs)?;
            for (parameter, found) in plan.outputs.iter().zip(probabilities) {
                told[*parameter] = Some(found);
            }
            heads.push(head);
        }
        Ok(heads)
    }

    /// What a frozen block says of every material, for each parameter that it tells.
    fn probabilities(
        &self,
        head: &Head,
        plan: &HeadPlan,
        inputs: &dyn Inputs,
    ) -> Result<Vec<Features>, TrainingError> {
        let device = self.device.clone().without_autodiff();
        let all: Vec<usize> = (0..self.pairs.labels.len()).collect();
        let logits = logits_of(head, inputs, &all, &device)?;
        let count = plan.outputs.len();
        let of_output = |place: usize| {
            let rows = logits.chunks_exact(count * BINS);
            let rows = rows.flat_map(|row| {
                let logits: [f64; BINS] =
                    std::array::from_fn(|bin| f64::from(row[place * BINS + bin]));
                softmax(&logits).map(f16::from_f64_const)
            });
            Features::new(BINS, rows.collect())
        };
        Ok((0..count).map(of_output).collect())
    }

    /// Trains one network from where its checkpoint left it, and returns its best epoch's weights.
    fn train_stage<N: Network>(
        &mut self,
        name: StageName,
        fresh: N,
        inputs: &dyn Inputs,
        outputs: Vec<(usize, f32)>,
    ) -> Result<N, TrainingError> {
        let number = self.number;
        self.number += 1;
        if number < self.state.finished {
            return unpack(fresh, &self.checkpoints.read_finished(number)?);
        }
        let stage = Stage {
            name: name.text(),
            number: name.number(),
            inputs,
            outputs,
            pairs: self.pairs,
            targets: &self.targets,
            metric: self.options.metric.as_ref().map(|metric| metric.share),
            epochs: self.options.epochs(name),
            patience: self.options.patience,
            optimiser: self.options.optimiser,
            block: matches!(name, StageName::Block(_)),
            dropout: self.options.dropout,
            seed: self.options.seed,
            device: self.device.clone(),
        };
        let mut learner = match self.state.stage {
            Some(state) => {
                let packed = self.checkpoints.read_stage(number, state.epoch)?;
                Learner::resume(fresh, &stage, state, packed)?
            }
            None => Learner::new(fresh, &stage),
        };
        let mut pace = Pace::default();
        while !learner.finished(&stage) {
            let epoch = learner.state.epoch;
            let line = learner.epoch(&stage, &|done, steps| {
                (self.tell)(Progress::Step {
                    stage: &stage.name,
                    epoch,
                    epochs: stage.epochs,
                    done,
                    steps,
                });
            })?;
            self.state.stage = Some(learner.state);
            self.state.log.push(line);
            pace.keep(|| {
                self.checkpoints
                    .write_stage(&self.state, &learner.packed()?)
            })?;
            self.checkpoints.write_log(&self.state)?;
            if let Some(line) = self.state.log.last() {
                if let Some(events) = &mut self.events {
                    events.append(line)?;
                }
                (self.tell)(Progress::Epoch {
                    line,
                    epochs: stage.epochs,
                });
            }
        }
        let best = learner.packed_best()?;
        self.checkpoints.finish_stage(&mut self.state, &best)?;
        unpack(learner.network, &best)
    }
}

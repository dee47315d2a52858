//! One network's training: epochs of steps.

use super::inputs::Inputs;
use super::network::Network;
use super::options::{BATCH, Optimiser};
use super::state::{EpochLine, StageState};
use super::targets::Targets;
use crate::data::Pairs;
use crate::error::TrainingError;
use crate::keystream::{Purpose, keystream};
use crate::labels::BINS;
use crate::labels::loss::cross_entropy;
use crate::network::dropout::Dropout;
use crate::network::loss::{cross_entropies, metric_loss, weighted_mean};
use burn::module::{Module, ModuleVisitor, Param};
use burn::optim::{AdamWConfig, GradientsParams, ModuleOptimizer, SgdConfig};
use burn::store::ModuleRecord;
use burn::tensor::{Bytes, Device, Tensor, TensorData};
use dataset::Split;
use rand_chacha::rand_core::Rng;
use std::f64::consts::PI;

/// Materials of a batch where nothing is learned.
const EVALUATION_BATCH: usize = 128;

/// One network to train, and on what.
pub struct Stage<'a> {
    /// Its name in the log: cnn0, cnnw, block1, ...
    pub name: String,
    /// Its number in the streams of order and dropout: the same in every variant that has it.
    pub number: u32,
    /// What it reads.
    pub inputs: &'a dyn Inputs,
    /// Parameters that it tells, and the weights of their losses.
    pub outputs: Vec<(usize, f32)>,
    /// The pairs and their targets.
    pub pairs: &'a Pairs,
    /// Targets of all parameters.
    pub targets: &'a Targets,
    /// How much the metric loss counts beside the cross-entropy, if it does.
    pub metric: Option<f64>,
    /// Epochs, at most.
    pub epochs: u32,
    /// Epochs without a better excess after which it ends.
    pub patience: u32,
    /// How weights follow gradients, with the rate at the beginning.
    pub optimiser: Optimiser,
    /// Whether it is a block: the paper's rates differ.
    pub block: bool,
    /// Whether activations are dropped.
    pub dropout: bool,
    /// The seed of order and dropout.
    pub seed: u64,
    /// Where it is trained, with derivatives.
    pub device: Device,
}

/// A network in training.
pub(super) struct Learner<N> {
    pub network: N,
    optimiser: ModuleOptimizer,
    pub state: StageState,
    // The network after its best epoch, without derivatives.
    best: Option<N>,
}

/// Packs a network's weights. The network is not changed.
pub(super) fn pack<N: Module>(network: &N) -> Result<Vec<u8>, TrainingError> {
    let bytes = network.clone().into_record().into_bytes();
    Ok(bytes.map_err(weights)?.to_vec())
}

/// The network with packed weights.
pub(super) fn unpack<N: Module>(network: N, bytes: &[u8]) -> Result<N, TrainingError> {
    let record = ModuleRecord::from_bytes(Bytes::from_bytes_vec(bytes.to_vec()));
    network
        .try_load_record(record.map_err(weights)?)
        .map_err(weights)
}

fn weights(error: impl std::fmt::Display) -> TrainingError {
    TrainingError::Weights(error.to_string())
}

impl<N: Network> Learner<N> {
    /// At the beginning.
    pub fn new(network: N, stage: &Stage<'_>) -> Self {
        Self {
            network,
            optimiser: stage.new_optimiser(),
            state: StageState::default(),
            best: None,
        }
    }

    /// Where a checkpoint left it.
    pub fn resume(
        network: N,
        stage: &Stage<'_>,
        state: StageState,
        packed: [Vec<u8>; 3],
    ) -> Result<Self, TrainingError> {
        let [weights_now, optimiser, best] = packed;
        let optimiser = stage
            .new_optimiser()
            .from_bytes(Bytes::from_bytes_vec(optimiser))
            .map_err(weights)?;
        let network = unpack(network, &weights_now)?;
        Ok(Self {
            best: Some(unpack(network.valid(), &best)?),
            network,
            optimiser,
            state,
        })
    }

    /// Weights, optimiser and best weights, packed.
    pub fn packed(&self) -> Result<[Vec<u8>; 3], TrainingError> {
        let optimiser = self.optimiser.into_bytes().map_err(weights)?;
        Ok([
            pack(&self.network)?,
            optimiser.to_vec(),
            self.packed_best()?,
        ])
    }

    /// The best weights, packed; before the first epoch those of the beginning.
    pub fn packed_best(&self) -> Result<Vec<u8>, TrainingError> {
        pack(self.best.as_ref().unwrap_or(&self.network))
    }

    /// Whether no epoch is left.
    pub fn finished(&self, stage: &Stage<'_>) -> bool {
        let waited = self.state.epoch - self.state.best_epoch;
        self.state.epoch >= stage.epochs || waited >= stage.patience
    }

    /// One epoch; `tell` hears how many of how many steps are done.
    pub fn epoch(
        &mut self,
        stage: &Stage<'_>,
        tell: &dyn Fn(u64, u64),
    ) -> Result<EpochLine, TrainingError> {
        let order = stage.order(self.state.epoch);
        let steps = order.len().div_ceil(BATCH) as u64;
        let (mut loss, mut count) = (0.0, 0.0);
        for (done, positions) in order.chunks(BATCH).enumerate() {
            let mean = self.step(stage, positions, steps)?;
            loss += mean * positions.len() as f64;
            count += positions.len() as f64;
            tell(done as u64 + 1, steps);
        }
        self.state.epoch += 1;
        let valid = self.network.valid();
        let excesses = excesses(&valid, stage)?;
        let excess = excesses.iter().sum::<f64>() / excesses.len() as f64;
        if self.best.is_none() || excess < self.state.best_excess {
            self.state.best_excess = excess;
            self.state.best_epoch = self.state.epoch;
            self.best = Some(valid);
        }
        Ok(EpochLine {
            stage: stage.name.clone(),
            epoch: self.state.epoch,
            step: self.state.step,
            rate: stage.rate(self.state.step, steps),
            loss: loss / count,
            excess,
            parameters: stage
                .outputs
                .iter()
                .map(|(parameter, _)| *parameter)
                .collect(),
            excesses,
        })
    }

    /// One step; the batch's loss before it.
    fn step(
        &mut self,
        stage: &Stage<'_>,
        positions: &[usize],
        steps: u64,
    ) -> Result<f64, TrainingError> {
        let diverged = |what| TrainingError::Diverged {
            what,
            stage: stage.name.clone(),
            step: self.state.step,
            materials: positions
                .iter()
                .map(|&position| stage.pairs.labels[position].index)
                .collect(),
        };
        let dropout = stage.dropout(self.state.step);
        let rows = stage.inputs.rows(positions, Some(self.state.epoch));
        let inputs = tensor(rows, [positions.len(), stage.inputs.width()], &stage.device);
        let logits = stage.by_parameter(self.network.logits(inputs, dropout));
        let loss = stage.loss(logits, positions);
        let gradients = GradientsParams::from_grads(loss.backward(), &self.network);
        let squares = sum_of_squares(&gradients, &self.network);
        // Both are read at once: a device works ahead until it is asked.
        let read = numbers(Tensor::cat(vec![loss.inner(), squares], 0))?;
        let value = f64::from(read[0]);
        if !value.is_finite() {
            return Err(diverged("the loss"));
        }
        if !read[1].is_finite() {
            return Err(diverged("a gradient"));
        }
        let rate = stage.rate(self.state.step, steps);
        self.network = self.optimiser.step(rate, self.network.clone(), gradients);
        self.state.step += 1;
        Ok(value)
    }
}

impl Stage<'_> {
    fn new_optimiser(&self) -> ModuleOptimizer {
        match self.optimiser {
            Optimiser::Sgd { .. } => SgdConfig::new().init(),
            // PyTorch's defaults.
            Optimiser::AdamW { .. } => AdamWConfig::new()
                .with_epsilon(1e-8)
                .with_weight_decay(1e-2)
                .init(),
        }
    }

    /// The learning rate of a step, where an epoch has `steps`.
    fn rate(&self, step: u64, steps: u64) -> f64 {
        match self.optimiser {
            Optimiser::Sgd { block_rate, .. } if self.block => block_rate,
            Optimiser::Sgd { cnn_rate, .. } => cnn_rate,
            Optimiser::AdamW { rate } => {
                let all = (u64::from(self.epochs) * steps) as f64;
                rate * (1.0 + libm::cos(PI * step as f64 / all)) / 2.0
            }
        }
    }

    /// The training split in the order of an epoch.
    fn order(&self, epoch: u32) -> Vec<usize> {
        let stream = u64::from(self.number) << 32 | u64::from(epoch);
        let mut rng = keystream(self.seed, Purpose::Order, stream);
        let positions = self.pairs.positions(Split::Train);
        let mut keyed: Vec<(u64, usize)> = positions
            .into_iter()
            .map(|position| (rng.next_u64(), position))
            .collect();
        keyed.sort_unstable();
        keyed.into_iter().map(|(_, position)| position).collect()
    }

    fn dropout(&self, step: u64) -> Option<Dropout> {
        let key = u64::from(self.number) << 32 | step;
        self.dropout.then(|| Dropout::new(self.seed, key))
    }

    /// (batch, parameters x 100) as (batch, parameters, 100).
    fn by_parameter(&self, logits: Tensor<2>) -> Tensor<3> {
        let [batch, _] = logits.dims();
        logits.reshape([batch, self.outputs.len(), BINS])
    }

    fn loss(&self, logits: Tensor<3>, positions: &[usize]) -> Tensor<1> {
        let shape = logits.dims();
        let [batch, count, _] = shape;
        let parameters: Vec<usize> = self
            .outputs
            .iter()
            .map(|(parameter, _)| *parameter)
            .collect();
        let targets = tensor(
            self.targets.rows(positions, &parameters),
            shape,
            &self.device,
        );
        let of_material = |&position: &usize| {
            let outputs = self.outputs.iter();
            outputs
                .map(move |(parameter, weight)| weight * self.targets.weight(position, *parameter))
        };
        let weights: Vec<f32> = positions.iter().flat_map(of_material).collect();
        let weights = tensor(weights, [batch, count], &self.device);
        let loss = weighted_mean(cross_entropies(logits.clone(), targets), weights);
        let Some(share) = self.metric else {
            return loss;
        };
        let offsets = self.targets.offsets(positions, &parameters);
        let metrics = self.targets.metrics(positions, &parameters);
        let metric = metric_loss(
            logits,
            tensor(offsets, shape, &self.device),
            tensor(metrics, [batch, count, count], &self.device),
        );
        loss + metric.mul_scalar(share)
    }
}

/// A tensor of numbers in row-major order.
pub(super) fn tensor<const D: usize>(
    values: Vec<f32>,
    shape: [usize; D],
    device: &Device,
) -> Tensor<D> {
    Tensor::from_data(TensorData::new(values, shape), device)
}

/// The numbers of a tensor in row-major order.
pub(super) fn numbers<const D: usize>(tensor: Tensor<D>) -> Result<Vec<f32>, TrainingError> {
    let data = tensor.try_into_data().map_err(weights)?;
    data.try_into_vec::<f32>().map_err(weights)
}

/// The logits of materials without dropout, (position, parameters x 100). `network` is on a device
/// without derivatives.
pub(super) fn logits_of<N: Network>(
    network: &N,
    inputs: &dyn Inputs,
    positions: &[usize],
    device: &Device,
) -> Result<Vec<f32>, TrainingError> {
    let mut all = Vec::new();
    for positions in positions.chunks(EVALUATION_BATCH) {
        let rows = inputs.rows(positions, None);
        let inputs = tensor(rows, [positions.len(), inputs.width()], device);
        all.extend(numbers(network.logits(inputs, None))?);
    }
    Ok(all)
}

/// Mean over the validation split of loss less entropy, for each parameter, in nats.
fn excesses<N: Network>(network: &N, stage: &Stage<'_>) -> Result<Vec<f64>, TrainingError> {
    let positions = stage.pairs.positions(Split::Validation);
    let device = stage.device.clone().without_autodiff();
    let logits = logits_of(network, stage.inputs, &positions, &device)?;
    let mut sums = vec![0.0; stage.outputs.len()];
    let rows = logits.chunks_exact(stage.outputs.len() * BINS);
    for (&position, row) in positions.iter().zip(rows) {
        for (place, logits) in row.chunks_exact(BINS).enumerate() {
            let (parameter, _) = stage.outputs[place];
            let target = stage.targets.target(position, parameter);
            let loss = cross_entropy(
                logits.iter().copied().map(f64::from),
                target.iter().copied().map(f64::from),
            );
            sums[place] += loss - stage.targets.entropy(position, parameter);
        }
    }
    let count = positions.len() as f64;
    Ok(sums.into_iter().map(|sum| sum / count).collect())
}

struct Squares<'a> {
    gradients: &'a GradientsParams,
    sum: Option<Tensor<1>>,
}

impl ModuleVisitor for Squares<'_> {
    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        if let Some(gradient) = self.gradients.get::<D>(param.id) {
            let squares = (gradient.clone() * gradient).sum();
            self.sum = Some(match self.sum.take() {
                Some(sum) => sum + squares,
                None => squares,
            });
        }
    }
}

/// The sum of the squares of all gradients: finite where all of them are, and small enough.
fn sum_of_squares<N: Module>(gradients: &GradientsParams, network: &N) -> Tensor<1> {
    let mut squares = Squares {
        gradients,
        sum: None,
    };
    network.visit(&mut squares);
    let Some(sum) = squares.sum else {
        unreachable!("a network has weights");
    };
    sum
}

//! A trained model: one safetensors file with PyTorch's names and layouts, and in its metadata, under
//! one key, everything that is needed to apply it.

mod claims;

use crate::data::{Identity, Pairs};
use crate::error::{TrainingError, bad_input};
use crate::fit::inputs::{Codes, Inputs, Photographs};
use crate::fit::options::Options;
use crate::labels::loss::softmax;
use crate::labels::reading::{Reader, Reading};
use crate::labels::{BINS, PARAMETERS};
use crate::network::estimator::Estimator;
use crate::pixels::CHANNELS;
use crate::pixels::noise::Noise;
use crate::pixels::normalisation::Normalisation;
use burn::store::{BurnToPyTorchAdapter, ModuleSnapshot, PyTorchToBurnAdapter, SafetensorsStore};
use burn::tensor::{Device, Tensor, TensorData};
use dataset::{Material, Specification};
use export::file::{sync_folder, unable, write_bytes};
use half::f16;
use rand_chacha::rand_core::Rng;
use rand_distr::{Distribution, StandardUniform};
use safetensors::SafeTensors;
use serde::{Deserialize, Serialize};
use std::fs;
use std::path::Path;

/// The metadata's key. Only one: a map of several would be written in random order.
const METADATA: &str = "brdfarm";

/// Materials that are read at one time.
const BATCH: usize = 64;

/// A distribution over bins for each parameter.
pub type Distributions = [[f64; BINS]; PARAMETERS];

/// How a model was trained and is applied.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModelOptions {
    /// The options of its training.
    pub training: Options,
    /// What it was trained on.
    pub identity: Identity,
    /// Digest of the pixels and labels that it was trained on.
    pub pairs: String,
    /// How CNN_0's and CNN_w's photographs are normalised; absent for a trunk that it has not.
    pub normalisations: [Option<Normalisation>; 2],
    /// The specification that its images were rendered under, as JSON.
    pub specification: String,
}

impl ModelOptions {
    /// The specification that its images were rendered under.
    ///
    /// # Errors
    /// When it is none, as in a file that was edited.
    pub fn scene(&self) -> Result<Specification, TrainingError> {
        Specification::from_json(&self.specification)
            .map_err(|error| TrainingError::Input(format!("the model's specification: {error}")))
    }
}

/// A trained model on a device without derivatives.
#[derive(Debug)]
pub struct Model {
    /// How it was trained and is applied.
    pub options: ModelOptions,
    /// The networks.
    pub estimator: Estimator,
}

impl Model {
    /// Writes the file whole. The same model gives the same bytes.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn write(&self, path: &Path) -> Result<(), TrainingError> {
        let json = serde_json::to_string(&self.options)
            .map_err(|error| TrainingError::Weights(error.to_string()))?;
        let mut store = SafetensorsStore::from_bytes(None)
            .with_to_adapter(BurnToPyTorchAdapter)
            .clear_metadata()
            .metadata(METADATA, json);
        let saved = self.estimator.save_into(&mut store);
        saved.map_err(|error| TrainingError::Weights(error.to_string()))?;
        let bytes = store
            .get_bytes()
            .map_err(|error| TrainingError::Weights(error.to_string()))?;
        write_bytes(path, &bytes)?;
        match path.parent() {
            Some(folder) if !folder.as_os_str().is_empty() => Ok(sync_folder(folder)?),
            _ => Ok(()),
        }
    }

    /// Reads a file.
    ///
    /// # Errors
    /// When it is missing, damaged or no model of brdfarm.
    pub fn read(path: &Path, device: &Device) -> Result<Self, TrainingError> {
        let bytes = fs::read(path).map_err(unable("read", path))?;
        let no_model = |reason: String| bad_input(path, format!("no model of brdfarm: {reason}"));
        let (_, header) =
            SafeTensors::read_metadata(&bytes).map_err(|error| no_model(error.to_string()))?;
        let metadata = header.metadata().as_ref().and_then(|map| map.get(METADATA));
        let json = metadata.ok_or_else(|| no_model(format!("it lacks the key {METADATA}")))?;
        let options: ModelOptions =
            serde_json::from_str(json).map_err(|error| no_model(error.to_string()))?;
        if let Some(fault) = options.fault(bytes.len()) {
            return Err(no_model(fault));
        }
        let training = &options.training;
        let mut estimator = Estimator::new(training.variant, training.architecture, 0, device);
        let mut store = SafetensorsStore::from_bytes(Some(bytes))
            .with_from_adapter(PyTorchToBurnAdapter)
            .allow_partial(false);
        estimator
            .load_from(&mut store)
            .map_err(|error| no_model(error.to_string()))?;
        Ok(Self { options, estimator })
    }

    /// Refuses pairs of another dataset, renderer, side or views than it was trained on.
    ///
    /// # Errors
    /// Names what differs.
    pub fn check(&self, path: &Path, pairs: &Pairs) -> Result<(), TrainingError> {
        let (ours, theirs) = (&self.options.identity, &pairs.identity);
        let differs = |what: &str, ours: String, theirs: String| {
            bad_input(
                path,
                format!("the model was trained on {what} {ours}, the export has {theirs}"),
            )
        };
        if ours.specification != theirs.specification {
            let (ours, theirs) = (ours.specification.clone(), theirs.specification.clone());
            return Err(differs("the specification", ours, theirs));
        }
        if ours.renderer_version != theirs.renderer_version {
            let (ours, theirs) = (
                ours.renderer_version.clone(),
                theirs.renderer_version.clone(),
            );
            return Err(differs("images of renderer version", ours, theirs));
        }
        if ours.views != theirs.views {
            let (ours, theirs) = (format!("{:?}", ours.views), format!("{:?}", theirs.views));
            return Err(differs("the views", ours, theirs));
        }
        Ok(())
    }

    /// What the model says of materials, by their positions in `pairs`, from photographs with noise.
    ///
    /// # Errors
    /// When the device fails.
    pub fn distributions(
        &self,
        pairs: &Pairs,
        positions: &[usize],
        noise: Noise,
        device: &Device,
    ) -> Result<Vec<Distributions>, TrainingError> {
        let codes = Codes::new(pairs, self.options.training.encoding);
        let readers = self.options.normalisations.clone().map(|normalisation| {
            normalisation.map(|normalisation| Photographs {
                codes: &codes,
                normalisation,
                noise,
            })
        });
        let mut all = Vec::with_capacity(positions.len());
        for positions in positions.chunks(BATCH) {
            let photographs = readers.each_ref().map(|reader| {
                reader.as_ref().map(|reader| {
                    let shape = [positions.len(), CHANNELS, pairs.side(), pairs.side()];
                    let rows = reader.rows(positions, None);
                    Tensor::from_data(TensorData::new(rows, shape), device)
                })
            });
            all.extend(self.apply(photographs)?);
        }
        Ok(all)
    }

    /// What the model says of one pair: six planes of side x side, the oblique view's first, linear,
    /// in units of white.
    ///
    /// # Errors
    /// When the device fails.
    pub fn read_pair(
        &self,
        planes: &[f16],
        device: &Device,
    ) -> Result<Distributions, TrainingError> {
        let table = self.options.training.encoding.table();
        let side = self.options.identity.side as usize;
        let photographs = self.options.normalisations.each_ref().map(|normalisation| {
            normalisation.as_ref().map(|normalisation| {
                let codes = planes
                    .iter()
                    .map(|pixel| table[usize::from(pixel.to_bits())]);
                let mut codes: Vec<f32> = codes.collect();
                normalisation.apply(&mut codes);
                let shape = [1, CHANNELS, side, side];
                Tensor::from_data(TensorData::new(codes, shape), device)
            })
        });
        let found = self.apply(photographs)?.into_iter().next();
        found.ok_or_else(|| TrainingError::Weights("the network answers nothing".to_owned()))
    }

    /// What the model says of photographs, normalised as CNN_0 and as CNN_w read them.
    fn apply(
        &self,
        photographs: [Option<Tensor<4>>; 2],
    ) -> Result<Vec<Distributions>, TrainingError> {
        let logits = self
            .estimator
            .logits(self.options.training.variant, photographs);
        let numbers = logits
            .try_into_data()
            .map_err(|error| TrainingError::Weights(error.to_string()))?
            .try_into_vec::<f32>()
            .map_err(|error| TrainingError::Weights(error.to_string()))?;
        if !numbers.iter().all(|number| number.is_finite()) {
            return Err(TrainingError::Weights(
                "a network's answer is not finite".to_owned(),
            ));
        }
        let materials = numbers.chunks_exact(PARAMETERS * BINS);
        let each = materials.map(|row| {
            std::array::from_fn(|parameter| {
                let row = &row[parameter * BINS..][..BINS];
                softmax::<BINS>(&std::array::from_fn(|bin| f64::from(row[bin])))
            })
        });
        Ok(each.collect())
    }

    /// A reader of this model's distributions.
    pub fn reader(&self, reading: Reading) -> Reader {
        Reader::new(reading, self.options.training.smoothing)
    }

    /// The labels, in their units, that distributions are read as.
    pub fn values(&self, distributions: &Distributions, reader: &Reader) -> [f64; PARAMETERS] {
        let axes = self.options.training.colours.axes();
        std::array::from_fn(|parameter| {
            let axis = &axes[parameter];
            axis.value(reader.position(&distributions[parameter], axis.circular))
        })
    }

    /// A material drawn from distributions, each parameter by itself, evenly within its bin.
    pub(crate) fn draw(&self, distributions: &Distributions, rng: &mut impl Rng) -> Material {
        let colours = self.options.training.colours;
        let axes = colours.axes();
        let values: [f64; PARAMETERS] = std::array::from_fn(|parameter| {
            let mut left: f64 = StandardUniform.sample(rng);
            let within: f64 = StandardUniform.sample(rng);
            let mut probabilities = distributions[parameter].iter();
            // Rounding may leave a little behind the last bin.
            let bin = probabilities.position(|probability| {
                left -= probability;
                left < 0.0
            });
            let bin = bin.unwrap_or(BINS - 1);
            axes[parameter].value(bin as f64 + within - 0.5)
        });
        colours.material(&values)
    }

    /// The material that distributions are read as.
    pub fn material(&self, distributions: &Distributions, reader: &Reader) -> Material {
        let values = self.values(distributions, reader);
        self.options.training.colours.material(&values)
    }
}

//! What a training leaves on the disk so that it can go on after any kill.
//!
//! ```text
//! OUT/state.json        options, finished stages, log, and where the stage in hand stands
//! OUT/stage-N-E/        weights.bpk, optimiser.bpk, best.bpk of stage N after E epochs
//! OUT/stage-N.bpk       the best weights of a finished stage
//! OUT/log.csv           the log
//! OUT/tensorboard/      the log as TensorBoard reads it, if that was asked for
//! OUT/model.safetensors the result
//! ```
//!
//! `state.json` is replaced last, by a rename, and names everything else. What it does not name is
//! left over from a kill and removed by the training that goes on.

use super::events;
use super::options::Options;
use super::state::{EpochLine, StageState, csv};
use crate::data::Identity;
use crate::error::{TrainingError, bad_input};
use export::file::{beside, sync_folder, unable, write_bytes};
use serde::{Deserialize, Serialize};
use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

const STATE: &str = "state.json";
const PARTS: [&str; 3] = ["weights.bpk", "optimiser.bpk", "best.bpk"];

/// The result's name.
pub const MODEL: &str = "model.safetensors";

/// What `state.json` holds.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct State {
    /// What decides the weights.
    pub options: Options,
    /// What is trained on.
    pub identity: Identity,
    /// Digest of the pixels and labels.
    pub pairs: String,
    /// Stages finished.
    pub finished: u32,
    /// Where the stage in hand stands; absent before its first checkpoint.
    pub stage: Option<StageState>,
    /// All epochs so far.
    pub log: Vec<EpochLine>,
}

/// The folder of a training.
#[derive(Debug)]
pub struct Checkpoints {
    folder: PathBuf,
}

impl Checkpoints {
    /// A new or an existing folder.
    ///
    /// # Errors
    /// When it cannot be made.
    pub fn new(folder: &Path) -> Result<Self, TrainingError> {
        fs::create_dir_all(folder).map_err(unable("make", folder))?;
        Ok(Self {
            folder: folder.to_owned(),
        })
    }

    /// The folder of another training. Makes nothing.
    pub(super) fn of(folder: &Path) -> Self {
        Self {
            folder: folder.to_owned(),
        }
    }

    /// The state that a training of `fresh`'s options and data left, or `fresh` where there is none,
    /// once `begin` has put into folder and state what a new training begins with.
    ///
    /// # Errors
    /// When the folder holds another training, naming what differs, or something else; when what a
    /// kill left over cannot be removed; and those of `begin`.
    pub fn resume_or(
        &self,
        fresh: State,
        begin: impl FnOnce(&mut State) -> Result<(), TrainingError>,
    ) -> Result<State, TrainingError> {
        let Some(found) = self.read_state()? else {
            let mut fresh = self.empty_or(fresh)?;
            begin(&mut fresh)?;
            return Ok(fresh);
        };
        if let Some(difference) = difference(&found, &fresh)? {
            return Err(bad_input(
                &self.folder,
                format!("the folder holds another training, {difference}: choose another folder"),
            ));
        }
        // No checkpoint follows a kill that fell after the last one.
        self.remove_others(found.finished, found.stage.map_or(0, |stage| stage.epoch))?;
        Ok(found)
    }

    /// What the folder says of its training; `None` where there is none.
    pub(super) fn read_state(&self) -> Result<Option<State>, TrainingError> {
        let path = self.folder.join(STATE);
        let text = match fs::read(&path) {
            Ok(text) => text,
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(None),
            Err(error) => return Err(unable("read", &path)(error).into()),
        };
        serde_json::from_slice(&text)
            .map_err(|error| bad_input(&path, format!("no state of a training: {error}")))
            .map(Some)
    }

    fn empty_or(&self, fresh: State) -> Result<State, TrainingError> {
        let mut entries = fs::read_dir(&self.folder).map_err(unable("read", &self.folder))?;
        let ours = |name: &std::ffi::OsStr| {
            let name = name.to_string_lossy();
            ["lost+found", "state.json.new", events::FOLDER].contains(&name.as_ref())
                || name.starts_with("stage-")
        };
        let occupant = entries.find_map(|entry| {
            let name = entry.ok()?.file_name();
            (!ours(&name)).then_some(name)
        });
        match occupant {
            None => Ok(fresh),
            Some(name) => Err(bad_input(
                &self.folder,
                format!("the folder holds {name:?}: choose an empty or a new folder"),
            )),
        }
    }

    fn stage_folder(&self, stage: u32, epoch: u32) -> PathBuf {
        self.folder.join(format!("stage-{stage}-{epoch}"))
    }

    /// Weights, optimiser and best weights of a stage, packed.
    ///
    /// # Errors
    /// When they cannot be read.
    pub fn read_stage(&self, stage: u32, epoch: u32) -> Result<[Vec<u8>; 3], TrainingError> {
        let folder = self.stage_folder(stage, epoch);
        let read = |part: &str| {
            let path = folder.join(part);
            fs::read(&path).map_err(unable("read", &path))
        };
        let [weights, optimiser, best] = PARTS.map(read);
        Ok([weights?, optimiser?, best?])
    }

    /// Writes a stage's checkpoint, then the state that names it, then removes the one before.
    ///
    /// # Errors
    /// When it cannot be written. The checkpoint before is still there.
    pub fn write_stage(&self, state: &State, parts: &[Vec<u8>; 3]) -> Result<(), TrainingError> {
        let epoch = state.stage.map_or(0, |stage| stage.epoch);
        let folder = self.stage_folder(state.finished, epoch);
        let aside = beside(&folder);
        for path in [&aside, &folder] {
            remove_folder(path)?;
        }
        fs::create_dir(&aside).map_err(unable("make", &aside))?;
        for (name, bytes) in PARTS.into_iter().zip(parts) {
            write_bytes(&aside.join(name), bytes)?;
        }
        sync_folder(&aside)?;
        fs::rename(&aside, &folder).map_err(unable("rename to", &folder))?;
        // The state must not be durable before what it names.
        sync_folder(&self.folder)?;
        self.write_state(state)?;
        self.remove_others(state.finished, epoch)
    }

    /// Writes the best weights of a finished stage, then the state that counts it as finished.
    ///
    /// # Errors
    /// When they cannot be written.
    pub fn finish_stage(&self, state: &mut State, best: &[u8]) -> Result<(), TrainingError> {
        write_bytes(&self.finished_path(state.finished), best)?;
        sync_folder(&self.folder)?;
        state.finished += 1;
        state.stage = None;
        self.write_state(state)?;
        self.remove_others(state.finished, 0)
    }

    fn finished_path(&self, stage: u32) -> PathBuf {
        self.folder.join(format!("stage-{stage}.bpk"))
    }

    /// The best weights of a finished stage, packed.
    ///
    /// # Errors
    /// When they cannot be read.
    pub fn read_finished(&self, stage: u32) -> Result<Vec<u8>, TrainingError> {
        let path = self.finished_path(stage);
        Ok(fs::read(&path).map_err(unable("read", &path))?)
    }

    /// Writes the log as the state has it.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn write_log(&self, state: &State) -> Result<(), TrainingError> {
        let names = state.options.colours.axes().map(|axis| axis.name);
        let path = self.folder.join("log.csv");
        Ok(write_bytes(&path, csv(&state.log, names).as_bytes())?)
    }

    /// The path of a file of the result.
    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.join(name)
    }

    fn write_state(&self, state: &State) -> Result<(), TrainingError> {
        let path = self.folder.join(STATE);
        let json = serde_json::to_vec_pretty(state)
            .map_err(|error| TrainingError::Weights(error.to_string()))?;
        write_bytes(&path, &json)?;
        Ok(sync_folder(&self.folder)?)
    }

    /// Removes checkpoints of stages but for one.
    fn remove_others(&self, stage: u32, epoch: u32) -> Result<(), TrainingError> {
        let kept = self.stage_folder(stage, epoch);
        let entries = fs::read_dir(&self.folder).map_err(unable("read", &self.folder))?;
        for entry in entries.flatten() {
            let path = entry.path();
            let name = entry.file_name();
            if name.to_string_lossy().starts_with("stage-") && path.is_dir() && path != kept {
                remove_folder(&path)?;
            }
        }
        Ok(())
    }
}

/// Decides after which epochs a checkpoint is written: after each one, unless writing it takes more
/// than a tenth of an epoch, as on a GPU. Then epochs pass until it takes a tenth of the time.
#[derive(Debug, Default)]
pub(super) struct Pace {
    // When the last one was written, and how long that took.
    last: Option<(Instant, Duration)>,
}

impl Pace {
    /// The time between two checkpoints, over the time that writing the first of them took, at least.
    const EPOCHS_PER_CHECKPOINT: u32 = 10;

    /// Writes a checkpoint if it is time.
    pub fn keep<E>(&mut self, write: impl FnOnce() -> Result<(), E>) -> Result<(), E> {
        let early = |(end, took): (Instant, Duration)| {
            end.elapsed() < took.saturating_mul(Self::EPOCHS_PER_CHECKPOINT)
        };
        if self.last.is_some_and(early) {
            return Ok(());
        }
        let begin = Instant::now();
        write()?;
        self.last = Some((Instant::now(), begin.elapsed()));
        Ok(())
    }
}

fn remove_folder(path: &Path) -> Result<(), TrainingError> {
    match fs::remove_dir_all(path) {
        Err(error) if error.kind() != ErrorKind::NotFound => {
            Err(unable("remove", path)(error).into())
        }
        _ => Ok(()),
    }
}

/// What tells two trainings apart, if anything does.
pub(super) fn difference(found: &State, wanted: &State) -> Result<Option<String>, TrainingError> {
    let json = |value: &Options| {
        serde_json::to_value(value).map_err(|error| TrainingError::Weights(error.to_string()))
    };
    if found.options != wanted.options {
        let (there, here) = (json(&found.options)?, json(&wanted.options)?);
        let fields = there.as_object().into_iter().flatten();
        let different = fields
            .filter(|(key, value)| here.get(*key) != Some(value))
            .map(|(key, value)| {
                let wanted = here.get(key).unwrap_or(&serde_json::Value::Null);
                format!("with {key} {value} where {wanted} is wanted")
            });
        let first = different.into_iter().next();
        return Ok(Some(
            first.unwrap_or_else(|| "with other options".to_owned()),
        ));
    }
    let other = found.identity != wanted.identity || found.pairs != wanted.pairs;
    Ok(other.then(|| "on other images".to_owned()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::convert::Infallible;
    use std::thread::sleep;

    /// How many checkpoints are written after epochs of a length, if each takes `took`.
    fn written(epochs: u32, epoch: Duration, took: Duration) -> u32 {
        let mut pace = Pace::default();
        let mut count = 0;
        for _ in 0..epochs {
            sleep(epoch);
            let kept = pace.keep(|| {
                sleep(took);
                count += 1;
                Ok::<_, Infallible>(())
            });
            assert!(kept.is_ok());
        }
        count
    }

    #[test]
    fn checkpoints_follow_every_long_epoch_and_few_short_ones() {
        assert_eq!(written(5, Duration::from_millis(20), Duration::ZERO), 5);
        // Ten times 300 ms is longer than all of these together.
        assert_eq!(written(5, Duration::ZERO, Duration::from_millis(300)), 1);
    }

    #[test]
    fn a_checkpoint_that_failed_is_tried_again() {
        let mut pace = Pace::default();
        assert_eq!(pace.keep(|| Err("full")), Err("full"));
        let mut kept = false;
        let again: Result<(), &str> = pace.keep(|| {
            kept = true;
            Ok(())
        });
        assert_eq!(again, Ok(()));
        assert!(kept);
    }
}

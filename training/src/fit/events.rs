//! The log as TensorBoard's event files, one folder a network.
//!
//! A file is a row of records (TensorFlow, `lib/io/record_writer.h`): the length in 8 bytes, its
//! masked CRC-32C, the bytes, and theirs. Each holds an `Event` message (`event.proto`). TensorBoard
//! reads what is appended while a training runs. A training that goes on writes new files of all
//! epochs so far, so that none is there twice and none is missing.

use super::state::EpochLine;
use crate::error::TrainingError;
use crate::labels::PARAMETERS;
use export::file::unable;
use prost::Message;
use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

/// The folder's name in that of a training.
pub(super) const FOLDER: &str = "tensorboard";

/// How the name of an event file begins.
const FILE_START: &str = "events.out.tfevents.";

/// What the first event of a file says.
const FILE_VERSION: &str = "brain.Event:2";

/// What is added to a rotated CRC-32C, so that the checksum of bytes that hold checksums is sound.
const MASK: u32 = 0xa282_ead8;

/// An event: those fields of `event.proto` that are written.
#[derive(Clone, PartialEq, Message)]
struct Event {
    /// Seconds since 1970.
    #[prost(double, tag = "1")]
    wall_time: f64,
    #[prost(int64, tag = "2")]
    step: i64,
    #[prost(oneof = "What", tags = "3, 5")]
    what: Option<What>,
}

#[derive(Clone, PartialEq, prost::Oneof)]
enum What {
    #[prost(string, tag = "3")]
    FileVersion(String),
    #[prost(message, tag = "5")]
    Summary(Summary),
}

/// `summary.proto`
#[derive(Clone, PartialEq, Message)]
struct Summary {
    #[prost(message, repeated, tag = "1")]
    values: Vec<Scalar>,
}

#[derive(Clone, PartialEq, Message)]
struct Scalar {
    #[prost(string, tag = "1")]
    tag: String,
    // One of several kinds of value: 0 is written too.
    #[prost(float, optional, tag = "2")]
    value: Option<f32>,
}

/// The event files of a training.
#[derive(Debug)]
pub(super) struct Events {
    folder: PathBuf,
    names: [&'static str; PARAMETERS],
    files: BTreeMap<String, OpenFile>,
}

/// The event file of a network.
#[derive(Debug)]
struct OpenFile {
    path: PathBuf,
    file: File,
}

impl Events {
    /// Writes the epochs so far into a folder, instead of what event files it holds. `names` are the
    /// parameters'.
    pub fn begin(
        folder: &Path,
        names: [&'static str; PARAMETERS],
        so_far: &[EpochLine],
    ) -> Result<Self, TrainingError> {
        fs::create_dir_all(folder).map_err(unable("make", folder))?;
        remove_old(folder)?;
        let mut events = Self {
            folder: folder.to_owned(),
            names,
            files: BTreeMap::new(),
        };
        for line in so_far {
            events.append(line)?;
        }
        Ok(events)
    }

    /// Appends an epoch.
    pub fn append(&mut self, line: &EpochLine) -> Result<(), TrainingError> {
        let now = seconds();
        if !self.files.contains_key(&line.stage) {
            let open = OpenFile::begin(&self.folder.join(&line.stage), now)?;
            self.files.insert(line.stage.clone(), open);
        }
        let Some(open) = self.files.get_mut(&line.stage) else {
            unreachable!("it was put there");
        };
        let summary = What::Summary(summary(line, self.names));
        open.append(&record(now, i64::from(line.epoch), summary))
    }
}

impl OpenFile {
    /// A new event file in a network's folder.
    fn begin(folder: &Path, now: f64) -> Result<Self, TrainingError> {
        fs::create_dir_all(folder).map_err(unable("make", folder))?;
        let path = folder.join(format!("{FILE_START}{now:.0}.brdfarm"));
        let file = File::create(&path).map_err(unable("write", &path))?;
        let mut open = Self { path, file };
        let version = What::FileVersion(FILE_VERSION.to_owned());
        open.append(&record(now, 0, version))?;
        Ok(open)
    }

    fn append(&mut self, record: &[u8]) -> Result<(), TrainingError> {
        let written = self.file.write_all(record);
        Ok(written.map_err(unable("write", &self.path))?)
    }
}

/// Removes event files of the networks' folders.
fn remove_old(folder: &Path) -> Result<(), TrainingError> {
    let entries = |folder: &Path| -> Result<Vec<PathBuf>, TrainingError> {
        let entries = fs::read_dir(folder).map_err(unable("read", folder))?;
        let paths = entries.map(|entry| Ok(entry?.path()));
        Ok(paths
            .collect::<Result<_, std::io::Error>>()
            .map_err(unable("read", folder))?)
    };
    for network in entries(folder)?.iter().filter(|path| path.is_dir()) {
        for file in entries(network)? {
            let name = file.file_name().unwrap_or_default().to_string_lossy();
            if name.starts_with(FILE_START) {
                fs::remove_file(&file).map_err(unable("remove", &file))?;
            }
        }
    }
    Ok(())
}

fn summary(line: &EpochLine, names: [&str; PARAMETERS]) -> Summary {
    let scalar = |tag: String, value: f64| Scalar {
        tag,
        value: Some(value as f32),
    };
    let mut values = vec![
        scalar("rate".to_owned(), line.rate),
        scalar("loss".to_owned(), line.loss),
        scalar("excess".to_owned(), line.excess),
    ];
    for (&parameter, &excess) in line.parameters.iter().zip(&line.excesses) {
        if let Some(name) = names.get(parameter) {
            values.push(scalar(format!("excess of/{name}"), excess));
        }
    }
    Summary { values }
}

fn record(wall_time: f64, step: i64, what: What) -> Vec<u8> {
    let event = Event {
        wall_time,
        step,
        what: Some(what),
    };
    let bytes = event.encode_to_vec();
    let length = (bytes.len() as u64).to_le_bytes();
    let mut record = length.to_vec();
    record.extend(masked(&length).to_le_bytes());
    record.extend(&bytes);
    record.extend(masked(&bytes).to_le_bytes());
    record
}

fn masked(bytes: &[u8]) -> u32 {
    crc32c::crc32c(bytes).rotate_right(15).wrapping_add(MASK)
}

/// Now, in seconds since 1970; 0 before.
fn seconds() -> f64 {
    let now = SystemTime::now().duration_since(UNIX_EPOCH);
    now.map_or(0.0, |now| now.as_secs_f64())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::labels::axes::Colours;

    fn line(stage: &str, epoch: u32) -> EpochLine {
        EpochLine {
            stage: stage.to_owned(),
            epoch,
            step: 10 * u64::from(epoch),
            rate: 1e-3,
            loss: 2.5,
            excess: 0.25,
            parameters: vec![3],
            excesses: vec![0.5],
        }
    }

    /// The events of all files of a network's folder.
    fn events(folder: &Path) -> Vec<Event> {
        let mut events = Vec::new();
        for file in fs::read_dir(folder).unwrap() {
            let bytes = fs::read(file.unwrap().path()).unwrap();
            let mut rest = bytes.as_slice();
            while !rest.is_empty() {
                let (length, checked) = rest.split_at(8);
                assert_eq!(checked[..4], masked(length).to_le_bytes());
                let count = u64::from_le_bytes(length.try_into().unwrap()) as usize;
                let (content, checked) = checked[4..].split_at(count);
                assert_eq!(checked[..4], masked(content).to_le_bytes());
                events.push(Event::decode(content).unwrap());
                rest = &checked[4..];
            }
        }
        events
    }

    #[test]
    fn a_training_that_goes_on_has_every_epoch_once() {
        let folder = tempfile::tempdir().unwrap();
        let names = Colours::Lab.axes().map(|axis| axis.name);
        let mut first = Events::begin(folder.path(), names, &[]).unwrap();
        first.append(&line("CNN_0", 1)).unwrap();
        first.append(&line("CNN_0", 2)).unwrap();
        drop(first);
        let so_far = [line("CNN_0", 1), line("CNN_0", 2), line("CNN_0", 3)];
        let mut second = Events::begin(folder.path(), names, &so_far).unwrap();
        second.append(&line("CNN_w", 1)).unwrap();

        let found = events(&folder.path().join("CNN_0"));
        let steps: Vec<i64> = found.iter().map(|event| event.step).collect();
        assert_eq!(steps, [0, 1, 2, 3]);
        let Some(What::Summary(summary)) = &found[3].what else {
            panic!("{found:?}");
        };
        let last = summary.values.last().unwrap();
        assert_eq!(
            (last.tag.as_str(), last.value),
            ("excess of/ior", Some(0.5))
        );
        assert_eq!(events(&folder.path().join("CNN_w")).len(), 2);
    }

    /// The checksum of RFC 3720, B.4, masked.
    #[test]
    fn checksums_are_crc_32c() {
        assert_eq!(crc32c::crc32c(&[0; 32]), 0x8a91_36aa);
        assert_eq!(
            masked(&[0; 32]),
            0x8a91_36aa_u32.rotate_right(15).wrapping_add(MASK)
        );
    }
}

//! The completion log: one line for each completed material, from which a lost ledger is rebuilt
//! and which readers read, with or without a coordinator at work.
//!
//! A line is the first 16 hexadecimal digits of the BLAKE3 hash of a JSON text, a space, the JSON
//! text of a [`Completion`] or of a [`Retraction`], and a newline. Lines are only ever appended;
//! where a material occurs twice the later line counts. A crash can tear the last line, which is
//! then cut off; a line that is damaged elsewhere is passed over and reported.

use dataset::Digest;
use imagestore::FileError;
use jobqueue::Completion;
use serde::{Deserialize, Serialize};
use std::{
    collections::{BTreeMap, BTreeSet},
    fs::{File, OpenOptions},
    io::{self, BufRead, BufReader, BufWriter, Read, Seek, SeekFrom, Write},
    os::unix::fs::FileExt,
    path::{Path, PathBuf},
};

const CHECKSUM_DIGITS: usize = 16;

/// The most damaged lines whose numbers are kept.
const BAD_LINES_LISTED_MAX: usize = 64;

/// A line that takes a material's completion back: what was delivered was wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Retraction {
    /// The material's index.
    pub retracted: u32,
}

/// What one line says.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Entry {
    /// A material was completed.
    Completed(Completion),
    /// Its completion no longer counts.
    Retracted(Retraction),
}

/// Where a line stands in the file.
#[derive(Clone, Copy, Debug)]
struct Place {
    offset: u64,
    bytes: u32,
    // Of the material's images.
    image_bytes: u64,
}

/// What a log holds; completions are read when they are asked for.
#[derive(Debug)]
pub struct Completions {
    file: File,
    path: PathBuf,
    places: BTreeMap<u32, Place>,
    /// Numbers, from 1, of the first lines that are damaged.
    pub bad_lines: Vec<u64>,
    /// How many lines are damaged.
    pub bad_line_count: u64,
    /// Bytes after the last newline.
    pub torn_bytes: u64,
    /// Bytes up to and with the last newline.
    pub whole_bytes: u64,
    // Lines up to there.
    lines: u64,
}

impl Completions {
    /// Reads a log and checks every line. Holds 24 bytes a line in memory, whatever lines hold.
    pub fn open(path: &Path) -> Result<Self, FileError> {
        let file = File::open(path).map_err(FileError::new("open", path))?;
        Self::read(file, path)
    }

    fn read(file: File, path: &Path) -> Result<Self, FileError> {
        let mut found = Self {
            file,
            path: path.to_owned(),
            places: BTreeMap::new(),
            bad_lines: Vec::new(),
            bad_line_count: 0,
            torn_bytes: 0,
            lines: 0,
            whole_bytes: 0,
        };
        found.read_on()?;
        Ok(found)
    }

    /// Reads the lines that were appended since it was last read. Returns the materials that they are
    /// about, in order.
    ///
    /// # Errors
    /// When the file cannot be read, or is shorter than it was: somebody else's log then.
    pub fn read_on(&mut self) -> Result<Vec<u32>, FileError> {
        let unable = |source| FileError::new("read", &self.path)(source);
        let length = self.file.metadata().map_err(unable)?.len();
        if length < self.whole_bytes {
            let why = "it is shorter than it was";
            return Err(unable(io::Error::new(io::ErrorKind::InvalidData, why)));
        }
        let mut file = self.file.try_clone().map_err(unable)?;
        file.seek(SeekFrom::Start(self.whole_bytes))
            .map_err(unable)?;
        let mut reader = BufReader::with_capacity(1 << 16, file);
        let mut changed = BTreeSet::new();
        self.torn_bytes = 0;
        let mut line = Vec::new();
        loop {
            let read = read_line(&mut reader, &mut line)
                .map_err(|source| FileError::new("read", &self.path)(source))?;
            if read == 0 {
                break;
            }
            if line.last() != Some(&b'\n') && !over_limit(&line) {
                self.torn_bytes = read;
                break;
            }
            self.lines += 1;
            match decode(&line) {
                Some(Entry::Completed(completion)) => {
                    let place = Place {
                        offset: self.whole_bytes,
                        bytes: line.len() as u32,
                        image_bytes: completion.bytes(),
                    };
                    self.places.insert(completion.material, place);
                    changed.insert(completion.material);
                }
                Some(Entry::Retracted(Retraction { retracted })) => {
                    self.places.remove(&retracted);
                    changed.insert(retracted);
                }
                None => self.note_bad_line(self.lines),
            }
            self.whole_bytes += read;
        }
        Ok(changed.into_iter().collect())
    }

    /// Adds a completion, as JSON, to what [`Transcript::read`] returned; [`Completions::read_on`]
    /// then reads it. Of a log it would be a line that its writer does not know of.
    ///
    /// # Errors
    /// When the transcript cannot be written.
    pub fn add_to_transcript(&self, json: &str) -> Result<(), FileError> {
        let line = format!("{} {json}\n", checksum(json.as_bytes()));
        let appended = self
            .file
            .metadata()
            .and_then(|metadata| self.file.write_all_at(line.as_bytes(), metadata.len()));
        appended.map_err(FileError::new("add to the copy of", &self.path))
    }

    /// How many materials are complete.
    pub fn len(&self) -> usize {
        self.places.len()
    }

    /// Whether none is.
    pub fn is_empty(&self) -> bool {
        self.places.is_empty()
    }

    /// Whether a material is complete.
    pub fn contains(&self, material: u32) -> bool {
        self.places.contains_key(&material)
    }

    /// The completed materials, in order.
    pub fn materials(&self) -> impl Iterator<Item = u32> {
        self.places.keys().copied()
    }

    /// Bytes of a complete material's images.
    pub fn image_bytes(&self, material: u32) -> Option<u64> {
        Some(self.places.get(&material)?.image_bytes)
    }

    /// Reads one completion. `None` where the material is not complete, and where its line was
    /// damaged since it was checked.
    pub fn get(&self, material: u32) -> Result<Option<Completion>, FileError> {
        let Some(place) = self.places.get(&material) else {
            return Ok(None);
        };
        let mut line = vec![0; place.bytes as usize];
        self.file
            .read_exact_at(&mut line, place.offset)
            .map_err(FileError::new("read", &self.path))?;
        Ok(match decode(&line) {
            Some(Entry::Completed(completion)) => Some(completion),
            _ => None,
        })
    }

    fn note_bad_line(&mut self, number: u64) {
        self.bad_line_count += 1;
        if self.bad_lines.len() < BAD_LINES_LISTED_MAX {
            self.bad_lines.push(number);
        }
    }
}

/// The log open for appending; a store has one at most.
#[derive(Debug)]
pub struct CompletionLog {
    file: File,
    path: PathBuf,
}

impl CompletionLog {
    /// Opens a log, or begins one, and cuts off a torn last line.
    pub fn open(path: &Path) -> Result<(Self, Completions), FileError> {
        let file = OpenOptions::new()
            .create(true)
            .append(true)
            .open(path)
            .map_err(FileError::new("open", path))?;
        let found = Completions::open(path)?;
        if found.torn_bytes > 0 {
            file.set_len(found.whole_bytes)
                .and_then(|()| file.sync_all())
                .map_err(FileError::new("cut the torn last line off", path))?;
        }
        let path = path.to_owned();
        Ok((Self { file, path }, found))
    }

    /// Appends completions and syncs, as [`CompletionLog::append_entries`] does.
    pub fn append<'a>(
        &mut self,
        completions: impl IntoIterator<Item = &'a Completion>,
    ) -> Result<(), FileError> {
        let completions = completions.into_iter().cloned();
        let entries: Vec<Entry> = completions.map(Entry::Completed).collect();
        self.append_entries(&entries)
    }

    /// Appends lines and syncs. After an error the end of the file may be torn: nothing can be
    /// appended until the log is opened anew.
    pub fn append_entries(&mut self, entries: &[Entry]) -> Result<(), FileError> {
        let mut lines = Vec::new();
        for entry in entries {
            encode(entry, &mut lines).map_err(FileError::new("append to", &self.path))?;
        }
        if lines.is_empty() {
            return Ok(());
        }
        self.file
            .write_all(&lines)
            .and_then(|()| self.file.sync_data())
            .map_err(FileError::new("append to", &self.path))
    }
}

/// What another place has recorded as complete, copied into the form of a log, in a file without a
/// name that ends with its readers.
#[derive(Debug)]
pub struct Transcript {
    lines: BufWriter<File>,
    // For people.
    of: PathBuf,
}

impl Transcript {
    /// Begins with no completion. Errors name `of`, the store or log that is copied.
    pub fn begin(of: &Path) -> Result<Self, FileError> {
        let file = tempfile::tempfile().map_err(FileError::new("make a copy of", of))?;
        let of = of.to_owned();
        let lines = BufWriter::new(file);
        Ok(Self { lines, of })
    }

    /// Adds a completion, as JSON. What is none becomes a damaged line.
    pub fn add(&mut self, json: &str) -> Result<(), FileError> {
        let written = writeln!(self.lines, "{} {json}", checksum(json.as_bytes()));
        written.map_err(FileError::new("make a copy of", &self.of))
    }

    /// What was added.
    pub fn read(self) -> Result<Completions, FileError> {
        let Self { lines, of } = self;
        let file = lines.into_inner().map_err(io::IntoInnerError::into_error);
        let file = file.and_then(|mut file| {
            file.rewind()?;
            Ok(file)
        });
        Completions::read(file.map_err(FileError::new("make a copy of", &of))?, &of)
    }
}

fn encode(entry: &Entry, lines: &mut Vec<u8>) -> io::Result<()> {
    let json = serde_json::to_string(entry)?;
    writeln!(lines, "{} {json}", checksum(json.as_bytes()))
}

fn decode(line: &[u8]) -> Option<Entry> {
    let line = line.strip_suffix(b"\n")?;
    let (sum, rest) = line.split_at_checked(CHECKSUM_DIGITS)?;
    let json = rest.strip_prefix(b" ")?;
    if checksum(json).as_bytes() != sum {
        return None;
    }
    serde_json::from_slice(json).ok()
}

fn checksum(json: &[u8]) -> String {
    let mut hex = Digest::of(json).to_string();
    hex.truncate(CHECKSUM_DIGITS);
    hex
}

fn over_limit(line: &[u8]) -> bool {
    line.len() as u64 >= limits::LOG_LINE_BYTES_MAX
}

/// Reads through the next newline and returns how many bytes that were. Of a line beyond the limit
/// only the limit is kept, without its newline, so that it counts as damaged; a file of noise thus
/// costs no more memory than the longest line.
fn read_line(reader: &mut impl BufRead, line: &mut Vec<u8>) -> io::Result<u64> {
    line.clear();
    let mut read = reader
        .by_ref()
        .take(limits::LOG_LINE_BYTES_MAX)
        .read_until(b'\n', line)? as u64;
    if over_limit(line) && line.last() != Some(&b'\n') {
        read += reader.skip_until(b'\n')? as u64;
    }
    Ok(read)
}

#[cfg(test)]
mod tests {
    use super::*;
    use dataset::{CompletedView, ErrorStatistics, PixelStatistics};
    use std::fs;

    #[test]
    fn a_reader_sees_lines_that_are_appended_and_a_torn_one_when_it_is_whole() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("log");
        let (mut log, _) = CompletionLog::open(&path).unwrap();
        log.append([&completion(1), &completion(5)]).unwrap();
        let mut reader = Completions::open(&path).unwrap();
        assert!(reader.read_on().unwrap().is_empty());
        let retracted = Entry::Retracted(Retraction { retracted: 1 });
        log.append_entries(&[retracted, Entry::Completed(completion(3))])
            .unwrap();
        let mut lines = Vec::new();
        encode(&Entry::Completed(completion(9)), &mut lines).unwrap();
        let mut file = OpenOptions::new().append(true).open(&path).unwrap();
        file.write_all(&lines[..40]).unwrap();
        assert_eq!(reader.read_on().unwrap(), [1, 3]);
        assert_eq!(reader.materials().collect::<Vec<_>>(), [3, 5]);
        assert_eq!(reader.torn_bytes, 40);
        file.write_all(&lines[40..]).unwrap();
        assert_eq!(reader.read_on().unwrap(), [9]);
        assert_eq!(reader.torn_bytes, 0);
        assert_eq!(reader.get(9).unwrap(), Some(completion(9)));
        file.write_all(b"noise\n").unwrap();
        assert!(reader.read_on().unwrap().is_empty());
        assert_eq!(reader.bad_lines, [6]);
        fs::write(&path, b"").unwrap();
        assert!(
            reader
                .read_on()
                .unwrap_err()
                .to_string()
                .contains("shorter")
        );
    }

    #[test]
    fn what_is_added_to_a_transcript_is_read() {
        let mut transcript = Transcript::begin(Path::new("a database")).unwrap();
        let json = |material| serde_json::to_string(&completion(material)).unwrap();
        transcript.add(&json(2)).unwrap();
        let mut completions = transcript.read().unwrap();
        completions.add_to_transcript(&json(4)).unwrap();
        completions.add_to_transcript(&json(3)).unwrap();
        assert_eq!(completions.read_on().unwrap(), [3, 4]);
        assert_eq!(completions.get(4).unwrap(), Some(completion(4)));
    }

    fn completion(material: u32) -> Completion {
        let view = |view: u8| CompletedView {
            digest: Digest::of(&[material as u8, view]),
            bytes: 30_000 + u64::from(view),
            statistics: ErrorStatistics {
                mean: 0.1 + 0.2,
                p95: 1e-300,
                max: 4.0,
                within_target: 1.0,
                samples: u64::MAX,
                evaluations: 7,
            },
            // Some records are of versions that did not note it.
            pixels: (view > 0).then_some(PixelStatistics {
                sample_share: 0.1 + 0.2,
                brightness_mean: 1e-300,
                brightness_p99: 4.0,
                dark_share: 1.0,
                above_white_share: 0.0,
            }),
        };
        Completion {
            material,
            views: (0..3).map(view).collect(),
            seconds: 1.5,
            worker: "a \"worker\"\nof two lines".to_owned(),
        }
    }

    fn log_of(count: u32) -> (tempfile::TempDir, PathBuf) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("completions.log");
        let (mut log, found) = CompletionLog::open(&path).unwrap();
        assert!(found.is_empty());
        let all: Vec<Completion> = (0..count).map(completion).collect();
        log.append(&all).unwrap();
        (folder, path)
    }

    #[test]
    fn what_is_appended_reads_back() {
        let (_folder, path) = log_of(5);
        let (mut log, found) = CompletionLog::open(&path).unwrap();
        assert_eq!(found.materials().collect::<Vec<_>>(), [0, 1, 2, 3, 4]);
        assert_eq!(found.get(3).unwrap(), Some(completion(3)));
        assert_eq!(found.get(7).unwrap(), None);
        let mut again = completion(3);
        again.seconds = 9.0;
        log.append([&again]).unwrap();
        let found = Completions::open(&path).unwrap();
        assert_eq!(found.len(), 5);
        assert_eq!(found.get(3).unwrap(), Some(again), "the later line counts");
    }

    #[test]
    fn a_retracted_completion_is_gone_until_it_is_completed_again() {
        let (_folder, path) = log_of(3);
        let (mut log, _) = CompletionLog::open(&path).unwrap();
        let retraction = Entry::Retracted(Retraction { retracted: 1 });
        log.append_entries(&[retraction]).unwrap();
        let found = Completions::open(&path).unwrap();
        assert_eq!(found.materials().collect::<Vec<_>>(), [0, 2]);
        assert_eq!((found.get(1).unwrap(), found.bad_line_count), (None, 0));
        log.append([&completion(1)]).unwrap();
        let found = Completions::open(&path).unwrap();
        assert_eq!(found.get(1).unwrap(), Some(completion(1)));
    }

    #[test]
    fn a_line_torn_anywhere_is_cut_and_the_log_goes_on() {
        let (_folder, path) = log_of(3);
        let whole = fs::read(&path).unwrap();
        let last = whole[..whole.len() - 1]
            .iter()
            .rposition(|byte| *byte == b'\n')
            .unwrap()
            + 1;
        for length in last..whole.len() {
            fs::write(&path, &whole[..length]).unwrap();
            let (mut log, found) = CompletionLog::open(&path).unwrap();
            assert_eq!(found.materials().collect::<Vec<_>>(), [0, 1]);
            assert_eq!(found.torn_bytes, (length - last) as u64);
            assert_eq!(found.bad_line_count, 0);
            log.append([&completion(2)]).unwrap();
            assert_eq!(fs::read(&path).unwrap(), whole);
        }
    }

    #[test]
    fn a_damaged_line_is_passed_over_and_reported() {
        let (_folder, path) = log_of(3);
        let whole = fs::read(&path).unwrap();
        let line = whole.len() / 3;
        for offset in [line, line + 9, line + 40, 2 * line - 3] {
            let mut damaged = whole.clone();
            damaged[offset] ^= 1;
            fs::write(&path, damaged).unwrap();
            let found = Completions::open(&path).unwrap();
            assert_eq!(found.materials().collect::<Vec<_>>(), [0, 2], "{offset}");
            assert_eq!(found.bad_lines, [2]);
            assert_eq!(found.torn_bytes, 0);
        }
    }

    #[test]
    fn noise_is_no_completion_and_no_memory() {
        let (_folder, path) = log_of(1);
        let mut noise = fs::read(&path).unwrap();
        noise.resize(noise.len() + 3 * limits::LOG_LINE_BYTES_MAX as usize, 0);
        noise.push(b'\n');
        noise.extend_from_slice(b"\n0123456789abcdef {}\n\xff\xfe\n");
        fs::write(&path, &noise).unwrap();
        let found = Completions::open(&path).unwrap();
        assert_eq!(found.len(), 1);
        assert_eq!(found.bad_lines, [2, 3, 4, 5]);
        assert_eq!(found.whole_bytes, noise.len() as u64);
    }
}

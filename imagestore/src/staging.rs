//! Which uploaded images wait for their completion, and what each says of itself.

use crate::blobs::StagedFile;
use dataset::{Digest, ImageHeader};
use jobqueue::Completion;
use std::{
    collections::{HashMap, hash_map::Entry},
    time::Duration,
};

/// An accepted image that belongs to no completed material yet.
pub struct StagedImage {
    /// Where it waits.
    pub file: StagedFile,
    /// Its size.
    pub bytes: u64,
    /// What it says of itself.
    pub header: ImageHeader,
    /// When it was staged or last named, after the start.
    pub since: Duration,
    /// How far it is on its way to its name.
    pub stage: Stage,
}

/// How far an image is on its way to its name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// It waits for its completion.
    Waiting,
    /// It gets its name.
    Publishing,
    /// It has its name, and its completion is about to be recorded.
    Published,
}

/// The staged images of one coordinator. Touches no file: whoever locks it never waits for a disk.
#[derive(Default)]
pub struct Staging {
    images: HashMap<Digest, StagedImage>,
    // Bytes of images staged and of room reserved.
    bytes: u64,
}

impl Staging {
    /// Makes room for an image that is about to be checked and written. False when there is none.
    pub fn reserve(&mut self, bytes: u64) -> bool {
        let room = self.bytes + bytes <= limits::STAGED_BYTES_MAX;
        if room {
            self.bytes += bytes;
        }
        room
    }

    /// Gives reserved room back.
    pub fn release(&mut self, bytes: u64) {
        self.bytes -= bytes;
    }

    /// Puts an image into the room reserved for it. Where it was staged before, the one before
    /// stays, and the file of this one is returned to be discarded.
    #[must_use = "the file is still there"]
    pub fn insert(&mut self, image: StagedImage) -> Option<StagedFile> {
        match self.images.entry(image.file.digest) {
            Entry::Vacant(place) => {
                place.insert(image);
                None
            }
            Entry::Occupied(_) => {
                self.release(image.bytes);
                Some(image.file)
            }
        }
    }

    /// An image that a completion names; it is kept as if it had just been staged.
    pub fn touch(&mut self, digest: &Digest, now: Duration) -> Option<&StagedImage> {
        let image = self.images.get_mut(digest)?;
        image.since = now;
        Some(image)
    }

    /// Whether an image is staged.
    pub fn contains(&self, digest: &Digest) -> bool {
        self.images.contains_key(digest)
    }

    /// Whether an image of a completion is staged and has no name yet.
    pub fn awaits_publication(&self, completion: &Completion) -> bool {
        let mut images = completion
            .views
            .iter()
            .filter_map(|view| self.images.get(&view.digest));
        images.any(|image| image.stage != Stage::Published)
    }

    /// Marks the images of a completion that have no name yet and returns their files.
    pub fn begin_publishing(&mut self, completion: &Completion) -> Vec<StagedFile> {
        let mut files = Vec::new();
        for view in &completion.views {
            if let Some(image) = self.images.get_mut(&view.digest)
                && image.stage != Stage::Published
            {
                image.stage = Stage::Publishing;
                files.push(image.file.clone());
            }
        }
        files
    }

    /// Keeps images that could not be published.
    pub fn not_published(&mut self, files: &[StagedFile]) {
        self.mark(files, Stage::Waiting);
    }

    /// Keeps images that have been published until their completion is recorded: whoever reports it
    /// again need not send them again.
    pub fn published(&mut self, files: &[StagedFile]) {
        self.mark(files, Stage::Published);
    }

    fn mark(&mut self, files: &[StagedFile], stage: Stage) {
        for file in files {
            if let Some(image) = self.images.get_mut(&file.digest) {
                image.stage = stage;
            }
        }
    }

    /// Forgets the images of a completion that have been published.
    pub fn forget_published(&mut self, completion: &Completion) {
        for view in &completion.views {
            if let Entry::Occupied(image) = self.images.entry(view.digest)
                && image.get().stage == Stage::Published
            {
                let image = image.remove();
                self.release(image.bytes);
            }
        }
    }

    /// Forgets images of these files, which are to be sent again. Their files are left to the caller.
    pub fn forget(&mut self, files: &[StagedFile]) {
        for file in files {
            // Another file may have been staged under the digest since.
            if let Entry::Occupied(image) = self.images.entry(file.digest)
                && image.get().file == *file
            {
                let image = image.remove();
                self.release(image.bytes);
            }
        }
    }

    /// Forgets images whose completion never came, and returns the files to be discarded. One that
    /// has its name keeps it, and is garbage.
    #[must_use = "the files are still there"]
    pub fn take_old(&mut self, now: Duration) -> Vec<StagedFile> {
        let old: Vec<Digest> = self
            .images
            .iter()
            .filter(|(_, image)| {
                image.stage != Stage::Publishing
                    && now.saturating_sub(image.since) > limits::STAGED_AGE_MAX
            })
            .map(|(digest, _)| *digest)
            .collect();
        let mut files = Vec::new();
        for digest in old {
            if let Some(image) = self.images.remove(&digest) {
                self.release(image.bytes);
                if image.stage == Stage::Waiting {
                    files.push(image.file);
                }
            }
        }
        files
    }
}

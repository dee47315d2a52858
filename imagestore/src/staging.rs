//! Which uploaded images wait for their completion, what each says of itself, and whose room they
//! take.
//!
//! Room for a whole job is reserved by its lease before the first image comes, so that whoever
//! begins to send can end. What a lease has staged dies with it. An image that two leases of one
//! material hold, as when the first ran out and its work is done again, dies with the last.
//!
//! Nobody takes all the room: a worker has at most as much as is left free, and all workers of one
//! credential together a multiple of it, [`limits::STAGED_SHARE_OF_FREE`]; so somebody new finds
//! some. Who finds none waits in line. Of all lines that of the credential with the least room goes
//! first, and of its workers that with the least. Room that others wait for is taken back from a
//! lease that stages too slowly to end.

use crate::blobs::StagedFile;
use dataset::{Digest, ImageHeader};
use jobqueue::{
    Completion,
    token::{Token, WorkerId},
};
use std::{
    collections::{BTreeMap, HashMap, VecDeque, hash_map::Entry},
    hash::Hash,
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
    stage: Stage,
    // It dies with the last of them.
    leases: Vec<LeaseOf>,
}

/// How far an image is on its way to its name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stage {
    // It waits for its completion.
    Waiting,
    // It gets its name.
    Publishing,
    // It has its name, and its completion is about to be recorded.
    Published,
}

/// A lease of a material.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct LeaseOf {
    /// What is leased.
    pub material: u32,
    /// The lease.
    pub token: Token,
}

/// What a caller showed, by its digest; all who show nothing are the same.
pub type Credential = Option<Digest>;

/// Who has room.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Holder {
    /// By which credential.
    pub credential: Credential,
    /// Which of its workers. `None` stands for those that need so little that it is not asked.
    pub worker: Option<WorkerId>,
}

/// Who sends an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sender {
    /// Under which lease.
    pub lease: LeaseOf,
    /// Whose share of the room it takes.
    pub holder: Holder,
}

/// The room of one lease.
struct Room {
    holder: Holder,
    reserved: u64,
    // The images that it holds: one a view, so few that a search from the front is the quickest.
    staged: Vec<Held>,
    since: Duration,
    // When it last staged something.
    active: Duration,
    // When its lease was last known to be current.
    checked: Duration,
}

/// An image that a lease holds.
struct Held {
    digest: Digest,
    view: u32,
    bytes: u64,
}

/// Leases of one holder that wait for room, the first in line first.
#[derive(Default)]
struct Line(VecDeque<Waiting>);

struct Waiting {
    lease: LeaseOf,
    bytes: u64,
    asked: Duration,
}

/// The staged images of one coordinator. Touches no file: whoever locks it never waits for a disk.
pub struct Staging {
    images: HashMap<Digest, StagedImage>,
    rooms: BTreeMap<LeaseOf, Room>,
    lines: HashMap<Holder, Line>,
    // Of all rooms.
    reserved: u64,
    // The same by worker and by credential; no entry is 0.
    by_worker: HashMap<Holder, u64>,
    by_credential: HashMap<Credential, u64>,
    bytes_max: u64,
}

impl Default for Staging {
    fn default() -> Self {
        Self::of(limits::STAGED_BYTES_MAX)
    }
}

impl Room {
    fn staged_bytes(&self) -> u64 {
        self.staged.iter().map(|held| held.bytes).sum()
    }

    fn hold(&mut self, held: Held) {
        if self.staged.iter().all(|other| other.digest != held.digest) {
            self.staged.push(held);
        }
    }

    /// Whether it stages too slowly for others to wait: at the slowest rate of a sound line its
    /// images would have come.
    fn is_stalled(&self, now: Duration) -> bool {
        let age = now.saturating_sub(self.since).as_secs();
        let due = age.saturating_mul(limits::STAGED_BYTES_PER_SECOND_MIN);
        let begun = limits::protocol::MESSAGE_BYTES_MAX as u64;
        due > self.staged_bytes() + begun
            || now.saturating_sub(self.active) > limits::STAGED_IDLE_MAX
    }
}

impl Staging {
    /// Room for images of `bytes_max` bytes together.
    pub fn of(bytes_max: u64) -> Self {
        Self {
            images: HashMap::new(),
            rooms: BTreeMap::new(),
            lines: HashMap::new(),
            reserved: 0,
            by_worker: HashMap::new(),
            by_credential: HashMap::new(),
            bytes_max,
        }
    }

    /// Whose share the room of a lease is, if it has room for more than came with its completion.
    pub fn sender(&self, lease: LeaseOf) -> Option<Sender> {
        let holder = self.rooms.get(&lease)?.holder;
        holder.worker.map(|_| Sender { lease, holder })
    }

    /// Reserves room for all images of a lease together, or keeps its place in line. True when it
    /// has as much now. Asks again within [`limits::STAGING_ASKER_ABSENT`], or loses its place.
    pub fn reserve(&mut self, sender: Sender, bytes: u64, now: Duration) -> bool {
        let Sender { lease, holder } = sender;
        if self.has_reserved(lease, bytes) {
            return true;
        }
        let Line(line) = self.lines.entry(holder).or_default();
        match line.iter_mut().find(|waiting| waiting.lease == lease) {
            Some(waiting) => waiting.asked = now,
            None => line.push_back(Waiting {
                lease,
                bytes,
                asked: now,
            }),
        }
        // All others in line did not fit when room was last given back, nor do they now.
        while self.serve_first(holder, now) {}
        self.has_reserved(lease, bytes)
    }

    /// The same for images so small that nobody has to wait in line for them.
    pub fn reserve_at_once(&mut self, sender: Sender, bytes: u64, now: Duration) -> bool {
        if self.has_reserved(sender.lease, bytes) {
            return true;
        }
        let fits = self.fits(sender.holder, bytes);
        if fits {
            self.enlarge(sender, bytes, now);
        }
        fits
    }

    fn has_reserved(&self, lease: LeaseOf, bytes: u64) -> bool {
        let room = self.rooms.get(&lease);
        room.is_some_and(|room| room.reserved >= bytes)
    }

    /// What a holder's credential has, and what it has itself.
    fn has(&self, holder: Holder) -> [u64; 2] {
        let by_credential = self.by_credential.get(&holder.credential);
        let by_worker = self.by_worker.get(&holder);
        [by_credential, by_worker].map(|has| has.copied().unwrap_or(0))
    }

    /// Whether a holder may have so much more. Its first job it may have wherever there is room.
    fn fits(&self, holder: Holder, bytes: u64) -> bool {
        let free = self.bytes_max.saturating_sub(self.reserved);
        let shares = [free.saturating_mul(limits::STAGED_SHARE_OF_FREE), free];
        let mut shares = self.has(holder).into_iter().zip(shares);
        bytes <= free && shares.all(|(has, share)| has == 0 || has + bytes <= share)
    }

    /// Makes a lease's room at least so large.
    fn enlarge(&mut self, sender: Sender, bytes: u64, now: Duration) {
        let Sender { lease, holder } = sender;
        let room = self.rooms.entry(lease).or_insert_with(|| Room {
            holder,
            reserved: 0,
            staged: Vec::new(),
            since: now,
            active: now,
            checked: now,
        });
        let more = bytes.saturating_sub(room.reserved);
        room.reserved += more;
        self.reserved += more;
        *self.by_worker.entry(room.holder).or_default() += more;
        *self
            .by_credential
            .entry(room.holder.credential)
            .or_default() += more;
    }

    /// Gives room to the first in a holder's line, if that fits.
    fn serve_first(&mut self, holder: Holder, now: Duration) -> bool {
        self.drop_absent(holder, now);
        let first = self.lines.get(&holder).and_then(|Line(line)| line.front());
        let Some(&Waiting { lease, bytes, .. }) = first else {
            return false;
        };
        let fits = self.fits(holder, bytes);
        if fits {
            self.leave_line(lease, holder);
            self.enlarge(Sender { lease, holder }, bytes, now);
        }
        fits
    }

    /// Takes from the front of a line those that stopped asking.
    fn drop_absent(&mut self, holder: Holder, now: Duration) {
        let is_absent = |waiting: &mut Waiting| {
            now.saturating_sub(waiting.asked) > limits::STAGING_ASKER_ABSENT
        };
        if let Entry::Occupied(mut line) = self.lines.entry(holder) {
            while line.get_mut().0.pop_front_if(is_absent).is_some() {}
            if line.get().0.is_empty() {
                line.remove();
            }
        }
    }

    fn leave_line(&mut self, lease: LeaseOf, holder: Holder) {
        if let Entry::Occupied(mut line) = self.lines.entry(holder) {
            line.get_mut().0.retain(|waiting| waiting.lease != lease);
            if line.get().0.is_empty() {
                line.remove();
            }
        }
    }

    /// Gives room to whoever is first in line and fits, those with the least room first.
    fn serve_lines(&mut self, now: Duration) {
        let holders: Vec<Holder> = self.lines.keys().copied().collect();
        for holder in holders {
            self.drop_absent(holder, now);
        }
        loop {
            let first = |(holder, Line(line)): (&Holder, &Line)| {
                let fits = self.fits(*holder, line.front()?.bytes);
                fits.then_some((self.has(*holder), *holder))
            };
            let Some((_, holder)) = self.lines.iter().filter_map(first).min() else {
                return;
            };
            self.serve_first(holder, now);
        }
    }

    /// Puts an image into the room of the lease that it was sent under. Returns files to be
    /// discarded: this one where the same image was staged before or the lease is over, and one that
    /// the lease had staged for the same view.
    #[must_use = "the files are still there"]
    pub fn insert(
        &mut self,
        lease: LeaseOf,
        file: StagedFile,
        bytes: u64,
        header: ImageHeader,
        now: Duration,
    ) -> Inserted {
        let digest = file.digest;
        let view = header.view;
        let Some(room) = self.rooms.get_mut(&lease) else {
            return Inserted {
                counts: false,
                surplus: vec![file],
            };
        };
        room.active = now;
        let is_before = |held: &mut Held| held.view == view && held.digest != digest;
        let before: Vec<Held> = room.staged.extract_if(.., is_before).collect();
        room.hold(Held {
            digest,
            view,
            bytes,
        });
        let before = before.into_iter();
        let mut surplus: Vec<_> = before
            .filter_map(|held| self.let_go(lease, held.digest))
            .collect();
        match self.images.entry(digest) {
            Entry::Vacant(place) => {
                place.insert(StagedImage {
                    file,
                    bytes,
                    header,
                    stage: Stage::Waiting,
                    leases: vec![lease],
                });
            }
            Entry::Occupied(mut image) => {
                hold(image.get_mut(), lease);
                surplus.push(file);
            }
        }
        self.cover(lease, now);
        Inserted {
            counts: true,
            surplus,
        }
    }

    /// An image that a lease names: from now on the lease holds it, if it is of its material. One
    /// whose sender's lease is over is not sent again.
    pub fn name(&mut self, sender: Sender, digest: &Digest, now: Duration) -> Option<&StagedImage> {
        let lease = sender.lease;
        let image = self.images.get_mut(digest)?;
        if image.header.material == Some(lease.material) {
            hold(image, lease);
            let (view, bytes) = (image.header.view, image.bytes);
            self.enlarge(sender, 0, now);
            if let Some(room) = self.rooms.get_mut(&lease) {
                room.hold(Held {
                    digest: *digest,
                    view,
                    bytes,
                });
                room.active = now;
            }
            self.cover(lease, now);
        }
        self.images.get(digest)
    }

    /// What is there takes its room, whether or not so much was reserved.
    fn cover(&mut self, lease: LeaseOf, now: Duration) {
        if let Some(room) = self.rooms.get(&lease) {
            let (holder, staged) = (room.holder, room.staged_bytes());
            self.enlarge(Sender { lease, holder }, staged, now);
        }
    }

    /// Whether an image is staged.
    pub fn contains(&self, digest: &Digest) -> bool {
        self.images.contains_key(digest)
    }

    /// Ends the room of a lease that is over. One that waits in line loses its place when nobody asks
    /// for it any more. Returns the files that nobody holds any more.
    #[must_use = "the files are still there"]
    pub fn end(&mut self, lease: LeaseOf, now: Duration) -> Vec<StagedFile> {
        let files = self.take_room(lease);
        self.serve_lines(now);
        files
    }

    fn take_room(&mut self, lease: LeaseOf) -> Vec<StagedFile> {
        let Some(room) = self.rooms.remove(&lease) else {
            return Vec::new();
        };
        self.reserved -= room.reserved;
        give_back(&mut self.by_worker, room.holder, room.reserved);
        give_back(
            &mut self.by_credential,
            room.holder.credential,
            room.reserved,
        );
        let staged = room.staged.into_iter();
        let files = staged.filter_map(|held| self.let_go(lease, held.digest));
        files.collect()
    }

    /// Takes a lease from those that hold an image. An image that nobody holds is forgotten, but for
    /// one that is just getting its name; the file of one that has none is returned.
    fn let_go(&mut self, lease: LeaseOf, digest: Digest) -> Option<StagedFile> {
        let Entry::Occupied(mut image) = self.images.entry(digest) else {
            return None;
        };
        image.get_mut().leases.retain(|held| *held != lease);
        if !image.get().leases.is_empty() || image.get().stage == Stage::Publishing {
            return None;
        }
        let image = image.remove();
        (image.stage == Stage::Waiting).then_some(image.file)
    }

    /// Leases of a material that have room.
    pub fn leases_of(&self, material: u32) -> impl Iterator<Item = LeaseOf> {
        let [first, last] = [u8::MIN, u8::MAX].map(|byte| LeaseOf {
            material,
            token: Token::from_bytes([byte; limits::protocol::TOKEN_BYTES]),
        });
        self.rooms.range(first..=last).map(|(lease, _)| *lease)
    }

    /// Leases whose standing was not looked at for a while; it counts as looked at now.
    pub fn take_unchecked(&mut self, now: Duration) -> Vec<LeaseOf> {
        let rooms = self.rooms.iter_mut().filter(|(_, room)| {
            now.saturating_sub(room.checked) >= limits::STAGED_LEASE_CHECK_INTERVAL
        });
        let unchecked = rooms.map(|(lease, room)| {
            room.checked = now;
            *lease
        });
        unchecked.collect()
    }

    /// Takes room that others wait for from leases that stage too slowly. Returns the files that
    /// nobody holds any more; they are to be sent again.
    #[must_use = "the files are still there"]
    pub fn take_stalled(&mut self, now: Duration) -> Vec<StagedFile> {
        self.serve_lines(now);
        if self.lines.is_empty() {
            return Vec::new();
        }
        let stalled = self.rooms.iter().filter(|(_, room)| room.is_stalled(now));
        let stalled: Vec<LeaseOf> = stalled.map(|(lease, _)| *lease).collect();
        let files = stalled.into_iter().flat_map(|lease| self.take_room(lease));
        let files = files.collect();
        self.serve_lines(now);
        files
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

    /// Keeps images that could not be published. Returns the files of those whose leases ended
    /// meanwhile.
    #[must_use = "the files are still there"]
    pub fn not_published(&mut self, files: &[StagedFile]) -> Vec<StagedFile> {
        self.mark(files, Stage::Waiting)
    }

    /// Keeps images that have been published until their completion is recorded: whoever reports it
    /// again need not send them again.
    pub fn published(&mut self, files: &[StagedFile]) {
        // Those that nobody holds any more have their names: they are no files of staging.
        drop(self.mark(files, Stage::Published));
    }

    fn mark(&mut self, files: &[StagedFile], stage: Stage) -> Vec<StagedFile> {
        let mut without_lease = Vec::new();
        for file in files {
            if let Entry::Occupied(mut image) = self.images.entry(file.digest) {
                image.get_mut().stage = stage;
                if image.get().leases.is_empty() {
                    without_lease.push(image.remove().file);
                }
            }
        }
        without_lease
    }

    /// Forgets the images of a completion that have been published.
    pub fn forget_published(&mut self, completion: &Completion) {
        for view in &completion.views {
            let image = self.images.get(&view.digest);
            if image.is_some_and(|image| image.stage == Stage::Published) {
                self.remove(&view.digest);
            }
        }
    }

    /// Forgets images of these files, which are to be sent again. Their files are left to the caller.
    pub fn forget(&mut self, files: &[StagedFile]) {
        for file in files {
            // Another file may have been staged under the digest since.
            let image = self.images.get(&file.digest);
            if image.is_some_and(|image| image.file == *file) {
                self.remove(&file.digest);
            }
        }
    }

    fn remove(&mut self, digest: &Digest) {
        let Some(image) = self.images.remove(digest) else {
            return;
        };
        for lease in &image.leases {
            if let Some(room) = self.rooms.get_mut(lease) {
                room.staged.retain(|held| held.digest != *digest);
            }
        }
    }
}

/// What became of an image that was put into its lease's room.
#[derive(Debug, PartialEq, Eq)]
pub struct Inserted {
    /// It is staged. False where its lease is over.
    pub counts: bool,
    /// Files to be discarded.
    pub surplus: Vec<StagedFile>,
}

fn give_back<Key: Eq + Hash>(reserved_by: &mut HashMap<Key, u64>, key: Key, bytes: u64) {
    if let Entry::Occupied(mut reserved) = reserved_by.entry(key) {
        *reserved.get_mut() -= bytes;
        if *reserved.get() == 0 {
            reserved.remove();
        }
    }
}

fn hold(image: &mut StagedImage, lease: LeaseOf) {
    if !image.leases.contains(&lease) {
        image.leases.push(lease);
    }
}

#[cfg(test)]
mod tests;

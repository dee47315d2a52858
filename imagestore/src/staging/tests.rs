use super::*;
use crate::{blobs::Blobs, validation::expected_headers};
use dataset::Specification;
use std::{collections::BTreeSet, fs, path::Path};

const NOW: Duration = Duration::from_secs(1000);

struct Bench {
    folder: tempfile::TempDir,
    blobs: Blobs,
    specification: Specification,
    staging: Staging,
}

fn lease(material: u32, number: u8) -> LeaseOf {
    LeaseOf {
        material,
        token: Token::from_bytes([number; 16]),
    }
}

fn sender(material: u32, number: u8, credential: u8) -> Sender {
    Sender {
        lease: lease(material, number),
        holder: Holder {
            credential: Some(Digest::of(&[credential])),
            // Each lease of a credential is of another worker.
            worker: Some(WorkerId::from_bytes([number; 16])),
        },
    }
}

fn of_one_worker(material: u32, number: u8, worker: u8) -> Sender {
    Sender {
        lease: lease(material, number),
        holder: Holder {
            credential: None,
            worker: Some(WorkerId::from_bytes([worker; 16])),
        },
    }
}

impl Bench {
    fn new(bytes_max: u64) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let blobs = Blobs::new(folder.path());
        blobs.prepare().unwrap();
        Self {
            folder,
            blobs,
            specification: Specification::preset(),
            staging: Staging::of(bytes_max),
        }
    }

    /// Stages an image of a view that has these bytes; what is surplus is discarded.
    fn stage(&mut self, lease: LeaseOf, view: usize, bytes: &[u8]) -> bool {
        let hash = self.specification.hash();
        let headers = expected_headers(&self.specification, hash, lease.material);
        let file = self.blobs.stage(Digest::of(bytes), bytes).unwrap();
        let size = bytes.len() as u64;
        let header = headers[view].clone();
        let inserted = self.staging.insert(lease, file, size, header, NOW);
        self.discard(inserted.surplus);
        inserted.counts
    }

    fn end(&mut self, lease: LeaseOf) {
        let files = self.staging.end(lease, NOW);
        self.discard(files);
    }

    fn discard(&self, files: Vec<StagedFile>) {
        files.iter().for_each(|file| self.blobs.discard(file));
    }

    fn files(&self) -> usize {
        fs::read_dir(Path::new(self.folder.path()).join("staging"))
            .unwrap()
            .count()
    }

    fn check(&self) {
        let staging = &self.staging;
        let reserved: u64 = staging.rooms.values().map(|room| room.reserved).sum();
        assert_eq!(staging.reserved, reserved);
        assert_eq!(staging.by_worker.values().sum::<u64>(), reserved);
        assert_eq!(staging.by_credential.values().sum::<u64>(), reserved);
        for (lease, room) in &staging.rooms {
            assert!(room.staged_bytes() <= room.reserved, "{}", room.reserved);
            for Held { digest, .. } in &room.staged {
                assert!(staging.images[digest].leases.contains(lease));
            }
        }
        for (digest, image) in &staging.images {
            assert!(!image.leases.is_empty() || image.stage == Stage::Publishing);
            for lease in &image.leases {
                let held = &staging.rooms[lease].staged;
                assert!(held.iter().any(|held| held.digest == *digest));
            }
        }
        assert_eq!(self.files(), staging.images.len());
    }
}

#[test]
fn room_is_reserved_for_a_job_and_given_back_when_its_lease_ends() {
    let mut bench = Bench::new(100);
    let [first, second] = [sender(1, 1, 1), sender(2, 2, 2)];
    assert!(!bench.stage(first.lease, 0, b"nothing reserved"));
    assert_eq!(bench.files(), 0);
    assert!(bench.staging.reserve(first, 60, NOW));
    assert!(!bench.staging.reserve(second, 60, NOW), "there are 40");
    assert!(bench.stage(first.lease, 0, b"one"));
    assert!(bench.stage(first.lease, 1, b"two"));
    // The same view again: the image of before goes.
    assert!(bench.stage(first.lease, 1, b"three"));
    assert_eq!(bench.files(), 2);
    bench.check();
    bench.end(first.lease);
    assert_eq!(bench.files(), 0);
    assert!(
        bench.staging.sender(second.lease).is_some(),
        "it was next in line"
    );
    bench.check();
}

#[test]
fn nobody_takes_what_others_need_however_many_leases_they_have() {
    let mut bench = Bench::new(1000);
    let greedy = (0..200).filter(|number| bench.staging.reserve(sender(1, *number, 1), 10, NOW));
    assert_eq!(greedy.count(), 75, "three quarters of the room");
    let honest = (0..60).filter(|number| bench.staging.reserve(sender(2, *number, 2), 10, NOW));
    assert_eq!(honest.count(), 19, "three quarters of what was left");
    // What the greedy one gives back goes to whoever has less, until both have as much.
    for number in 0..40 {
        bench.end(lease(1, number));
    }
    let has = |credential: u8| bench.staging.by_credential[&Some(Digest::of(&[credential]))];
    for has in [has(1), has(2)] {
        assert!((410..=440).contains(&has), "{has}");
    }
    // And somebody new finds room at once.
    assert!(bench.staging.reserve(sender(3, 1, 3), 100, NOW));
    bench.check();
}

#[test]
fn a_worker_has_no_more_than_is_left_for_others_of_its_credential() {
    let mut bench = Bench::new(100);
    let greedy = (0..20).filter(|number| {
        let sender = of_one_worker(1, *number, 1);
        bench.staging.reserve(sender, 10, NOW)
    });
    assert_eq!(greedy.count(), 5);
    let honest = (20..40).filter(|number| {
        let sender = of_one_worker(2, *number, *number);
        bench.staging.reserve(sender, 10, NOW)
    });
    assert!(honest.count() >= 2);
    bench.end(lease(1, 0));
    bench.end(lease(1, 1));
    bench.check();
    let greedy = bench.staging.by_worker[&of_one_worker(1, 0, 1).holder];
    assert!(greedy <= 30, "it gave 20 of 50 back, and others waited");
}

#[test]
fn who_stops_asking_loses_the_place_in_line() {
    let mut bench = Bench::new(100);
    assert!(bench.staging.reserve(sender(1, 1, 1), 100, NOW));
    for number in [2, 3] {
        assert!(!bench.staging.reserve(sender(1, number, 1), 100, NOW));
    }
    let later = NOW + limits::STAGING_ASKER_ABSENT + Duration::from_secs(1);
    assert!(!bench.staging.reserve(sender(1, 3, 1), 100, later));
    drop(bench.staging.end(lease(1, 1), later));
    assert!(bench.staging.sender(lease(1, 2)).is_none(), "it is gone");
    assert!(bench.staging.sender(lease(1, 3)).is_some());
}

#[test]
fn room_that_others_wait_for_is_taken_from_the_slow() {
    let mut bench = Bench::new(1 << 30);
    let slow = sender(1, 1, 1);
    assert!(bench.staging.reserve(slow, 1 << 30, NOW));
    assert!(bench.stage(slow.lease, 0, b"one"));
    let late = NOW + limits::STAGED_IDLE_MAX + Duration::from_secs(1);
    assert_eq!(bench.staging.take_stalled(late), [], "nobody waits");
    let other = sender(2, 2, 2);
    assert!(!bench.staging.reserve(other, 5, NOW));
    assert_eq!(bench.staging.take_stalled(NOW), [], "it is not slow yet");
    assert!(!bench.staging.reserve(other, 5, late));
    let taken = bench.staging.take_stalled(late);
    assert_eq!(taken.len(), 1);
    bench.discard(taken);
    assert!(bench.staging.sender(other.lease).is_some());
    assert!(!bench.stage(slow.lease, 0, b"one"), "it waits again");
    bench.check();
}

/// A lease ran out, and its material's next lease has images of the same digests.
#[test]
fn an_image_of_two_leases_dies_with_the_last() {
    let mut bench = Bench::new(100);
    let [old, new] = [sender(1, 1, 1), sender(1, 2, 2)];
    assert!(bench.staging.reserve(old, 20, NOW));
    assert!(bench.stage(old.lease, 0, b"one"));
    assert!(bench.stage(old.lease, 1, b"two"));
    assert!(bench.staging.reserve(new, 20, NOW));
    assert!(bench.stage(new.lease, 0, b"one"));
    assert_eq!(bench.files(), 2);
    bench.check();
    bench.end(old.lease);
    assert!(bench.staging.contains(&Digest::of(b"one")));
    assert!(!bench.staging.contains(&Digest::of(b"two")));
    // A third names it without having sent anything, and without room of its own.
    let third = sender(1, 3, 3);
    assert!(
        bench
            .staging
            .name(third, &Digest::of(b"one"), NOW)
            .is_some()
    );
    bench.end(new.lease);
    bench.check();
    assert_eq!(bench.files(), 1);
    // One that names it under another material's lease keeps nothing.
    let stranger = sender(2, 4, 4);
    assert!(
        bench
            .staging
            .name(stranger, &Digest::of(b"one"), NOW)
            .is_some()
    );
    bench.end(third.lease);
    assert_eq!(bench.files(), 0);
    bench.check();
}

#[test]
fn images_that_are_getting_their_names_outlive_their_lease_until_they_have_them() {
    let mut bench = Bench::new(100);
    let completion = Completion::sample(1, b"one");
    for named in [true, false] {
        let sender = sender(1, 1, 1);
        assert!(bench.staging.reserve(sender, 20, NOW));
        assert!(bench.stage(sender.lease, 0, b"one"));
        let files = bench.staging.begin_publishing(&completion);
        assert_eq!(files.len(), 1);
        bench.end(sender.lease);
        assert!(bench.staging.awaits_publication(&completion));
        if named {
            bench.staging.published(&files);
            bench.discard(files);
        } else {
            let surplus = bench.staging.not_published(&files);
            assert_eq!(surplus, files);
            bench.discard(surplus);
        }
        assert!(!bench.staging.contains(&Digest::of(b"one")));
        bench.check();
    }
}

/// Whatever comes in whatever order, the books are right and no file is left behind.
#[test]
fn random_operations_keep_the_books_right() {
    let mut bench = Bench::new(400);
    let mut state = 7_u64;
    let mut draw = |below: u64| {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) % below
    };
    let mut reached = BTreeSet::new();
    for _ in 0..4000 {
        let material = draw(3) as u32;
        let sender = sender(material, draw(4) as u8, draw(3) as u8);
        let view = draw(3);
        let bytes = [material as u8, view as u8, draw(2) as u8];
        let completion = Completion::sample(material, &bytes);
        let operation = draw(8);
        match operation {
            0 | 1 => drop(bench.staging.reserve(sender, 30 + draw(60), NOW)),
            2 | 3 => drop(bench.stage(sender.lease, view as usize, &bytes)),
            4 => bench.end(sender.lease),
            5 => drop(
                bench
                    .staging
                    .name(sender, &Digest::of(&bytes), NOW)
                    .is_some(),
            ),
            6 => {
                let files = bench.staging.begin_publishing(&completion);
                if draw(2) == 0 {
                    let surplus = bench.staging.not_published(&files);
                    bench.discard(surplus);
                } else if !files.is_empty() {
                    bench.staging.published(&files);
                    bench.staging.forget_published(&completion);
                    bench.discard(files);
                    reached.insert("published");
                }
            }
            _ => {
                let files = bench.staging.begin_publishing(&completion);
                bench.staging.forget(&files);
                bench.discard(files);
            }
        }
        reached.insert(if bench.staging.lines.is_empty() {
            "free"
        } else {
            "full"
        });
        bench.check();
    }
    assert_eq!(reached.len(), 3, "{reached:?}");
}

//! Faults of every kind, injected into a whole store: `verify` names each and nothing else,
//! `repair` brings back the digests of before.

use crate::{
    cheap_image::{Cheap, small_specification},
    cheap_renderer::{CheapRenderer, checks},
    complete_store::completion,
};
use dataset::{Digest, PixelStatistics, Specification};
use datastore::{
    ReadOnlyStore, Store, WritableStore,
    garbage::{remove_unnamed, unnamed},
    repair::{Outcome, Repair, repair},
    verify::{Checks, FaultKind, Report, verify},
};
use imagestore::validation::decode;
use jobqueue::Completion;
use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
};

const MATERIALS: u32 = 12;

/// A whole store, with a ledger that knows it.
fn whole_store() -> (tempfile::TempDir, CheapRenderer) {
    let folder = tempfile::tempdir().unwrap();
    let specification = small_specification(MATERIALS);
    let mut store = Store::open_or_create(folder.path(), &specification).unwrap();
    let (completions, images): (Vec<Completion>, Vec<_>) = (0..MATERIALS)
        .map(|material| completion(&specification, material))
        .unzip();
    put(&mut store, &completions, images.concat());
    (folder, CheapRenderer(specification))
}

fn put(store: &mut Store, completions: &[Completion], images: Vec<Vec<u8>>) {
    let images: Vec<_> = images
        .into_iter()
        .map(|bytes| (Digest::of(&bytes), bytes))
        .collect();
    store.put(completions, &images).unwrap();
}

/// Records what is not so, as a liar or an editor would: in the log, and in the ledger too or not.
fn record(path: &Path, completion: &Completion, images: Vec<Vec<u8>>, in_ledger: bool) {
    if in_ledger {
        let mut store = Store::open(path).unwrap();
        put(&mut store, std::slice::from_ref(completion), images);
    } else {
        let log = path.join("completions.log");
        let (mut log, _) = jobstore::completion_log::CompletionLog::open(&log).unwrap();
        log.append([completion]).unwrap();
    }
}

/// An image that says what it should, but whose pixels are all `value`'s multiples.
fn image_of(specification: &Specification, material: u32, view: u32, value: f32) -> Vec<u8> {
    let mut cheap = Cheap::new(specification, material, view);
    cheap.value = value;
    cheap.encode()
}

fn blobs(path: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = BTreeMap::new();
    for folder in fs::read_dir(path.join("blobs")).unwrap() {
        for file in fs::read_dir(folder.unwrap().path()).unwrap() {
            let file = file.unwrap().path();
            found.insert(file.clone(), fs::read(file).unwrap());
        }
    }
    found
}

fn look(path: &Path, checks: &Checks<'_>) -> Report {
    verify(&ReadOnlyStore::open(path).unwrap(), checks, &|_| ()).unwrap()
}

fn mend(path: &Path, renderer: &CheapRenderer, checks: &Checks<'_>) -> Vec<Repair> {
    let mut store = WritableStore::open(path).unwrap();
    repair(&mut store, checks, renderer, &|_| (), &|_, _| ()).unwrap()
}

/// Where the store of a folder has an image.
fn image(path: &Path, specification: &Specification, material: u32, view: usize) -> PathBuf {
    let digest = completion(specification, material).0.views[view].digest;
    path.join(dataset::blob_path(&digest))
}

/// Files: missing, truncated, one bit flipped, two swapped, one put there by a stranger, one of another
/// image under this one's name. Returns the stranger's.
fn hurt_files(path: &Path, specification: &Specification) -> PathBuf {
    let image = |material, view| image(path, specification, material, view);
    let before = blobs(path);
    fs::remove_file(image(0, 0)).unwrap();
    let cut = fs::read(image(1, 1)).unwrap();
    fs::write(image(1, 1), &cut[..cut.len() / 2]).unwrap();
    let mut flipped = fs::read(image(2, 2)).unwrap();
    let middle = flipped.len() / 2;
    flipped[middle] ^= 4;
    fs::write(image(2, 2), flipped).unwrap();
    fs::write(image(3, 0), &before[&image(4, 1)]).unwrap();
    fs::write(image(4, 1), &before[&image(3, 0)]).unwrap();
    let foreign = image_of(&small_specification(99), 50, 0, 2.0);
    let foreign_path = path.join(dataset::blob_path(&Digest::of(&foreign)));
    fs::create_dir_all(foreign_path.parent().unwrap()).unwrap();
    fs::write(&foreign_path, &foreign).unwrap();
    foreign_path
}

/// Records: a view's digest changed by hand, with the checksum put right; two views swapped; a size
/// and an error that are not the image's; and images that are what is recorded, with no number in
/// them, black, of another material.
fn hurt_records(path: &Path, specification: &Specification) {
    let mut edited = completion(specification, 5).0;
    edited.views[2].digest = Digest::of(b"nothing");
    record(path, &edited, vec![], false);
    let mut swapped = completion(specification, 6).0;
    swapped.views.swap(0, 1);
    record(path, &swapped, vec![], true);
    let mut resized = completion(specification, 10).0;
    resized.views[0].bytes += 1;
    record(path, &resized, vec![], true);
    let mut flattered = completion(specification, 11).0;
    flattered.views[1].statistics.max = 0.0;
    record(path, &flattered, vec![], true);
    for (material, view, bytes) in [
        (7, 1, image_of(specification, 7, 1, f32::NAN)),
        (8, 0, image_of(specification, 8, 0, 0.0)),
        (9, 2, image_of(specification, 0, 2, 1.0)),
    ] {
        let mut lie = completion(specification, material).0;
        lie.views[view].digest = Digest::of(&bytes);
        lie.views[view].bytes = bytes.len() as u64;
        record(path, &lie, vec![bytes], true);
    }
}

/// What [`hurt_files`] and [`hurt_records`] do, by material and view.
const HURT: [(u32, u32, FaultKind); 13] = [
    (0, 0, FaultKind::Missing),
    (1, 1, FaultKind::Size),
    (2, 2, FaultKind::Digest),
    (3, 0, FaultKind::Size),
    (4, 1, FaultKind::Size),
    (5, 2, FaultKind::Missing),
    (6, 0, FaultKind::Identity),
    (6, 1, FaultKind::Identity),
    (7, 1, FaultKind::Pixel),
    (8, 0, FaultKind::Black),
    (9, 2, FaultKind::Identity),
    (10, 0, FaultKind::Size),
    (11, 1, FaultKind::Statistics),
];

/// The kind of a fault; swapped files, those of 3 and 4, may have one size.
fn kind_of(material: u32, kind: FaultKind) -> FaultKind {
    match (material, kind) {
        (3 | 4, FaultKind::Size) => FaultKind::Digest,
        _ => kind,
    }
}

#[test]
fn every_fault_is_named_and_mended() {
    let (folder, renderer) = whole_store();
    let path = folder.path();
    let specification = &renderer.0;
    let all = checks(MATERIALS, Some(&renderer));
    assert_eq!(look(path, &all).faults, []);
    assert_eq!(look(path, &all).images_rerendered, 36);
    let before = blobs(path);
    let foreign = hurt_files(path, specification);
    hurt_records(path, specification);

    let report = look(path, &all);
    let found = report.faults.iter().map(|fault| {
        let kind = kind_of(fault.material, fault.kind);
        (fault.material, fault.view.unwrap(), kind)
    });
    let expected = HURT.map(|(material, view, kind)| (material, view, kind_of(material, kind)));
    assert_eq!(found.collect::<Vec<_>>(), expected);
    // What no record names any more, and the stranger's.
    let strays = [(5, 2), (7, 1), (8, 0), (9, 2)];
    let strays = strays.map(|(material, view)| image(path, specification, material, view));
    let mut strays = [&strays[..], &[foreign]].concat();
    strays.sort();
    assert_eq!(report.unnamed, strays);

    let repairs = mend(path, &renderer, &all);
    for Repair { fault, outcome, .. } in &repairs {
        let restored = matches!(fault.material, 0..=4);
        let expected = if restored {
            Outcome::Restored
        } else {
            Outcome::Corrected
        };
        assert_eq!(*outcome, expected, "{fault}");
    }
    assert_eq!(repairs.len(), expected.len());
    assert_eq!(look(path, &all).faults, []);
    let removed = remove_unnamed(&mut WritableStore::open(path).unwrap()).unwrap();
    assert_eq!(removed.len(), 4, "the stranger's and three that were lies");
    assert!(blobs(path) == before);
    let reader = ReadOnlyStore::open(path).unwrap();
    for material in 0..MATERIALS {
        let found = reader.completion(material).unwrap().unwrap();
        assert_eq!(found.views, completion(specification, material).0.views);
    }
}

#[test]
fn what_cannot_be_mended_is_reported_and_left() {
    let (folder, renderer) = whole_store();
    let path = folder.path();
    let specification = &renderer.0;
    // A record of an image that nobody can render again, whose file is gone.
    let mut lost = completion(specification, 3).0;
    lost.views[1].digest = Digest::of(b"of another renderer");
    record(path, &lost, vec![], true);
    // A material that is not recorded at all.
    let mut wanted = specification.clone();
    wanted.materials = MATERIALS + 1;
    drop(Store::open_or_create(path, &wanted).unwrap());

    let repairs = mend(path, &renderer, &checks(MATERIALS + 1, Some(&renderer)));
    let why: Vec<_> = repairs
        .iter()
        .map(|Repair { fault, outcome, .. }| match outcome {
            Outcome::Failed(why) => (fault.material, why.as_str()),
            other => panic!("{fault}: {other:?}"),
        })
        .collect();
    assert_eq!(why.len(), 2, "{why:?}");
    assert!(why[0].0 == 3 && why[0].1.contains("renders again to the digest"));
    assert!(why[1].0 == MATERIALS && why[1].1.contains("brdfarm run"));
    assert_eq!(look(path, &checks(MATERIALS + 1, None)).faults.len(), 2);
}

/// A lie in a finished set, under the right header: what is rendered here is the truth, and who lied
/// is named.
#[test]
fn an_image_that_renders_to_another_is_replaced_and_its_worker_named() {
    let (folder, renderer) = whole_store();
    let path = folder.path();
    let mut lie = completion(&renderer.0, 1).0;
    let image = image_of(&renderer.0, 1, 2, 7.0);
    lie.views[2].digest = Digest::of(&image);
    lie.views[2].bytes = image.len() as u64;
    let pixels = decode(&image, &renderer.0).unwrap().pixels;
    lie.views[2].pixels = PixelStatistics::of(&renderer.0, 2, pixels.iter().copied());
    lie.worker = "eve/node".to_owned();
    record(path, &lie, vec![image], true);
    assert_eq!(look(path, &checks(MATERIALS, None)).faults, []);

    let all = checks(MATERIALS, Some(&renderer));
    let repairs = mend(path, &renderer, &all);
    assert_eq!(repairs.len(), 1);
    assert_eq!(repairs[0].fault.kind, FaultKind::Rerender);
    assert_eq!(repairs[0].outcome, Outcome::Corrected);
    assert_eq!(repairs[0].delivered_by.as_deref(), Some("eve/node"));
    assert_eq!(look(path, &all).faults, []);
    let reader = ReadOnlyStore::open(path).unwrap();
    let mended = reader.completion(1).unwrap().unwrap();
    assert_eq!(mended.views, completion(&renderer.0, 1).0.views);
}

/// A lie about an image's brightness is seen in its pixels; nothing is rendered to find it.
#[test]
fn a_wrong_brightness_is_found_without_a_renderer_and_mended() {
    let (folder, renderer) = whole_store();
    let path = folder.path();
    let truth = completion(&renderer.0, 1).0;
    let mut lie = truth.clone();
    let brightness = &mut lie.views[2].pixels.as_mut().unwrap().brightness_mean;
    *brightness = brightness.next_up();
    record(path, &lie, vec![], true);
    let faults = look(path, &checks(MATERIALS, None)).faults;
    let found: Vec<_> = faults
        .iter()
        .map(|fault| (fault.material, fault.view, fault.kind))
        .collect();
    assert_eq!(found, [(1, Some(2), FaultKind::Statistics)]);

    let repairs = mend(path, &renderer, &checks(MATERIALS, None));
    assert_eq!(repairs.len(), 1);
    assert_eq!(repairs[0].outcome, Outcome::Corrected);
    let reader = ReadOnlyStore::open(path).unwrap();
    let mended = reader.completion(1).unwrap().unwrap();
    assert_eq!(mended.views, truth.views);
}

/// A renderer whose images are none of this dataset replaces nothing.
#[test]
fn another_rendering_is_a_fault_and_replaces_nothing() {
    let (folder, mut renderer) = whole_store();
    renderer.0.image.width += 1;
    let all = checks(2, Some(&renderer));
    let report = look(folder.path(), &all);
    assert_eq!(report.faults.len(), 6);
    assert!(
        report
            .faults
            .iter()
            .all(|fault| fault.kind == FaultKind::Rerender)
    );
    let before = blobs(folder.path());
    let repairs = mend(folder.path(), &renderer, &all);
    for repair in repairs {
        let Outcome::Failed(why) = &repair.outcome else {
            panic!("{}: {:?}", repair.fault, repair.outcome);
        };
        assert!(why.contains("no image of this dataset"), "{why}");
    }
    assert!(blobs(folder.path()) == before);
    // A share is a share, and its seed chooses it.
    let chosen = |rerender_seed| {
        let some = Checks {
            materials: MATERIALS,
            rerender_share: 0.3,
            rerender_seed,
            ..all
        };
        let faults = look(folder.path(), &some).faults;
        let chosen: Vec<_> = faults
            .iter()
            .map(|fault| (fault.material, fault.view))
            .collect();
        chosen
    };
    assert_eq!(chosen(5), chosen(5));
    assert_ne!(chosen(5), chosen(6));
    assert!((3..20).contains(&chosen(5).len()), "{}", chosen(5).len());
}

#[test]
fn only_images_that_nothing_names_are_garbage() {
    let (folder, _) = whole_store();
    let path = folder.path();
    let reader = || ReadOnlyStore::open(path).unwrap();
    assert_eq!(unnamed(&reader()).unwrap(), []);
    let stray = path.join(dataset::blob_path(&Digest::of(b"stray")));
    fs::create_dir_all(stray.parent().unwrap()).unwrap();
    fs::write(&stray, b"stray").unwrap();
    let note = path.join("blobs/note.txt");
    fs::write(&note, b"mine").unwrap();
    let found = unnamed(&reader()).unwrap();
    let is_image: BTreeMap<_, _> = found
        .iter()
        .map(|f| (f.path.clone(), f.is_image()))
        .collect();
    assert_eq!(
        is_image,
        BTreeMap::from([(stray.clone(), true), (note.clone(), false)])
    );
    let removed = remove_unnamed(&mut WritableStore::open(path).unwrap()).unwrap();
    assert_eq!((removed.len(), removed[0].bytes), (1, 5));
    assert!(note.exists() && !stray.exists());
    assert!(look(path, &checks(MATERIALS, None)).is_sound());
}

use crate::{
    cheap_image::small_specification,
    complete_store::{completion, make_store},
};
use dataset::Specification;
use datastore::{ReadOnlyStore, Store, StoreError};
use jobstore::Recovery;
use std::{fs, path::Path};

const MATERIALS: u32 = 6;

fn open(path: &Path, specification: &Specification) -> Recovery {
    let store = Store::open_or_create(path, specification).unwrap();
    store.recovery().clone()
}

fn complete_store() -> (tempfile::TempDir, Specification) {
    let folder = tempfile::tempdir().unwrap();
    let specification = small_specification(MATERIALS);
    make_store(folder.path(), &specification, 0..MATERIALS);
    let recovery = open(folder.path(), &specification);
    assert_eq!(recovery.completions_recovered, MATERIALS);
    assert_eq!(open(folder.path(), &specification), Recovery::default());
    (folder, specification)
}

#[test]
fn a_deleted_ledger_is_rebuilt_from_the_log() {
    let (folder, specification) = complete_store();
    fs::remove_dir_all(folder.path().join("ledger")).unwrap();
    let recovery = open(folder.path(), &specification);
    assert_eq!(recovery.completions_recovered, MATERIALS);
    assert_eq!(open(folder.path(), &specification), Recovery::default());
}

#[test]
fn a_deleted_log_is_rebuilt_from_the_ledger() {
    let (folder, specification) = complete_store();
    fs::remove_file(folder.path().join("completions.log")).unwrap();
    let recovery = open(folder.path(), &specification);
    assert_eq!(recovery.log_lines_restored, MATERIALS);
    let store = ReadOnlyStore::open(folder.path()).unwrap();
    assert_eq!(store.materials_missing(), 0);
    let (expected, _) = completion(&specification, 4);
    assert_eq!(store.completion(4).unwrap(), Some(expected));
}

#[test]
fn a_torn_and_a_damaged_line_come_back_from_the_ledger() {
    let (folder, specification) = complete_store();
    let path = folder.path().join("completions.log");
    let mut log = fs::read(&path).unwrap();
    log.truncate(log.len() - 10);
    log[100] ^= 4;
    fs::write(&path, log).unwrap();
    let store = ReadOnlyStore::open(folder.path()).unwrap();
    assert_eq!(store.materials_missing(), 2);
    assert_eq!(store.records_damaged(), 1);

    let recovery = open(folder.path(), &specification);
    assert_eq!(recovery.log_lines_restored, 2);
    assert_eq!(recovery.log_lines_damaged, 1);
    assert!(recovery.log_bytes_cut > 0);
    let store = ReadOnlyStore::open(folder.path()).unwrap();
    assert_eq!(store.materials_missing(), 0);
}

/// Truncated at 50 places, bits flipped at 50, and stretches overwritten at 10, all drawn from a
/// fixed seed.
#[test]
fn a_ledger_damaged_anywhere_costs_no_completion() {
    const ROUNDS: usize = 110;
    let (folder, specification) = complete_store();
    let ledger = folder.path().join("ledger");
    let kept = folder.path().join("kept");
    fs::rename(&ledger, &kept).unwrap();
    let whole = fs::read(kept.join("db")).unwrap();
    let used = whole.iter().rposition(|byte| *byte != 0).unwrap();
    let mut draw: usize = 4;
    let mut said = 0;
    for round in 0..=ROUNDS {
        // A linear congruential generator: places need to differ, no more.
        draw = draw.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        let place = (draw >> 33) % used;
        let mut damaged = whole.clone();
        match round {
            0..50 => damaged.truncate(place),
            50..100 => damaged[place] ^= 1 << (draw >> 61),
            100..ROUNDS => damaged[place..(place + 900).min(used)].fill(0xa5),
            _ => {}
        }
        copy_folder(&kept, &ledger);
        fs::write(ledger.join("db"), damaged).unwrap();
        let recovery = open(folder.path(), &specification);
        if round == ROUNDS {
            assert_eq!(recovery, Recovery::default(), "a copy without damage");
        }
        said += usize::from(recovery != Recovery::default());
        let store = ReadOnlyStore::open(folder.path()).unwrap();
        assert_eq!(store.materials_missing(), 0, "round {round}");
        fs::remove_dir_all(&ledger).unwrap();
        if let Some(aside) = recovery.ledger_moved_aside {
            fs::remove_dir_all(aside).unwrap();
        }
    }
    // A flipped bit can miss everything that is read; what costs something is told.
    assert!(said >= ROUNDS / 2, "{said} of {ROUNDS} rounds were told of");
}

fn copy_folder(from: &Path, to: &Path) {
    fs::create_dir(to).unwrap();
    for entry in fs::read_dir(from).unwrap() {
        let entry = entry.unwrap();
        let target = to.join(entry.file_name());
        if entry.file_type().unwrap().is_dir() {
            copy_folder(&entry.path(), &target);
        } else {
            fs::copy(entry.path(), target).unwrap();
        }
    }
}

#[test]
fn a_completion_whose_images_are_gone_is_not_recovered() {
    let (folder, specification) = complete_store();
    let (lost, _) = completion(&specification, 2);
    let store = ReadOnlyStore::open(folder.path()).unwrap();
    fs::remove_file(store.image_path(&lost.views[1].digest)).unwrap();
    fs::remove_dir_all(folder.path().join("ledger")).unwrap();
    let recovery = open(folder.path(), &specification);
    assert_eq!(recovery.completions_recovered, MATERIALS - 1);
    assert_eq!(recovery.materials_reopened, 1);
}

#[test]
fn a_store_has_one_writer() {
    let folder = tempfile::tempdir().unwrap();
    let specification = small_specification(2);
    let store = Store::open_or_create(folder.path(), &specification).unwrap();
    let second = Store::open_or_create(folder.path(), &specification);
    assert!(matches!(second, Err(StoreError::Locked { .. })));
    assert!(ReadOnlyStore::open(folder.path()).is_ok());
    drop(store);
    assert!(Store::open(folder.path()).is_ok());
}

#[test]
fn a_store_grows_never_shrinks_and_keeps_its_dataset() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    assert!(matches!(Store::open(path), Err(StoreError::Absent(_))));
    drop(Store::open_or_create(path, &small_specification(4)).unwrap());
    let store = Store::open_or_create(path, &small_specification(9)).unwrap();
    assert_eq!(store.specification().materials, 9);
    drop(store);
    let store = Store::open_or_create(path, &small_specification(2)).unwrap();
    assert_eq!(store.specification().materials, 9);
    assert_eq!(store.materials_asked(), 2);
    drop(store);
    let mut other = small_specification(9);
    other.seed += 1;
    let error = Store::open_or_create(path, &other).err().unwrap();
    assert!(matches!(error, StoreError::Specification { .. }));
    let error = error.to_string();
    let told = format!(
        "seed: {} in the store, {} given",
        other.seed - 1,
        other.seed
    );
    assert!(error.contains(&told), "{error}");
}

#[test]
fn a_store_of_another_renderer_or_with_noise_for_a_specification_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let specification = small_specification(2);
    drop(Store::open_or_create(folder.path(), &specification).unwrap());
    let identity = folder.path().join("store.json");
    let kept = fs::read_to_string(&identity).unwrap();
    let version = format!("\"renderer_version\": \"{}\"", dataset::RENDERER_VERSION);
    assert!(kept.contains(&version));
    let other = kept.replace(&version, "\"renderer_version\": \"0\"");
    fs::write(&identity, other).unwrap();
    let error = Store::open(folder.path()).err().unwrap();
    assert!(matches!(error, StoreError::Renderer { .. }), "{error}");
    fs::write(&identity, &kept).unwrap();

    let path = folder.path().join("specification.json");
    let whole = fs::read(&path).unwrap();
    for content in [&whole[..whole.len() / 2], b"", b"\xff\xfe", b"[]"] {
        fs::write(&path, content).unwrap();
        assert!(ReadOnlyStore::open(folder.path()).is_err());
        assert!(Store::open_or_create(folder.path(), &specification).is_err());
        assert_eq!(fs::read(&path).unwrap(), content, "nothing is written over");
    }
}

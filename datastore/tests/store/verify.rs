use crate::{
    cheap_image::{cheap_image, small_specification},
    cheap_renderer::checks,
    complete_store::{completion, make_store},
};
use datastore::{
    ReadOnlyStore,
    verify::{Report, verify},
};
use std::{
    fs,
    path::{Path, PathBuf},
    sync::atomic::{AtomicU64, Ordering},
};

fn check(path: &Path) -> Report {
    let store = ReadOnlyStore::open(path).unwrap();
    verify(
        &store,
        &checks(store.specification().materials, None),
        &|_| (),
    )
    .unwrap()
}

#[test]
fn every_kind_of_damage_is_found_where_it_is() {
    let folder = tempfile::tempdir().unwrap();
    let specification = small_specification(8);
    make_store(folder.path(), &specification, 0..8);
    let looked_at = AtomicU64::new(0);
    let store = ReadOnlyStore::open(folder.path()).unwrap();
    let report = verify(&store, &checks(8, None), &|images| {
        looked_at.fetch_max(images, Ordering::Relaxed);
    })
    .unwrap();
    assert_eq!(report.faults, []);
    assert_eq!(report.images_sound, 24);
    assert_eq!(looked_at.into_inner(), 24);

    let image = |material: u32, view: usize| -> PathBuf {
        store.image_path(&completion(&specification, material).0.views[view].digest)
    };
    let rewrite = |path: &Path, change: fn(&mut Vec<u8>)| {
        let mut bytes = fs::read(path).unwrap();
        change(&mut bytes);
        fs::write(path, bytes).unwrap();
    };
    fs::remove_file(image(1, 0)).unwrap();
    rewrite(&image(2, 1), |bytes| bytes[700] ^= 1);
    rewrite(&image(3, 2), |bytes| bytes.truncate(600));
    rewrite(&image(5, 0), |bytes| bytes.resize(9_000_000, 0));
    let faults = check(folder.path()).faults;
    let found: Vec<(u32, Option<u32>)> = faults
        .iter()
        .map(|fault| (fault.material, fault.view))
        .collect();
    let at = |material, view| (material, Some(view));
    assert_eq!(found, [at(1, 0), at(2, 1), at(3, 2), at(5, 0)]);
    for (fault, what) in faults.iter().zip(["missing", "digest", "fewer", "more"]) {
        assert!(fault.what.contains(what), "{fault}");
        assert!(fault.path.as_ref().unwrap().starts_with(folder.path()));
    }
}

#[test]
fn what_is_not_complete_or_is_another_image_is_a_fault() {
    let folder = tempfile::tempdir().unwrap();
    let specification = small_specification(3);
    make_store(folder.path(), &specification, [0, 2]);
    let (mut swapped, _) = completion(&specification, 2);
    swapped.views.swap(0, 1);
    let path = folder.path().join("completions.log");
    let (mut log, _) = jobstore::completion_log::CompletionLog::open(&path).unwrap();
    log.append([&swapped]).unwrap();
    let report = check(folder.path());
    let faults: Vec<String> = report.faults.iter().map(ToString::to_string).collect();
    assert_eq!(faults.len(), 3, "{faults:#?}");
    assert!(faults[0].starts_with("material 1: it is not complete"));
    assert!(faults[1].starts_with("material 2, view 0") && faults[1].contains("view is 1"));
    assert!(faults[2].starts_with("material 2, view 1") && faults[2].contains("view is 0"));
    assert_eq!(report.images_sound, 4);
    assert_ne!(
        cheap_image(&specification, 2, 0),
        cheap_image(&specification, 2, 1)
    );
}

use crate::{
    cheap_image::small_specification,
    complete_store::{completion, make_store},
};
use dataset::{Digest, Split};
use datastore::ReadOnlyStore;
use export::{
    ExportError,
    card::Publication,
    layout::{Layout, Options, export},
    manifest::Exported,
    product::Products,
    selection::Selection,
};
use std::{
    collections::BTreeMap,
    fs,
    os::unix::fs::MetadataExt,
    path::{Path, PathBuf},
    sync::atomic::{AtomicU64, Ordering},
};

const LAYOUTS: [Layout; 3] = [
    Layout::Files { links: false },
    Layout::WebDataset,
    Layout::HuggingFace,
];

fn options(layout: Layout) -> Options {
    Options {
        layout,
        selection: Selection::default(),
        products: Products {
            npy: true,
            png_exposure_stops: Some(-1.0),
            rectified_side: Some(4),
        },
        // A shard has a few materials.
        shard_bytes: 200_000,
        threads: 2,
        publication: Publication::default(),
        overwrite: false,
    }
}

fn store_of(materials: u32) -> (tempfile::TempDir, ReadOnlyStore) {
    let folder = tempfile::tempdir().unwrap();
    make_store(folder.path(), &small_specification(materials), 0..materials);
    let store = ReadOnlyStore::open(folder.path()).unwrap();
    (folder, store)
}

fn run(
    store: &ReadOnlyStore,
    options: &Options,
    folder: &Path,
) -> Result<(Exported, u64), ExportError> {
    let told = AtomicU64::new(0);
    let exported = export(store, options, b"a picture", folder, &|images| {
        told.fetch_max(images, Ordering::Relaxed);
    })?;
    Ok((exported, told.into_inner()))
}

/// Every file below a folder with the digest of its bytes.
fn contents(folder: &Path) -> BTreeMap<PathBuf, Digest> {
    let mut found = BTreeMap::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(next) = folders.pop() {
        for entry in fs::read_dir(next).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else {
                let name = path.strip_prefix(folder).unwrap().to_owned();
                found.insert(name, Digest::of(&fs::read(&path).unwrap()));
            }
        }
    }
    found
}

#[test]
fn the_same_store_exports_to_the_same_bytes_in_every_layout() {
    let (_folder, store) = store_of(12);
    for layout in LAYOUTS {
        let places = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
        for (threads, place) in [1, 3].into_iter().zip(&places) {
            let mut options = options(layout);
            options.threads = threads;
            let (exported, told) = run(&store, &options, place.path()).unwrap();
            assert_eq!((exported.rows, exported.materials_missing), (36, 0));
            assert_eq!(told, 36);
        }
        let found = contents(places[0].path());
        assert_eq!(found, contents(places[1].path()), "{layout:?}");
        let shards = found
            .keys()
            .filter(|path| path.starts_with("train"))
            .count();
        match layout {
            // Eight materials, three views, six files.
            Layout::Files { .. } => assert_eq!(shards, 8 * 3 * 6),
            _ => assert!((2..8).contains(&shards), "{layout:?}: {shards}"),
        }
    }
}

#[test]
fn an_export_that_was_stopped_goes_on_and_ends_the_same() {
    let (_folder, store) = store_of(13);
    for layout in LAYOUTS {
        let whole = tempfile::tempdir().unwrap();
        run(&store, &options(layout), whole.path()).unwrap();
        let expected = contents(whole.path());

        // As a kill leaves it: no manifest, one unit missing, one under way.
        let manifest = whole.path().join("manifest.parquet");
        fs::remove_file(&manifest).unwrap();
        let units: Vec<PathBuf> = fs::read_dir(whole.path().join("train"))
            .unwrap()
            .map(|entry| entry.unwrap().path())
            .collect();
        let mut under_way = units[0].clone().into_os_string();
        under_way.push(".new");
        fs::rename(&units[0], &under_way).unwrap();
        let kept = fs::metadata(&units[1]).unwrap().ino();
        run(&store, &options(layout), whole.path()).unwrap();
        assert_eq!(contents(whole.path()), expected, "{layout:?}");
        assert_eq!(fs::metadata(&units[1]).unwrap().ino(), kept, "made again");
    }
    // After a power loss a plain file may be there without its bytes.
    let place = tempfile::tempdir().unwrap();
    let layout = Layout::Files { links: false };
    run(&store, &options(layout), place.path()).unwrap();
    let expected = contents(place.path());
    for name in ["v01.exr", "v02.rectified.npy"] {
        let first = expected.keys().find(|path| path.ends_with(name)).unwrap();
        fs::write(place.path().join(first), b"").unwrap();
        run(&store, &options(layout), place.path()).unwrap();
        assert_eq!(contents(place.path()), expected);
    }
}

#[test]
fn what_is_in_the_way_is_refused() {
    let (_folder, store) = store_of(6);
    let layout = Layout::WebDataset;
    let place = tempfile::tempdir().unwrap();
    fs::write(place.path().join("thesis.tex"), b"precious").unwrap();
    let refused = run(&store, &options(layout), place.path()).unwrap_err();
    assert!(refused.to_string().contains("thesis.tex"), "{refused}");
    assert_eq!(contents(place.path()).len(), 1);

    let place = tempfile::tempdir().unwrap();
    run(&store, &options(layout), place.path()).unwrap();
    let mut others = [
        options(layout),
        options(layout),
        options(Layout::HuggingFace),
    ];
    others[0].selection.views = Some(vec![1]);
    others[1].products.rectified_side = Some(5);
    for (other, named) in others.iter().zip(["views", "rectified_side", "layout"]) {
        let refused = run(&store, other, place.path()).unwrap_err();
        assert!(matches!(refused, ExportError::OtherExport { .. }));
        assert!(refused.to_string().contains(named), "{refused}");
    }
}

#[test]
fn a_set_with_holes_leaves_only_in_part_and_says_so() {
    let folder = tempfile::tempdir().unwrap();
    make_store(folder.path(), &small_specification(12), [0, 2, 3, 11]);
    let store = ReadOnlyStore::open(folder.path()).unwrap();
    let place = tempfile::tempdir().unwrap();
    let mut wanted = options(Layout::WebDataset);
    let refused = run(&store, &wanted, place.path()).unwrap_err();
    assert!(matches!(
        refused,
        ExportError::Incomplete { missing: 8, .. }
    ));
    wanted.selection.partial = true;
    let (exported, _) = run(&store, &wanted, place.path()).unwrap();
    assert_eq!((exported.rows, exported.materials_missing), (12, 8));
    let card = fs::read_to_string(place.path().join("README.md")).unwrap();
    assert!(card.contains("8 materials are missing"), "{card}");
}

#[test]
fn a_damaged_image_does_not_leave() {
    let (_folder, store) = store_of(6);
    let path = store.image_path(&completion(&small_specification(6), 4).0.views[1].digest);
    let mut bytes = fs::read(&path).unwrap();
    bytes[300] ^= 1;
    fs::write(&path, bytes).unwrap();
    for layout in LAYOUTS {
        let place = tempfile::tempdir().unwrap();
        let refused = run(&store, &options(layout), place.path()).unwrap_err();
        assert!(matches!(refused, ExportError::Image { .. }), "{refused}");
        assert!(!place.path().join("manifest.parquet").exists());
        assert!(!place.path().join("README.md").exists());
    }
}

#[test]
fn views_and_splits_are_chosen_and_links_are_links() {
    let (_folder, store) = store_of(12);
    let place = tempfile::tempdir().unwrap();
    let mut wanted = options(Layout::Files { links: true });
    wanted.products = Products::default();
    wanted.selection.views = Some(vec![2, 0, 2]);
    wanted.selection.split = Some(Split::Validation);
    let (exported, told) = run(&store, &wanted, place.path()).unwrap();
    assert_eq!((exported.rows, told), (4, 4));
    let found = contents(place.path());
    let images: Vec<_> = found
        .keys()
        .filter(|path| path.ends_with("v02.exr"))
        .collect();
    assert_eq!(images.len(), 2);
    for image in images {
        assert!(image.starts_with("validation"));
        assert_eq!(fs::metadata(place.path().join(image)).unwrap().nlink(), 2);
    }
    assert!(!found.keys().any(|path| path.ends_with("v01.exr")));
    wanted.selection.views = Some(vec![3]);
    let refused = run(&store, &wanted, place.path()).unwrap_err();
    assert!(matches!(refused, ExportError::NoSuchView { view: 3, .. }));
}

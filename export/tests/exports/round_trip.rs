//! Out of a store, into another one, out again; and what is stopped on the way in.

use crate::{
    cheap_image::{Cheap, small_specification},
    complete_store::{completion, make_store},
};
use dataset::{Digest, Specification};
use datastore::{ReadOnlyStore, Store};
use export::{
    card::Publication,
    diff::diff,
    import::{ImportError, Imported, import},
    layout::{Layout, Options, export as export_layout},
    manifest::{
        Format,
        check::check_manifest,
        export,
        read::{ReadError, read, read_specification},
    },
    product::Products,
    selection::Selection,
};
use jobqueue::Completion;
use std::{
    fs,
    path::{Path, PathBuf},
};

const LAYOUTS: [Layout; 3] = [
    Layout::Files { links: false },
    Layout::WebDataset,
    Layout::HuggingFace,
];

/// Shards have a few materials.
pub fn options(layout: Layout) -> Options {
    Options {
        layout,
        selection: Selection::default(),
        products: Products::default(),
        shard_bytes: 100_000,
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

fn take_in(from: &Path, store: &Path) -> Result<Imported, ImportError> {
    let manifest = from.join("manifest.parquet");
    let specification = read_specification(&manifest)?;
    import(
        &specification,
        &manifest,
        &from.into(),
        store,
        None,
        2,
        &|_, _| (),
    )
}

fn manifests(store: &ReadOnlyStore, folder: &Path) -> [Vec<u8>; 3] {
    Format::ALL.map(|format| {
        let path = folder.join(format!("out.{}", format.ending()));
        export(store, format, true, &path).unwrap();
        fs::read(path).unwrap()
    })
}

#[test]
fn out_in_and_out_again_is_the_same() {
    let (folder, store) = store_of(12);
    let scratch = tempfile::tempdir().unwrap();
    let before = manifests(&store, scratch.path());
    for (number, layout) in LAYOUTS.into_iter().enumerate() {
        let out = scratch.path().join(format!("out-{number}"));
        export_layout(&store, &options(layout), b"", &out, &|_| ()).unwrap();
        let path = scratch.path().join(format!("store-{number}"));
        let imported = take_in(&out, &path).unwrap();
        assert_eq!((imported.materials, imported.images), (12, 36));
        let again = ReadOnlyStore::open(&path).unwrap();
        assert!(manifests(&again, scratch.path()) == before, "{layout:?}");
        assert!(diff(folder.path(), &path).unwrap().is_empty());
        // Nothing is to do a second time; and the ledger knows all of it.
        let again = take_in(&out, &path).unwrap();
        assert_eq!((again.materials, again.materials_there), (0, 12));
        let recovery = Store::open(&path).unwrap().recovery().clone();
        assert_eq!(recovery, jobstore::Recovery::default());
    }
}

#[test]
fn every_format_reads_back_to_its_rows_and_agrees_with_the_store() {
    let (folder, store) = store_of(7);
    for format in Format::ALL {
        let path = folder.path().join(format!("out.{}", format.ending()));
        export(&store, format, false, &path).unwrap();
        let mut rows = 0;
        read::<ReadError>(&path, |number, row| {
            rows += 1;
            assert_eq!(number, rows);
            assert_eq!(u64::from(row.image().0 * 3 + row.image().1), rows - 1);
            Ok(())
        })
        .unwrap();
        assert_eq!(rows, 21);
        assert_eq!(check_manifest(&store, &path).unwrap(), []);
    }
    let parquet = folder.path().join("out.parquet");
    assert_eq!(
        read_specification(&parquet).unwrap(),
        *store.specification()
    );
}

/// Edits a row of a CSV manifest: the field that is `from` becomes `to` in the line of an image.
fn edit(path: &Path, line: usize, edit: impl Fn(&str) -> String) {
    let text = fs::read_to_string(path).unwrap();
    let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
    lines[line] = edit(&lines[line]);
    fs::write(path, lines.join("\n") + "\n").unwrap();
}

#[test]
fn a_row_edited_by_hand_is_named_with_its_column() {
    let (folder, store) = store_of(6);
    let path = folder.path().join("out.csv");
    export(&store, Format::Csv, false, &path).unwrap();
    edit(&path, 5, |line| {
        line.replacen(",train,", ",test,", 1)
            .replacen(",validation,", ",train,", 1)
    });
    let digest = |material, view: usize| {
        completion(&small_specification(6), material).0.views[view]
            .digest
            .to_string()
    };
    edit(&path, 8, |line| line.replace(&digest(2, 1), &digest(2, 2)));
    let roughness = store.specification().material(4).material.roughness;
    edit(&path, 13, |line| {
        line.replace(&format!(",{roughness:?},"), ",50.0,")
    });
    let last = fs::read_to_string(&path)
        .unwrap()
        .lines()
        .last()
        .unwrap()
        .to_owned();
    fs::write(&path, fs::read_to_string(&path).unwrap() + &last + "\n").unwrap();
    let found: Vec<_> = check_manifest(&store, &path)
        .unwrap()
        .into_iter()
        .map(|fault| (fault.row, fault.material, fault.view, fault.column))
        .collect();
    assert_eq!(
        found,
        [
            (5, 1, 1, Some("split")),
            (8, 2, 1, Some("digest")),
            (13, 4, 0, Some("roughness")),
            (19, 5, 2, None),
        ]
    );
    // Nor does such a manifest come in.
    let refused = import(
        store.specification(),
        &path,
        &folder.path().into(),
        &folder.path().join("new"),
        None,
        1,
        &|_, _| (),
    );
    let refused = refused.unwrap_err().to_string();
    assert!(
        refused.starts_with("row 5 of the manifest, material 1, view 1: split is"),
        "{refused}"
    );
}

#[test]
fn what_is_no_manifest_is_refused_in_a_sentence() {
    let (folder, store) = store_of(6);
    let refused = |name: &str, bytes: &[u8], what: &str| {
        let path = folder.path().join(name);
        fs::write(&path, bytes).unwrap();
        let error = check_manifest(&store, &path).unwrap_err().to_string();
        assert!(error.contains(what), "{name}: {error}");
    };
    refused("a.txt", b"", "ends in .jsonl, .csv or .parquet");
    refused("a.jsonl", b"{}\n", "row 1: dataset is missing");
    refused("b.jsonl", b"{\"no such\": 1}\n", "no column \"no such\"");
    refused("c.jsonl", &vec![b'['; 2 << 20], "longer than");
    refused("a.csv", b"dataset,material\n", "is called \"material\"");
    refused("a.parquet", b"PAR1 no more", "a.parquet: ");
    let path = folder.path().join("whole.parquet");
    export(&store, Format::Parquet, false, &path).unwrap();
    let whole = fs::read(&path).unwrap();
    for place in (0..whole.len()).step_by(97) {
        let mut damaged = whole.clone();
        damaged[place] ^= 0x10;
        fs::write(&path, &damaged).unwrap();
        // Damage is an error or a fault, or is where nothing is read; it is never a panic.
        let _ = check_manifest(&store, &path);
    }
}

fn image_in(from: &Path, view: usize, specification: &Specification) -> PathBuf {
    let split = specification.split(3);
    from.join(format!("{split}/000003/v{view:02}.exr"))
}

#[test]
fn a_bad_image_does_not_come_in_and_the_rest_goes_on_after_it() {
    let (_folder, store) = store_of(6);
    let specification = store.specification();
    let scratch = tempfile::tempdir().unwrap();
    let out = scratch.path().join("out");
    let layout = Layout::Files { links: false };
    export_layout(&store, &options(layout), b"", &out, &|_| ()).unwrap();
    let path = scratch.path().join("store");
    let image = image_in(&out, 1, specification);
    let whole = fs::read(&image).unwrap();
    let other = fs::read(image_in(&out, 2, specification)).unwrap();
    let mut flipped = whole.clone();
    flipped[whole.len() / 2] ^= 1;
    let faults: [(&[u8], &str); 4] = [
        (&whole[..99], "bytes"),
        (&flipped, "digest"),
        (&other, ""),
        (&[], "bytes"),
    ];
    for (bytes, what) in faults {
        fs::write(&image, bytes).unwrap();
        let refused = take_in(&out, &path).unwrap_err().to_string();
        assert!(
            refused.contains("material 3, view 1") && refused.contains(what),
            "{refused}"
        );
    }
    fs::remove_file(&image).unwrap();
    assert!(take_in(&out, &path).is_err());
    fs::write(&image, whole).unwrap();
    take_in(&out, &path).unwrap();
    assert_eq!(ReadOnlyStore::open(&path).unwrap().materials_missing(), 0);
}

#[test]
fn what_a_store_has_is_not_replaced() {
    let (_folder, store) = store_of(3);
    let scratch = tempfile::tempdir().unwrap();
    let out = scratch.path().join("out");
    export_layout(&store, &options(Layout::WebDataset), b"", &out, &|_| ()).unwrap();
    let path = scratch.path().join("store");
    take_in(&out, &path).unwrap();
    let mut other = completion(&small_specification(3), 1).0;
    other.views[2].statistics.mean += 1e-9;
    Store::open(&path).unwrap().put(&[other], &[]).unwrap();
    assert!(matches!(
        take_in(&out, &path),
        Err(ImportError::Conflict(1))
    ));
}

#[test]
fn a_manifest_that_leads_out_of_its_folder_lies_of_sizes_or_is_of_a_part_is_refused() {
    let (folder, store) = store_of(6);
    let path = folder.path().join("out.jsonl");
    export(&store, Format::Jsonl, false, &path).unwrap();
    let whole = fs::read_to_string(&path).unwrap();
    let go = || {
        let new = folder.path().join("new");
        let refused = import(
            store.specification(),
            &path,
            &folder.path().into(),
            &new,
            None,
            1,
            &|_, _| (),
        );
        refused.unwrap_err()
    };
    for place in ["../../etc/passwd", "/etc/passwd", ""] {
        let start = whole.find("\"path\":\"").unwrap() + 8;
        let end = start + whole[start..].find('"').unwrap();
        let edited = format!("{}{place}{}", &whole[..start], &whole[end..]);
        fs::write(&path, edited).unwrap();
        let refused = go().to_string();
        assert!(refused.contains("leaves the folder"), "{refused}");
    }
    let bytes = whole.find("\"bytes\":").unwrap() + 8;
    let digits = whole[bytes..].find(',').unwrap();
    let edited = format!(
        "{}{}{}",
        &whole[..bytes],
        u64::MAX,
        &whole[bytes + digits..]
    );
    fs::write(&path, edited).unwrap();
    let refused = go().to_string();
    assert!(refused.contains("no image of this film"), "{refused}");
    let part: Vec<&str> = whole
        .lines()
        .filter(|line| !line.contains("\"view\":1,"))
        .collect();
    fs::write(&path, part.join("\n")).unwrap();
    assert!(matches!(
        go(),
        ImportError::Views {
            material: 0,
            found: 2,
            views: 3
        }
    ));
}

#[test]
fn what_differs_between_two_stores_is_counted_and_measured() {
    let specification = small_specification(6);
    let (folder, store) = store_of(6);
    let other = tempfile::tempdir().unwrap();
    make_store(other.path(), &specification, 0..5);
    // One image a little brighter, one much.
    let mut changed: Vec<Completion> = Vec::new();
    let mut images = Vec::new();
    for (material, view, gain) in [(1, 0, 1.25), (3, 2, 2.0)] {
        let mut cheap = Cheap::new(&specification, material, view);
        cheap.value *= gain;
        let bytes = cheap.encode();
        let mut done = completion(&specification, material).0;
        done.views[view as usize].digest = Digest::of(&bytes);
        done.views[view as usize].bytes = bytes.len() as u64;
        images.push((Digest::of(&bytes), bytes));
        changed.push(done);
    }
    Store::open(other.path())
        .unwrap()
        .put(&changed, &images)
        .unwrap();

    let found = diff(folder.path(), other.path()).unwrap();
    assert_eq!(
        (found.in_both, found.only_in_a, found.only_in_b),
        (15, 3, 0)
    );
    assert_eq!(found.digests_differ, 2);
    assert_eq!(found.columns.get("digest"), Some(&2));
    let worst: Vec<_> = found
        .worst
        .iter()
        .map(|image| (image.material, image.view))
        .collect();
    assert_eq!(worst, [(3, 2), (1, 0)]);
    // Of b = g a it is (g - 1)^2, but for black pixels and the floor.
    let expected = [1.0, 0.0625].map(|whole| whole * 15.0 / 16.0);
    for (image, expected) in found.worst.iter().zip(expected) {
        assert!(
            (image.relative_mse / expected - 1.0).abs() < 0.01,
            "{image:?}"
        );
    }
    // A manifest stands for its store, less the pixels.
    let path = folder.path().join("a.csv");
    export(&store, Format::Csv, false, &path).unwrap();
    let of_manifest = diff(&path, other.path()).unwrap();
    assert_eq!(of_manifest.columns, found.columns);
    assert_eq!(of_manifest.relative_mse_mean, None);
    assert!(diff(&path, folder.path()).unwrap().is_empty());
}

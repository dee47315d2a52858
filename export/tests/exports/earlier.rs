//! What an earlier version wrote, which recorded nothing of brightness.

use crate::{
    cheap_image::small_specification,
    complete_store::{completion, make_store, put},
};
use dataset::manifest::{Kind, columns};
use datastore::ReadOnlyStore;
use export::{
    import::{Source, import},
    manifest::{Format, check::check_manifest, export},
};
use std::{
    collections::BTreeSet,
    fs,
    path::{Path, PathBuf},
};

const MATERIALS: u32 = 4;

fn manifest_of(store: &Path, format: Format) -> PathBuf {
    let path = store.join(format!("manifest.{}", format.ending()));
    let store = ReadOnlyStore::open(store).unwrap();
    export(&store, format, false, &path).unwrap();
    path
}

#[test]
fn a_store_without_brightness_has_the_same_manifest() {
    let specification = small_specification(MATERIALS);
    let (now, earlier) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    make_store(now.path(), &specification, 0..MATERIALS);
    let without = |material| {
        let (mut completion, images) = completion(&specification, material);
        // One image of the four materials is recorded as it is now.
        let views = completion.views.iter_mut();
        for view in views.skip(usize::from(material == 2)) {
            view.pixels = None;
        }
        (completion, images)
    };
    put(earlier.path(), &specification, (0..MATERIALS).map(without));
    // The pixels speak where the store does not: a false brightness is no row of it.
    let jsonl = manifest_of(earlier.path(), Format::Jsonl);
    let text = fs::read_to_string(&jsonl).unwrap();
    let lie = text.replacen("\"dark_share\":0.0", "\"dark_share\":0.5", 1);
    assert_ne!(lie, text);
    fs::write(&jsonl, lie).unwrap();
    let store = ReadOnlyStore::open(earlier.path()).unwrap();
    let faults = check_manifest(&store, &jsonl).unwrap();
    let columns: Vec<_> = faults.iter().map(|fault| fault.column).collect();
    assert_eq!(columns, [Some("dark_share")]);
    for format in Format::ALL {
        let [now, earlier] = [&now, &earlier].map(|store| {
            let manifest = manifest_of(store.path(), format);
            fs::read(manifest).unwrap()
        });
        assert!(now == earlier, "{format:?}");
    }
}

/// The manifests of a store as an earlier version would have written them.
fn without_later_columns(store: &Path) -> [PathBuf; 2] {
    let later: BTreeSet<&str> = columns()
        .iter()
        .filter(|column| column.optional)
        .map(|column| column.name)
        .collect();
    assert!(later.contains("brightness_mean"));
    let lines = fs::read_to_string(manifest_of(store, Format::Jsonl)).unwrap();
    let lines = lines.lines().map(|line| {
        let mut row: serde_json::Map<String, serde_json::Value> =
            serde_json::from_str(line).unwrap();
        row.retain(|name, _| !later.contains(name.as_str()));
        serde_json::to_string(&row).unwrap() + "\n"
    });
    let jsonl = store.join("earlier.jsonl");
    fs::write(&jsonl, lines.collect::<String>()).unwrap();

    let fields = columns().iter().filter(|column| column.optional);
    let fields: usize = fields
        .map(|column| match column.kind {
            Kind::F64List(length) => length,
            _ => 1,
        })
        .sum();
    let lines = fs::read_to_string(manifest_of(store, Format::Csv)).unwrap();
    let lines = lines.lines().map(|line| {
        let all: Vec<&str> = line.split(',').collect();
        all[..all.len() - fields].join(",") + "\n"
    });
    let csv = store.join("earlier.csv");
    fs::write(&csv, lines.collect::<String>()).unwrap();
    [jsonl, csv]
}

#[test]
fn a_manifest_without_later_columns_is_read_and_its_images_come_in_with_their_brightness() {
    let specification = small_specification(MATERIALS);
    let folder = tempfile::tempdir().unwrap();
    make_store(folder.path(), &specification, 0..MATERIALS);
    let store = ReadOnlyStore::open(folder.path()).unwrap();
    for manifest in without_later_columns(folder.path()) {
        let faults = check_manifest(&store, &manifest).unwrap();
        assert!(faults.is_empty(), "{faults:?}");
        let copy = tempfile::tempdir().unwrap();
        let source = Source::Folder(folder.path().to_owned());
        import(
            &specification,
            &manifest,
            &source,
            copy.path(),
            None,
            2,
            &|_, _| {},
        )
        .unwrap();
        let copied = ReadOnlyStore::open(copy.path()).unwrap();
        for material in 0..MATERIALS {
            let (expected, _) = completion(&specification, material);
            let found = copied.completion(material).unwrap().unwrap();
            assert_eq!(found.views, expected.views);
        }
    }
    // Without the last column, or two, it is one from before there were meshes, and without a third from
    // before there were shapes; half of a colour is damage.
    let csv = folder.path().join("shorter.csv");
    let mut text = fs::read_to_string(manifest_of(folder.path(), Format::Csv)).unwrap();
    for is_sound in [true, true, true, false] {
        let lines = text
            .lines()
            .map(|line| line.rsplit_once(',').unwrap().0.to_owned() + "\n");
        text = lines.collect();
        fs::write(&csv, &text).unwrap();
        let faults = check_manifest(&store, &csv);
        assert_eq!(faults.is_ok_and(|faults| faults.is_empty()), is_sound);
    }
}

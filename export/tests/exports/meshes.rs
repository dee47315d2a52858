//! Datasets whose sample is a mesh: its file leaves with them and comes back, or nothing comes back.

use crate::round_trip::options;
use crate::{
    complete_store::{completion, make_store},
    mesh_specification::mesh_specification,
};
use dataset::{
    Specification,
    manifest::{Kind, Value, columns},
};
use datastore::{ReadOnlyStore, Store};
use export::{
    import::{ImportError, Imported, Source, import, read_images},
    layout::{Layout, Options, export as export_layout},
    manifest::{
        Format,
        check::check_manifest,
        export,
        read::{ReadError, read, read_specification},
    },
};
use std::{
    collections::BTreeMap,
    fs,
    os::unix::fs::symlink,
    path::{Path, PathBuf},
};

const MATERIALS: u32 = 6;

const LAYOUTS: [Layout; 4] = [
    Layout::Files { links: false },
    Layout::Files { links: true },
    Layout::WebDataset,
    Layout::HuggingFace,
];

fn mesh_of(specification: &Specification) -> (String, Vec<u8>) {
    let mesh = specification.sample.mesh.as_ref().unwrap();
    (mesh.file_name(), mesh.loaded().unwrap().bytes().to_vec())
}

fn store_of(height: f64) -> (tempfile::TempDir, ReadOnlyStore) {
    let folder = tempfile::tempdir().unwrap();
    let specification = mesh_specification(MATERIALS, height);
    make_store(folder.path(), &specification, 0..MATERIALS);
    let store = ReadOnlyStore::open(folder.path()).unwrap();
    (folder, store)
}

fn leave(store: &ReadOnlyStore, options: &Options, out: &Path) {
    export_layout(store, options, b"a picture", out, &|_| ()).unwrap();
}

fn take_in(from: &Path, store: &Path) -> Result<Imported, ImportError> {
    let manifest = from.join("manifest.parquet");
    let specification = read_specification(&manifest)?;
    let source = Source::Folder(from.to_owned());
    import(
        &specification,
        &manifest,
        &source,
        store,
        None,
        2,
        &|_, _| (),
    )
}

fn manifests(store: &ReadOnlyStore, folder: &Path) -> [Vec<u8>; 3] {
    Format::ALL.map(|format| {
        let path = folder.join(format!("out.{}", format.ending()));
        export(store, format, false, &path).unwrap();
        fs::read(path).unwrap()
    })
}

/// The files of a folder with their bytes, less those in folders of it.
fn files(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let entries = fs::read_dir(folder).unwrap();
    let paths = entries.map(|entry| entry.unwrap().path());
    paths
        .filter(|path| path.is_file())
        .map(|path| (path.clone(), fs::read(path).unwrap()))
        .collect()
}

#[test]
fn the_mesh_leaves_in_every_layout_and_comes_back() {
    let (_folder, store) = store_of(1.0);
    let (name, bytes) = mesh_of(store.specification());
    let scratch = tempfile::tempdir_in(store.name().folder().unwrap()).unwrap();
    let before = manifests(&store, scratch.path());
    for (number, layout) in LAYOUTS.into_iter().enumerate() {
        let out = scratch.path().join(format!("out-{number}"));
        leave(&store, &options(layout), &out);
        assert_eq!(fs::read(out.join(&name)).unwrap(), bytes, "{layout:?}");
        // The specification can be read where it is, and is that of the store with its mesh.
        let read = Specification::load(&out.join("specification.toml")).unwrap();
        assert_eq!(read.hash(), store.specification_hash());
        assert_eq!(mesh_of(&read).1, bytes);
        let card = fs::read_to_string(out.join("README.md")).unwrap();
        assert!(card.contains(&format!("`{name}` is the mesh")), "{card}");
        let metadata = fs::read(out.join("croissant.json")).unwrap();
        let metadata: serde_json::Value = serde_json::from_slice(&metadata).unwrap();
        let described = metadata["distribution"].as_array().unwrap().iter();
        let described: Vec<_> = described.filter(|file| file["@id"] == *name).collect();
        assert_eq!(described.len(), 1, "{metadata}");

        let path = scratch.path().join(format!("store-{number}"));
        let imported = take_in(&out, &path).unwrap();
        assert_eq!((imported.materials, imported.images), (6, 18));
        assert_eq!(fs::read(path.join(&name)).unwrap(), bytes);
        let again = ReadOnlyStore::open(&path).unwrap();
        assert!(manifests(&again, scratch.path()) == before, "{layout:?}");
        // What is known of brightness needs the mesh, and came along.
        for material in 0..MATERIALS {
            let (expected, _) = completion(store.specification(), material);
            let found = again.completion(material).unwrap().unwrap();
            assert_eq!(found.views, expected.views);
        }
        let again = take_in(&out, &path).unwrap();
        assert_eq!((again.materials, again.materials_there), (0, 6));
    }
}

#[test]
fn a_store_is_brought_into_another_store_with_its_mesh() {
    let (folder, store) = store_of(1.0);
    let (name, bytes) = mesh_of(store.specification());
    for format in Format::ALL {
        let manifest = folder.path().join(format!("all.{}", format.ending()));
        export(&store, format, false, &manifest).unwrap();
        let named = Specification::from_json(&store.specification().to_json()).unwrap();
        let other = tempfile::tempdir().unwrap();
        let source = Source::Folder(folder.path().to_owned());
        import(
            &named,
            &manifest,
            &source,
            other.path(),
            None,
            1,
            &|_, _| (),
        )
        .unwrap();
        assert_eq!(fs::read(other.path().join(&name)).unwrap(), bytes);
        let copied = ReadOnlyStore::open(other.path()).unwrap();
        assert_eq!(check_manifest(&copied, &manifest).unwrap(), []);
    }
}

/// Every way in which the file of a mesh can be wrong, and a word that the refusal says of it.
fn spoil(out: &Path, name: &str, number: usize) -> Option<&'static str> {
    let mesh = out.join(name);
    let whole = fs::read(&mesh).unwrap();
    let (other, other_bytes) = mesh_of(&mesh_specification(1, 2.0));
    assert_ne!(other, name);
    fs::remove_file(&mesh).unwrap();
    Some(match number {
        0 => "cannot be read",
        1 => {
            fs::write(out.join("mesh.obj"), whole).unwrap();
            "cannot be read"
        }
        2 => {
            fs::write(out.join(other), whole).unwrap();
            "cannot be read"
        }
        3 => {
            fs::write(&mesh, other_bytes).unwrap();
            "changed or damaged"
        }
        4 => {
            let mut changed = whole;
            changed[3] ^= 1;
            fs::write(&mesh, changed).unwrap();
            "changed or damaged"
        }
        5 => {
            fs::write(&mesh, [&*whole, b"\n"].concat()).unwrap();
            "changed or damaged"
        }
        6 => {
            fs::write(&mesh, b"").unwrap();
            "changed or damaged"
        }
        7 => {
            fs::create_dir(&mesh).unwrap();
            "is not a file"
        }
        8 => {
            // The right bytes, in a place that is none of this export's.
            let outside = out.with_extension("outside");
            fs::write(&outside, whole).unwrap();
            symlink(outside, &mesh).unwrap();
            "is not in the specification's folder"
        }
        9 => {
            symlink("/dev/zero", &mesh).unwrap();
            "is not in the specification's folder"
        }
        10 => {
            let file = fs::File::create(&mesh).unwrap();
            file.set_len(1 << 40).unwrap();
            "bytes: simplify"
        }
        _ => return None,
    })
}

#[test]
fn an_export_whose_mesh_is_missing_or_another_is_refused_and_makes_no_store() {
    let (_folder, store) = store_of(1.0);
    let (name, _) = mesh_of(store.specification());
    let scratch = tempfile::tempdir().unwrap();
    for number in 0.. {
        let out = scratch.path().join(format!("out-{number}"));
        leave(&store, &options(LAYOUTS[2]), &out);
        let Some(word) = spoil(&out, &name, number) else {
            assert_eq!(number, 11);
            break;
        };
        let path = scratch.path().join(format!("store-{number}"));
        let refused = take_in(&out, &path).unwrap_err();
        assert!(matches!(refused, ImportError::Mesh { .. }), "{refused}");
        let said = refused.to_string();
        for part in [word, &name, "put back this file", "--spec"] {
            assert!(said.contains(part), "{number}: {said}");
        }
        assert_eq!(said.lines().count(), 1, "{said}");
        assert!(!path.exists(), "{number}");
        // Nor is the specification read without it, and the sentence says what to do.
        let refused = Specification::load(&out.join("specification.toml")).unwrap_err();
        let said = refused.to_string();
        for part in [word, &*format!("put back {name}")] {
            assert!(said.contains(part), "{number}: {said}");
        }
        // Who has the mesh from elsewhere can import.
        let source = Source::Folder(out.clone());
        let manifest = out.join("manifest.parquet");
        let specification = store.specification();
        import(
            specification,
            &manifest,
            &source,
            &path,
            None,
            1,
            &|_, _| (),
        )
        .unwrap();
        assert_eq!(ReadOnlyStore::open(&path).unwrap().materials_missing(), 0);
    }
}

#[test]
fn a_specification_whose_mesh_is_elsewhere_is_refused() {
    let (_folder, store) = store_of(1.0);
    let (name, bytes) = mesh_of(store.specification());
    let scratch = tempfile::tempdir().unwrap();
    let out = scratch.path().join("out");
    leave(&store, &options(LAYOUTS[0]), &out);
    fs::write(scratch.path().join(&name), &bytes).unwrap();
    let path = out.join("specification.toml");
    let text = fs::read_to_string(&path).unwrap();
    let digest = name.strip_suffix(".mesh").unwrap();
    let absolute = scratch.path().join(&name).display().to_string();
    for elsewhere in [&*format!("../{name}"), &absolute, "..", ""] {
        fs::write(&path, text.replace(digest, elsewhere)).unwrap();
        let said = Specification::load(&path).unwrap_err().to_string();
        assert!(
            said.contains("not in the specification's folder"),
            "{elsewhere}: {said}"
        );
    }
    // The specification in a Parquet manifest has a digest or is none.
    let manifest = out.join("manifest.parquet");
    let forged = fs::read(&manifest).unwrap();
    let forged = replaced(&forged, digest, &format!("../{}", &digest[3..]));
    fs::write(&manifest, forged).unwrap();
    let store = scratch.path().join("store");
    let refused = take_in(&out, &store).unwrap_err();
    assert!(matches!(refused, ImportError::Manifest(_)), "{refused}");
    assert!(!store.exists());
}

/// The bytes with every occurrence of a text replaced by one of the same length.
fn replaced(bytes: &[u8], text: &str, by: &str) -> Vec<u8> {
    assert_eq!(text.len(), by.len());
    let mut bytes = bytes.to_vec();
    let places: Vec<usize> = (0..bytes.len() - text.len())
        .filter(|&place| bytes[place..].starts_with(text.as_bytes()))
        .collect();
    assert!(!places.is_empty());
    for place in places {
        bytes[place..place + by.len()].copy_from_slice(by.as_bytes());
    }
    bytes
}

#[test]
fn an_export_that_lost_its_mesh_or_was_killed_ends_the_same() {
    let (_folder, store) = store_of(1.0);
    let (name, bytes) = mesh_of(store.specification());
    for layout in LAYOUTS {
        let place = tempfile::tempdir_in(store.name().folder().unwrap()).unwrap();
        let out = place.path().join("out");
        leave(&store, &options(layout), &out);
        let expected = files(&out);
        for damage in [None, Some(&bytes[1..]), Some(&b""[..])] {
            fs::remove_file(out.join(&name)).unwrap();
            fs::write(out.join(format!("{name}.new")), &bytes[..9]).unwrap();
            if let Some(damage) = damage {
                fs::write(out.join(&name), damage).unwrap();
            }
            leave(&store, &options(layout), &out);
            assert!(files(&out) == expected, "{layout:?}");
        }
    }
}

#[test]
fn an_export_of_another_mesh_is_replaced_with_its_mesh() {
    let (_folder, store) = store_of(1.0);
    let (_other_folder, other) = store_of(2.0);
    let place = tempfile::tempdir().unwrap();
    let (out, fresh) = (place.path().join("out"), place.path().join("fresh"));
    let mut wanted = options(LAYOUTS[2]);
    leave(&store, &wanted, &out);
    let (name, bytes) = mesh_of(store.specification());
    fs::write(out.join(format!("{name}.new")), bytes).unwrap();
    // A mesh that no export wrote is a stranger's.
    fs::write(out.join("cloth.mesh"), b"mine").unwrap();
    wanted.overwrite = true;
    let refused = export_layout(&other, &wanted, b"a picture", &out, &|_| ()).unwrap_err();
    assert!(refused.to_string().contains("cloth.mesh"), "{refused}");
    fs::remove_file(out.join("cloth.mesh")).unwrap();
    leave(&other, &wanted, &out);
    leave(&other, &wanted, &fresh);
    let names = |folder: &Path| -> Vec<_> {
        let files = files(folder).into_iter();
        files
            .map(|(path, bytes)| (path.file_name().unwrap().to_owned(), bytes))
            .collect()
    };
    assert!(names(&out) == names(&fresh));
}

#[test]
fn rows_name_the_mesh_and_count_its_triangles() {
    let (folder, store) = store_of(1.0);
    let (name, _) = mesh_of(store.specification());
    let digest = name.strip_suffix(".mesh").unwrap();
    for format in Format::ALL {
        let path = folder.path().join(format!("out.{}", format.ending()));
        export(&store, format, false, &path).unwrap();
        read::<ReadError>(&path, |_, row| {
            let value = |name: &str| row.value(name).cloned();
            assert_eq!(value("sample_shape"), Some(Value::Text("mesh".to_owned())));
            assert_eq!(value("sample_triangles"), Some(Value::U32(4)));
            assert_eq!(value("sample_mesh"), Some(Value::Text(digest.to_owned())));
            Ok(())
        })
        .unwrap();
        assert_eq!(check_manifest(&store, &path).unwrap(), []);
    }
    // A row that lies of either is none of the store's.
    let csv = folder.path().join("out.csv");
    let whole = fs::read_to_string(&csv).unwrap();
    let other = mesh_of(&mesh_specification(1, 2.0)).0;
    for (column, lie) in [
        ("sample_triangles", format!(",mesh,5,{digest}")),
        ("sample_triangles", format!(",mesh,0,{digest}")),
        ("sample_mesh", ",mesh,4,none".to_owned()),
        (
            "sample_mesh",
            format!(",mesh,4,{}", other.strip_suffix(".mesh").unwrap()),
        ),
    ] {
        let truth = format!(",mesh,4,{digest}");
        fs::write(&csv, whole.replacen(&truth, &lie, 1)).unwrap();
        let faults = check_manifest(&store, &csv).unwrap();
        let columns: Vec<_> = faults.iter().map(|fault| fault.column).collect();
        assert_eq!(columns, [Some(column)]);
        let source = Source::Folder(folder.path().to_owned());
        let new = folder.path().join("new");
        let refused = import(
            store.specification(),
            &csv,
            &source,
            &new,
            None,
            1,
            &|_, _| (),
        );
        let refused = refused.unwrap_err().to_string();
        assert!(refused.contains(&format!("{column} is")), "{refused}");
    }
}

/// Who reads images and no sample needs no mesh: what is not known is no difference.
#[test]
fn images_are_read_beside_no_mesh() {
    let (_folder, store) = store_of(1.0);
    let scratch = tempfile::tempdir().unwrap();
    let out = scratch.path().join("out");
    leave(&store, &options(LAYOUTS[3]), &out);
    fs::remove_file(out.join(mesh_of(store.specification()).0)).unwrap();
    let manifest = out.join("manifest.parquet");
    let named = read_specification(&manifest).unwrap();
    assert!(named.sample.loaded_mesh().is_none());
    let mut materials = 0;
    read_images(&named, &manifest, &Source::Folder(out), &mut |_, images| {
        materials += 1;
        assert_eq!(images.len(), 3);
        Ok(())
    })
    .unwrap();
    assert_eq!(materials, MATERIALS);
}

/// An import heals a store that lost its mesh, as its export has it.
#[test]
fn an_import_puts_back_the_mesh_of_its_store() {
    let (folder, store) = store_of(1.0);
    let (name, bytes) = mesh_of(store.specification());
    let scratch = tempfile::tempdir().unwrap();
    leave(&store, &options(LAYOUTS[0]), scratch.path());
    fs::remove_file(folder.path().join(&name)).unwrap();
    assert!(Store::open(folder.path()).is_err());
    let imported = take_in(scratch.path(), folder.path()).unwrap();
    assert_eq!((imported.materials, imported.materials_there), (0, 6));
    assert_eq!(fs::read(folder.path().join(name)).unwrap(), bytes);
}

#[test]
fn what_is_no_mesh_says_so_in_every_row() {
    let row = |name: &str| columns().iter().find(|column| column.name == name).unwrap();
    assert_eq!(row("sample_triangles").kind, Kind::U32);
    let preset = Specification::preset();
    let (done, _) = completion(&crate::cheap_image::small_specification(1), 0);
    let sampled = preset.material(0);
    let row = dataset::manifest::Row::new(&preset, preset.hash(), &sampled, 0, &done.views[0]);
    assert_eq!(row.value("sample_triangles"), Some(&Value::U32(0)));
    let none = Value::Text("none".to_owned());
    assert_eq!(row.value("sample_mesh"), Some(&none));
}

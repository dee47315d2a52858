//! Stores whose sample is a mesh: its file is beside their identity.

use crate::{
    cheap_image::small_specification, cheap_renderer::checks, complete_store::make_store,
    mesh_specification::mesh_specification,
};
use dataset::{Digest, Specification};
use datastore::{
    BlobsPlace, ReadOnlyStore, SharedStore, SharedStoreError, Store, StoreError, StoreName,
    WritableStore, garbage, verify::verify,
};
use jobstore_postgres::testing::{fresh_schema, run};
use std::{
    fs,
    path::{Path, PathBuf},
};

fn mesh_path(store: &Path, specification: &Specification) -> PathBuf {
    store.join(specification.sample.mesh.as_ref().unwrap().file_name())
}

fn bytes(specification: &Specification) -> &[u8] {
    specification.sample.loaded_mesh().unwrap().bytes()
}

/// The same without the mesh, as who asks for more has it.
fn named(specification: &Specification) -> Specification {
    Specification::from_json(&specification.to_json()).unwrap()
}

/// What opening a store says, in each of the ways to do that.
fn refusals(store: &Path, specification: &Specification) -> Vec<String> {
    let errors = [
        Store::open(store).err(),
        Store::open_or_create(store, &named(specification)).err(),
        Store::kept_specification(store).err(),
        ReadOnlyStore::open(store).err(),
        WritableStore::open(store).err(),
    ];
    let told = errors.map(|error| error.unwrap().to_string());
    told.into()
}

#[test]
fn a_store_gives_its_mesh_back() {
    let folder = tempfile::tempdir().unwrap();
    let specification = mesh_specification(4, 1.0);
    make_store(folder.path(), &specification, 0..4);
    let path = mesh_path(folder.path(), &specification);
    assert_eq!(fs::read(&path).unwrap(), bytes(&specification));

    // Whoever asks for more need not have the mesh.
    let mut named = named(&specification);
    named.materials = 5;
    let grown = Store::open_or_create(folder.path(), &named).unwrap();
    assert_eq!(grown.specification().materials, 5);
    assert_eq!(bytes(grown.specification()), bytes(&specification));
    drop(grown);
    let opened = Store::open(folder.path()).unwrap();
    assert_eq!(bytes(opened.specification()), bytes(&specification));
    drop(opened);
    let kept = Store::kept_specification(folder.path()).unwrap().unwrap();
    assert_eq!(bytes(&kept), bytes(&specification));
    let store = ReadOnlyStore::open(folder.path()).unwrap();
    assert_eq!(bytes(store.specification()), bytes(&specification));

    // Checks and cleaning leave it alone.
    let report = verify(&store, &checks(4, None), &|_| ()).unwrap();
    assert_eq!((report.faults, report.images_sound), (vec![], 12));
    assert_eq!(garbage::unnamed(&store).unwrap(), []);
    let mut store = WritableStore::open(folder.path()).unwrap();
    assert_eq!(garbage::remove_unnamed(&mut store).unwrap(), []);
    assert_eq!(fs::read(&path).unwrap(), bytes(&specification));
}

#[test]
fn a_missing_or_damaged_mesh_is_named_and_can_be_put_back() {
    let folder = tempfile::tempdir().unwrap();
    let specification = mesh_specification(2, 1.0);
    make_store(folder.path(), &specification, 0..2);
    let path = mesh_path(folder.path(), &specification);
    let whole = fs::read(&path).unwrap();
    let digest = Digest::of(&whole).to_string();
    let expect = |part: &str| {
        for error in refusals(folder.path(), &specification) {
            assert!(error.contains(part), "{error}");
            for remedy in [&*format!("put back the file {digest}.mesh"), "run --spec"] {
                assert!(error.contains(remedy), "{error}");
            }
            assert_eq!(error.lines().count(), 1, "{error}");
        }
    };
    fs::remove_file(&path).unwrap();
    expect("cannot be read");
    for damage in [&whole[1..], b"", b"f 1 2 3\n"] {
        fs::write(&path, damage).unwrap();
        expect("changed or damaged");
    }
    fs::remove_file(&path).unwrap();
    fs::create_dir(&path).unwrap();
    expect("is not a file");
    fs::remove_dir(&path).unwrap();
    let large = fs::File::create(&path).unwrap();
    large.set_len(1 << 40).unwrap();
    expect("bytes: simplify");
    fs::write(&path, whole).unwrap();
    Store::open(folder.path()).unwrap();
}

#[test]
fn who_gives_the_mesh_again_heals_the_store() {
    let folder = tempfile::tempdir().unwrap();
    let specification = mesh_specification(2, 1.0);
    make_store(folder.path(), &specification, 0..2);
    let path = mesh_path(folder.path(), &specification);
    let whole = fs::read(&path).unwrap();
    for damage in [None, Some(&whole[1..]), Some(b"f 1 2 3\n".as_slice())] {
        match damage {
            None => fs::remove_file(&path).unwrap(),
            Some(bytes) => fs::write(&path, bytes).unwrap(),
        }
        // Another dataset's mesh is none of this one's.
        let other = Store::open_or_create(folder.path(), &mesh_specification(2, 2.0));
        let other = other.err().unwrap();
        assert!(matches!(other, StoreError::Specification { .. }), "{other}");
        let healed = Store::open_or_create(folder.path(), &specification).unwrap();
        assert_eq!(bytes(healed.specification()), whole);
        drop(healed);
        assert_eq!(fs::read(&path).unwrap(), whole);
        let store = ReadOnlyStore::open(folder.path()).unwrap();
        let report = verify(&store, &checks(2, None), &|_| ()).unwrap();
        assert_eq!((report.faults, report.images_sound), (vec![], 6));
    }
}

#[test]
fn another_mesh_is_another_dataset() {
    let folder = tempfile::tempdir().unwrap();
    let specification = mesh_specification(2, 1.0);
    make_store(folder.path(), &specification, 0..2);
    for other in [mesh_specification(2, 2.0), small_specification(2)] {
        let error = Store::open_or_create(folder.path(), &other).err().unwrap();
        let StoreError::Specification { differences, .. } = &error else {
            panic!("{error}");
        };
        assert!(differences.to_string().contains("sample"), "{error}");
        assert_eq!(
            fs::read_dir(folder.path()).unwrap().count(),
            8,
            "no more files"
        );
    }
}

#[test]
fn a_store_cannot_be_made_for_a_mesh_that_nobody_gave() {
    let folder = tempfile::tempdir().unwrap();
    let specification = mesh_specification(2, 1.0);
    let named = named(&specification);
    let error = Store::open_or_create(folder.path(), &named).err().unwrap();
    assert!(matches!(error, StoreError::MeshNotLoaded(_)), "{error}");
    assert!(matches!(
        ReadOnlyStore::open(folder.path()).err().unwrap(),
        StoreError::Absent(_)
    ));
    Store::open_or_create(folder.path(), &specification).unwrap();
}

/// A making that is killed leaves the mesh before anything names it, and can be done again.
#[test]
fn a_making_that_was_killed_is_made_again() {
    let specification = mesh_specification(2, 1.0);
    let made = tempfile::tempdir().unwrap();
    drop(Store::open_or_create(made.path(), &specification).unwrap());
    let mesh = mesh_path(made.path(), &specification);
    let name = mesh.file_name().unwrap().to_str().unwrap().to_owned();
    let torn = format!("{name}.new");
    // In the order in which they are written.
    for left in [
        vec![(torn.as_str(), &bytes(&specification)[..7])],
        vec![(name.as_str(), bytes(&specification))],
        vec![
            (name.as_str(), bytes(&specification)),
            ("store.json", b"{}"),
        ],
        vec![(name.as_str(), b"torn by somebody else")],
    ] {
        let folder = tempfile::tempdir().unwrap();
        for (name, bytes) in left {
            fs::write(folder.path().join(name), bytes).unwrap();
        }
        assert!(matches!(Store::kept_specification(folder.path()), Ok(None)));
        let store = Store::open_or_create(folder.path(), &specification).unwrap();
        assert_eq!(bytes(store.specification()), bytes(&specification));
        let path = mesh_path(folder.path(), &specification);
        assert_eq!(fs::read(path).unwrap(), bytes(&specification));
    }
    // The specification, which makes the folder a store, comes after the mesh.
    let time = |path: &Path| fs::metadata(path).unwrap().modified().unwrap();
    assert!(time(&mesh) <= time(&made.path().join("store.json")));
    assert!(time(&mesh) <= time(&made.path().join("specification.json")));
}

#[tokio::test]
async fn a_shared_store_gives_its_mesh_back() {
    let url = fresh_schema().await;
    let images = tempfile::tempdir().unwrap();
    let place = BlobsPlace::Folder(images.path().to_owned());
    let specification = mesh_specification(2, 1.0);
    let mut named = named(&specification);
    let error = SharedStore::open_or_create(&url, &named, Some(&place)).await;
    let error = error.err().unwrap();
    assert!(
        matches!(error, SharedStoreError::MeshNotLoaded(_)),
        "{error}"
    );
    assert!(
        SharedStore::kept_specification(&url)
            .await
            .unwrap()
            .is_none()
    );

    let store = SharedStore::open_or_create(&url, &specification, Some(&place)).await;
    assert_eq!(bytes(store.unwrap().specification()), bytes(&specification));
    named.materials = 3;
    let grown = SharedStore::open_or_create(&url, &named, None).await;
    let grown = grown.unwrap();
    assert_eq!(grown.specification().materials, 3);
    assert_eq!(bytes(grown.specification()), bytes(&specification));
    let opened = SharedStore::open(&url).await.unwrap();
    assert_eq!(bytes(opened.specification()), bytes(&specification));
    let kept = SharedStore::kept_specification(&url).await.unwrap();
    assert_eq!(bytes(&kept.unwrap()), bytes(&specification));
    let read = url.clone();
    let read = tokio::task::spawn_blocking(move || ReadOnlyStore::open(StoreName::Database(read)));
    let read = read.await.unwrap().unwrap();
    assert_eq!(bytes(read.specification()), bytes(&specification));

    let other = mesh_specification(2, 2.0);
    let error = SharedStore::open_or_create(&url, &other, None).await;
    let error = error.err().unwrap();
    assert!(
        matches!(error, SharedStoreError::Specification { .. }),
        "{error}"
    );
}

#[tokio::test]
async fn a_missing_or_damaged_mesh_of_a_shared_store_is_named() {
    let url = fresh_schema().await;
    let images = tempfile::tempdir().unwrap();
    let place = BlobsPlace::Folder(images.path().to_owned());
    let specification = mesh_specification(2, 1.0);
    drop(SharedStore::open_or_create(&url, &specification, Some(&place)).await);
    for (damage, part) in [
        (
            "UPDATE meshes SET bytes = 'v 0 0 0'",
            "is damaged: its bytes have the digest",
        ),
        ("DELETE FROM meshes", "is missing"),
    ] {
        run(&url, damage).await;
        let errors = [
            SharedStore::open(&url).await.err(),
            SharedStore::open_or_create(&url, &named(&specification), None)
                .await
                .err(),
            SharedStore::kept_specification(&url).await.err(),
        ];
        for error in errors {
            let error = error.unwrap();
            assert!(matches!(error, SharedStoreError::Mesh { .. }), "{error}");
            let told = error.to_string();
            assert!(
                told.contains(part) && told.contains("restore the table meshes"),
                "{told}"
            );
        }
        // Who gives the mesh again heals the store.
        let healed = SharedStore::open_or_create(&url, &specification, None).await;
        assert_eq!(
            bytes(healed.unwrap().specification()),
            bytes(&specification)
        );
        let opened = SharedStore::open(&url).await.unwrap();
        assert_eq!(bytes(opened.specification()), bytes(&specification));
    }
}

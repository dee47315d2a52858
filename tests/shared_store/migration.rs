//! Copies there and back.

use crate::cheap_image::small_specification;
use crate::contents::{self, COMPLETE, MATERIALS};
use crate::place::Place;
use crate::s3::Server;
use serde_json::Value;
use std::fs;

const IMAGES: u32 = 3 * COMPLETE;

fn manifest(place: &Place, store: &str) -> Vec<u8> {
    place.succeed(&format!(
        "dataset manifest export --store {store} --format csv --out m.csv --partial"
    ));
    fs::read(place.path().join("m.csv")).expect("a manifest")
}

#[test]
fn a_store_goes_into_a_database_and_a_bucket_and_comes_back_the_same() {
    let mut place = Place::new(MATERIALS);
    let server = Server::start(&place.path().join("s3"));
    place.environment = server.environment();
    let expected = contents::make(&place.path().join("first"));
    let labels = manifest(&place, "first");

    let database = place.database();
    let said = place.succeed(&format!(
        "store migrate first {database} --blobs images --json"
    ));
    let said: Value = serde_json::from_str(&said).expect("JSON");
    let told = ["images", "images_written", "materials", "jobs", "workers"].map(|what| &said[what]);
    let counts = [IMAGES, IMAGES, COMPLETE, MATERIALS - 1, 3].map(Value::from);
    assert_eq!(told, counts.each_ref());
    assert!(manifest(&place, &database) == labels);
    let stages = "SELECT count(*) FROM (SELECT sum(pending), sum(leased), sum(completed), \
                  sum(disputed), sum(set_aside), sum(cancelled), sum(checks) FROM tallies) AS sums \
                  (pending, leased, completed, disputed, set_aside, cancelled, checks) \
                  WHERE (pending, leased, completed, disputed, set_aside, cancelled, checks) \
                      = (3, 0, 34, 1, 1, 1, 2)";
    assert_eq!(place.number(&database, stages), 1);
    let ends = "SELECT count(*) FROM workers WHERE bar_ends_ms > now_ms()";
    assert_eq!(place.number(&database, ends), 1, "one bar over failures");
    // Copies are stores like any other.
    let specification = small_specification(MATERIALS).to_toml();
    fs::write(place.path().join("spec.toml"), specification).expect("written");
    let (coordinator, url) = place.coordinator(&database, "");
    // Its exit code tells of what was quarantined.
    let status = place.run(&format!("status --json --coordinator {url}"));
    let status: Value = serde_json::from_slice(&status.stdout).expect("JSON");
    assert_eq!(status["mode"], "paused", "{status:#}");
    coordinator.kill();

    place.succeed(&format!("store migrate {database} second"));
    assert_eq!(contents::read(&place, "second"), expected);
    assert!(!place.path().join("second/migration.json").exists());

    // Into a bucket, from there into another under a database, and back.
    place.succeed("store migrate second third --blobs s3://farm/third");
    assert_eq!(server.objects("third/blobs").len(), IMAGES as usize);
    assert_eq!(contents::read(&place, "third"), expected);
    let other = place.database();
    place.succeed(&format!(
        "store migrate third {other} --blobs s3://farm/fourth"
    ));
    assert!(manifest(&place, &other) == labels);
    let last = place.database();
    place.succeed(&format!("store migrate {other} {last} --blobs last"));
    let said = place.succeed(&format!("store migrate {last} fifth"));
    assert!(said.contains("105 images of 35 materials"), "{said}");
    assert_eq!(contents::read(&place, "fifth"), expected);
    // The source is as it was, but for what opening it does.
    assert!(manifest(&place, "first") == labels);
}

/// Every command that opens a store says that this one is an unfinished copy, and how to end it.
fn expect_unfinished(place: &Place, target: &str) {
    for command in [
        "dataset verify --store",
        "dataset gc --delete --store",
        "run --spec spec.toml --store",
        "coordinator serve --spec spec.toml --store",
        "store migrate --blobs s3://farm/x",
    ] {
        let more = if command.starts_with("store") {
            "elsewhere"
        } else {
            ""
        };
        let said = place.refuse(&format!("{command} {target} {more}"), 2);
        assert!(said.contains("is an unfinished copy"), "{command}: {said}");
        assert!(
            said.contains("`brdfarm store migrate /"),
            "{command}: {said}"
        );
    }
}

#[test]
fn what_is_half_of_a_copy_is_refused_until_the_same_command_ends_it() {
    let place = Place::new(MATERIALS);
    let expected = contents::make(&place.path().join("first"));
    contents::make(&place.path().join("other"));
    let mut other = datastore::Store::open(&place.path().join("other")).expect("a store");
    let changed = other.completion_in_ledger(3).expect("read");
    let mut changed = changed.expect("complete");
    changed.seconds += 1.0;
    other.put(&[changed], &[]).expect("put");
    drop(other);
    let store = datastore::ReadOnlyStore::open(&place.path().join("first")).expect("a store");
    let late = store.completion(COMPLETE - 1).expect("read");
    let late = late.expect("complete").views[1].digest;
    let image = place.path().join("first").join(dataset::blob_path(&late));
    let bytes = fs::read(&image).expect("an image");
    let database = place.database();

    for (target, options, blobs) in [
        ("copy", "", "copy"),
        (&database, "--blobs images", "images"),
    ] {
        let migrate = format!("store migrate first {target} {options}");
        fs::write(&image, &bytes[1..]).expect("written");
        let said = place.refuse(&migrate, 1);
        assert!(
            said.contains("material 34, view 1") && said.contains("it has fewer than its"),
            "{said}"
        );
        expect_unfinished(&place, target);
        let said = place.refuse(&format!("store migrate other {target} {options}"), 2);
        assert!(said.contains("choose another target"), "{said}");
        fs::write(&image, &bytes).expect("written");
        // What the copy has of it already may be something else.
        let planted = place.path().join(blobs).join(dataset::blob_path(&late));
        fs::create_dir_all(planted.parent().expect("a folder")).expect("made");
        fs::write(planted, vec![7; bytes.len()]).expect("written");
        let said = place.succeed(&format!("{migrate} --json"));
        let said: Value = serde_json::from_str(&said).expect("JSON");
        assert_eq!(said["images"], IMAGES);
        let written = said["images_written"].as_u64().expect("a number");
        assert!((1..u64::from(IMAGES) / 2).contains(&written), "{written}");
        // Whoever does not know that it ended is told so; another store stays out.
        let said = place.succeed(&migrate);
        assert!(
            said.contains("105 images") && said.contains(" 0.0 MB"),
            "{said}"
        );
        let said = place.refuse(&format!("store migrate other {target} {options}"), 2);
        assert!(said.contains("is already a store"), "{said}");
    }
    assert_eq!(contents::read(&place, "copy"), expected);
    place.succeed(&format!("store migrate {database} back"));
    assert_eq!(contents::read(&place, "back"), expected);
}

#[test]
fn a_store_that_somebody_is_at_work_on_is_not_copied() {
    let place = Place::new(2);
    let said = place.refuse("store migrate nowhere copy", 2);
    assert!(said.contains("there is no store"), "{said}");
    contents::make(&place.path().join("first"));
    let said = place.refuse("store migrate first ./first", 2);
    assert!(said.contains("a copy of itself"), "{said}");
    let (coordinator, _) = place.coordinator("folder", "");
    let said = place.refuse("store migrate folder copy", 1);
    assert!(said.contains("folder is in use by process"), "{said}");
    coordinator.kill();

    let database = place.database();
    let (coordinator, url) = place.coordinator(&database, "--blobs images");
    let copy = format!("store migrate {database} copy");
    let said = place.refuse(&format!("store migrate {database} {database}"), 2);
    assert!(said.contains("a copy of itself"), "{said}");
    let admitted = "INSERT INTO sessions VALUES ('w', 'w', now_ms())";
    place.sql(&database, admitted);
    let said = place.refuse(&copy, 1);
    assert!(said.contains("workers heard of lately: 1"), "{said}");
    place.sql(&database, "DELETE FROM sessions");
    let another = place.database();
    let said = place.refuse(
        &format!("store migrate {database} {another} --blobs images"),
        2,
    );
    assert!(said.contains("need a place of their own"), "{said}");
    // A coordinator that has nothing to do is made to wait.
    place.succeed(&copy);
    place.work(&url, "w");
    coordinator.kill();
    assert!(!place.path().join("copy/migration.json").exists());
}

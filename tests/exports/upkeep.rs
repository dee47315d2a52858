//! `verify`, `repair` and `gc` on a store of real images.

use crate::cheap_image::Cheap;
use crate::small::rendered;
use crate::workplace::Workplace;
use dataset::{Digest, Specification};
use datastore::{ReadOnlyStore, Store};
use serde_json::{Value, json};
use std::fs;
use std::path::{Path, PathBuf};

fn report(place: &Workplace) -> Value {
    serde_json::from_slice(&fs::read(place.path().join("report.json")).unwrap()).unwrap()
}

fn manifest(place: &Workplace) -> Vec<u8> {
    place.succeed("dataset manifest export --format jsonl --out manifest.jsonl");
    fs::read(place.path().join("manifest.jsonl")).unwrap()
}

fn image(place: &Workplace, material: u32, view: usize) -> PathBuf {
    let store = ReadOnlyStore::open(&place.path().join("store")).unwrap();
    let completion = store.completion(material).unwrap().unwrap();
    store.image_path(&completion.views[view].digest)
}

fn change(path: &Path, change: impl FnOnce(&mut Vec<u8>)) {
    let mut bytes = fs::read(path).unwrap();
    change(&mut bytes);
    fs::write(path, bytes).unwrap();
}

/// A black image that says what the one of a material's view says.
fn black(specification: &Specification, material: u32, view: u32) -> Vec<u8> {
    let mut image = Cheap::new(specification, material, view);
    image.value = 0.0;
    image.encode()
}

/// Records a black image as the view of a material: a lie with a valid digest.
fn blacken(place: &Workplace, material: u32, view: u32) {
    let mut store = Store::open(&place.path().join("store")).unwrap();
    let mut completion = store.completion_in_ledger(material).unwrap().unwrap();
    let bytes = black(store.specification(), material, view);
    completion.views[view as usize].digest = Digest::of(&bytes);
    completion.views[view as usize].bytes = bytes.len() as u64;
    store
        .put(&[completion], &[(Digest::of(&bytes), bytes)])
        .unwrap();
}

#[test]
fn faults_are_reported_for_machines_and_repaired_to_the_digests_of_before() {
    let place = rendered(3);
    let before = manifest(&place);
    fs::remove_file(image(&place, 0, 4)).unwrap();
    change(&image(&place, 1, 7), |bytes| {
        bytes.truncate(bytes.len() - 100)
    });
    change(&image(&place, 2, 13), |bytes| bytes[600] ^= 1);
    // A view that sees the chart is never black, whatever the material; one without it is not
    // where a rough sample is lit.
    blacken(&place, 2, 5);
    blacken(&place, 1, 12);

    let found = place.run("dataset verify --report report.json");
    assert_eq!(found.status.code(), Some(1));
    let report_before = report(&place);
    assert_eq!(report_before["sound"], json!(false));
    assert_eq!(report_before["images_sound"], json!(3 * 14 - 5));
    assert_eq!(report_before["unnamed_count"], json!(2));
    let faults: Vec<_> = report_before["faults"]
        .as_array()
        .unwrap()
        .iter()
        .map(|fault| {
            (
                fault["material"].clone(),
                fault["view"].clone(),
                fault["kind"].clone(),
            )
        })
        .collect();
    let expected = [
        (0, 4, "missing"),
        (1, 7, "size"),
        (1, 12, "black"),
        (2, 5, "black"),
        (2, 13, "digest"),
    ];
    assert_eq!(
        faults,
        expected.map(|(m, v, kind)| (json!(m), json!(v), json!(kind)))
    );

    let said = place.succeed("dataset repair --report report.json");
    assert!(said.contains("mended 5 faults"), "{said}");
    assert_eq!(report(&place).as_array().map(Vec::len), Some(5));
    assert!(manifest(&place) == before);
    place.succeed("dataset verify --rerender 100% --report report.json --manifest manifest.jsonl");
    assert_eq!(report(&place)["images_rerendered"], json!(42));
    assert_eq!(report(&place)["sound"], json!(true));
    let said = place.succeed("dataset repair");
    assert!(said.contains("nothing to do"), "{said}");

    // What the lies left behind goes, and only when asked for.
    let stray = report_before["unnamed"][0].as_str().unwrap().to_owned();
    let dry = place.succeed("dataset gc");
    assert!(dry.contains("--delete would remove 2 images"), "{dry}");
    assert!(!dry.contains(&stray), "the image of before is named again");
    let removed = place.succeed("dataset gc --delete");
    assert!(removed.contains("removed 2 images"), "{removed}");
    place.succeed("dataset verify");
}

#[test]
fn a_manifest_edited_by_hand_is_named_and_other_stores_are_compared() {
    let place = rendered(2);
    let edited = String::from_utf8(manifest(&place)).unwrap().replacen(
        "\"tint\":\"hue\"",
        "\"tint\":\"product\"",
        1,
    );
    fs::write(place.path().join("edited.jsonl"), edited).unwrap();
    let found = place.run("dataset verify --manifest edited.jsonl");
    assert_eq!(found.status.code(), Some(1));
    let said = String::from_utf8_lossy(&found.stdout);
    assert!(
        said.contains("row 1, material 0, view 0: tint is product, and has to be hue"),
        "{said}"
    );

    place.succeed("dataset diff store manifest.jsonl");
    let found = place.run("dataset diff manifest.jsonl edited.jsonl");
    assert_eq!(found.status.code(), Some(1));
    let said = String::from_utf8_lossy(&found.stdout);
    assert!(said.contains("1 row differ first in tint"), "{said}");

    let said = place.succeed("dataset stats --pixels");
    assert!(said.contains("2 of 2 complete"), "{said}");
    let json: Value = serde_json::from_str(&place.succeed("dataset stats --json")).unwrap();
    assert_eq!(json["views"].as_array().map(Vec::len), Some(14));
    assert_eq!(json["images"], json!(28));
}

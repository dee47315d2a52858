//! A dataset whose sample is a mesh, from the run to the export, to strangers' loaders, and back.

use crate::killed::contents;
use crate::readers::python;
use crate::workplace::Workplace;
use std::fs;

/// Small images of a small mesh, so that all of them take seconds. Some of the materials are so smooth that
/// black images state next to no error: all readers have to take what they state.
const SPECIFICATION: &str = r#"
name = "roofs"
materials = 6
[image]
width = 16
height = 16
[accuracy]
absolute = 0.02
relative = 0.2
[sample]
shape = "mesh"
mesh = "shapes/roof.obj"
[[views]]
camera_elevation_deg = 90
[[views]]
camera_elevation_deg = 60
light_elevation_deg = 50
checker = true
"#;

/// A roof and the valley beside it: three sheets that shade and light each other.
const ROOF: &str = "v -1 -1 0\nv 0 -1 0.6\nv 1 -1 0\nv 2 -1 0.6\nv -1 1 0\nv 0 1 0.6\nv 1 1 0\nv 2 1 0.6\n\
     f 1 2 6 5\nf 2 3 7 6\nf 3 4 8\nf 3 8 7\n";

/// What mlcroissant misses where it is not said.
const PUBLICATION: &str =
    "--licence cc-by-4.0 --creator nobody --url https://example.org --published 2026-01-31";

/// A folder with a store of a mesh, and the name of the mesh's file.
fn rendered() -> (Workplace, String) {
    let place = Workplace::empty();
    fs::create_dir(place.path().join("shapes")).unwrap();
    fs::write(place.path().join("shapes/roof.obj"), ROOF).unwrap();
    fs::write(place.path().join("spec.toml"), SPECIFICATION).unwrap();
    place.succeed("run --spec spec.toml");
    let mesh = dataset::Digest::of(ROOF.as_bytes());
    (place, format!("{mesh}.mesh"))
}

fn manifests(place: &Workplace, store: &str) -> [Vec<u8>; 3] {
    ["parquet", "csv", "jsonl"].map(|format| {
        place.succeed(&format!(
            "dataset manifest export --store {store} --format {format} --out manifest.{format}"
        ));
        fs::read(place.path().join(format!("manifest.{format}"))).unwrap()
    })
}

/// What a command says that ends with this exit code.
fn refused(place: &Workplace, arguments: &str, code: i32) -> String {
    let output = place.run(arguments);
    assert_eq!(output.status.code(), Some(code), "{arguments}");
    String::from_utf8(output.stderr).unwrap()
}

#[test]
fn a_mesh_leaves_in_every_layout_is_read_by_strangers_and_comes_back() {
    let (place, mesh) = rendered();
    assert_eq!(
        fs::read(place.path().join("store").join(&mesh)).unwrap(),
        ROOF.as_bytes()
    );
    let before = manifests(&place, "store");
    let layouts = ["files", "webdataset", "huggingface"];
    for layout in layouts {
        place.succeed(&format!(
            "dataset export {layout} --layout {layout} --npy --png {PUBLICATION}"
        ));
    }
    let arguments = ["store", ".", "files", "webdataset", "huggingface"];
    let said = python(&place, "tests/clients/read_layouts.py", &arguments);
    assert!(said.contains("12 images in three layouts"), "{said}");

    for layout in layouts {
        // Nothing but the export is there.
        let elsewhere = Workplace::empty();
        let out = elsewhere.path().join("out");
        fs::rename(place.path().join(layout), &out).unwrap();
        let said = elsewhere.succeed("dataset import out");
        assert!(said.contains("12 images of 6 materials imported"), "{said}");
        assert!(manifests(&elsewhere, "store") == before, "{layout}");
        elsewhere.succeed("dataset verify --rerender 100%");
        let said = elsewhere.succeed("run --spec out/specification.toml");
        assert!(said.contains("nothing to do"), "{said}");
        let digest = row(&before[2], 3)["digest"].as_str().unwrap().to_owned();
        elsewhere.succeed(&format!(
            "render --spec out/specification.toml --material 1 --view 1 --expect {digest}"
        ));
        // Its own export is the same once more.
        elsewhere.succeed(&format!(
            "dataset export again --layout {layout} --npy --png {PUBLICATION}"
        ));
        assert!(
            contents(&elsewhere.path().join("again")) == contents(&out),
            "{layout}"
        );
    }
}

/// A row of a manifest in JSON Lines.
fn row(manifest: &[u8], number: usize) -> serde_json::Value {
    let text = str::from_utf8(manifest).unwrap();
    serde_json::from_str(text.lines().nth(number).unwrap()).unwrap()
}

#[test]
fn an_export_without_its_mesh_does_not_come_in_and_says_what_to_do() {
    let (place, mesh) = rendered();
    let file = place.path().join("out").join(&mesh);
    place.succeed("dataset export out --layout webdataset");
    manifests(&place, "store");
    for name in ["manifest.csv", "manifest.jsonl"] {
        fs::rename(place.path().join(name), place.path().join("out").join(name)).unwrap();
    }
    let other = ROOF.replace("0.6", "0.7");
    let flipped = ROOF.replacen("v 0", "v 1", 1);
    for bytes in [None, Some(&*other), Some(&*flipped), Some(&ROOF[1..])] {
        match bytes {
            None => fs::remove_file(&file).unwrap(),
            Some(bytes) => fs::write(&file, bytes).unwrap(),
        }
        for manifest in ["", "--manifest out/manifest.csv"] {
            let said = refused(
                &place,
                &format!("dataset import out --store new {manifest}"),
                2,
            );
            assert!(said.contains(&mesh) && said.contains("put back"), "{said}");
            assert_eq!(said.lines().count(), 1, "{said}");
            assert!(!place.path().join("new").exists());
        }
    }
    // The specification that the dataset was made with has the mesh; the same export brings it back.
    place.succeed("dataset import out --store new --spec spec.toml");
    assert!(manifests(&place, "new") == manifests(&place, "store"));
    place.succeed("dataset export out --layout webdataset");
    place.succeed("dataset import out --store newer");
    place.succeed("dataset verify --store newer --rerender 100%");
}

#[test]
fn a_store_that_lost_its_mesh_is_healed_by_its_specification() {
    let (place, mesh) = rendered();
    let file = place.path().join("store").join(&mesh);
    let before = manifests(&place, "store");
    for bytes in [None, Some(ROOF.replace("0.6", "0.7"))] {
        match bytes {
            None => fs::remove_file(&file).unwrap(),
            Some(bytes) => fs::write(&file, bytes).unwrap(),
        }
        for command in [
            "dataset verify",
            "dataset export out --layout files",
            "run",
            "dataset stats",
        ] {
            let said = refused(&place, command, 1);
            for part in [&*mesh, "put back the file", "run --spec"] {
                assert!(said.contains(part), "{command}: {said}");
            }
        }
        let said = place.succeed("run --spec spec.toml");
        assert!(said.contains("nothing to do"), "{said}");
        assert_eq!(fs::read(&file).unwrap(), ROOF.as_bytes());
        place.succeed("dataset verify --rerender 100%");
        assert!(manifests(&place, "store") == before);
    }
}

//! Any image again, on a machine that has the program and a manifest and nothing else.

use crate::folder::files_below;
use crate::small::rendered;
use crate::workplace::Workplace;
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};

/// Rows that are rendered again.
const ROWS: usize = 100;

#[test]
fn a_hundred_random_rows_render_again_from_a_manifest_alone() {
    let farm = rendered(12);
    farm.succeed("dataset manifest export --format parquet --out manifest.parquet");
    farm.succeed("dataset manifest export --format jsonl --out manifest.jsonl");

    let elsewhere = Workplace::empty();
    for name in ["manifest.parquet", "manifest.jsonl"] {
        fs::copy(farm.path().join(name), elsewhere.path().join(name)).unwrap();
    }
    drop(farm);
    let specification = elsewhere.succeed("dataset specification --manifest manifest.parquet");
    fs::write(elsewhere.path().join("spec.toml"), specification).unwrap();
    let rows = fs::read_to_string(elsewhere.path().join("manifest.jsonl")).unwrap();
    let mut rows: Vec<Value> = rows
        .lines()
        .map(|row| serde_json::from_str(row).unwrap())
        .collect();
    // In the order of their digests: as random as any, and the same every time.
    rows.sort_by_key(|row| row["digest"].to_string());
    for row in &rows[..ROWS] {
        let (seed, material, view) = (&row["seed"], &row["material"], &row["view"]);
        let digest = row["digest"].as_str().unwrap();
        elsewhere.succeed(&format!(
            "render --spec spec.toml --seed {seed} --material {material} --view {view} --expect \
             {digest}"
        ));
    }
}

#[test]
fn what_leaves_a_store_makes_the_same_store_elsewhere() {
    let farm = rendered(3);
    let manifests = |place: &Workplace| {
        ["parquet", "csv", "jsonl"].map(|format| {
            place.succeed(&format!(
                "dataset manifest export --format {format} --out m.{format}"
            ));
            fs::read(place.path().join(format!("m.{format}"))).unwrap()
        })
    };
    let before = manifests(&farm);
    for layout in ["files", "webdataset", "huggingface"] {
        let elsewhere = Workplace::empty();
        let out = elsewhere.path().join("out");
        farm.succeed(&format!(
            "dataset export {} --layout {layout}",
            out.display()
        ));
        let said = elsewhere.succeed("dataset import out");
        assert!(said.contains("42 images of 3 materials imported"), "{said}");
        assert!(manifests(&elsewhere) == before, "{layout}");
        elsewhere.succeed("dataset verify --rerender 10%");
        // And it is a store to go on with.
        let said = elsewhere.succeed("run --spec out/specification.toml");
        assert!(said.contains("nothing to do"), "{said}");
    }
}

/// Another export is replaced only when that is asked for, and then nothing of it stays; what is of no
/// export is never touched.
#[test]
fn another_export_is_replaced_on_request() {
    let farm = rendered(6);
    let export = |folder: &str, more: &str| {
        farm.run(&format!("dataset export {folder} --layout files {more}"))
    };
    let refused = |more: &str| {
        let output = export("out", more);
        assert_eq!(output.status.code(), Some(2), "{more}");
        String::from_utf8(output.stderr).unwrap()
    };
    let out = farm.path().join("out");
    assert!(export("out", "--png --views 5,8").status.success());
    let before = files_below(&out);

    let said = refused("--views 5");
    assert!(
        said.contains("of png_exposure_stops 0.0 where none is wanted"),
        "{said}"
    );
    assert!(said.contains("--overwrite"), "{said}");
    fs::write(out.join("thesis.tex"), "mine").unwrap();
    let said = refused("--views 5 --overwrite");
    assert!(said.contains("thesis.tex"), "{said}");
    fs::remove_file(out.join("thesis.tex")).unwrap();
    assert_eq!(files_below(&out), before, "a refusal removes nothing");

    // Another program's folder, with the same names.
    let foreign = farm.path().join("foreign");
    fs::create_dir_all(foreign.join("train")).unwrap();
    fs::write(foreign.join("train/mine.png"), "mine").unwrap();
    fs::write(foreign.join("export.json"), "{\"layout\": \"mine\"}").unwrap();
    let output = export("foreign", "--overwrite");
    assert_eq!(output.status.code(), Some(2));
    assert!(foreign.join("train/mine.png").exists());

    // Killed while the old export was being removed: its plan is still there.
    fs::remove_dir_all(out.join("train")).unwrap();
    fs::write(out.join("manifest.parquet.whole.new"), "half").unwrap();
    assert!(export("out", "--views 5 --overwrite").status.success());
    assert!(export("fresh", "--views 5").status.success());
    let fresh = farm.path().join("fresh");
    let content = |folder: &Path| -> Vec<(PathBuf, Vec<u8>)> {
        let files = files_below(folder).into_iter();
        let named = files.map(|path| {
            let name = path.strip_prefix(folder).unwrap().to_owned();
            (name, fs::read(&path).unwrap())
        });
        named.collect()
    };
    assert!(content(&out) == content(&fresh), "it is as a fresh one");
    // The same once more has nothing to replace.
    assert!(export("out", "--views 5 --overwrite").status.success());
}

#[test]
fn materials_are_chosen_by_their_labels() {
    let farm = rendered(12);
    let rows = farm.succeed("dataset manifest export --format jsonl --out -");
    let rows = rows.lines().map(|row| serde_json::from_str(row).unwrap());
    let smooth = |row: &Value| row["roughness"].as_f64().unwrap() < 50.0;
    let expected = rows.filter(smooth).count();
    assert!((1..12 * 14).contains(&expected));

    let refused = |arguments: &str| {
        let output = farm.run(arguments);
        assert_eq!(output.status.code(), Some(2), "{arguments}");
        String::from_utf8(output.stderr).unwrap()
    };
    let wanted = "--where=not(roughness>=50)";
    let said = farm.succeed(&format!("dataset export out --layout files {wanted}"));
    assert!(said.contains(&format!("{expected} images")), "{said}");
    let card = fs::read_to_string(farm.path().join("out/README.md")).unwrap();
    assert!(
        card.contains("materials with `not(roughness>=50)`"),
        "{card}"
    );
    // The same again goes on, and another condition does not.
    farm.succeed(&format!("dataset export out --layout files {wanted}"));
    let said = refused("dataset export out --layout files --where=roughness<60");
    assert!(said.contains("another export"), "{said}");
    let said = farm.succeed(&format!("dataset stats {wanted}"));
    let materials = expected / 14;
    assert!(
        said.contains(&format!("{materials} of {materials} complete")),
        "{said}"
    );
    farm.succeed(&format!("dataset show {wanted} --out sheet.png"));
    for command in ["export none --layout files", "show"] {
        let said = refused(&format!("dataset {command} --where=ior>90"));
        assert!(said.contains("satisfies"), "{said}");
    }
}

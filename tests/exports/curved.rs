//! A dataset of curved samples, from the run to the export.

use crate::workplace::Workplace;
use std::fs;

const SPECIFICATION: &str = r#"
name = "curved"
materials = 2
[image]
width = 16
height = 16
[accuracy]
absolute = 0.01
relative = 0.1
[sample]
shape = "cylinder"
"#;

#[test]
fn a_dataset_of_cylinders_is_rendered_verified_and_exported() {
    let place = Workplace::empty();
    fs::write(place.path().join("spec.toml"), SPECIFICATION).unwrap();
    place.succeed("run --spec spec.toml");
    let verified = place.succeed("dataset verify --rerender 100%");
    assert!(verified.contains("rendered 28 images again"), "{verified}");
    place.succeed("dataset manifest export --format jsonl --out rows.jsonl");
    let rows = fs::read_to_string(place.path().join("rows.jsonl")).unwrap();
    assert_eq!(
        rows.matches("\"sample_shape\":\"cylinder\"").count(),
        28,
        "{rows}"
    );
    place.succeed("dataset export out --layout files");
    let card = fs::read_to_string(place.path().join("out/README.md")).unwrap();
    assert!(card.contains("the sample is a cylinder of diameter and length 0.1 along x"));
    assert!(card.contains("on the square in z = 0 that the sample touches"));

    let refused = place.run("dataset export square --layout files --rectified 8");
    assert_eq!(refused.status.code(), Some(2));
    let said = String::from_utf8_lossy(&refused.stderr);
    assert!(
        said.contains("a curved sample cannot be warped to a square"),
        "{said}"
    );

    // Another shape is another dataset.
    let sphere = SPECIFICATION.replace("cylinder", "sphere");
    fs::write(place.path().join("spec.toml"), sphere).unwrap();
    let refused = place.run("run --spec spec.toml");
    assert_eq!(refused.status.code(), Some(2));
    let said = String::from_utf8_lossy(&refused.stderr);
    let difference = "sample.shape: \"cylinder\" in the store, \"sphere\" given";
    assert!(said.contains(difference), "{said}");
}

//! Specifications.

use dataset::Specification;

/// Reads TOML and JSON; what is valid has to read back and to give labels.
pub fn specification(bytes: &[u8]) -> bool {
    let Ok(text) = str::from_utf8(bytes) else {
        return false;
    };
    let mut accepted = false;
    for read in [
        Specification::from_toml(text, "fuzzed.toml"),
        Specification::from_json(text),
    ] {
        match read {
            Ok(specification) => {
                accepted = true;
                check(&specification);
            }
            Err(error) => assert_eq!(error.to_string().lines().count(), 1, "{error}"),
        }
    }
    accepted
}

fn check(specification: &Specification) {
    let json = Specification::from_json(&specification.to_json()).unwrap();
    assert_eq!(json, *specification);
    let toml = Specification::from_toml(&specification.to_toml(), "again.toml").unwrap();
    assert_eq!(toml, *specification);
    assert_eq!(toml.hash(), specification.hash());
    for index in [0, specification.materials - 1] {
        let sampled = specification.material(index);
        sampled.material.check().unwrap();
        specification.split(index);
    }
    for view in 0..specification.views.len() {
        specification.view_geometry(view).unwrap();
    }
}

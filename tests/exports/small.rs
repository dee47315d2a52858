//! A small store.

use crate::workplace::Workplace;
use std::fs;

/// Small images, so that 14 of them take a fraction of a second.
const SPECIFICATION: &str = r#"
name = "small"
materials = 12
[image]
width = 32
height = 32
[integrator]
kind = "path"
samples_per_pixel = 16
"#;

/// A folder with a store of this many materials.
pub fn rendered(materials: u32) -> Workplace {
    let place = Workplace::empty();
    fs::write(place.path().join("spec.toml"), SPECIFICATION).unwrap();
    place.succeed(&format!("run --spec spec.toml --materials {materials}"));
    place
}

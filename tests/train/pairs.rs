//! An export of small pairs.

use crate::workplace::Workplace;
use std::fs;

/// Two views, as the networks read them, on a film of 24 pixels.
pub const SPECIFICATION: &str = r#"
name = "small-pairs"
materials = 24
[image]
width = 24
height = 24
[accuracy]
relative = 1e-1
absolute = 1e-2
[[views]]
camera_elevation_deg = 30.0
light_elevation_deg = 45.0
rotation_deg = 0.0
checker = true
[[views]]
camera_elevation_deg = 90.0
light_elevation_deg = 45.0
rotation_deg = 0.0
checker = true
"#;

/// A training that takes seconds.
pub const TRAIN: &str = "train pairs --epochs 3 --block-epochs 2";

/// A folder with an export `pairs`, rectified to 32 pixels.
pub fn exported() -> Workplace {
    let place = Workplace::empty();
    fs::write(place.path().join("spec.toml"), SPECIFICATION).unwrap();
    place.succeed("run --spec spec.toml --store store");
    place.succeed("dataset export pairs --store store --layout files --rectified 32");
    place
}

/// The one sentence of a command that has to end with an exit code.
#[track_caller]
pub fn fail(place: &Workplace, arguments: &str, code: i32) -> String {
    let output = place.run(arguments);
    let errors = String::from_utf8(output.stderr).unwrap();
    assert_eq!(
        output.status.code(),
        Some(code),
        "brdfarm {arguments}: {errors}"
    );
    assert_eq!(errors.lines().count(), 1, "{errors}");
    errors
}

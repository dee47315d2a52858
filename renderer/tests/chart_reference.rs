//! The preset's colour chart against the published one: `reference/checker.json`.

use dataset::{Specification, sin_cos_deg};
use renderer::{
    geometry::{BackendChoice, Ray},
    scene::{Encounter, Scene},
    vector::Vec3,
};
use serde::Deserialize;

#[derive(Deserialize)]
struct Reference {
    patches: Vec<Patch>,
}

/// The published chart lies in landscape, 6 columns by 4 rows; the scene's stands in portrait.
#[derive(Deserialize)]
struct Patch {
    name: String,
    /// In the scene the column, from -x to +x.
    landscape_row: u32,
    /// In the scene the row, from the far one to the one beside the sample.
    landscape_column: u32,
    srgb8: [u8; 3],
    linear: [f64; 3],
}

fn patches() -> Vec<Patch> {
    let reference: Reference =
        serde_json::from_str(include_str!("reference/checker.json")).expect("reference values");
    assert_eq!(reference.patches.len(), 24);
    reference.patches
}

#[test]
fn the_preset_lists_the_published_codes() {
    let checker = Specification::preset().checker;
    assert_eq!((checker.columns, checker.rows), (4, 6));
    assert_eq!(checker.patches_srgb8.len(), 24);
    for patch in patches() {
        let index = patch.landscape_column * checker.columns + patch.landscape_row;
        let listed = checker.patches_srgb8[index as usize];
        assert_eq!(listed, patch.srgb8, "{}", patch.name);
    }
}

/// A ray straight at the middle of each patch, whose position is worked out here.
#[test]
fn every_patch_stands_where_it_should_with_its_reflectance() {
    const PITCH_M: f64 = 0.04;
    const LOWER_EDGE_Y_M: f64 = 0.055;
    let (sin, cos) = sin_cos_deg(38.0);
    let normal = Vec3::new(0.0, -sin, cos);
    let scene = Scene::new(&Specification::preset(), 0, BackendChoice::Native);
    let scene = scene.expect("a view").expect("a scene");
    for patch in patches() {
        let x = PITCH_M * (f64::from(patch.landscape_row) - 1.5);
        let up = PITCH_M * (5.5 - f64::from(patch.landscape_column));
        let middle = Vec3::new(x, LOWER_EDGE_Y_M + up * cos, up * sin);
        let ray = Ray {
            origin: middle + normal * 0.1,
            direction: -normal,
        };
        let Some(Encounter::Surface(surface)) = scene.encounter(&ray, None) else {
            panic!("{} is not there", patch.name);
        };
        let found = surface.patch.expect("the chart");
        for (found, expected) in found.into_iter().zip(patch.linear) {
            assert!((found - expected).abs() < 1e-15, "{}", patch.name);
        }
    }
}

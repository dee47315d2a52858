//! Pixels worked out by adaptive cubature, to about 1e-8 relative: `reference/pixels.json`.

use dataset::{Material, specification::Tint};
use serde::Deserialize;

/// One pixel of a view without chart.
#[derive(Deserialize)]
pub struct ReferencePixel {
    pub material: Material,
    pub camera_elevation_deg: f64,
    pub light_elevation_deg: f64,
    pub rotation_deg: f64,
    pub tint: Tint,
    pub column: u32,
    pub row: u32,
    pub value: [f64; 3],
}

/// All 35 of them.
pub fn reference_pixels() -> Vec<ReferencePixel> {
    let pixels: Vec<ReferencePixel> =
        serde_json::from_str(include_str!("../reference/pixels.json")).expect("reference values");
    assert_eq!(pixels.len(), 35);
    pixels
}

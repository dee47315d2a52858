//! Pictures for people: sRGB PNG, clipped at white.

mod canvas;
mod contact_sheet;
mod digits;

pub use contact_sheet::ContactSheet;

use ::picture::{EXPOSURE_STOPS_MAX, to_srgb8};
use canvas::Canvas;

/// A picture of `values` (linear Rec.709, row by row), brightened by `exposure_stops`, as PNG.
pub fn develop(
    values: &[[f64; 3]],
    width: u32,
    height: u32,
    exposure_stops: f64,
) -> anyhow::Result<Vec<u8>> {
    let mut picture = Canvas::filled(width, height, [0; 3]);
    for (index, value) in (0..).zip(values) {
        picture.put(
            index % width,
            index / width,
            to_srgb8(*value, exposure_stops),
        );
    }
    picture.to_png()
}

/// Reads an exposure, in stops.
pub fn parse_exposure(text: &str) -> Result<f64, String> {
    text.parse()
        .ok()
        .filter(|stops: &f64| stops.abs() <= EXPOSURE_STOPS_MAX)
        .ok_or_else(|| {
            format!("exposure is a number from -{EXPOSURE_STOPS_MAX} to {EXPOSURE_STOPS_MAX}")
        })
}

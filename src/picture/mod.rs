//! Pictures for people: sRGB PNG, clipped at white.

mod contact_sheet;
mod digits;

pub use contact_sheet::ContactSheet;

use anyhow::Context;
use dataset::colour::srgb_from_linear;
use image::{ImageFormat, Rgb, RgbImage};
use std::io::Cursor;

/// A picture of `values` (linear Rec.709, row by row), brightened by `exposure_stops`, as PNG.
pub fn develop(
    values: &[[f64; 3]],
    width: u32,
    height: u32,
    exposure_stops: f64,
) -> anyhow::Result<Vec<u8>> {
    let picture = RgbImage::from_fn(width, height, |x, y| {
        Rgb(to_srgb8(values[(y * width + x) as usize], exposure_stops))
    });
    encode_png(&picture)
}

/// The darkest and the brightest that a picture can be made, in stops.
const EXPOSURE_STOPS_MAX: f64 = 64.0;

/// Reads an exposure, in stops.
pub fn parse_exposure(text: &str) -> Result<f64, String> {
    text.parse()
        .ok()
        .filter(|stops: &f64| stops.abs() <= EXPOSURE_STOPS_MAX)
        .ok_or_else(|| {
            format!("exposure is a number from -{EXPOSURE_STOPS_MAX} to {EXPOSURE_STOPS_MAX}")
        })
}

fn to_srgb8(value: [f64; 3], exposure_stops: f64) -> [u8; 3] {
    let gain = libm::exp2(exposure_stops);
    value.map(|channel| (255.0 * srgb_from_linear((channel * gain).clamp(0.0, 1.0))).round() as u8)
}

fn encode_png(picture: &RgbImage) -> anyhow::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    picture
        .write_to(&mut Cursor::new(&mut bytes), ImageFormat::Png)
        .context("cannot encode the picture")?;
    Ok(bytes)
}

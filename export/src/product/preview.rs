//! Previews for people: 8-bit sRGB PNG, clipped at white, the exposure stated inside.

use super::Picture;
use crate::error::ExportError;
use ::picture::{encode_png, to_srgb8};

pub(super) fn encode(picture: &Picture, exposure_stops: f64) -> Result<Vec<u8>, ExportError> {
    let pixels: Vec<[u8; 3]> = picture
        .values
        .iter()
        .map(|value| to_srgb8(value.map(f64::from), exposure_stops))
        .collect();
    let texts = [("exposure_stops", &*exposure_stops.to_string())];
    let encoded = encode_png(picture.width, picture.height, &pixels, &texts);
    encoded.map_err(ExportError::encode("a preview"))
}

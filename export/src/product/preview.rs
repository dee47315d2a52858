//! Previews for people: 8-bit sRGB PNG, clipped at white, the exposure stated inside.

use super::Picture;
use crate::error::ExportError;
use dataset::colour::srgb_from_linear;
use png::{BitDepth, ColorType, Encoder, SrgbRenderingIntent};

/// The darkest and the brightest that a preview can be made, in stops.
pub const EXPOSURE_STOPS_MAX: f64 = 64.0;

/// A linear Rec.709 value, brightened by `exposure_stops`, clipped at white, as 8-bit sRGB.
pub fn to_srgb8(value: [f64; 3], exposure_stops: f64) -> [u8; 3] {
    let gain = libm::exp2(exposure_stops);
    value.map(|channel| (255.0 * srgb_from_linear((channel * gain).clamp(0.0, 1.0))).round() as u8)
}

pub(super) fn encode(picture: &Picture, exposure_stops: f64) -> Result<Vec<u8>, ExportError> {
    let pixels: Vec<[u8; 3]> = picture
        .values
        .iter()
        .map(|value| to_srgb8(value.map(f64::from), exposure_stops))
        .collect();
    let mut bytes = Vec::new();
    let mut encoder = Encoder::new(&mut bytes, picture.width, picture.height);
    encoder.set_color(ColorType::Rgb);
    encoder.set_depth(BitDepth::Eight);
    encoder.set_source_srgb(SrgbRenderingIntent::RelativeColorimetric);
    encoder
        .add_text_chunk("exposure_stops".to_owned(), exposure_stops.to_string())
        .and_then(|()| encoder.write_header())
        .and_then(|mut writer| {
            writer.write_image_data(pixels.as_flattened())?;
            writer.finish()
        })
        .map_err(ExportError::encode("a preview"))?;
    Ok(bytes)
}

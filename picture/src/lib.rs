//! Pictures for people: 8-bit sRGB, clipped at white, as PNG.

use dataset::colour::srgb_from_linear;
use png::{BitDepth, ColorType, Encoder, SrgbRenderingIntent};

pub use png::EncodingError;

/// The darkest and the brightest that a picture can be made, in stops.
pub const EXPOSURE_STOPS_MAX: f64 = 64.0;

/// A linear Rec.709 value, brightened by `exposure_stops`, clipped at white, as 8-bit sRGB.
pub fn to_srgb8(value: [f64; 3], exposure_stops: f64) -> [u8; 3] {
    let gain = libm::exp2(exposure_stops);
    value.map(|channel| (255.0 * srgb_from_linear((channel * gain).clamp(0.0, 1.0))).round() as u8)
}

/// A picture of 8-bit sRGB, row by row from the top, as PNG, with texts of a keyword and a value.
///
/// # Errors
/// When there are not `width` x `height` pixels, or a text cannot be encoded as Latin-1.
pub fn encode_png(
    width: u32,
    height: u32,
    pixels: &[[u8; 3]],
    texts: &[(&str, &str)],
) -> Result<Vec<u8>, EncodingError> {
    let mut bytes = Vec::new();
    let mut encoder = Encoder::new(&mut bytes, width, height);
    encoder.set_color(ColorType::Rgb);
    encoder.set_depth(BitDepth::Eight);
    encoder.set_source_srgb(SrgbRenderingIntent::RelativeColorimetric);
    for (keyword, text) in texts {
        encoder.add_text_chunk((*keyword).to_owned(), (*text).to_owned())?;
    }
    let mut writer = encoder.write_header()?;
    writer.write_image_data(pixels.as_flattened())?;
    writer.finish()?;
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_texts_and_colour_space_are_read_back() {
        let pixels = [[0, 10, 20], [30, 40, 50], [255, 254, 253], [1, 2, 3]];
        let bytes = encode_png(2, 2, &pixels, &[("exposure_stops", "-1.5")]).unwrap();
        let decoder = png::Decoder::new(std::io::Cursor::new(bytes));
        let mut reader = decoder.read_info().unwrap();
        let mut read = vec![0; 12];
        reader.next_frame(&mut read).unwrap();
        assert_eq!(read, pixels.as_flattened());
        let info = reader.info();
        assert_eq!(info.uncompressed_latin1_text[0].text, "-1.5");
        assert_eq!(info.srgb, Some(SrgbRenderingIntent::RelativeColorimetric));
        assert!(encode_png(3, 2, &pixels, &[]).is_err());
    }

    #[test]
    fn exposure_is_in_stops_and_ends_at_white() {
        assert_eq!(to_srgb8([0.0, 1.0, 5.0], 0.0), [0, 255, 255]);
        assert_eq!(to_srgb8([0.25; 3], 1.0), to_srgb8([0.5; 3], 0.0));
        assert_eq!(to_srgb8([-1.0, f64::NAN, 0.0], 0.0)[0], 0);
    }
}

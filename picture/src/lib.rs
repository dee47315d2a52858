//! Pictures for people: 8-bit sRGB, clipped at white, as PNG.

use dataset::colour::srgb_from_linear;
use png::{BitDepth, ColorType, Encoder, SrgbRenderingIntent};
use std::io::Write;

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
    let mut encoder = encoder(&mut bytes, width, height);
    for (keyword, text) in texts {
        encoder.add_text_chunk((*keyword).to_owned(), (*text).to_owned())?;
    }
    let mut writer = encoder.write_header()?;
    writer.write_image_data(pixels.as_flattened())?;
    writer.finish()?;
    Ok(bytes)
}

/// A picture of bands of whole rows, each encoded before the next one is asked for, so that only one is in memory.
///
/// # Errors
/// When the bands have not `width` x `height` pixels in all, and what a band fails with.
pub fn encode_png_by_bands<E: From<EncodingError>>(
    width: u32,
    height: u32,
    bands: impl IntoIterator<Item = Result<Vec<[u8; 3]>, E>>,
) -> Result<Vec<u8>, E> {
    let failed = |error: std::io::Error| E::from(EncodingError::from(error));
    let mut bytes = Vec::new();
    let mut writer = encoder(&mut bytes, width, height).write_header()?;
    let mut stream = writer.stream_writer()?;
    let mut left = width as usize * height as usize;
    for band in bands {
        let band = band?;
        // The stream would take more for another picture.
        left = left
            .checked_sub(band.len())
            .ok_or_else(|| failed(std::io::Error::other("more pixels than the picture has")))?;
        stream.write_all(band.as_flattened()).map_err(failed)?;
    }
    stream.finish()?;
    writer.finish()?;
    Ok(bytes)
}

fn encoder<'a>(bytes: &mut Vec<u8>, width: u32, height: u32) -> Encoder<'a, &mut Vec<u8>> {
    let mut encoder = Encoder::new(bytes, width, height);
    encoder.set_color(ColorType::Rgb);
    encoder.set_depth(BitDepth::Eight);
    encoder.set_source_srgb(SrgbRenderingIntent::RelativeColorimetric);
    encoder
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
    fn a_picture_in_bands_has_all_its_rows_or_fails() {
        let rows: Vec<Vec<[u8; 3]>> = (0..7).map(|row| vec![[row, 2 * row, 200]; 5]).collect();
        let bands = |rows: &[Vec<[u8; 3]>]| {
            let bands: Vec<_> = rows.chunks(3).map(|band| Ok(band.concat())).collect();
            encode_png_by_bands::<EncodingError>(5, 7, bands)
        };
        let bytes = bands(&rows).unwrap();
        let mut reader = png::Decoder::new(std::io::Cursor::new(bytes))
            .read_info()
            .unwrap();
        let mut read = vec![0; 5 * 7 * 3];
        reader.next_frame(&mut read).unwrap();
        assert_eq!(read, rows.concat().as_flattened());
        assert!(bands(&rows[..6]).is_err(), "a row is missing");
        assert!(bands(&[rows.clone(), rows].concat()).is_err(), "too many");
        assert!(encode_png_by_bands::<EncodingError>(5, 7, []).is_err());
    }

    #[test]
    fn exposure_is_in_stops_and_ends_at_white() {
        assert_eq!(to_srgb8([0.0, 1.0, 5.0], 0.0), [0, 255, 255]);
        assert_eq!(to_srgb8([0.25; 3], 1.0), to_srgb8([0.5; 3], 0.0));
        assert_eq!(to_srgb8([-1.0, f64::NAN, 0.0], 0.0)[0], 0);
    }
}

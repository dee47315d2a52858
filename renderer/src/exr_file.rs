//! The image as an OpenEXR file whose bytes are a function of its pixels and header.
//!
//! The encoder keeps attributes it does not know in a hash map of random order; so everything of
//! ours is one text attribute of JSON, its keys in the order of the type, and the rest are standard attributes, which it
//! writes in a fixed order. Nothing tells the time or the host.

use crate::film::{Film, FilmPixel};
use dataset::{IMAGE_HEADER_ATTRIBUTE, ImageHeader, specification::Pixel};
use exr::prelude::*;
use std::io::Cursor;

/// Why a file could not be encoded or decoded.
#[derive(Debug, thiserror::Error)]
pub enum ExrError {
    /// A pixel is too bright for 16 bits.
    #[error(
        "a pixel of {value} does not fit a 16-bit float (at most {}): set image.pixel = \"float\"",
        half::f16::MAX
    )]
    TooBright {
        /// The offending channel.
        value: f64,
    },
    /// The header could not be written as JSON.
    #[error("the image's header cannot be written as JSON: {0}")]
    Header(#[from] serde_json::Error),
    /// The library refused.
    #[error("the EXR library failed: {0}")]
    Library(#[from] Error),
}

/// Encodes `film` as scan lines compressed with ZIP, 16 lines a block. A pixel of value 1 has
/// `white_luminance` cd/m^2.
///
/// # Errors
/// When a pixel exceeds the largest 16-bit float and `pixel` is [`Pixel::Half`].
pub fn encode(
    film: &Film,
    pixel: Pixel,
    header: &ImageHeader,
    white_luminance: f64,
) -> std::result::Result<Vec<u8>, ExrError> {
    match pixel {
        Pixel::Half => {
            if let Some(value) = too_bright(film) {
                return Err(ExrError::TooBright { value });
            }
            // The conversion that ignores the processor: the other rounds twice where the machine
            // converts in hardware.
            encode_as(film, header, white_luminance, f16::from_f64_const)
        }
        Pixel::Float => encode_as(film, header, white_luminance, |value| value as f32),
    }
}

/// The first channel that would round to a 16-bit infinity.
fn too_bright(film: &Film) -> Option<f64> {
    film.pixels
        .iter()
        .flat_map(|pixel| pixel.value)
        .find(|&value| f16::from_f64_const(value).is_infinite())
}

fn encode_as<T: IntoSample + Copy + Default>(
    film: &Film,
    header: &ImageHeader,
    white_luminance: f64,
    convert: impl Fn(f64) -> T + Sync,
) -> std::result::Result<Vec<u8>, ExrError> {
    let width = film.width as usize;
    let channels = SpecificChannels::rgb(|position: Vec2<usize>| {
        let FilmPixel { value, .. } = film.pixels[position.y() * width + position.x()];
        let [red, green, blue] = value.map(&convert);
        (red, green, blue)
    });
    let mut attributes = LayerAttributes {
        software_name: Some(Text::from("brdfarm")),
        white_luminance: Some(white_luminance as f32),
        ..LayerAttributes::default()
    };
    attributes.other.insert(
        Text::from(IMAGE_HEADER_ATTRIBUTE),
        AttributeValue::Text(Text::from(serde_json::to_string(header)?.as_str())),
    );
    let encoding = Encoding {
        compression: Compression::ZIP16,
        blocks: Blocks::ScanLines,
        line_order: LineOrder::Increasing,
    };
    let layer = Layer::new(
        (width, film.height as usize),
        attributes,
        encoding,
        channels,
    );
    let mut image = Image::from_layer(layer);
    image.attributes.chromaticities = Some(attribute::Chromaticities {
        red: Vec2(0.64, 0.33),
        green: Vec2(0.30, 0.60),
        blue: Vec2(0.15, 0.06),
        white: Vec2(0.3127, 0.3290),
    });
    let mut bytes = Vec::new();
    image
        .write()
        .non_parallel()
        .to_buffered(Cursor::new(&mut bytes))?;
    Ok(bytes)
}

/// The pixels of a file that [`encode`] wrote, row by row, linear Rec.709. For bytes that are known
/// by their digest: those of a stranger have to be checked before they are decoded.
///
/// # Errors
/// When the file is no such image.
pub fn decode(bytes: &[u8]) -> std::result::Result<Vec<[f64; 3]>, ExrError> {
    let image = read()
        .no_deep_data()
        .largest_resolution_level()
        .rgb_channels(
            |size: Vec2<usize>, _| (size.width(), vec![[0.0; 3]; size.area()]),
            |(width, pixels), position, (red, green, blue): (f32, f32, f32)| {
                pixels[position.y() * *width + position.x()] = [red, green, blue].map(f64::from);
            },
        )
        .first_valid_layer()
        .all_attributes()
        .non_parallel()
        .from_buffered(Cursor::new(bytes))?;
    Ok(image.layer_data.channel_data.pixels.1)
}

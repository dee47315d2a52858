//! The image, and the error of each of its pixels, as OpenEXR files whose bytes are a function of
//! the pixels and the header.
//!
//! The encoder keeps attributes it does not know in a hash map of random order; so everything of
//! ours is one text attribute of JSON, its keys in the order of the type, and the rest are standard
//! attributes, which it writes in a fixed order. Nothing tells the time or the host. The file of an
//! image begins with the bytes of [`dataset::image_file_header`].

use crate::film::{Film, FilmPixel};
use crate::rounding::rounded_up;
use dataset::{
    IMAGE_HEADER_ATTRIBUTE, IMAGE_SOFTWARE, ImageHeader, REC709_CHROMATICITIES,
    specification::Pixel,
};
use exr::image::write::channels::WritableChannels;
use exr::prelude::*;
use std::io::Cursor;

/// What the file of errors says of its values, in the standard attribute for comments.
const ERROR_COMMENTS: &str = "error: half the width of the 95 percent interval of the worst channel \
    in units of white (1 is the radiance of a perfect white diffuser at the origin which faces the \
    bulb), rounded up; the rounding of the image's pixels to 16 bits is not included";

/// What the file of surfaces says of its values.
const AOV_COMMENTS: &str = "what the middle of each pixel sees, 0 where that is nothing: depth along the \
    camera's axis in metres; normal and tangent (the x axis of the material's frame) in the world; u \
    and v by arcs from the origin in units of the sample's side, and 0 to 1 over the chart; masks of the \
    fronts of sample and chart, and of the bulb";

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
    let samples = match pixel {
        Pixel::Half => {
            if let Some(value) = too_bright(film) {
                return Err(ExrError::TooBright { value });
            }
            // The conversion that ignores the processor: the other rounds twice where the machine
            // converts in hardware.
            planes(film, f16::from_f64_const).map(FlatSamples::F16)
        }
        Pixel::Float => planes(film, |value| value as f32).map(FlatSamples::F32),
    };
    encode_samples(film, header, white_luminance, samples)
}

/// A pixel as a file of this pixel type has it.
pub fn stored(pixel: &FilmPixel, as_pixel: Pixel) -> [f32; 3] {
    pixel.value.map(|value| match as_pixel {
        Pixel::Half => f16::from_f64_const(value).to_f32_const(),
        Pixel::Float => value as f32,
    })
}

/// From here on a number rounds to a 16-bit infinity: halfway from the largest finite one to the next power of two.
const ROUNDS_TO_INFINITY: f64 = 65_520.0;

/// The first channel that would round to a 16-bit infinity.
fn too_bright(film: &Film) -> Option<f64> {
    let mut values = film.pixels.iter().flat_map(|pixel| pixel.value);
    values.find(|value| value.abs() >= ROUNDS_TO_INFINITY)
}

/// Each channel of all pixels, row by row from the top.
fn planes<T>(film: &Film, convert: impl Fn(f64) -> T) -> [Vec<T>; 3] {
    [0, 1, 2].map(|channel| {
        let values = film.pixels.iter().map(|pixel| pixel.value[channel]);
        values.map(&convert).collect()
    })
}

/// Encodes red, green and blue of a film as they are stored.
fn encode_samples(
    film: &Film,
    header: &ImageHeader,
    white_luminance: f64,
    samples: [FlatSamples; 3],
) -> std::result::Result<Vec<u8>, ExrError> {
    // Whole lines are copied; of channels by pixel the library copies every sample.
    let channels = ["R", "G", "B"].into_iter().zip(samples);
    let channels = channels.map(|(name, samples)| AnyChannel::new(name, samples));
    let channels = AnyChannels::sort(channels.collect());
    let attributes = attributes(header, white_luminance)?;
    let mut image = Image::from_layer(layer(film, attributes, channels));
    let [
        red_x,
        red_y,
        green_x,
        green_y,
        blue_x,
        blue_y,
        white_x,
        white_y,
    ] = REC709_CHROMATICITIES;
    image.attributes.chromaticities = Some(attribute::Chromaticities {
        red: Vec2(red_x, red_y),
        green: Vec2(green_x, green_y),
        blue: Vec2(blue_x, blue_y),
        white: Vec2(white_x, white_y),
    });
    write(&image)
}

/// Encodes the error of each pixel of `film` as one channel, `error`, of 32-bit floats in units of
/// white. They are rounded up, so none is below the error that was stated. The file's layout and
/// its header are those of the image that [`encode`] makes; a comment gives the unit.
///
/// # Errors
/// When the library refuses.
pub fn encode_error(
    film: &Film,
    header: &ImageHeader,
    white_luminance: f64,
) -> std::result::Result<Vec<u8>, ExrError> {
    let width = film.width as usize;
    let channels = SpecificChannels::build()
        .with_channel("error")
        .with_pixel_fn(|position: Vec2<usize>| {
            let FilmPixel { error, .. } = film.pixels[position.y() * width + position.x()];
            (rounded_up(error),)
        });
    let attributes = LayerAttributes {
        comments: Some(Text::from(ERROR_COMMENTS)),
        ..attributes(header, white_luminance)?
    };
    write(&Image::from_layer(layer(film, attributes, channels)))
}

/// Encodes channels of 32-bit floats, named by layer as in `normal.X`. The file's layout and its header
/// are those of the image that [`encode`] makes of `film`; a comment gives the units.
///
/// # Errors
/// When the library refuses.
pub fn encode_channels<const N: usize>(
    film: &Film,
    header: &ImageHeader,
    white_luminance: f64,
    names: [&str; N],
    channels: [Vec<f32>; N],
) -> std::result::Result<Vec<u8>, ExrError> {
    let list = names.into_iter().zip(channels);
    let list = list.map(|(name, values)| AnyChannel::new(name, FlatSamples::F32(values)));
    let attributes = LayerAttributes {
        comments: Some(Text::from(AOV_COMMENTS)),
        ..attributes(header, white_luminance)?
    };
    let channels = AnyChannels::sort(list.collect());
    write(&Image::from_layer(layer(film, attributes, channels)))
}

/// What every file says of itself.
fn attributes(
    header: &ImageHeader,
    white_luminance: f64,
) -> std::result::Result<LayerAttributes, ExrError> {
    let mut attributes = LayerAttributes {
        software_name: Some(Text::from(IMAGE_SOFTWARE)),
        white_luminance: Some(white_luminance as f32),
        ..LayerAttributes::default()
    };
    attributes.other.insert(
        Text::from(IMAGE_HEADER_ATTRIBUTE),
        AttributeValue::Text(Text::from(serde_json::to_string(header)?.as_str())),
    );
    Ok(attributes)
}

/// Scan lines from top to bottom, compressed with ZIP, 16 lines a block.
fn layer<'a, Channels: WritableChannels<'a> + 'a>(
    film: &Film,
    attributes: LayerAttributes,
    channels: Channels,
) -> Layer<Channels> {
    let encoding = Encoding {
        compression: Compression::ZIP16,
        blocks: Blocks::ScanLines,
        line_order: LineOrder::Increasing,
    };
    let size = (film.width as usize, film.height as usize);
    Layer::new(size, attributes, encoding, channels)
}

fn write<'a, Channels: WritableChannels<'a>>(
    image: &'a Image<Layer<Channels>>,
) -> std::result::Result<Vec<u8>, ExrError> {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_too_bright_from_where_they_round_to_infinity() {
        let places = [0.0, 65_504.0, 65_519.0, ROUNDS_TO_INFINITY, 65_536.0, 1e300];
        let near = places.map(|at| [at.next_down(), at, at.next_up()]);
        for value in near.into_iter().flatten().flat_map(|at| [at, -at]) {
            let is_infinite = f16::from_f64_const(value).is_infinite();
            assert_eq!(value.abs() >= ROUNDS_TO_INFINITY, is_infinite, "{value}");
        }
    }
}

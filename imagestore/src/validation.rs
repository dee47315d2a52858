//! What is accepted as an image of a dataset.
//!
//! The bytes are anybody's until they have passed here. The header is read first, by a reader that
//! never reserves more than a few megabytes ahead of the bytes it has; only when it is, byte for
//! byte, the header that the renderer writes are pixels decoded, so one flipped bit cannot ask for
//! gigabytes, and nothing can be hidden between the pixels.

use crate::exact_file;
pub use crate::rejection::Rejection;
use crate::rejection::{layout, same};
use dataset::{
    Digest, IMAGE_BLOCK_LINES, IMAGE_HEADER_ATTRIBUTE, ImageHeader, RENDERER_VERSION,
    Specification, image_file_bytes_max, image_file_header,
    specification::{Image, Pixel},
};
use exr::{
    block::UncompressedBlock,
    compression::Compression,
    meta::{
        BlockDescription,
        attribute::{AttributeValue, LineOrder, SampleType, Text},
        header::Header,
    },
};
use half::f16;
use limits::IMAGE_HEADER_BYTES_MAX;
use std::{
    io::Cursor,
    panic::{self, AssertUnwindSafe},
};

/// Checks that bytes have a digest.
pub fn check_digest(bytes: &[u8], named: Digest) -> Result<(), Rejection> {
    let found = Digest::of(bytes);
    if found == named {
        Ok(())
    } else {
        Err(Rejection::Digest { named, found })
    }
}

/// An image that was read whole.
#[derive(Clone, Debug, PartialEq)]
pub struct Decoded {
    /// What it says of itself.
    pub header: ImageHeader,
    /// Linear Rec.709 in units of white, row by row from the top; exact for either pixel type.
    pub pixels: Vec<[f32; 3]>,
}

/// Reads a whole image of a dataset under bounds and returns what it says of itself.
pub fn inspect(bytes: &[u8], specification: &Specification) -> Result<ImageHeader, Rejection> {
    read_guarded(bytes, specification, |_| {})
}

/// Reads a whole image of a dataset under bounds, pixels and all.
pub fn decode(bytes: &[u8], specification: &Specification) -> Result<Decoded, Rejection> {
    let film = &specification.image;
    let mut pixels = vec![[0.0; 3]; film.width as usize * film.height as usize];
    let place = |block: &_| place_pixels(block, film, &mut pixels);
    let header = read_guarded(bytes, specification, place)?;
    Ok(Decoded { header, pixels })
}

/// Checks the size that an image is said to have, given what it has to say of itself.
pub fn check_size(
    bytes: u64,
    specification: &Specification,
    header: &ImageHeader,
) -> Result<(), Rejection> {
    check_size_max(bytes, image_bytes_max(specification, header))
}

/// Checks that an image is no larger than `bytes_max`.
pub fn check_size_max(bytes: u64, bytes_max: u64) -> Result<(), Rejection> {
    if bytes > bytes_max {
        let expected = format_args!("at most {bytes_max}");
        return Err(layout("size in bytes", bytes, expected));
    }
    Ok(())
}

/// The largest file that an image can be which says this of itself, bytes: raw pixels and what the
/// renderer writes around them.
pub fn image_bytes_max(specification: &Specification, header: &ImageHeader) -> u64 {
    let file_header = image_file_header(specification, header);
    image_file_bytes_max(specification, file_header.len() as u64)
}

fn read_guarded(
    bytes: &[u8],
    specification: &Specification,
    visit: impl FnMut(&UncompressedBlock),
) -> Result<ImageHeader, Rejection> {
    // The decoder is not ours: should some input make it panic, it is a bad image like any other,
    // and what was visited of it is dropped.
    panic::catch_unwind(AssertUnwindSafe(|| {
        read_unguarded(bytes, specification, visit)
    }))
    .unwrap_or_else(|_| {
        Err(Rejection::Unreadable(
            "the decoder gave up on it".to_owned(),
        ))
    })
}

/// What the images of a material have to say of themselves, view by view.
pub fn expected_headers(
    specification: &Specification,
    specification_hash: Digest,
    material: u32,
) -> Vec<ImageHeader> {
    let parameters = specification.material(material).material;
    (0..specification.views.len() as u32)
        .map(|view| ImageHeader {
            specification: specification_hash.to_string(),
            seed: specification.seed,
            material: Some(material),
            view,
            parameters,
            tint: specification.tint,
            renderer_version: RENDERER_VERSION.to_owned(),
        })
        .collect()
}

/// Checks that an image is the one that was asked for.
pub fn check_identity(header: &ImageHeader, expected: &ImageHeader) -> Result<(), Rejection> {
    if header == expected {
        return Ok(());
    }
    let properties = [
        (
            "specification",
            format!("{:?}", header.specification),
            format!("{:?}", expected.specification),
        ),
        (
            "renderer version",
            format!("{:?}", header.renderer_version),
            format!("{:?}", expected.renderer_version),
        ),
        (
            "material",
            format!("{:?}", header.material),
            format!("{:?}", expected.material),
        ),
        ("view", header.view.to_string(), expected.view.to_string()),
        ("seed", header.seed.to_string(), expected.seed.to_string()),
        (
            "tint",
            format!("{:?}", header.tint),
            format!("{:?}", expected.tint),
        ),
    ];
    let different = properties
        .into_iter()
        .find(|(_, found, expected)| found != expected);
    let (what, found, expected) = different.unwrap_or_else(|| {
        (
            "material parameters",
            format!("{:?}", header.parameters),
            format!("{:?}", expected.parameters),
        )
    });
    Err(Rejection::Identity {
        what,
        found,
        expected,
    })
}

fn read_unguarded(
    bytes: &[u8],
    specification: &Specification,
    mut visit: impl FnMut(&UncompressedBlock),
) -> Result<ImageHeader, Rejection> {
    let unreadable = |error: exr::error::Error| Rejection::Unreadable(error.to_string());
    let reader = exr::block::read(Cursor::new(bytes), true).map_err(unreadable)?;
    let [header] = reader.headers() else {
        let layers = reader.headers().len();
        return Err(layout("number of layers", layers, 1));
    };
    let film = &specification.image;
    check_layout(header, film)?;
    let identity = read_identity(header)?;
    exact_file::check(bytes, specification, &identity)?;
    let description = reader.meta_data().clone();
    let mut blocks = 0;
    for chunk in reader.all_chunks(true).map_err(unreadable)? {
        let chunk = chunk.map_err(unreadable)?;
        let block =
            UncompressedBlock::decompress_chunk(chunk, &description, true).map_err(unreadable)?;
        check_pixels(&block, film)?;
        visit(&block);
        blocks += 1;
    }
    same("number of blocks", blocks, film_blocks(film))?;
    Ok(identity)
}

fn check_layout(header: &Header, film: &Image) -> Result<(), Rejection> {
    let size = (header.layer_size.0, header.layer_size.1);
    let film_size = (film.width as usize, film.height as usize);
    same("data window's size", size, film_size)?;
    let corner = header.own_attributes.layer_position;
    same("data window's corner", (corner.0, corner.1), (0, 0))?;
    let display = header.shared_attributes.display_window;
    same(
        "display window",
        (
            display.position.0,
            display.position.1,
            display.size.0,
            display.size.1,
        ),
        (0, 0, film_size.0, film_size.1),
    )?;
    same("block layout", header.blocks, BlockDescription::ScanLines)?;
    same("compression", header.compression, Compression::ZIP16)?;
    same("line order", header.line_order, LineOrder::Increasing)?;
    same("depth", header.deep, false)?;
    same("number of blocks", header.chunk_count, film_blocks(film))?;
    let sample_type = match film.pixel {
        Pixel::Half => SampleType::F16,
        Pixel::Float => SampleType::F32,
    };
    let names: Vec<String> = header
        .channels
        .list
        .iter()
        .map(|channel| channel.name.to_string())
        .collect();
    same(
        "list of channels",
        names,
        ["B", "G", "R"].map(str::to_owned).to_vec(),
    )?;
    for channel in &header.channels.list {
        same("pixel type", channel.sample_type, sample_type)?;
        same(
            "channel sampling",
            (channel.sampling.0, channel.sampling.1),
            (1, 1),
        )?;
    }
    Ok(())
}

fn film_blocks(film: &Image) -> usize {
    film.height.div_ceil(IMAGE_BLOCK_LINES) as usize
}

fn read_identity(header: &Header) -> Result<ImageHeader, Rejection> {
    let name = Text::from(IMAGE_HEADER_ATTRIBUTE);
    let own = header.own_attributes.other.get(&name);
    let value = own.or_else(|| header.shared_attributes.other.get(&name));
    let text = match value {
        Some(AttributeValue::Text(text)) => text.to_string(),
        Some(_) => return Err(Rejection::Attribute("is no text".to_owned())),
        None => return Err(Rejection::Attribute("is missing".to_owned())),
    };
    if text.len() > IMAGE_HEADER_BYTES_MAX {
        return Err(Rejection::Attribute(format!(
            "has {} bytes, more than {IMAGE_HEADER_BYTES_MAX}",
            text.len()
        )));
    }
    serde_json::from_str(&text)
        .map_err(|error| Rejection::Attribute(format!("is no image header: {error}")))
}

/// Copies a block's pixels to their places. A line is all of blue, all of green, all of red.
fn place_pixels(block: &UncompressedBlock, film: &Image, pixels: &mut [[f32; 3]]) {
    let width = film.width as usize;
    let channel_bytes = width * film.pixel.bytes() as usize;
    let lines = block.data.chunks_exact(3 * channel_bytes);
    let places = pixels.chunks_exact_mut(width);
    let mut values = vec![0.0; width];
    for (line, places) in lines.zip(places.skip(block.index.pixel_position.1)) {
        for (samples, channel) in line.chunks_exact(channel_bytes).zip([2, 1, 0]) {
            read_samples(samples, film.pixel, &mut values);
            for (place, value) in places.iter_mut().zip(&values) {
                place[channel] = *value;
            }
        }
    }
}

/// Reads samples of a type, one for each value.
fn read_samples(samples: &[u8], pixel: Pixel, values: &mut [f32]) {
    match pixel {
        Pixel::Half => {
            for (value, bytes) in values.iter_mut().zip(samples.as_chunks().0) {
                *value = f16::from_ne_bytes(*bytes).to_f32_const();
            }
        }
        Pixel::Float => {
            for (value, bytes) in values.iter_mut().zip(samples.as_chunks().0) {
                *value = f32::from_ne_bytes(*bytes);
            }
        }
    }
}

/// Every value finite and not below zero, told from the bits: all exponent bits set is infinite or
/// no number; the sign bit with anything beside it is negative.
pub(crate) fn check_pixels(block: &UncompressedBlock, film: &Image) -> Result<(), Rejection> {
    let bytes_per_line = 3 * film.width as usize * film.pixel.bytes() as usize;
    for (row, line) in block.data.chunks(bytes_per_line).enumerate() {
        let fault = match film.pixel {
            Pixel::Half => {
                let samples = line.as_chunks().0.iter();
                let samples = samples.map(|bytes| u16::from_ne_bytes(*bytes).into());
                fault(samples, 0x7c00, 0x8000)
            }
            Pixel::Float => {
                let samples = line.as_chunks().0.iter();
                let samples = samples.map(|bytes| u32::from_ne_bytes(*bytes));
                fault(samples, 0x7f80_0000, 0x8000_0000)
            }
        };
        if let Some(what) = fault {
            let line = block.index.pixel_position.1 + row;
            return Err(Rejection::Pixel { line, what });
        }
    }
    Ok(())
}

/// What is wrong with samples, of whose bits these are the exponent and the sign.
#[inline(always)]
fn fault(samples: impl Iterator<Item = u32>, exponent: u32, sign: u32) -> Option<&'static str> {
    let nothing = [false; 2];
    let found = samples.fold(nothing, |[is_infinite, is_negative], bits| {
        // Without branches: nearly all samples are right.
        [
            is_infinite | (bits & exponent == exponent),
            is_negative | (bits > sign),
        ]
    });
    match found {
        [true, _] => Some("not finite"),
        [_, true] => Some("negative"),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use exr::{block::BlockIndex, math::Vec2};

    /// A block of two lines that begins at line 3 of a film of 8 columns.
    fn block(pixel: Pixel, samples: &[u32; 48]) -> (UncompressedBlock, Image) {
        let film = Image {
            width: 8,
            height: 5,
            pixel,
        };
        let bytes = film.pixel.bytes() as usize;
        let of_sample = |sample: &u32| match pixel {
            Pixel::Half => (*sample as u16).to_ne_bytes().to_vec(),
            Pixel::Float => sample.to_ne_bytes().to_vec(),
        };
        let data: Vec<u8> = samples.iter().flat_map(of_sample).collect();
        assert_eq!(data.len(), 48 * bytes);
        let index = BlockIndex {
            layer: 0,
            pixel_position: Vec2(0, 3),
            pixel_size: Vec2(8, 2),
            level: Vec2(0, 0),
        };
        (UncompressedBlock { index, data }, film)
    }

    fn value(pixel: Pixel, sample: u32) -> f32 {
        match pixel {
            Pixel::Half => f16::from_bits(sample as u16).to_f32(),
            Pixel::Float => f32::from_bits(sample),
        }
    }

    /// Every half, and floats all over, at every place of a block.
    #[test]
    fn samples_that_are_no_light_are_found_wherever_they_are() {
        let halves = (0..=0xffff).map(|bits| (Pixel::Half, bits));
        let floats = (0..=0xffff).flat_map(|high| [0, 1, 0xffff].map(|low| high << 16 | low));
        let floats = floats.map(|bits| (Pixel::Float, bits));
        for (count, (pixel, bits)) in halves.chain(floats).enumerate() {
            let place = count % 48;
            let mut samples = [0; 48];
            samples[place] = bits;
            let (block, film) = block(pixel, &samples);
            let value = value(pixel, bits);
            let expected = match (value.is_finite(), value < 0.0) {
                (false, _) => Some("not finite"),
                (true, true) => Some("negative"),
                (true, false) => None,
            };
            let found = match check_pixels(&block, &film) {
                Ok(()) => None,
                Err(Rejection::Pixel { line, what }) => {
                    assert_eq!(line, 3 + place / 24);
                    Some(what)
                }
                Err(other) => panic!("{other}"),
            };
            assert_eq!(found, expected, "{value}");
        }
    }

    #[test]
    fn a_block_lands_where_it_belongs() {
        for pixel in [Pixel::Half, Pixel::Float] {
            let samples = std::array::from_fn(|place| match pixel {
                Pixel::Half => u32::from(f16::from_f32(place as f32 / 64.0).to_bits()),
                Pixel::Float => (place as f32 / 64.0).to_bits(),
            });
            let (block, film) = block(pixel, &samples);
            let mut pixels = vec![[-1.0; 3]; 40];
            place_pixels(&block, &film, &mut pixels);
            for (index, found) in pixels.iter().enumerate() {
                let [row, column] = [index / 8, index % 8];
                let expected = match row {
                    3.. => {
                        [2, 1, 0].map(|plane| ((row - 3) * 24 + plane * 8 + column) as f32 / 64.0)
                    }
                    _ => [-1.0; 3],
                };
                assert_eq!(*found, expected, "{row} {column}");
            }
        }
    }
}

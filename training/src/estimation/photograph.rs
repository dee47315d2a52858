//! A photograph as linear light.

use crate::error::{TrainingError, bad_input};
use dataset::colour::linear_from_srgb;
use dataset::{IMAGE_HEADER_ATTRIBUTE, ImageHeader};
use export::file::unable;
use exr::prelude::{ReadChannels, ReadLayers, Text, Vec2, attribute::AttributeValue};
use image::{ImageReader, Limits};
use std::fs;
use std::io::Cursor;
use std::path::Path;

/// The most pixels of a photograph.
const PIXELS_MAX: usize = 1 << 26;

/// The most bytes that a decoder may take.
const DECODER_BYTES_MAX: u64 = 1 << 30;

/// How an OpenEXR file begins.
const EXR_MAGIC: [u8; 4] = [0x76, 0x2f, 0x31, 0x01];

/// The largest code of 16 bits; those of 8 bits are spread over the same range.
const CODE_MAX: f64 = 65535.0;

/// A photograph.
#[derive(Clone, Debug, PartialEq)]
pub struct Photograph {
    /// Columns and rows.
    pub size: [u32; 2],
    /// Linear Rec.709, row by row from the top; 1 is white.
    pub pixels: Vec<[f32; 3]>,
    /// Which pixels have a channel at the largest code: what is there was as bright or brighter.
    pub clipped: Vec<bool>,
    /// What brdfarm wrote into an image that it rendered.
    pub header: Option<ImageHeader>,
}

impl Photograph {
    /// Reads OpenEXR, whose values are linear, or PNG or JPEG, whose codes are taken as sRGB.
    ///
    /// # Errors
    /// When the file is missing, is none of these, is too large, or has a value that is negative or
    /// not finite.
    pub fn read(path: &Path) -> Result<Self, TrainingError> {
        let bytes = fs::read(path).map_err(|error| match error.kind() {
            std::io::ErrorKind::NotFound => bad_input(path, "there is no such file"),
            _ => unable("read", path)(error).into(),
        })?;
        match bytes.starts_with(&EXR_MAGIC) {
            true => read_exr(path, &bytes),
            false => read_codes(path, bytes),
        }
    }

    /// Whether a point lies on it.
    pub fn contains(&self, [x, y]: [f64; 2]) -> bool {
        let [width, height] = self.size.map(f64::from);
        (0.0..=width).contains(&x) && (0.0..=height).contains(&y)
    }
}

fn too_large(path: &Path, [width, height]: [usize; 2]) -> TrainingError {
    bad_input(
        path,
        format!("{width} x {height} pixels, where {PIXELS_MAX} in all are the most"),
    )
}

fn read_exr(path: &Path, bytes: &[u8]) -> Result<Photograph, TrainingError> {
    // A header may claim any size: what is too large stays empty.
    let read = exr::prelude::read()
        .no_deep_data()
        .largest_resolution_level()
        .rgb_channels(
            |size: Vec2<usize>, _| {
                let fits = size.width().saturating_mul(size.height()) <= PIXELS_MAX;
                let count = if fits { size.area() } else { 0 };
                ([size.width(), size.height()], vec![[0.0; 3]; count])
            },
            |(size, pixels): &mut ([usize; 2], Vec<[f32; 3]>),
             position,
             (r, g, b): (f32, f32, f32)| {
                if let Some(pixel) = pixels.get_mut(position.y() * size[0] + position.x()) {
                    *pixel = [r, g, b];
                }
            },
        )
        .first_valid_layer()
        .all_attributes()
        .non_parallel()
        .from_buffered(Cursor::new(bytes));
    let image = read.map_err(|error| bad_input(path, format!("no OpenEXR image: {error}")))?;
    let (size, pixels) = image.layer_data.channel_data.pixels;
    if pixels.is_empty() {
        return Err(too_large(path, size));
    }
    let unsound = |pixel: &[f32; 3]| pixel.iter().any(|v| !v.is_finite() || *v < 0.0);
    if let Some(place) = pixels.iter().position(unsound) {
        let (column, row) = (place % size[0], place / size[0]);
        let value = pixels[place];
        return Err(bad_input(
            path,
            format!("pixel ({column}, {row}) is {value:?}: light is finite and not negative"),
        ));
    }
    let attribute = image
        .layer_data
        .attributes
        .other
        .get(&Text::from(IMAGE_HEADER_ATTRIBUTE));
    let header = attribute.and_then(|value| match value {
        AttributeValue::Text(text) => serde_json::from_str(&text.to_string()).ok(),
        _ => None,
    });
    Ok(Photograph {
        size: size.map(|side| side as u32),
        clipped: vec![false; pixels.len()],
        pixels,
        header,
    })
}

fn read_codes(path: &Path, bytes: Vec<u8>) -> Result<Photograph, TrainingError> {
    let no_image = |error: &dyn std::fmt::Display| {
        bad_input(path, format!("no OpenEXR, PNG or JPEG image: {error}"))
    };
    let mut reader = ImageReader::new(Cursor::new(bytes))
        .with_guessed_format()
        .map_err(|error| no_image(&error))?;
    let mut limits = Limits::default();
    limits.max_alloc = Some(DECODER_BYTES_MAX);
    reader.limits(limits);
    let image = reader.decode().map_err(|error| no_image(&error))?;
    let size = [image.width(), image.height()];
    if size[0] as usize * size[1] as usize > PIXELS_MAX {
        return Err(too_large(path, size.map(|side| side as usize)));
    }
    let codes = image.into_rgb16();
    let linear: Vec<f32> = (0..=u16::MAX)
        .map(|code| linear_from_srgb(f64::from(code) / CODE_MAX) as f32)
        .collect();
    let pixels = codes.pixels();
    Ok(Photograph {
        size,
        clipped: pixels
            .clone()
            .map(|pixel| pixel.0.contains(&u16::MAX))
            .collect(),
        pixels: pixels
            .map(|pixel| pixel.0.map(|code| linear[usize::from(code)]))
            .collect(),
        header: None,
    })
}

//! Rectified images as OpenEXR, laid out like the images that they come from.
//!
//! One attribute of JSON says what they are: the encoder writes several unknown ones in random
//! order.

use super::Picture;
use crate::error::ExportError;
use dataset::{CompletedView, ImageHeader, specification::Pixel};
use exr::prelude::*;
use half::f16;
use serde::Serialize;
use std::io::Cursor;

/// The attribute's name. Not the images' own: a rectified image is no image of the dataset.
const ATTRIBUTE: &str = "brdfarm_rectified";

#[derive(Serialize)]
struct Origin<'a> {
    /// The image that it was made of.
    image: &'a ImageHeader,
    digest: String,
    filter: &'static str,
}

/// Encodes a square. At its border a value is divided by a coverage: what rounding lifts above the
/// largest 16-bit float is set to it.
pub(super) fn encode(
    picture: &Picture,
    header: &ImageHeader,
    done: &CompletedView,
) -> std::result::Result<Vec<u8>, ExportError> {
    match picture.pixel {
        Pixel::Half => encode_as(picture, header, done, |value| {
            f16::from_f32_const(value.min(f16::MAX.to_f32_const()))
        }),
        Pixel::Float => encode_as(picture, header, done, |value| value),
    }
}

fn encode_as<T: IntoSample + Copy + Default>(
    picture: &Picture,
    header: &ImageHeader,
    done: &CompletedView,
    convert: impl Fn(f32) -> T + Sync,
) -> std::result::Result<Vec<u8>, ExportError> {
    let width = picture.width as usize;
    let channels = SpecificChannels::rgb(|position: Vec2<usize>| {
        let value = picture.values[position.y() * width + position.x()];
        let [red, green, blue] = value.map(&convert);
        (red, green, blue)
    });
    let origin = Origin {
        image: header,
        digest: done.digest.to_string(),
        filter: "area on the sample, exact, divided by coverage",
    };
    let origin = serde_json::to_string(&origin).map_err(ExportError::encode("a header"))?;
    let mut attributes = LayerAttributes {
        software_name: Some(Text::from("brdfarm")),
        ..LayerAttributes::default()
    };
    attributes.other.insert(
        Text::from(ATTRIBUTE),
        AttributeValue::Text(Text::from(origin.as_str())),
    );
    let encoding = Encoding {
        compression: Compression::ZIP16,
        blocks: Blocks::ScanLines,
        line_order: LineOrder::Increasing,
    };
    let size = (width, picture.height as usize);
    let mut image = Image::from_layer(Layer::new(size, attributes, encoding, channels));
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
        .to_buffered(Cursor::new(&mut bytes))
        .map_err(ExportError::encode("a rectified image"))?;
    Ok(bytes)
}

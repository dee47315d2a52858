//! Images that are cheap to make and look to a coordinator like rendered ones: the film, layout and
//! header of the dataset, and pixels that are a function of material and view.

use dataset::{
    IMAGE_HEADER_ATTRIBUTE, ImageHeader, Specification,
    specification::{Image, Pixel},
};
use exr::prelude::{Image as ExrImage, *};
use imagestore::validation::expected_headers;
use std::io::Cursor;

/// How an image is encoded; [`Cheap::new`] is as the renderer does it.
pub struct Cheap {
    pub film: Image,
    pub header: String,
    pub attribute: &'static str,
    pub channels: &'static [&'static str],
    pub encoding: Encoding,
    pub value: f32,
}

/// A small dataset: 16 x 20 pixels, three views.
pub fn small_specification(materials: u32) -> Specification {
    let mut specification = Specification::preset();
    specification.materials = materials;
    specification.image.width = 16;
    specification.image.height = 20;
    specification.views.truncate(3);
    specification
}

/// The image of a material's view.
pub fn cheap_image(specification: &Specification, material: u32, view: u32) -> Vec<u8> {
    Cheap::new(specification, material, view).encode()
}

impl Cheap {
    pub fn new(specification: &Specification, material: u32, view: u32) -> Self {
        let headers = expected_headers(specification, specification.hash(), material);
        let header: &ImageHeader = &headers[view as usize];
        Self {
            film: specification.image.clone(),
            header: serde_json::to_string(header).unwrap(),
            attribute: IMAGE_HEADER_ATTRIBUTE,
            channels: &["B", "G", "R"],
            encoding: Encoding {
                compression: Compression::ZIP16,
                blocks: Blocks::ScanLines,
                line_order: LineOrder::Increasing,
            },
            value: 1.0 + (material % 100) as f32 + view as f32 / 16.0,
        }
    }

    pub fn encode(&self) -> Vec<u8> {
        let (width, height) = (self.film.width as usize, self.film.height as usize);
        let samples = |channel: usize| {
            let level = self.value / (channel + 1) as f32;
            let values = (0..width * height).map(|place| level * (place % width) as f32);
            match self.film.pixel {
                Pixel::Half => FlatSamples::F16(values.map(f16::from_f32).collect()),
                Pixel::Float => FlatSamples::F32(values.collect()),
            }
        };
        let channels = self.channels.iter().enumerate();
        let channels = channels
            .map(|(number, name)| AnyChannel::new(*name, samples(number)))
            .collect();
        let mut attributes = LayerAttributes::default();
        attributes.other.insert(
            Text::from(self.attribute),
            AttributeValue::Text(Text::from(self.header.as_str())),
        );
        let channels = AnyChannels::sort(channels);
        let layer = Layer::new((width, height), attributes, self.encoding, channels);
        let mut bytes = Vec::new();
        ExrImage::from_layer(layer)
            .write()
            .non_parallel()
            .to_buffered(Cursor::new(&mut bytes))
            .unwrap();
        bytes
    }
}

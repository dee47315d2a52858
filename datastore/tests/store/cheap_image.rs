//! Images that are cheap to make and look to a coordinator like rendered ones: the film, layout and
//! header of the dataset, and pixels that are a function of material and view.

use dataset::{
    IMAGE_HEADER_ATTRIBUTE, IMAGE_SOFTWARE, ImageHeader, REC709_CHROMATICITIES, Specification,
    specification::{Image, Pixel},
};
use exr::{
    image::write::channels::WritableChannels,
    prelude::{Image as ExrImage, *},
};
use imagestore::validation::expected_headers;
use std::io::Cursor;

/// How an image is encoded; [`Cheap::new`] is as the renderer does it.
pub struct Cheap {
    pub film: Image,
    pub header: String,
    pub attribute: &'static str,
    pub white_luminance: f32,
    pub channels: &'static [&'static str],
    pub encoding: Encoding,
    pub value: f32,
    /// Not 0: seeds pixels that do not compress.
    pub noise: u64,
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
            white_luminance: specification.white_luminance() as f32,
            channels: &["B", "G", "R"],
            encoding: Encoding {
                compression: Compression::ZIP16,
                blocks: Blocks::ScanLines,
                line_order: LineOrder::Increasing,
            },
            value: 1.0 + (material % 100) as f32 + view as f32 / 16.0,
            noise: 0,
        }
    }

    pub fn encode(&self) -> Vec<u8> {
        let (width, height) = (self.film.width as usize, self.film.height as usize);
        let samples = |channel: usize| {
            let level = self.value / (channel + 1) as f32;
            let values = (0..width * height).map(|place| match self.noise {
                0 => level * (place % width) as f32,
                seed => noise(seed, (channel * width * height + place) as u64),
            });
            match self.film.pixel {
                Pixel::Half => FlatSamples::F16(values.map(f16::from_f32).collect()),
                Pixel::Float => FlatSamples::F32(values.collect()),
            }
        };
        let channels = self.channels.iter().enumerate();
        let channels = channels
            .map(|(number, name)| AnyChannel::new(*name, samples(number)))
            .collect();
        let attributes = attributes(self.attribute, &self.header, self.white_luminance);
        let channels = AnyChannels::sort(channels);
        let layer = Layer::new((width, height), attributes, self.encoding, channels);
        file(layer)
    }
}

/// The attributes that the renderer gives an image.
pub fn attributes(name: &str, header: &str, white_luminance: f32) -> LayerAttributes {
    let mut attributes = LayerAttributes {
        software_name: Some(Text::from(IMAGE_SOFTWARE)),
        white_luminance: Some(white_luminance),
        ..LayerAttributes::default()
    };
    let header = AttributeValue::Text(Text::from(header));
    attributes.other.insert(Text::from(name), header);
    attributes
}

/// The file of an image.
pub fn file<Channels: for<'a> WritableChannels<'a>>(layer: Layer<Channels>) -> Vec<u8> {
    let mut image = ExrImage::from_layer(layer);
    let [red, green, blue, white] =
        [0, 2, 4, 6].map(|at| Vec2(REC709_CHROMATICITIES[at], REC709_CHROMATICITIES[at + 1]));
    image.attributes.chromaticities = Some(attribute::Chromaticities {
        red,
        green,
        blue,
        white,
    });
    let mut bytes = Vec::new();
    let written = image.write().non_parallel();
    written.to_buffered(Cursor::new(&mut bytes)).unwrap();
    bytes
}

/// A number from 0 to 60,000 that is a function of its place, and of which nothing compresses.
fn noise(seed: u64, place: u64) -> f32 {
    // The finaliser of SplitMix64.
    let mut bits = seed.wrapping_add(place.wrapping_mul(0x9e37_79b9_7f4a_7c15));
    bits = (bits ^ (bits >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    bits = (bits ^ (bits >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    bits ^= bits >> 31;
    f16::from_bits((bits % 0x7b00) as u16).to_f32()
}

/// An image of a material's view that is nearly as large as raw pixels.
pub fn noisy_image(specification: &Specification, material: u32, view: u32) -> Vec<u8> {
    let mut cheap = Cheap::new(specification, material, view);
    cheap.noise = 1 + (u64::from(material) << 8 | u64::from(view));
    cheap.encode()
}

//! A picture to draw on.

use anyhow::Context;
use png::{BitDepth, ColorType, Encoder, SrgbRenderingIntent};

/// A picture of 8-bit sRGB, row by row from the top.
pub struct Canvas {
    width: u32,
    height: u32,
    pixels: Vec<[u8; 3]>,
}

impl Canvas {
    /// A picture of one colour.
    pub fn filled(width: u32, height: u32, colour: [u8; 3]) -> Self {
        Self {
            width,
            height,
            pixels: vec![colour; width as usize * height as usize],
        }
    }

    /// Gives a pixel a colour; what is outside the picture is cut off.
    pub fn put(&mut self, x: u32, y: u32, colour: [u8; 3]) {
        if x < self.width && y < self.height {
            self.pixels[(y as usize) * self.width as usize + x as usize] = colour;
        }
    }

    /// The picture as PNG.
    pub fn to_png(&self) -> anyhow::Result<Vec<u8>> {
        let mut bytes = Vec::new();
        let mut encoder = Encoder::new(&mut bytes, self.width, self.height);
        encoder.set_color(ColorType::Rgb);
        encoder.set_depth(BitDepth::Eight);
        encoder.set_source_srgb(SrgbRenderingIntent::RelativeColorimetric);
        let mut writer = encoder
            .write_header()
            .context("cannot encode the picture")?;
        writer
            .write_image_data(self.pixels.as_flattened())
            .and_then(|()| writer.finish())
            .context("cannot encode the picture")?;
        Ok(bytes)
    }
}

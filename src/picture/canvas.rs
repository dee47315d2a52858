//! A picture to draw on.

use ::picture::encode_png;
use anyhow::Context;

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

    /// The pixels.
    pub fn into_pixels(self) -> Vec<[u8; 3]> {
        self.pixels
    }

    /// The picture as PNG.
    pub fn to_png(&self) -> anyhow::Result<Vec<u8>> {
        encode_png(self.width, self.height, &self.pixels, &[]).context("cannot encode the picture")
    }
}

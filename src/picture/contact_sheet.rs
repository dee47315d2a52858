//! Many images on one sheet: a row a material, a column a view, both numbered.

use super::{canvas::Canvas, digits};
use ::picture::to_srgb8;

/// Between tiles, in pixels.
const GAP: u32 = 4;

/// The longest side of a sheet that is written, in pixels.
const SIDE_MAX: u32 = 1 << 15;

/// A sheet under construction.
pub struct ContactSheet {
    picture: Canvas,
    tile: [u32; 2],
    margin: [u32; 2],
    exposure_stops: f64,
}

impl ContactSheet {
    /// An empty sheet for `materials` (rows) and `views` (columns) of `tile` pixels each.
    pub fn new(
        materials: &[u32],
        views: &[u32],
        tile: [u32; 2],
        exposure_stops: f64,
    ) -> anyhow::Result<Self> {
        let label = materials
            .iter()
            .map(|&m| digits::width(m))
            .max()
            .unwrap_or(0);
        let margin = [label + 2 * GAP, digits::HEIGHT + 2 * GAP];
        let side = |margin: u32, count: usize, tile: u32| {
            u32::try_from(count)
                .ok()
                .and_then(|count| count.checked_mul(tile + GAP)?.checked_add(margin))
                .filter(|&side| side <= SIDE_MAX)
        };
        let (Some(width), Some(height)) = (
            side(margin[0], views.len(), tile[0]),
            side(margin[1], materials.len(), tile[1]),
        ) else {
            anyhow::bail!(
                "{} materials by {} views make a sheet longer than {SIDE_MAX} pixels: choose fewer",
                materials.len(),
                views.len()
            );
        };
        let mut picture = Canvas::filled(width, height, [32; 3]);
        for (column, &view) in (0..).zip(views) {
            let centre = margin[0] + column * (tile[0] + GAP) + tile[0] / 2;
            let left = centre.saturating_sub(digits::width(view) / 2);
            digits::draw(&mut picture, view, left, GAP);
        }
        for (row, &material) in (0..).zip(materials) {
            let centre = margin[1] + row * (tile[1] + GAP) + tile[1] / 2;
            let top = centre.saturating_sub(digits::HEIGHT / 2);
            let left = margin[0] - GAP - digits::width(material);
            digits::draw(&mut picture, material, left, top);
        }
        Ok(Self {
            picture,
            tile,
            margin,
            exposure_stops,
        })
    }

    /// Puts an image (linear Rec.709, row by row) at a place of the sheet.
    pub fn place(&mut self, row: u32, column: u32, values: &[[f64; 3]]) {
        let [width, height] = self.tile;
        let left = self.margin[0] + column * (width + GAP);
        let top = self.margin[1] + row * (height + GAP);
        for (index, &value) in (0..width * height).zip(values) {
            self.picture.put(
                left + index % width,
                top + index / width,
                to_srgb8(value, self.exposure_stops),
            );
        }
    }

    /// The sheet as PNG.
    pub fn finish(&self) -> anyhow::Result<Vec<u8>> {
        self.picture.to_png()
    }
}

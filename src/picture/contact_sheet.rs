//! Many images on one sheet: a row a material, a column a view, both numbered.

use super::{canvas::Canvas, digits};
use ::picture::{encode_png_by_bands, to_srgb8};
use std::iter;

/// Between tiles, in pixels.
const GAP: u32 = 4;

/// The longest side of a sheet that is written, in pixels.
const SIDE_MAX: u32 = 1 << 15;

/// Where everything is on a sheet. Its pixels are made a row of tiles at a time.
pub struct ContactSheet<'a> {
    materials: &'a [u32],
    views: &'a [u32],
    tile: [u32; 2],
    /// From a tile to the next, along columns and rows. Numbers fit as well, however small tiles are.
    pitch: [u32; 2],
    margin: [u32; 2],
    sides: [u32; 2],
    exposure_stops: f64,
}

/// A row of tiles.
pub struct Band<'a> {
    sheet: &'a ContactSheet<'a>,
    canvas: Canvas,
}

impl<'a> ContactSheet<'a> {
    /// A sheet for `materials` (rows) and `views` (columns) of `tile` pixels each.
    pub fn new(
        materials: &'a [u32],
        views: &'a [u32],
        tile: [u32; 2],
        exposure_stops: f64,
    ) -> anyhow::Result<Self> {
        let widest = |numbers: &[u32]| numbers.iter().map(|&n| digits::width(n)).max().unwrap_or(0);
        let margin = [widest(materials) + 2 * GAP, digits::HEIGHT + 2 * GAP];
        let pitch = [
            tile[0].max(widest(views)) + GAP,
            tile[1].max(digits::HEIGHT) + GAP,
        ];
        let side = |axis: usize, count: usize| {
            u32::try_from(count)
                .ok()
                .and_then(|count| count.checked_mul(pitch[axis])?.checked_add(margin[axis]))
                .filter(|&side| side <= SIDE_MAX)
        };
        let (Some(width), Some(height)) = (side(0, views.len()), side(1, materials.len())) else {
            anyhow::bail!(
                "{} materials by {} views make a sheet longer than {SIDE_MAX} pixels: choose fewer",
                materials.len(),
                views.len()
            );
        };
        Ok(Self {
            materials,
            views,
            tile,
            pitch,
            margin,
            sides: [width, height],
            exposure_stops,
        })
    }

    /// The sheet as PNG. `fill` places the images of a material.
    pub fn to_png(
        &self,
        mut fill: impl FnMut(u32, &mut Band<'_>) -> anyhow::Result<()>,
    ) -> anyhow::Result<Vec<u8>> {
        let rows = self.materials.iter().map(|&material| {
            let mut band = self.band(material);
            fill(material, &mut band)?;
            Ok(band.canvas.into_pixels())
        });
        let bands = iter::once_with(|| Ok(self.numbers_of_views())).chain(rows);
        encode_png_by_bands::<anyhow::Error>(self.sides[0], self.sides[1], bands)
    }

    fn numbers_of_views(&self) -> Vec<[u8; 3]> {
        let mut canvas = self.blank(self.margin[1]);
        for (column, &view) in (0..).zip(self.views) {
            let centre = self.margin[0] + column * self.pitch[0] + self.tile[0] / 2;
            let left = centre.saturating_sub(digits::width(view) / 2);
            digits::draw(&mut canvas, view, left, GAP);
        }
        canvas.into_pixels()
    }

    fn band(&self, material: u32) -> Band<'_> {
        let mut canvas = self.blank(self.pitch[1]);
        let top = (self.tile[1] / 2).saturating_sub(digits::HEIGHT / 2);
        let left = self.margin[0] - GAP - digits::width(material);
        digits::draw(&mut canvas, material, left, top);
        Band {
            sheet: self,
            canvas,
        }
    }

    fn blank(&self, height: u32) -> Canvas {
        Canvas::filled(self.sides[0], height, [32; 3])
    }
}

impl Band<'_> {
    /// Puts an image (linear Rec.709, row by row) into a column.
    pub fn place(&mut self, column: u32, values: &[[f64; 3]]) {
        let ContactSheet {
            tile: [width, height],
            pitch,
            margin,
            exposure_stops,
            ..
        } = *self.sheet;
        let left = margin[0] + column * pitch[0];
        for (index, &value) in (0..width * height).zip(values) {
            let (x, y) = (left + index % width, index / width);
            self.canvas.put(x, y, to_srgb8(value, exposure_stops));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Tiles and numbers of a sheet of three materials and two views, one of them not there.
    fn sheet(tile: [u32; 2]) -> (u32, u32, Vec<u8>) {
        let sheet = ContactSheet::new(&[7, 88, 9], &[0, 13], tile, 0.0).unwrap();
        let png = sheet
            .to_png(|material, band| {
                let white = vec![[1.0; 3]; (tile[0] * tile[1]) as usize];
                band.place(0, &white);
                if material != 88 {
                    band.place(1, &white);
                }
                Ok(())
            })
            .unwrap();
        let image = image::load_from_memory(&png).unwrap().into_rgb8();
        (image.width(), image.height(), image.into_raw())
    }

    #[test]
    fn tiles_are_where_their_material_and_view_are() {
        for tile in [[1, 1], [5, 40], [30, 8], [128, 128]] {
            let (width, height, pixels) = sheet(tile);
            let white = pixels.chunks(3).filter(|&pixel| pixel == [255; 3]).count();
            assert_eq!(white as u32, 5 * tile[0] * tile[1], "{tile:?}");
            let ink = pixels.chunks(3).filter(|&pixel| pixel == [200; 3]).count();
            let (_, _, larger) = sheet([60, 60]);
            let all = larger.chunks(3).filter(|&pixel| pixel == [200; 3]).count();
            assert_eq!(ink, all, "{tile:?}: no number is cut off or hidden");
            assert!(width >= 2 * tile[0] && height >= 3 * tile[1]);
        }
    }

    #[test]
    fn a_sheet_that_would_be_too_long_is_refused() {
        let materials: Vec<u32> = (0..9000).collect();
        let error = ContactSheet::new(&materials, &[0], [128, 128], 0.0).err();
        assert!(error.unwrap().to_string().contains("choose fewer"));
    }
}

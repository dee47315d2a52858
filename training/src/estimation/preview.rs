//! A picture to look at: each photograph, its sample, and the sample as it was found, rendered.

use super::exposure::Gain;
use super::sample::Shot;
use crate::error::TrainingError;
use dataset::colour::srgb_from_linear;
use dataset::{Material, Specification};
use export::rectify::Rectifier;
use image::imageops::{FilterType, resize};
use image::{ImageFormat, Rgb, RgbImage};
use renderer::Renderer;
use renderer::geometry::BackendChoice;
use std::io::Cursor;

/// Pixels a side of a panel.
const PANEL: u32 = 256;

/// Pixels between panels.
const GAP: u32 = 8;

/// Panels in a row.
const COLUMNS: u32 = 3;

/// The tolerance of the renderings, relative to a pixel's value.
const RELATIVE_ACCURACY: f64 = 1e-2;

/// A row a photograph: the photograph, its sample as a square, and the sample of `material` rendered
/// in the same view at the same exposure. PNG.
pub(super) fn picture(
    specification: &Specification,
    views: [u32; 2],
    shots: &[Shot; 2],
    gains: [Gain; 2],
    material: &Material,
) -> Result<Vec<u8>, TrainingError> {
    let failed = |error: &dyn std::fmt::Display| TrainingError::Render(error.to_string());
    let mut film = specification.clone();
    (film.image.width, film.image.height) = (PANEL, PANEL);
    film.accuracy.relative = film.accuracy.relative.max(RELATIVE_ACCURACY);
    let renderer = Renderer::new(&film, BackendChoice::Native).map_err(|error| failed(&error))?;
    let size = |count: u32| count * PANEL + (count + 1) * GAP;
    let mut sheet = RgbImage::from_pixel(size(COLUMNS), size(2), Rgb([255; 3]));
    for (row, ((shot, view), gain)) in shots.iter().zip(views).zip(gains).enumerate() {
        let rendering = renderer
            .render(material, None, view)
            .map_err(|error| failed(&error))?;
        let pixels = rendering.film.pixels.iter();
        let pixels: Vec<[f32; 3]> = pixels
            .map(|pixel| std::array::from_fn(|c| (gain[c] * pixel.value[c]) as f32))
            .collect();
        let rectifier = Rectifier::new(&film, view, PANEL).map_err(|error| failed(&error))?;
        let panels = [
            whole(shot),
            developed(&shot.square(PANEL, [1.0; 3])?, [PANEL; 2]),
            developed(&rectifier.apply(&pixels), [PANEL; 2]),
        ];
        for (column, panel) in panels.iter().enumerate() {
            let place = |count: usize| i64::from(GAP) + count as i64 * i64::from(PANEL + GAP);
            image::imageops::replace(&mut sheet, panel, place(column), place(row));
        }
    }
    let mut png = Cursor::new(Vec::new());
    sheet
        .write_to(&mut png, ImageFormat::Png)
        .map_err(|error| failed(&error))?;
    Ok(png.into_inner())
}

/// The photograph within a panel.
fn whole(shot: &Shot) -> RgbImage {
    let photograph = &shot.photograph;
    let [width, height] = photograph.size;
    let full = developed(&photograph.pixels, [width, height]);
    let largest = f64::from(width.max(height));
    let scaled = |side: u32| ((f64::from(side) * f64::from(PANEL) / largest) as u32).max(1);
    let small = resize(&full, scaled(width), scaled(height), FilterType::Triangle);
    let mut panel = RgbImage::from_pixel(PANEL, PANEL, Rgb([255; 3]));
    image::imageops::replace(&mut panel, &small, 0, 0);
    panel
}

/// Linear pixels as sRGB codes.
fn developed(pixels: &[[f32; 3]], [width, height]: [u32; 2]) -> RgbImage {
    let code = |channel: f32| {
        let linear = f64::from(channel).clamp(0.0, 1.0);
        (255.0 * srgb_from_linear(linear)).round() as u8
    };
    RgbImage::from_fn(width, height, |x, y| {
        let pixel = pixels.get(y as usize * width as usize + x as usize);
        Rgb(pixel.copied().unwrap_or_default().map(code))
    })
}

//! Photographs made from films: another crop and tilt of the same camera, a gain, 8 bits.

use exr::prelude::*;
use image::{ImageFormat, Rgb, RgbImage};
use std::path::Path as FilePath;

/// Columns and rows of photographs.
pub const SIZE: [u32; 2] = [400, 300];

/// Pixels a side of the films.
pub const FILM_PIXELS: u32 = 512;

/// Their width at unit distance: three times the preset's, so that they show the chart.
pub const FILM_WIDTH: f64 = 0.72;

/// Points a side of a photograph's pixel at which the film is read.
const POINTS: u32 = 4;

pub type Point = [f64; 2];

/// Row-major, acts on (x, y, 1).
pub type Map = [[f64; 3]; 3];

/// A film: linear pixels, row by row.
pub struct Film {
    side: usize,
    pixels: Vec<[f32; 3]>,
}

impl Film {
    /// A square film that brdfarm rendered.
    pub fn read(path: &FilePath) -> Self {
        let image = read()
            .no_deep_data()
            .largest_resolution_level()
            .rgb_channels(
                |size: Vec2<usize>, _| (size.width(), vec![[0.0; 3]; size.area()]),
                |(width, pixels): &mut (usize, Vec<[f32; 3]>), at, (r, g, b): (f32, f32, f32)| {
                    pixels[at.y() * *width + at.x()] = [r, g, b];
                },
            )
            .first_valid_layer()
            .all_attributes()
            .non_parallel()
            .from_file(path)
            .unwrap();
        let (side, pixels) = image.layer_data.channel_data.pixels;
        Self { side, pixels }
    }

    /// The value at a point, linear between the centres of pixels; black beside the film.
    fn at(&self, [x, y]: Point) -> [f64; 3] {
        let (x, y) = (x - 0.5, y - 0.5);
        let (column, row) = (x.floor(), y.floor());
        let (s, t) = (x - column, y - row);
        let mut sum = [0.0; 3];
        for (dx, across) in [(0.0, 1.0 - s), (1.0, s)] {
            for (dy, down) in [(0.0, 1.0 - t), (1.0, t)] {
                let (x, y) = (column + dx, row + dy);
                let range = 0.0..self.side as f64;
                if range.contains(&x) && range.contains(&y) {
                    let pixel = self.pixels[y as usize * self.side + x as usize];
                    for (sum, value) in sum.iter_mut().zip(pixel) {
                        *sum += across * down * f64::from(value);
                    }
                }
            }
        }
        sum
    }

    /// A value that the share `share` of the pixels' channels within corners lies below.
    pub fn quantile(&self, corners: [Point; 4], share: f64) -> f64 {
        let inside = |place: usize| {
            let at = [place % self.side, place / self.side].map(|at| at as f64 + 0.5);
            (0..4).all(|corner| {
                let (a, b) = (corners[corner], corners[(corner + 1) % 4]);
                (b[0] - a[0]) * (at[1] - a[1]) <= (b[1] - a[1]) * (at[0] - a[0])
            })
        };
        let places = (0..self.pixels.len()).filter(|&place| inside(place));
        let mut values: Vec<f32> = places.flat_map(|place| self.pixels[place]).collect();
        values.sort_by(f32::total_cmp);
        f64::from(values[(share * (values.len() - 1) as f64) as usize])
    }

    /// Takes an 8-bit photograph: `film_from_photograph` says what it shows, `gain` how bright it is.
    pub fn photograph(&self, film_from_photograph: &Map, gain: [f64; 3], path: &FilePath) {
        let step = 1.0 / f64::from(POINTS);
        let image = RgbImage::from_fn(SIZE[0], SIZE[1], |column, row| {
            let mut sum = [0.0; 3];
            for point in 0..POINTS * POINTS {
                let offset =
                    [point % POINTS, point / POINTS].map(|at| step * (f64::from(at) + 0.5));
                let place = [f64::from(column) + offset[0], f64::from(row) + offset[1]];
                let value = self.at(project(film_from_photograph, place));
                for (sum, value) in sum.iter_mut().zip(value) {
                    *sum += value * step * step;
                }
            }
            Rgb(std::array::from_fn(|channel| {
                code(gain[channel] * sum[channel])
            }))
        });
        image.save_with_format(path, ImageFormat::Png).unwrap();
    }
}

/// The 8-bit sRGB code (IEC 61966-2-1) of linear light.
fn code(linear: f64) -> u8 {
    let linear = linear.clamp(0.0, 1.0);
    let code = if linear <= 0.003_130_8 {
        12.92 * linear
    } else {
        1.055 * libm::pow(linear, 1.0 / 2.4) - 0.055
    };
    (255.0 * code).round() as u8
}

pub fn project(map: &Map, [x, y]: Point) -> Point {
    let [u, v, w] = map.map(|line| line[0] * x + line[1] * y + line[2]);
    [u / w, v / w]
}

/// The inverse of a map, but for a factor.
pub fn inverse(m: &Map) -> Map {
    std::array::from_fn(|row| {
        std::array::from_fn(|column| {
            let (a, b) = ((column + 1) % 3, (row + 1) % 3);
            let (c, d) = ((column + 2) % 3, (row + 2) % 3);
            m[a][b] * m[c][d] - m[a][d] * m[c][b]
        })
    })
}

/// The preset's scene, seen by a camera at 0.5 m: a point in metres on a square film of
/// [`FILM_PIXELS`], [`FILM_WIDTH`] wide at unit distance.
fn on_film(elevation_deg: f64, [x, y, z]: [f64; 3]) -> Point {
    let (sine, cosine) = libm::sincos(elevation_deg.to_radians());
    let depth = 0.5 - (z * sine - y * cosine);
    let up = y * sine + z * cosine;
    let scale = f64::from(FILM_PIXELS) / FILM_WIDTH;
    let middle = 0.5 * f64::from(FILM_PIXELS);
    [middle + scale * x / depth, middle - scale * up / depth]
}

/// Corners as the command line takes them.
pub fn words(corners: [Point; 4]) -> String {
    let numbers = corners
        .iter()
        .flatten()
        .map(|number| format!("{number:.4}"));
    numbers.collect::<Vec<_>>().join(",")
}

/// The sample's corners on a film.
pub fn sample(elevation_deg: f64) -> [Point; 4] {
    [[-0.05, -0.05], [0.05, -0.05], [0.05, 0.05], [-0.05, 0.05]]
        .map(|[x, y]| on_film(elevation_deg, [x, y, 0.0]))
}

/// The chart's corners on a film: 4 x 6 patches of 0.04 m that rise at 38 degrees.
pub fn chart(elevation_deg: f64) -> [Point; 4] {
    let (sine, cosine) = libm::sincos(38_f64.to_radians());
    [[-0.08, 0.0], [0.08, 0.0], [0.08, 0.24], [-0.08, 0.24]]
        .map(|[x, up]| on_film(elevation_deg, [x, 0.055 + up * cosine, up * sine]))
}

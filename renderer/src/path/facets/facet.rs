//! A triangle that faces the camera: where it may be on the film, and how bright the bulb's light off it is
//! at most.

use super::light::{self, Known};
use super::spread::Spread;
use crate::reflectance::Reflectance;
use crate::scene::{Corners, PinholeCamera, Scene};
use crate::vector::Vec3;
use std::ops::Range;

/// By how much places on the film are rounded, in pixels.
const PLACE_ROUNDING: f64 = 1e-6;

/// By how much the area of a triangle on the film is rounded, in pixels squared.
const AREA_ROUNDING: f64 = 1e-9;

/// A triangle is divided where its bound is so many times what it would be if all of its normals were the
/// middle one.
const LOOSE: f64 = 1.25;

/// A triangle is not divided where its light is less than this, in units of white times pixels squared.
const LIGHT_MIN: f64 = 1e-3;

/// A triangle, or a part of one.
pub struct Facet {
    /// Where it may be on the film; `None` where that may be anywhere.
    pub on_film: Option<OnFilm>,
    /// At most the radiance of the bulb's light off it, in any channel.
    pub brightest: f64,
    /// Whether parts of it would have a smaller bound.
    pub is_loose: bool,
}

impl Facet {
    /// What is known of a triangle that faces the camera.
    pub fn new(scene: &Scene, reflectance: &Reflectance, corners: &Corners) -> Self {
        let on_film = OnFilm::new(&scene.camera, corners.positions);
        let bulb = &scene.bulb;
        let Some(known) = known(scene, corners) else {
            return Self {
                on_film,
                brightest: bulb.radiance,
                is_loose: true,
            };
        };
        let brightest = light::brightest(reflectance, bulb.radiance, &known);
        let area = on_film.as_ref().map_or(0.0, |on_film| on_film.area);
        let is_loose = brightest * area.min(1.0) > LIGHT_MIN && {
            let flat = light::brightest(reflectance, bulb.radiance, &known.flat());
            brightest > LOOSE * flat
        };
        Self {
            on_film,
            brightest,
            is_loose,
        }
    }
}

/// What is known of the points of a triangle; `None` where its normals are all around.
fn known(scene: &Scene, corners: &Corners) -> Option<Known> {
    let [a, b, c] = corners.positions;
    let middle = (a + b + c) * (1.0 / 3.0);
    let extents = corners.positions.map(|corner| (corner - middle).length());
    let extent = extents.into_iter().fold(0.0, f64::max);
    let bulb = &scene.bulb;
    let to_centre = bulb.centre - middle;
    let nearest = to_centre.length() - extent;
    Some(Known {
        to_eye: Spread::toward(scene.camera.position - middle, extent),
        to_centre: Spread::toward(to_centre, extent),
        to_bulb: Spread::toward(to_centre, extent + bulb.radius),
        bulb_sine: bulb.radius / nearest.max(bulb.radius),
        normal: match corners.normals {
            Some(normals) => Spread::between(normals)?,
            None => Spread {
                axis: (b - a).cross(c - a).normalized(),
                angle: 0.0,
            },
        },
        along: corners.along.and_then(Spread::between),
    })
}

/// Where a triangle may be on the film.
pub struct OnFilm {
    /// The columns and rows that its box touches.
    pub pixels: [Range<usize>; 2],
    /// The least and the largest column and row of its box.
    extents: [[f64; 2]; 2],
    /// Its area, in pixels squared.
    area: f64,
}

impl OnFilm {
    /// Of one with these corners; `None` where not all of it is in front of the camera.
    fn new(camera: &PinholeCamera, corners: [Vec3; 3]) -> Option<Self> {
        let [a, b, c] = corners.map(|corner| camera.project(corner));
        Some(Self::of_places([a?, b?, c?], camera.size()))
    }

    fn of_places(places: [[f64; 2]; 3], size: [u32; 2]) -> Self {
        let extents = [0, 1].map(|axis| {
            let places = places.map(|place| place[axis]);
            let least = places.into_iter().fold(f64::INFINITY, f64::min);
            let most = places.into_iter().fold(f64::NEG_INFINITY, f64::max);
            [least - PLACE_ROUNDING, most + PLACE_ROUNDING]
        });
        let pixels = [0, 1].map(|axis| {
            let [begin, end] = [extents[axis][0].floor(), extents[axis][1].floor() + 1.0];
            let [begin, end] = [begin, end].map(|at| at.clamp(0.0, f64::from(size[axis])) as usize);
            begin..end.max(begin)
        });
        let [a, b, c] = places;
        let [ab, ac] = [b, c].map(|to| [to[0] - a[0], to[1] - a[1]]);
        Self {
            pixels,
            extents,
            area: 0.5 * (ab[0] * ac[1] - ab[1] * ac[0]).abs() + AREA_ROUNDING,
        }
    }

    /// How many pixels its box touches.
    pub fn count(&self) -> usize {
        self.pixels[0].len() * self.pixels[1].len()
    }

    /// At most how much of a pixel it fills.
    pub fn share(&self, column: usize, row: usize) -> f64 {
        let overlap = |[least, most]: [f64; 2], at: usize| {
            let at = at as f64;
            (most.min(at + 1.0) - least.max(at)).max(0.0)
        };
        let [columns, rows] = self.extents;
        self.area.min(overlap(columns, column) * overlap(rows, row))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const SIDE: u32 = 8;

    proptest! {
        /// Each point of a triangle is in a pixel that it touches, and the pixels together hold all of it that
        /// is on the film.
        #[test]
        fn pixels_hold_the_triangle(
            corners in prop::array::uniform3(prop::array::uniform2(-2.0..10.0f64)),
            shrink in 0.01..1.0f64,
            [x, y] in [0.0..1.0f64, 0.0..1.0],
        ) {
            let places = corners.map(|corner| corner.map(|at| 4.0 + shrink * (at - 4.0)));
            let on_film = OnFilm::of_places(places, [SIDE; 2]);
            let [a, b, c] = places;
            let (v, w) = if x + y < 1.0 { (x, y) } else { (1.0 - x, 1.0 - y) };
            let point = [0, 1].map(|axis| a[axis] * (1.0 - v - w) + b[axis] * v + c[axis] * w);
            if point.iter().all(|at| (0.0..f64::from(SIDE)).contains(at)) {
                let [column, row] = point.map(|at| at as usize);
                let [columns, rows] = on_film.pixels.clone();
                prop_assert!(columns.contains(&column) && rows.contains(&row));
                prop_assert!(on_film.share(column, row) > 0.0);
            }
            let shares = (0..SIDE as usize).flat_map(|row| (0..SIDE as usize).map(move |column| [column, row]));
            let sum: f64 = shares.map(|[column, row]| on_film.share(column, row)).sum();
            let is_inside = places.iter().flatten().all(|at| (0.0..f64::from(SIDE)).contains(at));
            prop_assert!(!is_inside || sum >= on_film.area * (1.0 - 1e-12));
        }
    }
}

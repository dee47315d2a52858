//! Where the camera and the bulb of a view stand, and the map from film to sample.
//!
//! World: metres, right-handed, the sample in z = 0 with normal +z. The camera stands on the -y
//! side, the bulb on the +y side, both in the plane x = 0, at distance D and elevation e. Matrices
//! are row-major and act on columns.

use crate::specification::Specification;
use std::f64::consts::{FRAC_1_SQRT_2, PI};

/// The geometry of one view.
#[derive(Clone, Debug, PartialEq)]
pub struct ViewGeometry {
    /// The pinhole, in metres.
    pub camera_position: [f64; 3],
    /// Takes the camera's frame (x right, y up, looking along -z) to the world.
    pub world_from_camera: [[f64; 4]; 4],
    /// The centre of the bulb, in metres.
    pub light_position: [f64; 3],
    /// Takes the bulb's frame, whose -z points at the origin, to the world: it is the camera's at
    /// the same elevation, turned by half a turn about the world's z.
    pub world_from_light: [[f64; 4]; 4],
    /// Takes film pixels (column, row, 1) to (u w, v w, w) on the sample, where u runs along +x and
    /// v along +y, 0 to 1 across the square. Columns and rows are continuous from the film's top
    /// left corner, so centres of pixels have halves. It is scaled so that w = 1 at the film's
    /// centre; w > 0 wherever the film sees the sample's plane, w <= 0 at and above its horizon.
    pub sample_from_film: [[f64; 3]; 3],
}

/// Sine and cosine of an angle in degrees; NaN for an angle that is not finite.
///
/// Exact where they are 0, 1/2 or 1 in size, equal in size at odd multiples of 45 degrees, and
/// symmetric: the sine of x is the cosine of 90 - x to the last bit.
pub fn sin_cos_deg(angle_deg: f64) -> (f64, f64) {
    // Remainders and these differences are exact.
    let turn_deg = angle_deg.abs() % 360.0;
    let quarter = (turn_deg / 90.0).floor();
    let rest_deg = turn_deg - 90.0 * quarter;
    let (sine, cosine) = if rest_deg <= 45.0 {
        sin_cos_first_octant(rest_deg)
    } else {
        let (sine, cosine) = sin_cos_first_octant(90.0 - rest_deg);
        (cosine, sine)
    };
    let (sine, cosine) = match quarter as u8 {
        0 => (sine, cosine),
        1 => (cosine, -sine),
        2 => (-sine, -cosine),
        _ => (-cosine, sine),
    };
    // Adding 0 turns -0 into 0.
    let sine = if angle_deg < 0.0 { -sine } else { sine };
    (sine + 0.0, cosine + 0.0)
}

/// Sine and cosine of 0 to 45 degrees.
fn sin_cos_first_octant(angle_deg: f64) -> (f64, f64) {
    let radians = angle_deg * (PI / 180.0);
    let sine = match angle_deg {
        30.0 => 0.5,
        45.0 => FRAC_1_SQRT_2,
        _ => libm::sin(radians),
    };
    let cosine = match angle_deg {
        45.0 => FRAC_1_SQRT_2,
        _ => libm::cos(radians),
    };
    (sine, cosine)
}

/// The frame of something at a distance and elevation that looks at the origin, on the -y side
/// (`side` = -1) or the +y side (`side` = 1). Up is the limit of +z as the elevation grows.
fn world_from_looker(distance_m: f64, elevation_deg: f64, side: f64) -> [[f64; 4]; 4] {
    let (sine, cosine) = sin_cos_deg(elevation_deg);
    let right = [-side, 0.0, 0.0];
    let up = [0.0, -side * sine, cosine];
    let back = [0.0, side * cosine, sine];
    // Adding 0 turns -0 into 0.
    let row = |axis: usize| {
        [
            right[axis] + 0.0,
            up[axis] + 0.0,
            back[axis] + 0.0,
            distance_m * back[axis] + 0.0,
        ]
    };
    [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]]
}

fn position(world_from_local: &[[f64; 4]; 4]) -> [f64; 3] {
    std::array::from_fn(|axis| world_from_local[axis][3])
}

/// The centre of a bulb at a distance and elevation.
pub(crate) fn light_position(distance_m: f64, elevation_deg: f64) -> [f64; 3] {
    position(&world_from_looker(distance_m, elevation_deg, 1.0))
}

/// The place of a camera at a distance and elevation.
pub(crate) fn camera_position(distance_m: f64, elevation_deg: f64) -> [f64; 3] {
    position(&world_from_looker(distance_m, elevation_deg, -1.0))
}

/// A pixel's side at unit distance.
pub(crate) fn film_pitch(specification: &Specification) -> f64 {
    let half_columns = f64::from(specification.image.width) / 2.0;
    specification.camera.film_half_width / half_columns
}

/// A ray through film point (x, y) at unit distance has direction (x, y s + c, y c - s), where s
/// and c are the elevation's sine and cosine. From D (0, -c, s) it meets z = 0 at
/// (D x / w, D y / (s w)) with w = 1 - y c / s: a homography.
fn sample_from_film(specification: &Specification, elevation_deg: f64) -> [[f64; 3]; 3] {
    let distance_m = specification.camera.distance_m;
    let side_m = specification.sample.side_m;
    let half_columns = f64::from(specification.image.width) / 2.0;
    let half_rows = f64::from(specification.image.height) / 2.0;
    let (sine, cosine) = sin_cos_deg(elevation_deg);
    let pitch = film_pitch(specification);
    let along_x = distance_m * pitch / side_m;
    let along_y = distance_m * pitch / (side_m * sine);
    // w = w_row * row + w_0
    let w_row = cosine / sine * pitch;
    let w_0 = 1.0 - w_row * half_rows;
    [
        [along_x, w_row / 2.0, w_0 / 2.0 - along_x * half_columns],
        [0.0, w_row / 2.0 - along_y, w_0 / 2.0 + along_y * half_rows],
        [0.0, w_row, w_0],
    ]
}

impl Specification {
    /// The geometry of a view; `None` where the specification has no such view. The material's
    /// turn is not part of it: the square, and so the map, stays put.
    pub fn view_geometry(&self, view: usize) -> Option<ViewGeometry> {
        let view = self.views.get(view)?;
        let world_from_camera =
            world_from_looker(self.camera.distance_m, view.camera_elevation_deg, -1.0);
        let world_from_light =
            world_from_looker(self.light.distance_m, view.light_elevation_deg, 1.0);
        Some(ViewGeometry {
            camera_position: position(&world_from_camera),
            world_from_camera,
            light_position: position(&world_from_light),
            world_from_light,
            sample_from_film: sample_from_film(self, view.camera_elevation_deg),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
        a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    }

    fn column(matrix: &[[f64; 4]; 4], index: usize) -> [f64; 3] {
        std::array::from_fn(|row| matrix[row][index])
    }

    #[test]
    fn right_angles_and_diagonals_are_exact() {
        assert_eq!(sin_cos_deg(0.0), (0.0, 1.0));
        assert_eq!(sin_cos_deg(30.0).0, 0.5);
        assert_eq!(sin_cos_deg(60.0).1, 0.5);
        assert_eq!(sin_cos_deg(90.0), (1.0, 0.0));
        assert_eq!(sin_cos_deg(180.0), (0.0, -1.0));
        assert_eq!(sin_cos_deg(270.0), (-1.0, 0.0));
        assert_eq!(sin_cos_deg(-360.0), (0.0, 1.0));
        for odd in [45.0, 135.0, 225.0, 315.0, -45.0] {
            let (sine, cosine) = sin_cos_deg(odd);
            assert_eq!(sine.abs(), cosine.abs());
        }
        assert!(sin_cos_deg(f64::INFINITY).0.is_nan());
        assert!(sin_cos_deg(90.0).1.is_sign_positive());
    }

    #[test]
    fn degrees_agree_with_radians_and_complements_to_the_bit() {
        for step in -1500..1500 {
            let angle_deg = f64::from(step) * 0.25;
            let (sine, cosine) = sin_cos_deg(angle_deg);
            let radians = angle_deg.to_radians();
            assert!((sine - libm::sin(radians)).abs() < 2e-15);
            assert!((cosine - libm::cos(radians)).abs() < 2e-15);
            assert_eq!(sin_cos_deg(90.0 - angle_deg), (cosine, sine));
            assert_eq!(sin_cos_deg(-angle_deg), (0.0 - sine, cosine));
        }
    }

    #[test]
    fn frames_are_right_handed_and_look_at_the_origin() {
        let preset = Specification::preset();
        for view in 0..preset.views.len() {
            let geometry = preset.view_geometry(view).unwrap();
            let ends = [
                (&geometry.world_from_camera, geometry.camera_position, 0.5),
                (&geometry.world_from_light, geometry.light_position, 1.0),
            ];
            for (matrix, position, distance_m) in ends {
                let [x, y, z] = std::array::from_fn(|index| column(matrix, index));
                for axis in [x, y, z] {
                    assert!((dot(axis, axis) - 1.0).abs() < 1e-15);
                }
                let cross = [
                    x[1] * y[2] - x[2] * y[1],
                    x[2] * y[0] - x[0] * y[2],
                    x[0] * y[1] - x[1] * y[0],
                ];
                assert!((dot(cross, z) - 1.0).abs() < 1e-15);
                assert_eq!(position, z.map(|along| distance_m * along + 0.0));
                assert!(y[2] > 0.0 || z == [0.0, 0.0, 1.0], "up is never down");
                assert_eq!(matrix[3], [0.0, 0.0, 0.0, 1.0]);
            }
            assert!(geometry.camera_position[1] <= 0.0 && geometry.light_position[1] >= 0.0);
        }
        assert_eq!(preset.view_geometry(preset.views.len()), None);
    }

    #[test]
    fn from_straight_above_up_is_plus_y() {
        let overhead = Specification::preset().view_geometry(8).unwrap();
        assert_eq!(overhead.camera_position, [0.0, 0.0, 0.5]);
        assert_eq!(column(&overhead.world_from_camera, 1), [0.0, 1.0, 0.0]);
        assert_eq!(column(&overhead.world_from_camera, 0), [1.0, 0.0, 0.0]);
        // 0.12 m over 128 pixels; the square's corners are 10/12 of the film.
        let [u, v] = on_sample(&overhead.sample_from_film, [64.0, 64.0]);
        assert!((u - 0.5).abs() < 1e-15 && (v - 0.5).abs() < 1e-15);
        let margin = 128.0 / 12.0;
        let [u, v] = on_sample(&overhead.sample_from_film, [margin, margin]);
        assert!(
            u.abs() < 1e-14 && (v - 1.0).abs() < 1e-14,
            "top left is (0, 1)"
        );
    }

    fn on_sample(map: &[[f64; 3]; 3], [column, row]: [f64; 2]) -> [f64; 2] {
        let [u, v, w] = map.map(|line| dot(line, [column, row, 1.0]));
        [u / w, v / w]
    }

    #[test]
    fn points_of_the_sample_seen_by_the_camera_map_back_to_themselves() {
        let mut specification = Specification::preset();
        // A film that is not square tells columns from rows.
        specification.image.width = 160;
        specification.image.height = 96;
        for view in 0..specification.views.len() {
            let geometry = specification.view_geometry(view).unwrap();
            let frame = &geometry.world_from_camera;
            for [u, v] in [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0], [0.3, 0.85]] {
                let world = [(u - 0.5) * 0.1, (v - 0.5) * 0.1, 0.0];
                let from_camera: [f64; 3] =
                    std::array::from_fn(|axis| world[axis] - geometry.camera_position[axis]);
                let [x, y, z] = std::array::from_fn(|axis| dot(column(frame, axis), from_camera));
                assert!(z < 0.0, "the sample is in front of the camera");
                let pixels_a_unit = 160.0 / (2.0 * 0.12);
                let film = [80.0 + x / -z * pixels_a_unit, 48.0 - y / -z * pixels_a_unit];
                let [u_back, v_back] = on_sample(&geometry.sample_from_film, film);
                assert!((u_back - u).abs() < 1e-12 && (v_back - v).abs() < 1e-12);
            }
            let centre = geometry.sample_from_film[2];
            assert!((dot(centre, [80.0, 48.0, 1.0]) - 1.0).abs() < 1e-14);
        }
    }
}

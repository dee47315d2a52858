//! Which pixels of a film see a mesh from its front.

use crate::{
    Specification,
    masks::{Mask, MaskedFilm},
    specification::LoadedMesh,
    view::ViewGeometry,
};

/// The mask of a view of a mesh. It takes as long as all triangles have pixels in their boxes on the film.
pub(crate) fn mask_of_view(
    mesh: &LoadedMesh,
    specification: &Specification,
    geometry: &ViewGeometry,
    pitch: f64,
) -> Mask {
    let size = [specification.image.width, specification.image.height];
    let film = MaskedFilm {
        size,
        pitch: pitch.to_bits(),
        side_m: specification.sample.side_m.to_bits(),
        camera: geometry
            .world_from_camera
            .as_flattened()
            .iter()
            .map(|x| x.to_bits())
            .collect(),
    };
    mesh.masks().of_film(film, || {
        let placed = mesh.placed(specification.sample.side_m);
        Raster::new(size, pitch).mask(&placed, mesh.mesh().triangles(), geometry)
    })
}

/// What each pixel's centre sees so far.
struct Raster {
    size: [u32; 2],
    pitch: f64,
    /// How far along its direction the nearest triangle is, and whether that shows its front.
    nearest: Vec<(f64, bool)>,
}

type Vector = [f64; 3];

fn dot(a: Vector, b: Vector) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: Vector, b: Vector) -> Vector {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

impl Raster {
    fn new([width, height]: [u32; 2], pitch: f64) -> Self {
        Self {
            size: [width, height],
            pitch,
            nearest: vec![(f64::INFINITY, false); width as usize * height as usize],
        }
    }

    fn mask(mut self, placed: &[Vector], triangles: &[[u32; 3]], geometry: &ViewGeometry) -> Mask {
        let eye = geometry.camera_position;
        let axes = [0, 1, 2].map(|axis| geometry.world_from_camera.map(|row| row[axis]));
        let seen = |at: &Vector| {
            let offset = [0, 1, 2].map(|axis| at[axis] - eye[axis]);
            axes.map(|[x, y, z, _]| dot([x, y, z], offset))
        };
        let seen: Vec<Vector> = placed.iter().map(seen).collect();
        for triangle in triangles {
            self.enter(triangle.map(|vertex| seen[vertex as usize]));
        }
        self.nearest.iter().map(|(_, is_front)| *is_front).collect()
    }

    /// Enters a triangle, in the frame of the camera, which looks along -z. A direction d meets the plane of
    /// the triangle a, b, c at det(a, b, c) / d.n, and on the inner side of each edge if d.(a x b), d.(b x c)
    /// and d.(c x a) have one sign: also where corners are behind the camera (Olano and Greer, "Triangle Scan
    /// Conversion using 2D Homogeneous Coordinates", 1997).
    fn enter(&mut self, [a, b, c]: [Vector; 3]) {
        let edges = [cross(b, c), cross(c, a), cross(a, b)];
        let volume = dot(a, edges[0]);
        let [columns, rows] = self.places([a, b, c]);
        for row in rows {
            for column in columns.clone() {
                let direction = self.direction(column, row);
                let sides = edges.map(|edge| dot(direction, edge));
                let is_met =
                    sides.iter().all(|side| *side >= 0.0) || sides.iter().all(|side| *side <= 0.0);
                let distance = volume / (sides[0] + sides[1] + sides[2]);
                let cell = &mut self.nearest[row * self.size[0] as usize + column];
                // Not so for NaN: a plane through the camera shows nothing.
                if is_met && distance > 0.0 && distance < cell.0 {
                    *cell = (distance, volume < 0.0);
                }
            }
        }
    }

    /// From the camera to the centre of a pixel at unit depth.
    fn direction(&self, column: usize, row: usize) -> Vector {
        let [width, height] = self.size.map(f64::from);
        [
            (column as f64 + 0.5 - 0.5 * width) * self.pitch,
            (0.5 * height - row as f64 - 0.5) * self.pitch,
            -1.0,
        ]
    }

    /// The columns and rows whose centres may see a triangle: all, where a corner is behind the camera.
    fn places(&self, corners: [Vector; 3]) -> [std::ops::Range<usize>; 2] {
        let [width, height] = self.size.map(|side| side as usize);
        if corners.iter().any(|corner| corner[2] >= 0.0) {
            return [0..width, 0..height];
        }
        let range = |places: [f64; 3], side: usize| {
            let least = places.into_iter().fold(f64::INFINITY, f64::min);
            let most = places.into_iter().fold(f64::NEG_INFINITY, f64::max);
            // A place is rounded.
            let [begin, end] = [(least - 1.0).floor(), (most + 1.0).ceil()];
            let [begin, end] = [begin, end].map(|at| at.clamp(0.0, side as f64) as usize);
            begin..end
        };
        let half = self.size.map(|side| 0.5 * f64::from(side));
        let columns = corners.map(|[x, _, z]| half[0] - x / (z * self.pitch));
        let rows = corners.map(|[_, y, z]| half[1] + y / (z * self.pitch));
        [range(columns, width), range(rows, height)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        PixelStatistics,
        specification::{SampleMesh, Shape},
    };
    use proptest::prelude::*;

    fn specification(text: &str, size: [u32; 2]) -> Specification {
        let mut specification = Specification::preset();
        specification.sample.shape = Shape::Mesh;
        let mesh = SampleMesh::of_bytes(text.as_bytes().to_vec());
        specification.sample.mesh = Some(mesh.expect("a mesh"));
        [specification.image.width, specification.image.height] = size;
        specification
    }

    /// By the solution of a + u (b - a) + v (c - a) = eye + t d for each pixel and triangle.
    fn by_rays(specification: &Specification, view: usize) -> Vec<bool> {
        let geometry = specification.view_geometry(view).expect("a view");
        let mesh = specification.sample.loaded_mesh().expect("a mesh");
        let placed = mesh.placed(specification.sample.side_m);
        let image = &specification.image;
        let pitch = crate::view::film_pitch(specification);
        let centres =
            (0..image.height).flat_map(|row| (0..image.width).map(move |column| [column, row]));
        let sees_front = |[column, row]: [u32; 2]| {
            let x = (f64::from(column) + 0.5 - 0.5 * f64::from(image.width)) * pitch;
            let y = (0.5 * f64::from(image.height) - f64::from(row) - 0.5) * pitch;
            let direction = geometry
                .world_from_camera
                .map(|[right, up, back, _]| right * x + up * y - back);
            let direction = [direction[0], direction[1], direction[2]];
            let minus = |a: Vector, b: Vector| [0, 1, 2].map(|axis| a[axis] - b[axis]);
            let mut nearest = (f64::INFINITY, false);
            for triangle in mesh.mesh().triangles() {
                let [a, b, c] = triangle.map(|vertex| placed[vertex as usize]);
                let (to_b, to_c) = (minus(b, a), minus(c, a));
                let normal = cross(to_b, to_c);
                let across = dot(direction, normal);
                let from_a = minus(geometry.camera_position, a);
                let turned = cross(from_a, direction);
                let [u, v] = [dot(to_c, turned), -dot(to_b, turned)].map(|x| x / -across);
                let distance = -dot(from_a, normal) / across;
                let is_met = u >= 0.0 && v >= 0.0 && u + v <= 1.0 && distance > 0.0;
                if is_met && distance < nearest.0 {
                    nearest = (distance, across < 0.0);
                }
            }
            nearest.1
        };
        centres.map(sees_front).collect()
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn a_mask_is_what_rays_meet(
            corners in prop::collection::vec(prop::array::uniform3(-100i32..100), 12..40),
            view in 0usize..14,
            wide in any::<bool>(),
        ) {
            let mut text = String::new();
            for [x, y, z] in &corners {
                text += &format!("v {x} {y} {z}\n");
            }
            for corner in 0..corners.len() - 2 {
                text += &format!("f {} {} {}\n", corner + 1, corner + 2, corner + 3);
            }
            prop_assume!(SampleMesh::of_bytes(text.as_bytes().to_vec()).is_ok());
            let mut specification = specification(&text, [29, 17]);
            if wide {
                // Where corners are behind the camera.
                specification.sample.side_m = 3.0;
                specification.camera.film_half_width = 3.0;
            }
            let mask = PixelStatistics::mask(&specification, view as u32).expect("a view");
            let expected = by_rays(&specification, view);
            // A ray through an edge may be on either side.
            let other = mask.iter().zip(&expected).filter(|(a, b)| a != b).count();
            prop_assert!(other <= 1, "{other} pixels differ");
        }
    }

    #[test]
    fn masks_are_remembered_by_what_they_depend_on() {
        let mut specification = specification("v 0 0 0\nv 2 0 0\nv 0 1 0\nf 1 2 3\n", [16, 16]);
        let share = |specification: &Specification| {
            let mask = PixelStatistics::mask(specification, 8).expect("a view");
            mask.iter().filter(|is_seen| **is_seen).count()
        };
        let before = share(&specification);
        assert!(before > 0 && share(&specification) == before);
        specification.sample.side_m *= 0.5;
        assert!(share(&specification) < before);
        specification.sample.side_m *= 2.0;
        specification.camera.distance_m *= 1.5;
        assert!(share(&specification) < before);
        let named = Specification::from_json(&specification.to_json()).expect("JSON");
        assert_eq!(PixelStatistics::mask(&named, 8), None);
    }
}

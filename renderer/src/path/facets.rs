//! What of a mesh each pixel may see, and how bright the bulb's light may be there.
//!
//! A fold of a mesh that fills a thousandth of a pixel may turn the bulb's light to the camera, and no path
//! meets it. So before any path, each triangle that faces the camera is noted in the pixels that its
//! box on the film touches: a pixel that no triangle touches sees none, and in others the light is bounded
//! by the normals that their triangles have.

use crate::reflectance::Reflectance;
use crate::scene::{MeshSurface, PinholeCamera, Scene};
use crate::vector::Vec3;

/// The most entries of triangles into pixels, for each pixel and triangle there is. A mesh of long slivers
/// that would need more is not told apart: everything may be everywhere.
const ENTRIES_MAX: u64 = 64;

/// By how much the half vectors of a triangle may turn more than to first order, up to [`TURNS_MAX`].
const SECOND_ORDER: f64 = 1.2;

/// The sum of sines by which the directions from a triangle to the camera and to the bulb may turn. Of a
/// triangle or a bulb that is larger beside its distance nothing is known.
const TURNS_MAX: f64 = 0.5;

/// What each pixel of a film may see of a mesh.
#[derive(Debug)]
pub struct Facets {
    width: usize,
    /// The least log(1 + tan^2) of the angle between a normal and a half vector, by pixel; infinite where
    /// there is no triangle.
    log_secant2: Vec<f32>,
    /// The least cosine between a half vector and the light.
    cosine_min: f64,
    /// The radiance of a white diffuser that faces the bulb, where it is largest.
    white_max: f64,
}

impl Facets {
    /// Those of a scene's mesh; `None` for other samples.
    pub fn new(scene: &Scene) -> Option<Self> {
        let mesh = scene.sample.mesh()?;
        let [width, height] = scene.camera.size().map(|side| side as usize);
        let ball = mesh.ball();
        let nearest = (scene.bulb.centre - ball.centre).length() - ball.radius;
        let ratio = scene.bulb.radius / nearest.max(scene.bulb.radius);
        let mut found = Self {
            width,
            log_secant2: vec![f32::INFINITY; width * height],
            cosine_min: 1.0,
            white_max: scene.bulb.radiance * ratio * ratio,
        };
        let count = mesh.traced().triangles().count();
        let mut entries_left = ENTRIES_MAX * (width * height + count) as u64;
        for triangle in 0..count {
            let Some(facet) = Facet::new(scene, mesh, triangle) else {
                continue;
            };
            found.cosine_min = found.cosine_min.min(facet.cosine);
            let entered = facet
                .pixels(&scene.camera)
                .filter(|[columns, rows]| {
                    let entries = (columns.len() * rows.len()) as u64;
                    entries_left = entries_left.saturating_sub(entries);
                    entries_left > 0
                })
                .map(|pixels| found.enter(pixels, facet.log_secant2));
            if entered.is_none() {
                found.log_secant2.fill(0.0);
                found.cosine_min = 0.0;
                break;
            }
        }
        Some(found)
    }

    fn enter(&mut self, [columns, rows]: [std::ops::Range<usize>; 2], log_secant2: f32) {
        for row in rows {
            let line = row * self.width;
            for cell in &mut self.log_secant2[line + columns.start..line + columns.end] {
                *cell = cell.min(log_secant2);
            }
        }
    }

    /// Whether a pixel may see the mesh.
    pub fn may_be_seen(&self, column: u32, row: u32) -> bool {
        self.log_secant2[self.index(column, row)] < f32::INFINITY
    }

    /// At most the radiance of the bulb's light off the mesh, in any channel, where a pixel sees it.
    pub fn light_max(&self, column: u32, row: u32, reflectance: &Reflectance, bulb: f64) -> f64 {
        let log_secant2 = f64::from(self.log_secant2[self.index(column, row)]);
        let lobe = &reflectance.lobe;
        let power = libm::exp(-0.5 * lobe.n_u.min(lobe.n_v) * log_secant2);
        // Equation 1: a tint is at most 1, and the bulb's mean through the lobe no brighter than it is.
        let specular =
            (0.125 * lobe.normalization * power * self.white_max / self.cosine_min).min(bulb);
        let diffuse = reflectance.rgb0.into_iter().fold(0.0, f64::max) * self.white_max;
        let share = reflectance.specular_share;
        share * specular + (1.0 - share) * diffuse
    }

    fn index(&self, column: u32, row: u32) -> usize {
        row as usize * self.width + column as usize
    }
}

/// A triangle that faces the camera.
struct Facet {
    corners: [Vec3; 3],
    /// The least log(1 + tan^2) of the angle between its normals and half vectors.
    log_secant2: f32,
    /// The least cosine between its half vectors and the light.
    cosine: f64,
}

impl Facet {
    fn new(scene: &Scene, mesh: &MeshSurface, triangle: usize) -> Option<Self> {
        let corners = mesh.traced().triangles().at(triangle);
        let [a, b, c] = corners;
        let (eye, bulb) = (scene.camera.position, scene.bulb.centre);
        let facing = (b - a).cross(c - a);
        if facing.dot(eye - a) <= 0.0 {
            return None;
        }
        let middle = (a + b + c) * (1.0 / 3.0);
        let extent = corners.map(|corner| (corner - middle).length());
        let extent = extent.into_iter().fold(0.0, f64::max);
        let (to_eye, to_bulb) = (eye - middle, bulb - middle);
        let sum = to_eye.normalized() + to_bulb.normalized();
        // By how much the directions to the eye and to the bulb turn, to first order. Their sum turns by that
        // over its length.
        let turns = extent / to_eye.length() + (extent + scene.bulb.radius) / to_bulb.length();
        let cosine = 0.5 * sum.length();
        if turns > TURNS_MAX.min(cosine) {
            return Some(Self::unknown(corners));
        }
        let half_turns = SECOND_ORDER * 0.5 * turns / (cosine - 0.5 * turns);
        let (normal, normals_turn) = mesh.normal_cone(triangle);
        let between = normal.dot(sum.normalized()).clamp(-1.0, 1.0);
        let angle = (libm::acos(between) - normals_turn - half_turns).max(0.0);
        let log_secant2 = if angle < std::f64::consts::FRAC_PI_2 {
            -2.0 * libm::log(libm::cos(angle))
        } else {
            f64::from(f32::MAX)
        };
        Some(Self {
            corners,
            log_secant2: (log_secant2 as f32).next_down().max(0.0),
            cosine: (cosine - turns).max(0.0),
        })
    }

    /// One of which nothing is known but where it is.
    fn unknown(corners: [Vec3; 3]) -> Self {
        Self {
            corners,
            log_secant2: 0.0,
            cosine: 0.0,
        }
    }

    /// The columns and rows of the film that its box touches; `None` where not all of it is in front of the
    /// camera.
    fn pixels(&self, camera: &PinholeCamera) -> Option<[std::ops::Range<usize>; 2]> {
        let [a, b, c] = self.corners.map(|corner| camera.project(corner));
        let places = [a?, b?, c?];
        let size = camera.size();
        Some([0, 1].map(|axis| {
            let places = places.map(|place| place[axis]);
            let least = places.into_iter().fold(f64::INFINITY, f64::min);
            let most = places.into_iter().fold(f64::NEG_INFINITY, f64::max);
            let side = f64::from(size[axis]);
            // A place is rounded.
            let [begin, end] = [(least - 1e-6).floor(), (most + 1e-6).floor() + 1.0];
            let [begin, end] = [begin, end].map(|at| at.clamp(0.0, side) as usize);
            begin..end.max(begin)
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::BackendChoice;
    use crate::hybrid::direct::{BulbLight, SlopeBatch};
    use crate::numerics::{instructions::Instructions, tolerance::Tolerance};
    use crate::scene::Encounter;
    use dataset::{
        Material, Specification,
        specification::{SampleMesh, Shape, Tint},
    };
    use proptest::prelude::*;

    /// A bumpy plate of 2 `side`^2 triangles with heights drawn at random, with or without normals of its
    /// vertices, which are those of a smoother plate.
    fn plate(side: usize, heights: &[f64], has_normals: bool) -> SampleMesh {
        let places = || (0..=side).flat_map(|j| (0..=side).map(move |i| [i, j]));
        let height = |i: usize, j: usize| heights[(j * (side + 1) + i) % heights.len()];
        let positions = places().map(|[i, j]| [i as f64, j as f64, height(i, j)]);
        let normals = places().map(|[i, j]| [0.3 * height(i, j), 0.2 - 0.1 * height(j, i), 1.0]);
        let vertex = |i: usize, j: usize| (j * (side + 1) + i) as u32;
        let cells = (0..side).flat_map(|j| (0..side).map(move |i| [i, j]));
        let triangles = cells.flat_map(|[i, j]| {
            let [a, b] = [vertex(i, j), vertex(i + 1, j)];
            let [c, d] = [vertex(i + 1, j + 1), vertex(i, j + 1)];
            [[a, b, c], [a, c, d]]
        });
        let normals = has_normals.then(|| normals.collect());
        let (positions, triangles) = (positions.collect(), triangles.collect());
        let mesh = mesh::Mesh::new(positions, triangles, normals, None, None);
        SampleMesh::of_bytes(mesh.expect("a mesh").to_ply()).expect("a mesh")
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(300))]

        /// No point that a pixel sees is brighter by the bulb than the pixel's bound, whatever the mesh, the
        /// lobe and the bulb, and a pixel that may not see the mesh does not.
        #[test]
        fn no_light_of_the_bulb_exceeds_its_bound(
            (side, heights, has_normals) in (
                1usize..9, prop::collection::vec(-1.0..1.0f64, 81), any::<bool>()
            ),
            (roughness, anisotropy, angle_deg) in (0.0..100.0f64, 0.0..1.0f64, 0.0..180.0f64),
            (view, radius_m, side_m) in (0usize..14, 0.001..0.6f64, 0.02..0.6f64),
            places in prop::collection::vec((0.0..1.0f64, 0.0..1.0f64), 4),
        ) {
            const SIDE: u32 = 12;
            let mut specification = Specification::preset();
            specification.sample.shape = Shape::Mesh;
            specification.sample.side_m = side_m;
            specification.sample.mesh = Some(plate(side, &heights, has_normals));
            specification.light.radius_m = radius_m;
            specification.views[view].checker = false;
            (specification.image.width, specification.image.height) = (SIDE, SIDE);
            let scene = Scene::new(&specification, view, BackendChoice::Native);
            let scene = scene.expect("a view").expect("a scene");
            let facets = Facets::new(&scene).expect("a mesh");
            let material = Material {
                roughness,
                anisotropy,
                angle_deg,
                ior: 10.0,
                rgb0: [1.0, 0.8, 0.4],
                rgb90: [1.0, 1.0, 1.0],
            };
            let reflectance = Reflectance::new(&material, 0.0, Tint::Hue);
            let light = BulbLight {
                reflectance: &reflectance,
                radius: radius_m,
                radiance: scene.bulb.radiance,
                tolerance: Tolerance::new(1e-4),
                instructions: Instructions::widest(),
            };
            let mut batch = SlopeBatch::default();
            let pixels = (0..SIDE).flat_map(|row| (0..SIDE).map(move |column| [column, row]));
            for ([column, row], (x, y)) in pixels.flat_map(|at| places.iter().map(move |to| (at, to))) {
                let ray = scene.camera.ray(f64::from(column) + x, f64::from(row) + y);
                let Some(Encounter::Surface(surface)) = scene.encounter(&ray, None) else {
                    continue;
                };
                prop_assert!(facets.may_be_seen(column, row), "column {column}, row {row}");
                let wo = surface.frame.to_local(-ray.direction);
                let to_bulb = surface.frame.to_local(scene.bulb.centre - surface.position);
                if to_bulb.z < radius_m {
                    continue;
                }
                let (found, _) = light.toward(wo, to_bulb, &mut batch);
                let brightest = found.tint.into_iter().fold(0.0, f64::max) * libm::exp(found.log);
                let most = facets.light_max(column, row, &reflectance, scene.bulb.radiance);
                prop_assert!(
                    brightest <= most * 1.001 + 1e-12,
                    "column {column}, row {row}: {brightest} exceeds {most}"
                );
            }
        }
    }
}

//! What of a mesh each pixel may see, and how bright the bulb's light may be there.
//!
//! A fold of a mesh that fills a thousandth of a pixel may turn the bulb's light to the camera, and no path
//! meets it. So before any path, each triangle that faces the camera is noted in the pixels that its box on
//! the film touches, with at most the area that it fills and at most the light that it sends: a pixel that no
//! triangle touches sees none, and in others what no path met is no larger and no brighter than the
//! brightest triangles are together.

mod facet;
mod light;
mod spread;

use super::interval::UNSEEN;
use crate::reflectance::Reflectance;
use crate::scene::{Corners, Scene};
use crate::vector::Vec3;
use facet::{Facet, OnFilm};

/// The most entries of triangles into pixels, for each pixel and triangle there is. A mesh of long slivers
/// that would need more is not told apart: everything may be everywhere.
const ENTRIES_MAX: u64 = 64;

/// The most parts into which triangles are divided, for each pixel and triangle there is. A part takes about a
/// microsecond. Once there are so many, triangles stay whole.
const PARTS_MAX: u64 = 4;

/// A triangle is divided no oftener than this.
const DIVISIONS_MAX: u32 = 3;

/// Triangles of a pixel are kept in so many groups, by their brightness.
const GROUPS: usize = 8;

/// From one group to the next, light falls by this power of two.
const OCTAVES: f64 = 3.0;

/// What each pixel of a film may see of a mesh.
#[derive(Debug)]
pub struct Facets {
    width: usize,
    /// Of each pixel, the brightest first; `None` where everything may be everywhere.
    pixels: Option<Vec<[Group; GROUPS]>>,
    /// The bulb's radiance, which no light of it exceeds.
    radiance: f64,
}

/// Triangles that are about as bright.
#[derive(Clone, Copy, Debug, Default)]
struct Group {
    /// At most how much of the pixel they fill.
    area: f32,
    /// At most the radiance of the bulb's light off them, in any channel.
    brightest: f32,
}

/// How much work may still be done.
struct Left {
    entries: u64,
    parts: u64,
}

impl Facets {
    /// Those of a scene's mesh; `None` for other samples.
    pub fn new(scene: &Scene, reflectance: &Reflectance) -> Option<Self> {
        let mesh = scene.sample.mesh()?;
        let [width, height] = scene.camera.size().map(|side| side as usize);
        let mut found = Self {
            width,
            pixels: Some(vec![Default::default(); width * height]),
            radiance: scene.bulb.radiance,
        };
        let count = mesh.traced().triangles().count();
        let size = (width * height + count) as u64;
        let mut left = Left {
            entries: ENTRIES_MAX * size,
            parts: PARTS_MAX * size,
        };
        let facing = (0..count)
            .map(|triangle| mesh.corners(triangle))
            .filter(|corners| faces(corners, scene.camera.position));
        for corners in facing {
            if found.note(scene, reflectance, corners, &mut left).is_none() {
                found.pixels = None;
                break;
            }
        }
        Some(found)
    }

    /// Notes a triangle in the pixels that it may touch, in parts where that tells more. `None` where it may
    /// be anywhere, or no entries are left.
    fn note(
        &mut self,
        scene: &Scene,
        reflectance: &Reflectance,
        corners: Corners,
        left: &mut Left,
    ) -> Option<()> {
        let mut parts = vec![(corners, 0)];
        while let Some((corners, divisions)) = parts.pop() {
            let facet = Facet::new(scene, reflectance, &corners);
            let on_film = facet.on_film?;
            if facet.is_loose && divisions < DIVISIONS_MAX && left.parts > 0 {
                let divided = corners.divided();
                left.parts = left.parts.saturating_sub(divided.len() as u64);
                parts.extend(divided.map(|part| (part, divisions + 1)));
            } else {
                left.entries = left.entries.checked_sub(on_film.count() as u64)?;
                self.enter(&on_film, facet.brightest);
            }
        }
        Some(())
    }

    fn enter(&mut self, on_film: &OnFilm, brightest: f64) {
        let Some(pixels) = &mut self.pixels else {
            return;
        };
        let fallen = libm::log2(self.radiance / brightest) / OCTAVES;
        let group = (fallen.max(0.0) as usize).min(GROUPS - 1);
        let brightest = (brightest as f32).next_up();
        let [columns, rows] = &on_film.pixels;
        for row in rows.clone() {
            for column in columns.clone() {
                let group = &mut pixels[row * self.width + column][group];
                let share = on_film.share(column, row);
                group.area = ((f64::from(group.area) + share) as f32).next_up();
                group.brightest = group.brightest.max(brightest);
            }
        }
    }

    /// Whether a pixel may see the mesh.
    pub fn may_be_seen(&self, column: u32, row: u32) -> bool {
        let groups = self.groups(column, row);
        groups.is_none_or(|groups| groups.iter().any(|group| group.area > 0.0))
    }

    /// At most what a pixel is off by because no path met a fold: what `paths` paths do not meet fills less
    /// than three nths of the pixel at 95 percent, is no larger than the triangles that are there, and
    /// exceeds the brightest that the paths met by no more than those do.
    pub fn unmet(&self, column: u32, row: u32, paths: u32, brightest: f64) -> f64 {
        let mut left = UNSEEN / f64::from(paths);
        let Some(groups) = self.groups(column, row) else {
            return left * (self.radiance - brightest).max(0.0);
        };
        let mut sum = 0.0;
        for group in groups {
            let area = f64::from(group.area).min(left);
            sum += area * (f64::from(group.brightest) - brightest).max(0.0);
            left -= area;
        }
        sum
    }

    fn groups(&self, column: u32, row: u32) -> Option<&[Group; GROUPS]> {
        let pixels = self.pixels.as_ref()?;
        Some(&pixels[row as usize * self.width + column as usize])
    }
}

/// Whether the front of a triangle faces a point.
fn faces(corners: &Corners, point: Vec3) -> bool {
    let [a, b, c] = corners.positions;
    (b - a).cross(c - a).dot(point - a) > 0.0
}

#[cfg(test)]
pub(in crate::path) mod tests {
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

    impl Facets {
        /// At most the radiance of the bulb's light in a pixel, in any channel.
        fn brightest(&self, column: u32, row: u32) -> f64 {
            let groups = self.groups(column, row).map(|groups| groups.iter());
            let lights = groups.map(|groups| groups.map(|group| f64::from(group.brightest)));
            lights.map_or(self.radiance, |lights| lights.fold(0.0, f64::max))
        }
    }

    /// A bumpy plate of 2 `side`^2 triangles with heights drawn at random, with or without normals of its
    /// vertices, which are those of a smoother plate, and with tangents, texture coordinates or neither.
    pub fn plate(side: usize, heights: &[f64], has_normals: bool, along: u8) -> SampleMesh {
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
        let tangents = places().map(|[i, j]| [1.0, height(j, i), 0.3 * height(i, j)]);
        let tangents = (along == 0).then(|| tangents.collect());
        let uvs = places().map(|[i, j]| [i as f64 + height(i, j), j as f64 - 0.3 * height(j, i)]);
        let uvs = (along == 1).then(|| uvs.collect());
        let (positions, triangles) = (positions.collect(), triangles.collect());
        let mesh = mesh::Mesh::new(positions, triangles, normals, tangents, uvs);
        SampleMesh::of_bytes(mesh.expect("a mesh").to_ply()).expect("a mesh")
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(300))]

        /// No point that a pixel sees is brighter by the bulb than the pixel's bound, whatever the mesh, the
        /// lobe and the bulb, and a pixel that may not see the mesh does not.
        #[test]
        fn no_light_of_the_bulb_exceeds_its_bound(
            (side, heights, has_normals, along) in (
                1usize..9, prop::collection::vec(-1.0..1.0f64, 81), any::<bool>(), 0u8..3
            ),
            bumpiness in 0.0..1.0f64,
            (roughness, anisotropy, angle_deg) in (0.0..100.0f64, 0.0..1.0f64, 0.0..180.0f64),
            (ior, rgb0, rgb90) in (
                1.0..10.0f64, prop::array::uniform3(0.0..1.0f64), prop::array::uniform3(0.0..1.0f64)
            ),
            tint in prop::sample::select(vec![Tint::Hue, Tint::Product]),
            (view, radius_m, side_m) in (0usize..14, 0.001..0.6f64, 0.02..0.6f64),
            places in prop::collection::vec((0.0..1.0f64, 0.0..1.0f64), 4),
        ) {
            const SIDE: u32 = 12;
            let heights: Vec<f64> = heights.iter().map(|height| height * bumpiness).collect();
            let mut specification = Specification::preset();
            specification.sample.shape = Shape::Mesh;
            specification.sample.side_m = side_m;
            specification.sample.mesh = Some(plate(side, &heights, has_normals, along));
            specification.light.radius_m = radius_m;
            specification.views[view].checker = false;
            (specification.image.width, specification.image.height) = (SIDE, SIDE);
            let scene = Scene::new(&specification, view, BackendChoice::Native);
            let scene = scene.expect("a view").expect("a scene");
            let material = Material {
                roughness,
                anisotropy,
                angle_deg,
                ior,
                rgb0,
                rgb90,
            };
            let reflectance = Reflectance::new(&material, 0.0, tint);
            let facets = Facets::new(&scene, &reflectance).expect("a mesh");
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
                let most = facets.brightest(column, row);
                prop_assert!(
                    brightest <= most * 1.001 + 1e-12,
                    "column {column}, row {row}: {brightest} exceeds {most}"
                );
            }
        }
    }

    /// Of thousands of triangles that are each all over the film nothing is told apart, and no pixel claims to
    /// know what it may miss.
    #[test]
    fn a_mesh_that_takes_too_many_entries_is_everywhere() {
        const SIDE: u32 = 12;
        const SHEETS: u32 = 5000;
        let corners = [[-9.0, -9.0], [9.0, -9.0], [0.0, 9.0]];
        let positions = (0..SHEETS)
            .flat_map(|sheet| corners.map(|[x, y]: [f64; 2]| [x, y, 1e-4 * f64::from(sheet)]));
        let triangles = (0..SHEETS).map(|sheet| [0, 1, 2].map(|corner| 3 * sheet + corner));
        let (positions, triangles) = (positions.collect(), triangles.collect());
        let mesh = mesh::Mesh::new(positions, triangles, None, None, None);
        let mut specification = Specification::preset();
        specification.sample.shape = Shape::Mesh;
        specification.sample.side_m = 0.5;
        let mesh = SampleMesh::of_bytes(mesh.expect("a mesh").to_ply());
        specification.sample.mesh = Some(mesh.expect("a mesh"));
        (specification.image.width, specification.image.height) = (SIDE, SIDE);
        let scene = Scene::new(&specification, 12, BackendChoice::Native);
        let scene = scene.expect("a view").expect("a scene");
        let reflectance = Reflectance::new(&specification.material(0).material, 0.0, Tint::Hue);
        let facets = Facets::new(&scene, &reflectance).expect("a mesh");
        for (column, row) in (0..SIDE).flat_map(|row| (0..SIDE).map(move |column| (column, row))) {
            assert!(facets.may_be_seen(column, row));
            let unmet = facets.unmet(column, row, 300, 0.0);
            assert!((unmet / scene.bulb.radiance - 0.01).abs() < 1e-9, "{unmet}");
        }
    }
}

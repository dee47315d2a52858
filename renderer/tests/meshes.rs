//! Samples that are meshes.

mod plain_path;
mod shapes;

use dataset::{
    Material, Specification,
    specification::{IntegratorKind, SampleMesh, Shape as SampleShape},
};
use mesh::Mesh;
use rayon::prelude::*;
use renderer::{
    Instructions, RenderError, Renderer, Rendering,
    geometry::{BackendChoice, GeometryError, Isa},
    reflectance::Reflectance,
    scene::{Encounter, Scene},
    vector::Vec3,
};
use shapes::Shape;

/// The bytes of a file that holds a shape, perhaps with normals at its vertices.
fn file(shape: &Shape, normal: Option<&dyn Fn(Vec3) -> Vec3>) -> Vec<u8> {
    let positions = shape.positions.iter().map(|at| (*at).into()).collect();
    let normals = normal.map(|normal| {
        let all = shape.positions.iter();
        all.map(|at| normal(*at).into()).collect()
    });
    let mesh = Mesh::new(positions, shape.triangles.clone(), normals, None, None);
    mesh.expect("a mesh").to_ply()
}

/// The preset with a mesh as its sample, on a square film.
fn specification(mesh: Vec<u8>, side: u32) -> Specification {
    let mut specification = Specification::preset();
    specification.sample.shape = SampleShape::Mesh;
    specification.sample.mesh = Some(SampleMesh::of_bytes(mesh).expect("a mesh"));
    (specification.image.width, specification.image.height) = (side, side);
    specification
}

fn renderer(specification: &Specification, backend: BackendChoice) -> Renderer {
    Renderer::new(specification, backend).expect("a renderer")
}

fn render(specification: &Specification, material: &Material, view: u32) -> Rendering {
    let renderer = renderer(specification, BackendChoice::Auto);
    renderer.render(material, Some(1), view).expect("an image")
}

fn rough() -> Material {
    Material {
        roughness: 80.0,
        anisotropy: 0.7,
        angle_deg: 25.0,
        ior: 1.7,
        rgb0: [0.8, 0.3, 0.1],
        rgb90: [0.9, 0.8, 0.7],
    }
}

fn lambertian() -> Material {
    Material {
        roughness: 97.0,
        ..rough()
    }
}

fn smooth() -> Material {
    Material {
        roughness: 20.0,
        anisotropy: 0.4,
        ..rough()
    }
}

fn cloth(side: u32) -> Vec<u8> {
    file(&shapes::cloth(side), None)
}

/// A sphere and a cylinder, finely divided, are the sphere and the cylinder: frames, places and light. Each
/// of two images states 95 percent intervals, and fewer than 3 percent of the pixels may leave their sum.
#[test]
fn fine_meshes_are_the_surfaces_that_they_divide() {
    let outward: &dyn Fn(Vec3) -> Vec3 = &Vec3::normalized;
    let about_x: &dyn Fn(Vec3) -> Vec3 = &|at| Vec3::new(0.0, at.y, at.z).normalized();
    let cases = [
        (
            SampleShape::Sphere,
            file(&shapes::sphere(160, 1.0), Some(outward)),
        ),
        (
            SampleShape::Cylinder,
            file(&shapes::cylinder(4000, 1, 0.5, 1.0), Some(about_x)),
        ),
    ];
    for (shape, bytes) in cases {
        for (material, view) in [
            (rough(), 5),
            (smooth(), 9),
            (lambertian(), 0),
            (smooth(), 12),
        ] {
            for kind in [IntegratorKind::Hybrid, IntegratorKind::Path] {
                let mut of_mesh = specification(bytes.clone(), 24);
                of_mesh.accuracy.relative = 0.02;
                of_mesh.integrator.kind = kind;
                // A cylinder of no texture coordinates has the frame of a sphere: only one along x is its own.
                let mut smooth_one = of_mesh.clone();
                (smooth_one.sample.shape, smooth_one.sample.mesh) = (shape, None);
                let material = match shape {
                    SampleShape::Cylinder => Material {
                        anisotropy: 0.0,
                        ..material
                    },
                    _ => material,
                };
                let [found, expected] = [&of_mesh, &smooth_one]
                    .map(|specification| render(specification, &material, view));
                assert_eq!(found.integrator, kind);
                let pairs = found.film.pixels.iter().zip(&expected.film.pixels);
                let outside = pairs.filter(|(found, expected)| {
                    let off = found.value.iter().zip(expected.value);
                    let off = off.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
                    // What a mesh of chords lacks at the outline.
                    off > found.error + expected.error + 2e-4
                });
                let outside = outside.count();
                assert!(
                    outside * 100 <= 24 * 24 * 3,
                    "{shape:?} {kind:?} {view}: {outside} pixels"
                );
            }
        }
    }
}

/// Shadows, reflections of a cloth in itself and the chart, against plain paths that share the model, the
/// scene and the geometry and nothing else. Of 12 images of 144 pixels one is off by more than this with a
/// probability of 1e-3.
#[test]
fn a_cloth_agrees_with_plain_paths() {
    const T_LIMIT: f64 = 6.5;
    const SIDE: u32 = 12;
    let bytes = cloth(40);
    let cases: Vec<(Material, u32, IntegratorKind)> = [rough(), lambertian()]
        .into_iter()
        .flat_map(|material| [0, 5, 9].map(|view| (material, view)))
        .flat_map(|(material, view)| {
            [IntegratorKind::Hybrid, IntegratorKind::Path].map(|kind| (material, view, kind))
        })
        .collect();
    cases.par_iter().for_each(|(material, view, kind)| {
        let mut specification = specification(bytes.clone(), SIDE);
        specification.accuracy.relative = 0.01;
        specification.integrator.kind = *kind;
        specification.integrator.samples_per_pixel = 256;
        let image = render(&specification, material, *view);
        let scene = Scene::new(&specification, *view as usize, BackendChoice::Auto)
            .expect("a view")
            .expect("a scene");
        let rotation = specification.views[*view as usize].rotation_deg;
        let reflectance = Reflectance::new(material, rotation, specification.tint);
        let mut lit = 0;
        for (index, pixel) in (0u32..).zip(&image.film.pixels) {
            let at = [index % SIDE, index / SIDE];
            let plain = plain_path::pixel(&scene, &reflectance, at, [77, 256]);
            for (value, [mean, error]) in pixel.value.into_iter().zip(plain) {
                // A stated error is half of a 95 percent interval.
                let limit = T_LIMIT * libm::hypot(pixel.error / 1.96, error) + 1e-9;
                assert!(
                    (value - mean).abs() <= limit,
                    "view {view}, {kind:?}, pixel {at:?}: {value} against {mean}, limit {limit}"
                );
            }
            lit += usize::from(pixel.value[0] > 0.02);
        }
        assert!(lit > 20, "{lit} pixels are lit");
    });
}

/// Where all of the bulb is hidden it is dark, and nothing is added by what is worked out.
#[test]
fn a_shadow_is_black() {
    // A plate over a larger one, which the camera sees beside the plate's shadow.
    let square = |half: f64, z: f64| {
        [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]
            .map(|[x, y]| Vec3::new(half * x, half * y, z))
    };
    let shape = Shape {
        positions: [square(1.0, -1.0), square(0.4, 0.0)].concat(),
        triangles: vec![[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]],
    };
    let mut specification = specification(file(&shape, None), 64);
    specification.integrator.max_bounces = 1;
    specification.accuracy.relative = 0.05;
    // From above, with the bulb at an elevation of 45 degrees.
    let view = 8;
    specification.views[view as usize].checker = false;
    let image = render(&specification, &lambertian(), view);
    let scene = Scene::new(&specification, view as usize, BackendChoice::Native);
    let scene = scene.expect("a view").expect("a scene");
    let (mut dark, mut lit) = (0, 0);
    for row in 0..64u32 {
        for column in 0..64u32 {
            let pixel = image.film.pixels[(row * 64 + column) as usize];
            let mut hidden = 0;
            for corner in [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0], [0.5, 0.5]] {
                let ray = scene
                    .camera
                    .ray(f64::from(column) + corner[0], f64::from(row) + corner[1]);
                let Some(Encounter::Surface(surface)) = scene.encounter(&ray, None) else {
                    hidden = -9;
                    break;
                };
                // The plate's shadow on the plane below it, without its penumbra.
                let [x, y] = [surface.position.x, surface.position.y].map(|x| x / 0.05);
                let is_below = surface.position.z < -0.01;
                hidden += i32::from(is_below && x.abs() < 0.36 && (-1.3..-0.7).contains(&y));
            }
            if hidden == 5 {
                assert_eq!(pixel.value, [0.0; 3], "column {column}, row {row}");
                dark += 1;
            }
            lit += usize::from(pixel.value[0] > 0.1);
        }
    }
    assert!(dark > 20 && lit > 200, "{dark} dark, {lit} lit");
}

/// The same bytes, over Embree's instruction sets, without Embree, and on one or three threads.
#[test]
fn bytes_of_meshes_depend_on_nothing_but_the_specification() {
    let specification = specification(cloth(24), 10);
    let view = 5;
    let bytes = |renderer: Renderer| {
        renderer
            .render(&smooth(), Some(1), view)
            .expect("an image")
            .exr
    };
    let expected = bytes(renderer(&specification, BackendChoice::Native));
    for isa in [Isa::Sse2, Isa::Sse42, Isa::Avx, Isa::Avx2, Isa::Avx512] {
        match Renderer::new(&specification, BackendChoice::EmbreeOn(isa)) {
            Ok(renderer) => assert!(bytes(renderer) == expected, "{isa}"),
            Err(RenderError::Geometry(GeometryError::Embree(_))) => {}
            Err(error) => panic!("{error}"),
        }
    }
    for instructions in Instructions::available() {
        let renderer =
            renderer(&specification, BackendChoice::Auto).with_instructions(instructions);
        assert!(bytes(renderer) == expected, "{instructions:?}");
    }
    for threads in [1, 3] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        let again = pool
            .expect("a pool")
            .install(|| bytes(renderer(&specification, BackendChoice::Auto)));
        assert!(again == expected, "{threads} threads");
    }
}

/// `tests/meshes.sh` runs it.
#[test]
#[ignore = "without a hierarchy each ray tests a million triangles: minutes"]
fn a_million_triangles_have_one_digest() {
    let shape = shapes::torus(1000, 500, 1.0, 0.4);
    assert_eq!(shape.triangles.len(), 1_000_000);
    let mut specification = specification(file(&shape, None), 6);
    specification.integrator.kind = IntegratorKind::Path;
    specification.integrator.samples_per_pixel = 16;
    let digest = |backend: BackendChoice, threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        let renderer = renderer(&specification, backend);
        let rendered = pool
            .expect("a pool")
            .install(|| renderer.render(&smooth(), Some(1), 5));
        dataset::Digest::of(&rendered.expect("an image").exr)
    };
    let expected = digest(BackendChoice::Native, 2);
    for isa in [Isa::Sse2, Isa::Avx2, Isa::Avx512] {
        match Renderer::new(&specification, BackendChoice::EmbreeOn(isa)) {
            Ok(_) => {}
            Err(RenderError::Geometry(GeometryError::Embree(_))) => continue,
            Err(error) => panic!("{error}"),
        }
        for threads in [1, 2] {
            assert_eq!(
                digest(BackendChoice::EmbreeOn(isa), threads),
                expected,
                "{isa}, {threads}"
            );
        }
    }
}

/// Of several materials and views of a folded cloth at coarse accuracies, at least 96 percent of the pixels
/// of each image are within what they state of one that is much finer.
#[test]
fn meshes_state_their_error() {
    let bytes = cloth(60);
    let mirror_like = Material {
        roughness: 5.0,
        ..smooth()
    };
    let cases: Vec<(Material, u32, f64)> = [lambertian(), rough(), smooth(), mirror_like]
        .into_iter()
        .flat_map(|material| [(material, 5, 0.1), (material, 9, 0.02), (material, 12, 0.1)])
        .collect();
    cases.par_iter().for_each(|(material, view, relative)| {
        let outside = share_beyond_stated(&bytes, material, *view, *relative);
        assert!(
            outside <= 0.04,
            "R {} view {view}: {outside} of the pixels",
            material.roughness
        );
    });
}

/// The share of the pixels of a small image that differ by more than is stated from those of a much finer one.
fn share_beyond_stated(mesh: &[u8], material: &Material, view: u32, relative: f64) -> f64 {
    const SIDE: u32 = 24;
    let mut coarse = specification(mesh.to_vec(), SIDE);
    coarse.accuracy.relative = relative;
    coarse.accuracy.absolute = 0.1 * relative;
    coarse.integrator.samples_per_pixel = 32;
    let mut fine = coarse.clone();
    fine.accuracy.relative = 0.001;
    fine.accuracy.absolute = 0.0001;
    fine.integrator.samples_per_pixel = 512;
    let [found, finer] =
        [&coarse, &fine].map(|specification| render(specification, material, view));
    let pairs = found.film.pixels.iter().zip(&finer.film.pixels);
    let outside = pairs.filter(|(found, finer)| {
        let off = found.value.iter().zip(finer.value);
        let off = off.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        off > libm::hypot(found.error, finer.error)
    });
    outside.count() as f64 / f64::from(SIDE * SIDE)
}

/// The mean normal, by area, of the triangles about a vertex.
fn mean_normal(shape: &Shape, vertex: Vec3) -> Vec3 {
    let corners = shape.triangles.iter();
    let corners = corners.map(|triangle| triangle.map(|at| shape.positions[at as usize]));
    let about = corners.filter(|corners| corners.contains(&vertex));
    let areas = about.map(|[a, b, c]| (b - a).cross(c - a));
    areas
        .fold(Vec3::default(), |sum, area| sum + area)
        .normalized()
}

/// The same of materials and views that nobody chose, on cloths of flat triangles and of smooth ones: 5 percent
/// are allowed in all, and of one image, whose pixels share features, 8.
#[test]
#[ignore = "the fine images take minutes"]
#[allow(clippy::print_stdout, reason = "it tells its figures")]
fn drawn_materials_on_meshes_state_their_error() {
    const IMAGES: u32 = 80;
    let shape = shapes::cloth(60);
    let meshes = [cloth(60), file(&shape, Some(&|at| mean_normal(&shape, at)))];
    let preset = Specification::preset();
    let shares: Vec<f64> = (0..IMAGES)
        .into_par_iter()
        .map(|number| {
            let material = preset.material(1000 + number).material;
            let (view, mesh) = (number * 5 % 14, &meshes[number as usize % 2]);
            let relative = [0.02, 0.1][number as usize / 2 % 2];
            let share = share_beyond_stated(mesh, &material, view, relative);
            println!(
                "{number} R {:.1} view {view} relative {relative}: {share:.4}",
                material.roughness
            );
            share
        })
        .collect();
    let mean = shares.iter().sum::<f64>() / f64::from(IMAGES);
    println!("mean {mean:.4}");
    assert!(mean <= 0.05, "{mean}");
    assert!(shares.iter().all(|share| *share <= 0.08), "{shares:?}");
}

/// The x axis of the material follows the file's tangents, or else the texture coordinate u, also where that
/// is mirrored, or else is the world's, carried along.
#[test]
fn frames_follow_tangents_or_texture_coordinates() {
    let positions = vec![
        [-1.0, -1.0, 0.0],
        [1.0, -1.0, 0.0],
        [1.0, 1.0, 0.0],
        [-1.0, 1.0, 0.0],
    ];
    let triangles = vec![[0, 1, 2], [0, 2, 3]];
    // u grows along +y, and v along +x, which mirrors them; tilted normals and tangents.
    let uvs = vec![[0.0, 0.0], [0.0, 1.0], [1.0, 1.0], [1.0, 0.0]];
    let normals = vec![[0.0, 0.6, 0.8]; 4];
    let tangents = vec![[-1.0, 0.0, 0.0]; 4];
    let [x, y, z] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(Vec3::from);
    let tilted = Vec3::new(0.0, 0.6, 0.8);
    let along_y = Vec3::new(0.0, 0.8, -0.6);
    for (normals, tangents, uvs, expected) in [
        (None, None, None, [x, z]),
        (None, None, Some(uvs.clone()), [y, z]),
        (Some(normals.clone()), None, None, [x, tilted]),
        (
            Some(normals.clone()),
            None,
            Some(uvs.clone()),
            [along_y, tilted],
        ),
        (Some(normals), Some(tangents), Some(uvs), [-x, tilted]),
    ] {
        let mesh = Mesh::new(positions.clone(), triangles.clone(), normals, tangents, uvs);
        let specification = specification(mesh.expect("a mesh").to_ply(), 4);
        let scene = Scene::new(&specification, 12, BackendChoice::Native);
        let scene = scene.expect("a view").expect("a scene");
        let Some(Encounter::Surface(surface)) = scene.encounter(&scene.camera.ray(2.1, 2.3), None)
        else {
            panic!("the camera sees the mesh");
        };
        let [along, normal] = expected;
        let frame = surface.frame;
        for (found, expected) in [
            (frame.x, along),
            (frame.z, normal),
            (frame.y, normal.cross(along)),
        ] {
            assert!(
                (found - expected).length() < 1e-12,
                "{frame:?}, not {expected:?}"
            );
        }
    }
}

/// A mesh that is only named is refused with a sentence.
#[test]
fn a_mesh_that_is_not_loaded_is_refused() {
    let named = Specification::from_json(&specification(cloth(2), 4).to_json()).expect("JSON");
    let refused = Renderer::new(&named, BackendChoice::Auto).map(|_| ());
    let error = refused.expect_err("no mesh").to_string();
    assert!(error.contains("not loaded"), "{error}");
}

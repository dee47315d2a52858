//! No ray slips through a closed mesh, and every instruction set gives each ray the same answer.

mod shapes;

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use renderer::geometry::{
    BackendChoice, FIRST_TRIANGLE, Geometry, Hit, Isa, PrimitiveId, Ray, TracedMesh, Triangles,
};
use renderer::vector::Vec3;
use shapes::Shape;
use std::sync::Arc;

/// Rays of the test that always runs, for each shape.
const RAYS: u64 = 60_000;
/// Rays of the long test, for each of five shapes.
const RAYS_LONG: u64 = 2_000_000;

/// Evenly between `low` and `high`.
fn between(random: &mut ChaCha8Rng, low: f64, high: f64) -> f64 {
    low + (high - low) * (random.next_u64() >> 11) as f64 / (1u64 << 53) as f64
}

fn below(random: &mut ChaCha8Rng, count: usize) -> usize {
    (random.next_u64() % count as u64) as usize
}

fn direction(random: &mut ChaCha8Rng) -> Vec3 {
    loop {
        let [x, y, z] = [(); 3].map(|()| between(random, -1.0, 1.0));
        let v = Vec3::new(x, y, z);
        if (0.01..1.0).contains(&v.length_squared()) {
            return v.normalized();
        }
    }
}

fn traced(shape: &Shape, backend: BackendChoice) -> Geometry {
    let triangles = Triangles::new(
        shape.positions.clone().into(),
        shape.triangles.clone().into(),
    );
    let mesh = TracedMesh::new(triangles.expect("triangles"), backend).expect("a backend");
    Geometry::with_mesh(Vec::new(), Arc::new(mesh)).expect("a geometry")
}

/// A closed shape, and points of its inside.
struct Closed {
    shape: Shape,
    inside: fn(&mut ChaCha8Rng) -> Vec3,
    /// Whether all of it is seen from there. A ray may pass an edge that it only grazes.
    is_seen: bool,
}

fn closed_shapes() -> Vec<(&'static str, Closed)> {
    let about_centre: fn(&mut ChaCha8Rng) -> Vec3 =
        |random| direction(random) * between(random, 0.0, 0.3);
    let at_centre: fn(&mut ChaCha8Rng) -> Vec3 = |random| direction(random) * 0.01;
    let in_tube = |random: &mut ChaCha8Rng| {
        let (sin, cos) = libm::sincos(between(random, 0.0, 6.3));
        Vec3::new(cos, sin, 0.0) + direction(random) * between(random, 0.0, 0.05)
    };
    // Every vertex moved along its own ray from the centre: as jagged as can be, and closed.
    let jagged = shapes::sphere(24, 1.0).moved(|at| {
        let [x, y, z] = [at.x, at.y, at.z].map(|x| (x * 1e6).round());
        at * (0.75 + 0.25 * libm::sin(x + 3.0 * y + 7.0 * z))
    });
    // Triangles a hundred thousand times as long as others, and slivers: stretched away from a pole. Embree's
    // boxes are padded by a share of the longest, so it culls little here.
    let stretched = shapes::sphere(8, 1.0).moved(|at| {
        let beyond = (at.z - 0.8).max(0.0);
        Vec3::new(at.x, at.y, at.z + 4e6 * beyond * beyond * beyond)
    });
    // Far from the origin, where coordinates have lost 20 bits.
    let far = |at: Vec3| at + Vec3::new(1e6, -2e6, 3e6);
    let of = |shape: Shape, inside: fn(&mut ChaCha8Rng) -> Vec3| Closed {
        shape,
        inside,
        is_seen: true,
    };
    let torus = Closed {
        is_seen: false,
        ..of(shapes::torus(64, 48, 1.0, 0.2), in_tube)
    };
    vec![
        (
            "tetrahedron-like sphere",
            of(shapes::sphere(1, 1.0), about_centre),
        ),
        ("jagged", of(jagged, at_centre)),
        ("stretched", of(stretched, about_centre)),
        ("torus", torus),
        (
            "far away",
            of(shapes::sphere(6, 1.0).moved(far), |random| {
                let inside = direction(random) * between(random, 0.0, 0.9);
                inside + Vec3::new(1e6, -2e6, 3e6)
            }),
        ),
    ]
}

/// A point of an edge, or a vertex, of a triangle drawn at random.
fn brink(random: &mut ChaCha8Rng, shape: &Shape) -> Vec3 {
    let corners = shape.corners(below(random, shape.triangles.len()));
    let from = below(random, 3);
    let share = match below(random, 4) {
        0 => 0.0,
        1 => 0.5,
        _ => between(random, 0.0, 1.0),
    };
    let [a, b] = [from, (from + 1) % 3].map(|at| corners[at]);
    a + (b - a) * share
}

fn towards(origin: Vec3, point: Vec3) -> Ray {
    Ray {
        origin,
        direction: (point - origin).normalized(),
    }
}

fn instruction_sets() -> Vec<BackendChoice> {
    let all = [Isa::Sse2, Isa::Sse42, Isa::Avx, Isa::Avx2, Isa::Avx512];
    let has = |isa: &Isa| {
        let shape = shapes::sphere(1, 1.0);
        let triangles = Triangles::new(shape.positions.into(), shape.triangles.into());
        let choice = BackendChoice::EmbreeOn(*isa);
        TracedMesh::new(triangles.expect("triangles"), choice).is_ok()
    };
    all.into_iter()
        .filter(has)
        .map(BackendChoice::EmbreeOn)
        .collect()
}

fn bits(hit: Option<Hit>) -> Option<(u64, u64, u64, PrimitiveId)> {
    hit.map(|hit| {
        let [distance, u, v] = [hit.distance, hit.u, hit.v].map(f64::to_bits);
        (distance, u, v, hit.primitive)
    })
}

/// From inside, every ray meets the shape, and where all of it is seen no farther than the brink that it is
/// aimed at.
fn aim(count: u64) {
    let choices = instruction_sets();
    for (name, closed) in closed_shapes() {
        let Closed {
            shape,
            inside,
            is_seen,
        } = closed;
        let geometries: Vec<Geometry> = choices.iter().map(|&on| traced(&shape, on)).collect();
        // The native loop tests all triangles: a share of the rays.
        let native = traced(&shape, BackendChoice::Native);
        let native_every = 1 + shape.triangles.len() as u64 / 16;
        let mut random = ChaCha8Rng::seed_from_u64(4);
        for number in 0..count {
            let origin = inside(&mut random);
            let point = brink(&mut random, &shape);
            let ray = towards(origin, point);
            let reach = (point - origin).length();
            let mut others = geometries.iter();
            let first = others.next().unwrap_or(&native);
            let hit = first.intersect(&ray, None);
            let found =
                hit.unwrap_or_else(|| panic!("{name}: ray {number} slips through: {ray:?}"));
            assert!(
                !is_seen || found.distance <= reach * (1.0 + 1e-9) + 1e-9,
                "{name}: ray {number} passes {point:?}: {found:?}"
            );
            for other in others {
                assert_eq!(
                    bits(other.intersect(&ray, None)),
                    bits(hit),
                    "{name}: {ray:?}"
                );
            }
            assert!(
                first.occluded(&ray, None, None, f64::INFINITY),
                "{name}: {ray:?}"
            );
            if number % native_every == 0 {
                assert_eq!(
                    bits(native.intersect(&ray, None)),
                    bits(hit),
                    "{name}: {ray:?}"
                );
            }
        }
    }
}

#[test]
fn no_ray_slips_through_an_edge_or_a_vertex() {
    aim(RAYS);
}

/// `tests/meshes.sh` runs it.
#[test]
#[ignore = "ten million rays on every instruction set take minutes"]
fn no_ray_of_ten_million_slips_through() {
    aim(RAYS_LONG);
}

/// Along an edge and through a vertex, as seen from outside: whether it is met or not, every backend says
/// the same, and the ray that leaves a triangle does not meet it again.
#[test]
fn rays_from_outside_get_one_answer() {
    let choices = instruction_sets();
    for (name, Closed { shape, inside, .. }) in closed_shapes() {
        let geometries: Vec<Geometry> = choices.iter().map(|&on| traced(&shape, on)).collect();
        let native = traced(&shape, BackendChoice::Native);
        let mut random = ChaCha8Rng::seed_from_u64(5);
        for _ in 0..100 {
            let [a, b] = [(); 2].map(|()| brink(&mut random, &shape));
            let centre = inside(&mut random);
            let origins = [
                centre + (a - centre) * between(&mut random, 1.0, 3.0),
                // So far away that Embree's ray begins elsewhere, and rounding decides.
                centre + direction(&mut random) * libm::exp10(between(&mut random, 0.0, 12.0)),
                a,
            ];
            for origin in origins {
                let ray = towards(origin, b);
                let hit = native.intersect(&ray, None);
                let from = hit.map(|hit| hit.primitive);
                let next = native.intersect(&ray, from);
                assert!(next.is_none() || next.map(|hit| hit.primitive) != from);
                let hidden = native.occluded(&ray, from, None, 1.5);
                for geometry in &geometries {
                    assert_eq!(
                        bits(geometry.intersect(&ray, None)),
                        bits(hit),
                        "{name}: {ray:?}"
                    );
                    assert_eq!(
                        bits(geometry.intersect(&ray, from)),
                        bits(next),
                        "{name}: {ray:?}"
                    );
                    assert_eq!(
                        geometry.occluded(&ray, from, None, 1.5),
                        hidden,
                        "{name}: {ray:?}"
                    );
                }
            }
        }
    }
}

/// A million triangles without area or twice the same: of equals the first is met.
#[test]
fn of_equal_triangles_the_first_is_met() {
    let mut shape = shapes::sphere(6, 1.0);
    let twice = shape.triangles.clone();
    shape.triangles.extend(twice);
    for backend in [vec![BackendChoice::Native], instruction_sets()].concat() {
        let geometry = traced(&shape, backend);
        let mut random = ChaCha8Rng::seed_from_u64(6);
        for _ in 0..2000 {
            let ray = Ray {
                origin: Vec3::default(),
                direction: direction(&mut random),
            };
            let hit = geometry.intersect(&ray, None).expect("closed");
            let index = hit.primitive.0 - FIRST_TRIANGLE.0;
            assert!((index as usize) < shape.triangles.len() / 2, "{hit:?}");
        }
    }
}

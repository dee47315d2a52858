//! The two backends give the same bits, on every instruction set of this machine. These tests
//! need Embree: without it they fail and say what to run.

use std::process::Command;
use std::{env, hint, thread};

use rayon::prelude::*;
use renderer::geometry::{
    BackendChoice, BackendKind, Cylinder, Geometry, Hit, Isa, Primitive, PrimitiveId, Ray,
    Rectangle, Sphere,
};
use renderer::vector::Vec3;

/// Rays for each scene; over a million in all for each instruction set.
const RAYS_PER_SCENE: usize = 210_000;
const SCENE_SIZES: [u32; 5] = [3, 10, 30, 100, 300];

/// SplitMix64 (Steele, Lea and Flood, "Fast Splittable Pseudorandom Number Generators", 2014).
struct Random(u64);

impl Random {
    fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mixed = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        mixed ^ (mixed >> 31)
    }

    /// In [low, high).
    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * ((self.bits() >> 11) as f64 * f64::EPSILON / 2.0)
    }

    fn below(&mut self, count: u32) -> u32 {
        (self.bits() >> 32) as u32 % count
    }

    fn in_cube(&mut self, half: f64) -> Vec3 {
        Vec3::from([(); 3].map(|()| self.between(-half, half)))
    }

    fn direction(&mut self) -> Vec3 {
        loop {
            let v = self.in_cube(1.0);
            if (0.01..1.0).contains(&v.length_squared()) {
                return v.normalized();
            }
        }
    }
}

/// Rectangles at all angles and along the axes, spheres small and large, tiles that share edges,
/// and copies of earlier primitives, which tie with them everywhere.
fn scene(random: &mut Random, count: u32) -> Vec<Primitive> {
    let mut primitives: Vec<Primitive> = Vec::new();
    while primitives.len() < count as usize {
        let id = primitives.len() as u32;
        primitives.push(match random.below(8) {
            0 if id > 0 => primitives[random.below(id) as usize],
            1 => {
                let (x, y) = (Vec3::new(1.0, 0.0, 0.0), Vec3::new(0.0, 1.0, 0.0));
                let corner = Vec3::new(f64::from(id % 4) * 0.04, f64::from(id / 4 % 6) * 0.04, 0.1);
                Primitive::Rectangle(Rectangle::new(corner, x, y, 0.04, 0.04))
            }
            2 | 3 => {
                let u_axis = random.direction();
                let v_axis = u_axis.cross(random.direction()).normalized();
                let sides = [(); 2].map(|()| random.between(0.01, 0.6));
                let corner = random.in_cube(1.0);
                Primitive::Rectangle(Rectangle::new(corner, u_axis, v_axis, sides[0], sides[1]))
            }
            4 | 5 => Primitive::Cylinder(Cylinder {
                start: random.in_cube(1.0),
                axis: random.direction(),
                radius: random.between(0.003, 0.2),
                length: random.between(0.01, 0.6),
            }),
            _ => Primitive::Sphere(Sphere {
                centre: random.in_cube(1.0),
                radius: random.between(0.003, 0.25),
            }),
        });
    }
    primitives
}

fn point_on(random: &mut Random, primitive: &Primitive) -> Vec3 {
    match primitive {
        Primitive::Rectangle(r) => {
            let (u, v) = (random.between(0.0, 1.0), random.between(0.0, 1.0));
            r.corner + r.u_axis * (u * r.u_length) + r.v_axis * (v * r.v_length)
        }
        Primitive::Sphere(s) => s.centre + random.direction() * s.radius,
        Primitive::Cylinder(c) => {
            let across = c.axis.cross(random.direction()).normalized();
            c.start + c.axis * (random.between(0.0, 1.0) * c.length) + across * c.radius
        }
    }
}

/// A point on an edge, at a corner or at the silhouette as seen from `origin`.
fn brink_of(random: &mut Random, primitive: &Primitive, origin: Vec3) -> Vec3 {
    match primitive {
        Primitive::Rectangle(r) => {
            let end = f64::from(random.below(2));
            let along = if random.below(4) == 0 {
                f64::from(random.below(2))
            } else {
                random.between(0.0, 1.0)
            };
            let (u, v) = if random.below(2) == 0 {
                (end, along)
            } else {
                (along, end)
            };
            r.corner + r.u_axis * (u * r.u_length) + r.v_axis * (v * r.v_length)
        }
        Primitive::Sphere(s) => {
            let out = origin - s.centre;
            let sine_squared = s.radius * s.radius / out.length_squared();
            if sine_squared >= 1.0 {
                return point_on(random, primitive);
            }
            // The circle where lines from the origin touch the sphere.
            let across = out.cross(random.direction()).normalized();
            s.centre + out * sine_squared + across * (s.radius * (1.0 - sine_squared).sqrt())
        }
        Primitive::Cylinder(c) => {
            let end = c.axis * (f64::from(random.below(2)) * c.length);
            let out = origin - c.start;
            let out = out - c.axis * out.dot(c.axis);
            let sine_squared = c.radius * c.radius / out.length_squared();
            if sine_squared >= 1.0 || random.below(2) == 0 {
                let across = c.axis.cross(random.direction()).normalized();
                return c.start + end + across * c.radius;
            }
            // A line where planes from the origin touch the mantle.
            let across = out.cross(c.axis).normalized() * (c.radius * (1.0 - sine_squared).sqrt());
            let side = if random.below(2) == 0 {
                across
            } else {
                -across
            };
            c.start + c.axis * (random.between(0.0, 1.0) * c.length) + out * sine_squared + side
        }
    }
}

struct Question {
    ray: Ray,
    from: Option<PrimitiveId>,
    target: Option<PrimitiveId>,
    distance_max: f64,
}

/// Half of the questions are aimed at a brink, exactly or a few roundings beside it.
fn question(random: &mut Random, primitives: &[Primitive], aimed: bool) -> Question {
    let count = primitives.len() as u32;
    let (origin, from) = match random.below(8) {
        0..3 => (random.in_cube(1.5), None),
        // Beyond what is given to Embree.
        3 => (random.in_cube(100.0), None),
        _ => {
            let id = random.below(count);
            let primitive = &primitives[id as usize];
            let planar = matches!(primitive, Primitive::Rectangle(_));
            (
                point_on(random, primitive),
                planar.then_some(PrimitiveId(id)),
            )
        }
    };
    let target = random.below(count);
    let direction = if aimed {
        let brink = brink_of(random, &primitives[target as usize], origin);
        let nudge = [0.0, 1e-16, 1e-15, 1e-9][random.below(4) as usize];
        (brink + random.direction() * nudge - origin).normalized()
    } else if random.below(50) == 0 {
        let axis = random.below(3);
        let sign = if random.below(2) == 0 { 1.0 } else { -1.0 };
        Vec3::from([0, 1, 2].map(|i| if i == axis { sign } else { 0.0 }))
    } else {
        random.direction()
    };
    let distance_max = if random.below(4) == 0 {
        f64::INFINITY
    } else {
        random.between(0.0, 3.0)
    };
    Question {
        ray: Ray { origin, direction },
        from,
        target: (random.below(2) == 0).then_some(PrimitiveId(target)),
        distance_max,
    }
}

fn questions(random: &mut Random, primitives: &[Primitive], count: usize) -> Vec<Question> {
    (0..count)
        .map(|i| question(random, primitives, i % 2 == 0))
        .collect()
}

type Answer = (Option<[u64; 4]>, bool);

fn answer(geometry: &Geometry, question: &Question) -> Answer {
    let Question {
        ray,
        from,
        target,
        distance_max,
    } = question;
    let bits = |hit: Hit| {
        let Hit {
            distance,
            primitive,
            u,
            v,
        } = hit;
        [
            distance.to_bits(),
            primitive.0.into(),
            u.to_bits(),
            v.to_bits(),
        ]
    };
    (
        geometry.intersect(ray, *from).map(bits),
        geometry.occluded(ray, *from, *target, *distance_max),
    )
}

fn geometry(primitives: &[Primitive], choice: BackendChoice) -> Geometry {
    Geometry::new(primitives.to_vec(), choice).unwrap_or_else(|error| panic!("{error}"))
}

#[cfg(target_arch = "x86_64")]
fn instruction_sets() -> Vec<Isa> {
    let has = |isa: &Isa| match isa {
        Isa::Sse2 => true,
        Isa::Sse42 => is_x86_feature_detected!("sse4.2"),
        Isa::Avx => is_x86_feature_detected!("avx"),
        Isa::Avx2 => is_x86_feature_detected!("avx2"),
        Isa::Avx512 => is_x86_feature_detected!("avx512f"),
    };
    Isa::ALL.into_iter().filter(has).collect()
}

#[cfg(not(target_arch = "x86_64"))]
fn instruction_sets() -> Vec<Isa> {
    Vec::new()
}

#[test]
fn backends_agree_to_the_bit() {
    for size in SCENE_SIZES {
        let mut random = Random(u64::from(size));
        let primitives = scene(&mut random, size);
        let questions = questions(&mut random, &primitives, RAYS_PER_SCENE);
        let native = geometry(&primitives, BackendChoice::Native);
        let expected: Vec<Answer> = questions
            .par_iter()
            .map(|question| answer(&native, question))
            .collect();
        // Questions whose answers are all alike would show nothing.
        let hits = expected.iter().filter(|(hit, _)| hit.is_some()).count();
        let occluded = expected.iter().filter(|(_, occluded)| *occluded).count();
        for count in [hits, occluded] {
            assert!(
                count > RAYS_PER_SCENE / 40 && count < RAYS_PER_SCENE,
                "{count} of {size}"
            );
        }
        let widest = geometry(&primitives, BackendChoice::Embree);
        assert_eq!(widest.backend(), BackendKind::Embree);
        let forced = instruction_sets().into_iter().map(|isa| {
            let geometry = Geometry::new(primitives.clone(), BackendChoice::EmbreeOn(isa));
            (
                isa.to_string(),
                geometry.unwrap_or_else(|error| panic!("{error}")),
            )
        });
        for (name, embree) in forced.chain([("widest".to_owned(), widest)]) {
            let differing = questions
                .par_iter()
                .zip(&expected)
                .filter(|(question, expected)| answer(&embree, question) != **expected)
                .count();
            assert_eq!(differing, 0, "{name} with {size} primitives");
        }
    }
}

#[test]
fn threads_build_and_ask_at_once() {
    let mut random = Random(7);
    let primitives = scene(&mut random, 60);
    let questions = questions(&mut random, &primitives, 20_000);
    let shared = geometry(&primitives, BackendChoice::Embree);
    let alone: Vec<Answer> = questions
        .iter()
        .map(|question| answer(&shared, question))
        .collect();
    thread::scope(|scope| {
        for _ in 0..8 {
            scope.spawn(|| {
                // Its own scene, built and dropped while the others trace, and the shared one.
                for chunk in 0..10 {
                    let own = geometry(&primitives, BackendChoice::Embree);
                    for i in (chunk..questions.len()).step_by(10) {
                        assert_eq!(answer(&shared, &questions[i]), alone[i]);
                        assert_eq!(answer(&own, &questions[i]), alone[i]);
                    }
                }
            });
        }
    });
}

#[test]
fn building_leaves_subnormal_numbers_alone() {
    let primitives = scene(&mut Random(3), 300);
    let embree = geometry(&primitives, BackendChoice::Embree);
    let half = hint::black_box(f64::MIN_POSITIVE) / 2.0;
    assert!(half > 0.0 && hint::black_box(half) * 2.0 == f64::MIN_POSITIVE);
    // Asking does so too.
    let ray = Ray {
        origin: Vec3::default(),
        direction: Vec3::new(0.0, 0.0, 1.0),
    };
    hint::black_box(embree.intersect(&ray, None));
    assert!(hint::black_box(f64::MIN_POSITIVE) / 2.0 > 0.0);
}

/// The library is loaded once in a process, so a process of its own looks in vain.
#[test]
fn library_that_is_named_and_missing_is_an_error_unless_the_backend_is_native() {
    const NAME: &str = "library_that_is_named_and_missing_is_an_error_unless_the_backend_is_native";
    const MISSING: &str = "/nonexistent/libembree4.so.4";
    if env::var_os("EMBREE_LIBRARY").is_none_or(|path| path != MISSING) {
        let output = Command::new(env::current_exe().unwrap())
            .args(["--exact", NAME])
            .env("EMBREE_LIBRARY", MISSING)
            .output()
            .unwrap();
        let text = String::from_utf8_lossy(&output.stdout);
        assert!(
            output.status.success() && text.contains("1 passed"),
            "{text}"
        );
        return;
    }
    let primitives = scene(&mut Random(5), 300);
    let error = Geometry::new(primitives.clone(), BackendChoice::Embree).unwrap_err();
    assert_eq!(
        error.to_string(),
        format!("EMBREE_LIBRARY names {MISSING:?}, which cannot be used: no such file")
    );
    assert!(Geometry::new(primitives.clone(), BackendChoice::EmbreeOn(Isa::Sse2)).is_err());
    assert!(Geometry::new(primitives.clone(), BackendChoice::Auto).is_err());
    // Where Embree would not be used, too: whoever names it wants it.
    let few = primitives[..3].to_vec();
    assert!(Geometry::new(few.clone(), BackendChoice::Auto).is_err());
    assert!(Geometry::new(few, BackendChoice::Native).is_ok());
}

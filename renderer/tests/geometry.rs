//! What counts as a hit: where on a surface, at which distance, at which edges.

use std::f64::consts::FRAC_1_SQRT_2;

use proptest::prelude::*;
use renderer::geometry::{
    BackendChoice, BackendKind, Cylinder, EMBREE_PRIMITIVES_MIN, Geometry, GeometryError, Hit,
    Primitive, PrimitiveId, Ray, Rectangle, Sphere,
};
use renderer::vector::Vec3;

/// How far off its surface a hit may be, in units of 2^-52 of the sum of the lengths in play. The
/// largest seen in two million cases was 1.7.
const SURFACE_ULPS_MAX: f64 = 4.0;

fn native(primitives: Vec<Primitive>) -> Geometry {
    Geometry::new(primitives, BackendChoice::Native).unwrap_or_else(|error| panic!("{error}"))
}

fn towards(origin: Vec3, point: Vec3) -> Ray {
    Ray {
        origin,
        direction: (point - origin).normalized(),
    }
}

fn vector(range: std::ops::Range<f64>) -> impl Strategy<Value = Vec3> {
    [range.clone(), range.clone(), range].prop_map(Vec3::from)
}

/// Two unit vectors at a right angle.
fn axes() -> impl Strategy<Value = (Vec3, Vec3)> {
    (vector(-1.0..1.0), vector(-1.0..1.0))
        .prop_filter(
            "too short or too near each other to span a plane",
            |(a, b)| a.cross(*b).length() > 0.01,
        )
        .prop_map(|(a, b)| {
            let u_axis = a.normalized();
            let normal = a.cross(b).normalized();
            (u_axis, normal.cross(u_axis).normalized())
        })
}

fn unit_square(z: f64) -> Primitive {
    Primitive::Rectangle(Rectangle::new(
        Vec3::new(0.0, 0.0, z),
        Vec3::new(1.0, 0.0, 0.0),
        Vec3::new(0.0, 1.0, 0.0),
        1.0,
        1.0,
    ))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(20_000))]

    #[test]
    fn sphere_is_hit_on_its_surface(
        centre in vector(-100.0..100.0),
        origin in vector(-100.0..100.0),
        radius_exponent in -4.0..1.0,
        aside in vector(-1.0..1.0),
        offset in prop_oneof![0.0..1.0, 0.999..1.001],
    ) {
        let radius = libm::exp10(radius_exponent);
        let to_centre = centre - origin;
        // A point at `offset` radii from the centre, seen at a right angle.
        let across = to_centre.cross(aside);
        prop_assume!(across.length() > 1e-3 * to_centre.length());
        let ray = towards(origin, centre + across.normalized() * (offset * radius));
        let hit = native(vec![Primitive::Sphere(Sphere { centre, radius })]).intersect(&ray, None);
        let Some(hit) = hit else {
            prop_assert!(offset > 0.99, "missed at {offset} radii from the centre");
            return Ok(());
        };
        let out = ray.at(hit.distance) - centre;
        let scale = origin.length() + centre.length() + radius + hit.distance;
        let error = (out.length() - radius).abs();
        prop_assert!(
            error <= SURFACE_ULPS_MAX * f64::EPSILON * scale,
            "{error:e} off the surface at scale {scale}"
        );
        prop_assert!(hit.distance > 0.0);
        // The near side from outside, the far side from inside; at the silhouette either.
        let slack = 1e-5 * radius;
        let inside = to_centre.length() < radius;
        let side = out.dot(ray.direction);
        prop_assert!(if inside { side >= -slack } else { side <= slack }, "{side}");
    }

    #[test]
    fn cylinder_is_hit_on_its_mantle(
        start in vector(-100.0..100.0),
        origin in vector(-100.0..100.0),
        axis in vector(-1.0..1.0),
        exponents in (-4.0..1.0, -4.0..2.0),
        place in -0.2..1.2,
        offset in prop_oneof![0.0..1.0, 0.999..1.001],
    ) {
        prop_assume!(axis.length() > 1e-3);
        let axis = axis.normalized();
        let (radius, length) = (libm::exp10(exponents.0), libm::exp10(exponents.1));
        // A point at `offset` radii from the axis, seen at a right angle.
        let beside = start + axis * (place * length);
        let across = (beside - origin).cross(axis);
        prop_assume!(across.length() > 1e-3 * (beside - origin).length());
        let ray = towards(origin, beside + across.normalized() * (offset * radius));
        let cylinder = Cylinder { start, axis, radius, length };
        let hit = native(vec![Primitive::Cylinder(cylinder)]).intersect(&ray, None);
        let along = |distance: f64| (ray.at(distance) - start).dot(axis);
        let Some(hit) = hit else {
            // Both ends of the chord are beyond the same end of the cylinder, or beyond either.
            let half_chord = radius / axis.cross(ray.direction).length();
            let reach = half_chord * axis.dot(ray.direction).abs() / length;
            let is_within = (reach..1.0 - reach).contains(&place);
            prop_assert!(offset > 0.99 || !is_within, "missed at {offset} radii, {place}");
            return Ok(());
        };
        let place = along(hit.distance);
        let scale = origin.length() + start.length() + radius + length + hit.distance;
        let slack = SURFACE_ULPS_MAX * f64::EPSILON * scale;
        prop_assert!((-slack..length + slack).contains(&place), "{place} of {length}");
        prop_assert!((hit.u * length - place).abs() <= slack);
        let out = ray.at(hit.distance) - start - axis * place;
        let error = (out.length() - radius).abs();
        prop_assert!(error <= slack, "{error:e} off the mantle at scale {scale}");
    }

    #[test]
    fn rectangle_is_hit_on_its_plane_and_where_aimed(
        corner in vector(-10.0..10.0),
        origin in vector(-10.0..10.0),
        (u_axis, v_axis) in axes(),
        sides in [0.01..5.0, 0.01..5.0],
        at in [-0.5..1.5, -0.5..1.5],
    ) {
        let rectangle = Rectangle::new(corner, u_axis, v_axis, sides[0], sides[1]);
        let point = corner + u_axis * (at[0] * sides[0]) + v_axis * (at[1] * sides[1]);
        let ray = towards(origin, point);
        let cosine = ray.direction.dot(rectangle.normal).abs();
        prop_assume!(cosine > 1e-3);
        let scale = origin.length() + corner.length() + sides[0] + sides[1];
        let bound = SURFACE_ULPS_MAX * f64::EPSILON * scale;
        // Along the plane an error grows by the slant.
        let slack = bound / cosine;
        let edge = at.iter().zip(sides).any(|(at, side): (&f64, f64)| {
            (at * side).abs() <= slack || ((at - 1.0) * side).abs() <= slack
        });
        prop_assume!(!edge);
        let expected = at.iter().all(|at| (0.0..1.0).contains(at));
        let hit = native(vec![Primitive::Rectangle(rectangle)]).intersect(&ray, None);
        prop_assert_eq!(hit.is_some(), expected);
        let Some(hit) = hit else { return Ok(()) };
        let off_plane = (ray.at(hit.distance) - corner).dot(rectangle.normal).abs();
        prop_assert!(off_plane <= bound, "{off_plane:e} off the plane at scale {scale}");
        prop_assert!((0.0..1.0).contains(&hit.u) && (0.0..1.0).contains(&hit.v));
        prop_assert!((hit.u - at[0]).abs() * sides[0] <= slack, "u {} for {}", hit.u, at[0]);
        prop_assert!((hit.v - at[1]).abs() * sides[1] <= slack, "v {} for {}", hit.v, at[1]);
    }

    #[test]
    fn any_numbers_give_the_same_answer_from_both_backends(
        origin in [any_number(), any_number(), any_number()],
        direction in [any_number(), any_number(), any_number()],
        normalize in any::<bool>(),
        distance_max in any_number(),
    ) {
        thread_local! {
            static BACKENDS: [Geometry; 2] =
                [BackendChoice::Native, BackendChoice::Embree].map(|choice| {
                    let sphere = Sphere { centre: Vec3::new(0.5, 0.5, 0.0), radius: 2.0 };
                    let primitives = vec![unit_square(0.0), Primitive::Sphere(sphere)];
                    Geometry::new(primitives, choice).unwrap()
                });
        }
        let direction = Vec3::from(direction);
        let direction = if normalize { direction.normalized() } else { direction };
        let ray = Ray { origin: origin.into(), direction };
        let answers = BACKENDS.with(|backends| {
            backends.each_ref().map(|geometry| {
                let hit = geometry.intersect(&ray, None);
                (hit, geometry.occluded(&ray, None, None, distance_max))
            })
        });
        prop_assert_eq!(answers[0], answers[1]);
        if let Some(hit) = answers[0].0 {
            prop_assert!(hit.distance > 0.0 && hit.distance.is_finite());
        }
    }
}

/// Numbers of all kinds, most of which make no sense in a ray.
fn any_number() -> impl Strategy<Value = f64> {
    prop_oneof![
        -2.0..2.0,
        any::<f64>(),
        prop::sample::select(vec![
            0.0,
            -0.0,
            1.0,
            -1.0,
            f64::NAN,
            f64::INFINITY,
            f64::NEG_INFINITY,
            f64::MAX,
            f64::MIN_POSITIVE,
            5e-324,
            1e-300,
        ]),
    ]
}

#[test]
fn shared_edge_belongs_to_one_tile() {
    // Sixteen tiles on a grid of exact binary fractions, met from straight above.
    let tile = |column: u32, row: u32| {
        let corner = Vec3::new(f64::from(column) / 4.0, f64::from(row) / 4.0, 0.0);
        let (x, y) = (Vec3::new(1.0, 0.0, 0.0), Vec3::new(0.0, 1.0, 0.0));
        Primitive::Rectangle(Rectangle::new(corner, x, y, 0.25, 0.25))
    };
    let tiles = || (0..16).map(|id| tile(id % 4, id / 4)).collect();
    for choice in [BackendChoice::Native, BackendChoice::Embree] {
        let geometry = Geometry::new(tiles(), choice).unwrap();
        for row in 0..=4_u32 {
            for column in 0..=4_u32 {
                let origin = Vec3::new(f64::from(column) / 4.0, f64::from(row) / 4.0, 1.0);
                let down = Vec3::new(0.0, 0.0, -1.0);
                let ray = Ray {
                    origin,
                    direction: down,
                };
                let expected = (column < 4 && row < 4).then_some(Hit {
                    distance: 1.0,
                    primitive: PrimitiveId(row * 4 + column),
                    u: 0.0,
                    v: 0.0,
                });
                assert_eq!(geometry.intersect(&ray, None), expected, "{column}, {row}");
            }
        }
    }
}

#[test]
fn surface_left_is_never_hit_and_target_never_occludes() {
    let primitives = || vec![unit_square(0.0), unit_square(0.5), unit_square(1.0)];
    for choice in [BackendChoice::Native, BackendChoice::Embree] {
        let geometry = Geometry::new(primitives(), choice).unwrap();
        // The origin is a rounding below the lowest square, as computed points are.
        let ray = Ray {
            origin: Vec3::new(0.5, 0.5, -1e-17),
            direction: Vec3::new(0.0, 0.0, 1.0),
        };
        let first = |from: Option<u32>| {
            let hit = geometry.intersect(&ray, from.map(PrimitiveId));
            hit.map(|hit| hit.primitive.0)
        };
        assert_eq!(first(None), Some(0));
        assert_eq!(first(Some(0)), Some(1));
        let blocked = |target: Option<u32>, distance_max: f64| {
            let target = target.map(PrimitiveId);
            geometry.occluded(&ray, Some(PrimitiveId(0)), target, distance_max)
        };
        assert!(blocked(None, 0.75));
        assert!(!blocked(Some(1), 0.75));
        assert!(blocked(Some(1), 1.5));
        assert!(blocked(Some(1), f64::INFINITY));
        // What lies at the very distance does not occlude.
        assert!(!blocked(None, 0.5));
        assert!(blocked(None, 0.5_f64.next_up()));
        for nothing in [0.0, -1.0, f64::NAN] {
            assert!(!blocked(None, nothing), "{nothing}");
        }
    }
}

#[test]
fn of_equally_near_primitives_the_lowest_id_is_hit() {
    let squares = || vec![unit_square(0.0); 40];
    for choice in [BackendChoice::Native, BackendChoice::Embree] {
        let geometry = Geometry::new(squares(), choice).unwrap();
        let ray = towards(Vec3::new(0.3, 0.2, 2.0), Vec3::new(0.6, 0.7, 0.0));
        let id = |from| geometry.intersect(&ray, from).map(|hit| hit.primitive.0);
        assert_eq!(id(None), Some(0));
        assert_eq!(id(Some(PrimitiveId(0))), Some(1));
    }
}

#[test]
fn ray_from_inside_a_sphere_hits_its_far_side() {
    let sphere = Primitive::Sphere(Sphere {
        centre: Vec3::new(0.0, 0.0, 1.0),
        radius: 2.0,
    });
    let geometry = native(vec![sphere]);
    let direction = Vec3::new(0.0, 0.0, 1.0);
    let distance = |z| {
        let origin = Vec3::new(0.0, 0.0, z);
        geometry
            .intersect(&Ray { origin, direction }, None)
            .map(|hit| hit.distance)
    };
    assert_eq!(distance(0.0), Some(3.0));
    assert_eq!(distance(2.0), Some(1.0));
    assert_eq!(distance(-3.0), Some(2.0));
    assert_eq!(distance(3.5), None);
}

#[test]
fn primitive_that_makes_no_sense_is_refused() {
    let sphere = |x, radius| {
        Primitive::Sphere(Sphere {
            centre: Vec3::new(x, 0.0, 0.0),
            radius,
        })
    };
    let rectangle = |u_axis: [f64; 3], v_axis: [f64; 3], side| {
        let corner = Vec3::default();
        Primitive::Rectangle(Rectangle::new(
            corner,
            u_axis.into(),
            v_axis.into(),
            side,
            1.0,
        ))
    };
    let cylinder = |axis, radius, length| {
        let start = Vec3::default();
        Primitive::Cylinder(Cylinder {
            start,
            axis,
            radius,
            length,
        })
    };
    let (x, y) = ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0]);
    let mut rotated = unit_square(0.0);
    if let Primitive::Rectangle(rectangle) = &mut rotated {
        rectangle.normal = -rectangle.normal;
    }
    let refused = [
        sphere(0.0, 0.0),
        sphere(0.0, -1.0),
        sphere(0.0, f64::NAN),
        sphere(0.0, f64::INFINITY),
        sphere(f64::NAN, 1.0),
        sphere(2e9, 1.0),
        cylinder(Vec3::new(0.0, 0.0, 2.0), 1.0, 1.0),
        cylinder(Vec3::new(0.0, 0.0, f64::NAN), 1.0, 1.0),
        cylinder(Vec3::new(0.0, 0.0, 1.0), 0.0, 1.0),
        cylinder(Vec3::new(0.0, 0.0, 1.0), 1.0, -1.0),
        cylinder(Vec3::new(0.0, 0.0, 1.0), 1.0, f64::INFINITY),
        rectangle(x, y, 0.0),
        rectangle(x, y, f64::NAN),
        rectangle(x, y, 1e10),
        rectangle(x, x, 1.0),
        rectangle([2.0, 0.0, 0.0], y, 1.0),
        rectangle([f64::NAN, 0.0, 0.0], y, 1.0),
        rectangle([FRAC_1_SQRT_2, FRAC_1_SQRT_2, 0.0], y, 1.0),
        rotated,
    ];
    for primitive in refused {
        for choice in [BackendChoice::Native, BackendChoice::Embree] {
            let error = Geometry::new(vec![unit_square(0.0), primitive], choice).unwrap_err();
            assert!(
                matches!(error, GeometryError::Primitive { index: 1, .. }),
                "{error}"
            );
        }
    }
}

#[test]
fn auto_takes_the_faster_and_an_explicit_choice_is_kept() {
    let backend = |count, choice| {
        let geometry = Geometry::new(vec![unit_square(0.0); count], choice).unwrap();
        assert_eq!(geometry.primitives().len(), count);
        geometry.backend()
    };
    let few = EMBREE_PRIMITIVES_MIN - 1;
    assert_eq!(backend(few, BackendChoice::Auto), BackendKind::Native);
    assert_eq!(backend(few, BackendChoice::Embree), BackendKind::Embree);
    assert_eq!(backend(few + 1, BackendChoice::Auto), BackendKind::Embree);
    assert_eq!(backend(few + 1, BackendChoice::Native), BackendKind::Native);
}

#[test]
fn geometry_of_nothing_is_never_hit() {
    for choice in [BackendChoice::Native, BackendChoice::Embree] {
        let geometry = Geometry::new(Vec::new(), choice).unwrap();
        let ray = towards(Vec3::default(), Vec3::new(0.0, 0.0, 1.0));
        assert_eq!(geometry.intersect(&ray, None), None);
        assert!(!geometry.occluded(&ray, None, None, f64::INFINITY));
    }
}

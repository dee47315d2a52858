//! The bounds against brute force, and the higher orders against finer rules, in geometries drawn at random.

use super::Unresolved;
use super::bound::{Bounds, least_slope};
use super::bulb_arcs::PlainLineBatch;
use super::bulb_transfer::{BulbRule, Scratch, from_bulb};
use super::chart_transfer::{PositionBatch, add_from_chart};
use super::frame::Frame;
use super::higher::Higher;
use super::matrix::{Planned, Points, level_cells, rows};
use super::order_1;
use super::sources::disc;
use super::transfer::{Along, Receiver};
use crate::geometry::BackendChoice;
use crate::hybrid::PreparedView;
use crate::hybrid::budget::interreflection::{
    COARSE_GLANCE, EVALUATIONS_MAX, FIRST_EVALUATIONS_MAX, GLANCE, HIGHER_SHARE, LEVEL_MAX,
    ORDER_1_SHARE,
};
use crate::numerics::batch::LANES;
use crate::numerics::channels::{largest, largest_difference};
use crate::numerics::gauss::GaussRule;
use crate::numerics::polygon::Rectangle;
use crate::reflectance::Reflectance;
use crate::scene::{ChartPlane, Scene};
use crate::vector::Vec3;
use dataset::{
    Material, Specification,
    specification::{Tint, View},
};
use proptest::prelude::*;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

/// Positions along each side of sample and chart that brute force tries.
const TRIED: usize = 6;

fn specification(tilt_deg: f64, light_deg: f64, gap_m: f64, pitch_m: f64) -> Specification {
    let mut specification = Specification::preset();
    specification.checker.tilt_deg = tilt_deg;
    specification.checker.pitch_m = pitch_m;
    specification.checker.lower_edge_y_m = 0.5 * specification.sample.side_m + gap_m;
    specification.camera.film_half_width = 0.01;
    specification.views = vec![View {
        camera_elevation_deg: 60.0,
        light_elevation_deg: light_deg,
        rotation_deg: 0.0,
        checker: true,
    }];
    specification
}

/// Irradiance over pi at a point of the chart by the bulb's centre alone, and the factor from the
/// radiance of the chart, by midpoint rules.
fn brute_force(frame: &Frame<'_>, reflectance: &Reflectance, at: [f64; 2]) -> [f64; 2] {
    let view = frame.view;
    let normal = frame.chart.plane.z;
    let [width, height] = frame.chart.plane.size();
    let receiver = frame.chart.plane.point(at[0], at[1]);
    let step = |index: usize| (index as f64 + 0.5) / TRIED as f64;
    let side = 2.0 * view.sample_half;
    let cell = side / TRIED as f64;
    let patch = width * height / (TRIED * TRIED) as f64;
    let (mut order_1, mut transfer) = (0.0, 0.0);
    for index in 0..TRIED * TRIED {
        let [x, y] = [index % TRIED, index / TRIED].map(|i| side * (step(i) - 0.5));
        let from = Vec3::new(x, y, 0.0);
        let to = receiver - from;
        let wo = to.normalized();
        let form = wo.z * -normal.dot(wo) / to.length_squared()
            * cell
            * cell
            * std::f64::consts::FRAC_1_PI;
        // So close a midpoint rule says nothing.
        if form <= 0.0 || to.length_squared() < 9.0 * cell * cell {
            continue;
        }
        let bulb = view.bulb.centre - from;
        let sin2 = view.bulb.radius * view.bulb.radius / bulb.length_squared();
        let wi = bulb.normalized();
        let light = view.bulb.radiance * std::f64::consts::PI * sin2 * wi.z;
        order_1 += form * light * largest(reflectance.evaluate(wi, wo));
        for chart in 0..TRIED * TRIED {
            let at = [width * step(chart % TRIED), height * step(chart / TRIED)];
            let offset = frame.chart.plane.point(at[0], at[1]) - from;
            let wi = offset.normalized();
            let angle = patch * (-normal.dot(wi)).max(0.0) / offset.length_squared();
            transfer += form * angle * wi.z * largest(reflectance.evaluate(wi, wo));
        }
    }
    [order_1, transfer]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]
    #[test]
    fn bounds_bound(
        tilt_deg in 5.0..90.0f64, light in 0.0..1.0f64, gap_m in 0.0..0.1f64,
        pitch_m in 0.005..0.1f64, roughness in 5.0..90.0f64, anisotropy in 0.0..1.0f64,
        angle_deg in 0.0..180.0f64, ior in 1.0..10.0f64,
    ) {
        // The bulb has to stand in front of the chart.
        let light_deg = (tilt_deg - 25.0).max(5.0) + light * (90.0 - (tilt_deg - 25.0).max(5.0));
        let specification = specification(tilt_deg, light_deg, gap_m, pitch_m);
        let material = Material {
            roughness, anisotropy, angle_deg, ior,
            rgb0: [1.0; 3], rgb90: [1.0; 3],
        };
        let reflectance = Reflectance::new(&material, 0.0, Tint::Hue);
        let scene = Scene::new(&specification, 0, BackendChoice::Native)
            .expect("a view").expect("native geometry");
        let Some(prepared) = PreparedView::new(&scene, &specification) else { return Ok(()) };
        let Some(chart) = prepared.chart.as_ref() else { return Ok(()) };
        let frame = Frame::new(&prepared.view, chart, &reflectance);
        let bounds = Bounds::new(&frame, &reflectance, f64::INFINITY);
        let [width, height] = chart.plane.size();
        for (a, b) in [(0.1, 0.05), (0.5, 0.3), (0.5, 0.9), (0.9, 0.6)] {
            let [order_1, transfer] = brute_force(&frame, &reflectance, [a * width, b * height]);
            prop_assert!(order_1 <= bounds.order_1, "{} {:?}", order_1, bounds);
            prop_assert!(transfer <= bounds.transfer, "{} {:?}", transfer, bounds);
        }
    }
}

proptest! {
    /// Charts that lean over the sample or begin over it included, for which the bound is 0.
    #[test]
    fn half_vectors_between_two_directions_to_the_chart_are_steep(
        tilt_deg in 5.0..90.0f64, gap_m in -0.03..0.1f64, corner_z in 0.0..0.02f64, over in 0.0..1.0f64,
        sample in prop::array::uniform2(-1.0..1.0f64), chart in prop::array::uniform4(0.0..1.0f64),
    ) {
        let (half, pitch) = (0.05, 0.01);
        let (sin, cos) = libm::sincos(tilt_deg.to_radians());
        let cos = if over > 0.8 { -cos } else { cos };
        let plane = ChartPlane {
            corner: Vec3::new(-0.03, half + gap_m, corner_z),
            x: Vec3::new(1.0, 0.0, 0.0),
            y: Vec3::new(0.0, cos, sin),
            z: Vec3::new(0.0, -sin, cos),
            pitch, columns: 6, rows: 4,
        };
        let [width, height] = plane.size();
        let from = Vec3::new(half * sample[0], half * sample[1], 0.0);
        let [a, b, c, d] = chart;
        let [wi, wo] = [[a, b], [c, d]]
            .map(|[a, b]| (plane.point(a * width, b * height) - from).normalized());
        let sum = wi + wo;
        let slope = libm::hypot(sum.x, sum.y) / sum.z;
        let least = least_slope(&plane, half);
        prop_assert!(slope >= least - 1e-9 * (1.0 + least), "{} {}", slope, least);
    }
}

/// Irradiance over pi, in units of white, that no pixel shows.
const NOTHING: f64 = 1e-12;

/// Points of the chart at which a draw is looked at.
const POINTS: usize = 24;

/// A view with paths of three hits and a chart up to eight times as wide as the sample, and a material.
pub fn drawn(uniform: &mut impl FnMut(f64, f64) -> f64) -> (Specification, Material) {
    let gap_m = uniform(-0.01, 0.02).max(0.0);
    let tilt_deg = uniform(30.0, 89.0);
    let mut specification = specification(tilt_deg, 85.0, gap_m, uniform(2e-3, 2e-2));
    specification.checker.columns = uniform(4.0, 40.0) as u32;
    specification.checker.rows = uniform(3.0, 12.0) as u32;
    specification.checker.patches_srgb8 = (0..specification.checker.columns
        * specification.checker.rows)
        .map(|_| [(); 3].map(|()| uniform(0.0, 255.0) as u8))
        .collect();
    specification.integrator.max_bounces = 3;
    let material = Material {
        roughness: uniform(-20.0, 90.0).max(0.0),
        anisotropy: uniform(0.0, 1.3).min(1.0),
        angle_deg: uniform(0.0, 180.0),
        ior: 5.0,
        rgb0: [1.0; 3],
        rgb90: [1.0; 3],
    };
    (specification, material)
}

/// Numbers of a seed between two others.
pub fn draws(seed: u64) -> impl FnMut(f64, f64) -> f64 {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    move |low, high| low + (high - low) * (rng.next_u32() as f64 / f64::from(u32::MAX))
}

/// What `look` finds in the frame of a draw; `None` where there is no chart, or where the bulb is not in front of its
/// plane, which no specification may say.
pub fn in_frame<T>(
    (specification, material): (Specification, Material),
    look: impl FnOnce(&Frame<'_>) -> T,
) -> Option<T> {
    let reflectance = Reflectance::new(&material, 0.0, Tint::Hue);
    let scene = Scene::new(&specification, 0, BackendChoice::Native)
        .expect("a view")
        .expect("native geometry");
    let prepared = PreparedView::new(&scene, &specification)?;
    let (view, chart) = (&prepared.view, prepared.chart.as_ref()?);
    let in_front = (view.bulb.centre - chart.plane.corner).dot(chart.plane.z) > view.bulb.radius;
    in_front.then(|| look(&Frame::new(view, chart, &reflectance)))
}

/// The higher orders without order 1.
fn higher(frame: &Frame<'_>) -> Result<Higher, Unresolved> {
    Higher::solve(frame, HIGHER_SHARE, |_| [0.0; 3])
}

/// What the higher orders are off by at points of the chart of a draw, against the rules of a level, over what they
/// state there or this share of the tolerance; `None` where they are not worked out.
fn off_over_stated(
    draw: (Specification, Material),
    mut uniform: impl FnMut(f64, f64) -> f64,
    (level, share): (usize, f64),
) -> Option<Vec<f64>> {
    in_frame(draw, |frame| {
        let higher = higher(frame).ok()?;
        let Rectangle { low, high } = frame.bounds();
        let points: Vec<[f64; 2]> = (0..POINTS)
            .map(|_| [0, 1].map(|axis| uniform(low[axis], high[axis])))
            .collect();
        let (cells, _) = level_cells(frame, level);
        let senders = Points::new(frame, (&cells, level), &|_| [0.0; 3]);
        let planned: Vec<Planned> = points
            .iter()
            .map(|at| Planned::new(frame, *at, level))
            .collect();
        let exact = rows(frame, &planned, &senders);
        let tolerance = frame.tolerance(&frame.bounds());
        let ratios = points.iter().zip(&exact).map(|(at, row)| {
            let exact = row.apply(&senders, |i| senders.direct[i]);
            let tiles = &higher.tiles[0];
            let stated = tiles.error_on(&Rectangle {
                low: *at,
                high: *at,
            });
            let off = largest_difference(tiles.value(*at), exact);
            // Lobes that are too narrow leave next to nothing.
            off / stated.max(NOTHING).max(share * tolerance)
        });
        Some(ratios.collect())
    })?
}

/// By the last coefficients alone one point in 13 is off by more, by up to 50 times: a tile far wider than the
/// sample has no node where the light is.
#[test]
fn higher_orders_state_what_they_are_off_by() {
    // Finer than what most draws take.
    const LEVEL: usize = 2;
    let on_chart = |seed| {
        let mut uniform = draws(seed);
        off_over_stated(drawn(&mut uniform), uniform, (LEVEL, 0.0))
    };
    let ratios: Vec<f64> = (0..40).filter_map(on_chart).flatten().collect();
    let off_by_more = ratios.iter().filter(|ratio| **ratio > 1.0).count();
    let worst = ratios.iter().copied().fold(0.0, f64::max);
    assert!(
        off_by_more <= ratios.len() / 100,
        "{off_by_more} of {}",
        ratios.len()
    );
    assert!(worst < 1.5, "{worst}");
}

/// The same with a chart of patches that are small for their distance from the sample, a rough material and any
/// accuracy.
fn drawn_far(uniform: &mut impl FnMut(f64, f64) -> f64) -> (Specification, Material) {
    let (mut specification, mut material) = drawn(uniform);
    material.roughness = uniform(40.0, 110.0).min(100.0);
    specification.sample.side_m = uniform(0.01, 0.1);
    let chart = &mut specification.checker;
    chart.columns = uniform(1.0, 9.0) as u32;
    chart.rows = uniform(1.0, 7.0) as u32;
    chart.patches_srgb8 = (0..chart.columns * chart.rows)
        .map(|_| [(); 3].map(|()| uniform(0.0, 255.0) as u8))
        .collect();
    let gap_m = libm::exp(uniform(-5.0, -2.5));
    chart.lower_edge_y_m = 0.5 * specification.sample.side_m + gap_m;
    chart.pitch_m = (gap_m * uniform(0.1, 1.5)).min(0.03);
    let relative = libm::exp10(-uniform(2.0, 6.0));
    specification.accuracy.relative = relative;
    specification.accuracy.absolute = 0.1 * relative;
    (specification, material)
}

/// The first two levels have the same points on such a chart. Their rules agreed, whatever they missed: of 1,000 draws
/// one in 13 was off by more than it may be, by up to 22 times (draw 677 of seed 20261134 of the search was one).
/// Now one in 90 is, by up to 1.7 times.
#[test]
fn higher_orders_of_a_far_chart_state_what_they_are_off_by() {
    const LEVEL: usize = LEVEL_MAX + 1;
    let on_chart = |seed| {
        let mut uniform = draws(seed);
        let draw = drawn_far(&mut uniform);
        off_over_stated(draw, uniform, (LEVEL, HIGHER_SHARE))
    };
    let ratios: Vec<f64> = (0..100).filter_map(on_chart).flatten().collect();
    let off_by_more = ratios.iter().filter(|ratio| **ratio > 1.0).count();
    let worst = ratios.iter().copied().fold(0.0, f64::max);
    assert!(
        ratios.len() > 2_000 && off_by_more <= ratios.len() / 200,
        "{off_by_more} of {}",
        ratios.len()
    );
    assert!(worst < 1.5, "{worst}");
}

/// A share of the tolerance below which no pixel shows an error.
const NOTICED: f64 = 0.02;

/// Order 1 at shares of the chart's sides for a relative accuracy, and what its tiles state; `None` where it is not
/// worked out.
fn order_1_at(
    (mut specification, material): (Specification, Material),
    relative: f64,
    shares: &[[f64; 2]],
) -> Option<Vec<([f64; 3], f64)>> {
    specification.accuracy.relative = relative;
    specification.accuracy.absolute = 0.1 * relative;
    in_frame((specification, material), |frame| {
        let order_1 = order_1::solve(frame, ORDER_1_SHARE).ok()?;
        let Rectangle { low, high } = frame.bounds();
        let at = |shares: &[f64; 2]| [0, 1].map(|i| low[i] + (high[i] - low[i]) * shares[i]);
        let found = shares.iter().map(|shares| {
            let at = at(shares);
            let part = Rectangle { low: at, high: at };
            let counts = NOTICED * frame.tolerance(&frame.bounds());
            (
                order_1.tiles.value(at),
                order_1.tiles.error_on(&part).max(counts),
            )
        });
        Some(found.collect())
    })?
}

/// Of 400 seeds one point in 480 is off by more than its tile states, by up to 2.0 times. Series of eight terms that
/// are not looked at off their nodes leave one in 130 so, by up to 2.3 times.
#[test]
fn order_1_of_few_terms_states_what_it_is_off_by() {
    let (mut count, mut off_by_more, mut worst) = (0, 0, 0.0f64);
    for seed in 0..60 {
        let mut uniform = draws(seed);
        let (near, far) = (drawn(&mut uniform), drawn_far(&mut uniform));
        let shares: Vec<[f64; 2]> = (0..POINTS)
            .map(|_| [uniform(0.0, 1.0), uniform(0.0, 1.0)])
            .collect();
        let relative = libm::exp10(-uniform(1.0, 2.0));
        for draw in [near, far] {
            let fine = order_1_at(draw.clone(), 1e-5, &shares);
            let Some((coarse, fine)) = order_1_at(draw, relative, &shares).zip(fine) else {
                continue;
            };
            for ((value, stated), (exact, missed)) in coarse.into_iter().zip(fine) {
                let off = largest_difference(value, exact) - missed;
                count += 1;
                off_by_more += usize::from(off > stated.max(NOTHING));
                worst = worst.max(off / stated.max(NOTHING));
            }
        }
    }
    assert!(
        count > 2_000 && off_by_more * 200 < count && worst < 2.5,
        "{off_by_more} of {count}, by up to {worst} times"
    );
}

/// The most light of the second order at points of the chart, by the rules of a level.
fn most_of_order_2(frame: &Frame<'_>, points: &[[f64; 2]], level: usize) -> f64 {
    let (cells, _) = level_cells(frame, level);
    let senders = Points::new(frame, (&cells, level), &|_| [0.0; 3]);
    let planned = points.iter().map(|at| Planned::new(frame, *at, level));
    let planned: Vec<Planned> = planned.collect();
    let rows = rows(frame, &planned, &senders).into_iter();
    rows.map(|row| largest(row.apply(&senders, |i| senders.direct[i])))
        .fold(0.0, f64::max)
}

/// What a glance leaves out of a draw, and the most light at some points of the chart: drawn ones, others along its
/// lower edge and others up its middle. `None` where a glance does not do.
fn left_out_and_most(
    draw: (Specification, Material),
    mut uniform: impl FnMut(f64, f64) -> f64,
) -> Option<[f64; 2]> {
    const LEVEL: usize = 2;
    const ALONG: u32 = 8;
    in_frame(draw, |frame| {
        let higher = Higher::solve(frame, f64::INFINITY, |_| [0.0; 3]).ok()?;
        let Rectangle { low, high } = frame.bounds();
        let at = |shares: [f64; 2]| [0, 1].map(|i| low[i] + (high[i] - low[i]) * shares[i]);
        let mut points: Vec<[f64; 2]> = (0..POINTS)
            .map(|_| at([uniform(0.0, 1.0), uniform(0.0, 1.0)]))
            .collect();
        for step in 0..ALONG {
            let share = (f64::from(step) + 0.5) / f64::from(ALONG);
            points.extend([at([share, 0.02]), at([0.5, share])]);
        }
        Some([
            higher.tiles[0].error(),
            most_of_order_2(frame, &points, LEVEL),
        ])
    })?
}

/// Without a margin a chart holds up to seven times the light that is stated.
#[test]
fn a_glance_at_higher_orders_tells_how_dark_they_are() {
    for (glance, relative, seeds) in [(GLANCE, 1e-3, 80), (COARSE_GLANCE, 0.1, 40)] {
        let mut worst = [0.0f64; 3];
        for seed in 0..seeds {
            let mut uniform = draws(seed);
            let far = drawn_far(&mut uniform);
            let mut glossy = drawn(&mut uniform);
            glossy.1.roughness = uniform(15.0, 60.0);
            for (worst, mut draw) in worst.iter_mut().zip([drawn(&mut uniform), far, glossy]) {
                draw.0.accuracy.relative = relative;
                draw.0.accuracy.absolute = 0.1 * relative;
                if let Some([left_out, most]) = left_out_and_most(draw, draws(seed + 1_000)) {
                    *worst = worst.max(most / left_out.max(NOTHING));
                }
            }
        }
        let margins = worst.map(|share| share * glance.margin);
        assert!(
            worst.iter().all(|share| *share < 0.5) && margins.iter().any(|margin| *margin > 3.0),
            "up to {margins:?} times what is seen"
        );
    }
}

/// Evaluations that the higher orders of a draw take for an accuracy out of reach.
fn most_evaluations(
    (mut specification, material): (Specification, Material),
) -> Option<Result<u64, Unresolved>> {
    specification.accuracy.relative = 1e-6;
    specification.accuracy.absolute = 1e-7;
    in_frame((specification, material), |frame| {
        higher(frame).map(|higher| higher.evaluations)
    })
}

/// Draws of 600 whose first look is the dearest.
const DEAREST: [u64; 5] = [289, 306, 451, 555, 523];

/// Whatever is asked for, nothing is begun that would go beyond the limit, but for a first look.
#[test]
fn higher_orders_keep_their_limit() {
    let most = |draw: u64| most_evaluations(drawn(&mut draws(draw)))?.ok();
    let of_first = (0..40).filter_map(most).max().expect("higher orders");
    assert!(
        of_first > EVALUATIONS_MAX / 10 * 9,
        "no draw comes near the limit: the test shows nothing"
    );
    assert!(of_first <= EVALUATIONS_MAX, "{of_first}");
    for draw in DEAREST {
        let spent = most(draw).expect("higher orders");
        assert!(
            (EVALUATIONS_MAX..=FIRST_EVALUATIONS_MAX).contains(&spent),
            "draw {draw}: {spent}"
        );
    }
}

/// Charts of as many patches as are admitted, on the sample's edge: some are left to the path tracer.
#[test]
fn a_first_look_keeps_its_limit() {
    let mut left = 0;
    for draw in 0..40 {
        let (mut specification, material) = drawn(&mut draws(draw));
        specification.checker.columns = 64;
        specification.checker.rows = 64;
        specification.checker.patches_srgb8 = vec![[200; 3]; 64 * 64];
        specification.checker.lower_edge_y_m = 0.5 * specification.sample.side_m;
        match most_evaluations((specification, material)) {
            Some(Ok(spent)) => assert!(spent <= FIRST_EVALUATIONS_MAX, "draw {draw}: {spent}"),
            Some(Err(Unresolved)) => left += 1,
            None => (),
        }
    }
    assert!(left >= 3, "{left}");
}

/// What points of the chart and the bulb send to a receiver off lines.
fn sent(
    frame: &Frame<'_>,
    receiver: &Receiver,
    (positions, lines): (&PositionBatch, &PlainLineBatch),
    along: Along,
) -> Vec<f64> {
    let (set, surface, bulb) = (frame.view.instructions, &frame.surface, frame.bulb());
    let mut sums = vec![[[0.0; LANES]; 3]; positions.blocks().len()];
    for line in 0..lines.count() {
        let (line, sums) = (lines.point(line), &mut sums);
        add_from_chart(set, positions, line, receiver, surface, along, sums);
    }
    let rule = BulbRule {
        disc: &disc(1),
        along,
    };
    let buffers = &mut Scratch::default();
    let by_bulb = from_bulb(set, lines, rule, receiver, surface, &bulb, buffers);
    sums.into_iter()
        .flatten()
        .flatten()
        .chain(by_bulb)
        .collect()
}

/// By way of nodes that all sources share they send what they do by way of nodes of their own, which so long a reach
/// puts in the same places.
#[test]
fn sources_may_share_nodes() {
    const LONG: f64 = 1e9;
    const COUNT: usize = 11;
    let mut lit = 0;
    for seed in 0..20 {
        let mut uniform = draws(seed);
        let draw = drawn(&mut uniform);
        in_frame(draw, |frame| {
            let Rectangle { low, high } = frame.bounds();
            let mut receiver = || frame.receiver([0, 1].map(|axis| uniform(low[axis], high[axis])));
            let to = receiver();
            let mut positions = PositionBatch::default();
            for _ in 0..COUNT {
                let Vec3 { x, y, z } = receiver().position;
                positions.push([x, y, z]);
            }
            let half = frame.view.sample_half;
            let mut lines = PlainLineBatch::default();
            for _ in 0..COUNT {
                let [v, a, b] = [(); 3].map(|()| uniform(-half, half));
                lines.push([v, 1.0, a.min(b), a.max(b)]);
            }
            let [shared, own] = [None, Some(LONG)].map(|reach| {
                let rule = GaussRule::of(12);
                sent(frame, &to, (&positions, &lines), Along { rule, reach })
            });
            for (shared, own) in shared.into_iter().zip(own) {
                let off = (shared - own).abs();
                assert!(off <= 1e-10 * own.abs(), "draw {seed}: {shared} {own}");
                lit += usize::from(own > 0.0);
            }
        });
    }
    assert!(lit > 200, "{lit} numbers above 0: the test shows little");
}

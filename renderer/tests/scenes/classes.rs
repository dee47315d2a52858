//! Classes of errors that the hybrid integrator once made without a word, each by the case that it
//! was first seen in and ten variations of it.

use crate::case::Case;
use crate::draw::{Random, draw};
use crate::examine::{Effort, Kind, examine, render};
use dataset::{Material, Specification};
use std::sync::mpsc;
use std::thread;
use std::time::Duration;

const EFFORT: Effort = Effort {
    pixels_max: 12,
    samples_max: 1024,
    finer: &[Kind::Resolution],
};

/// Where a term is missing, all renderings miss it.
const REFERENCE_ONLY: Effort = Effort {
    pixels_max: 64,
    samples_max: 16384,
    finer: &[],
};

const VARIATIONS: u64 = 10;

/// No rendering of 128 x 128 pixels to the preset's accuracy takes more evaluations: 20 processor seconds
/// at 50 ns each. Seconds are not counted, because they depend on what else a machine does.
const EVALUATIONS_MAX: u64 = 400_000_000;

/// After so long by the clock on the wall a rendering is taken to have no end. Only this bounds the path
/// tracer, which makes no evaluations.
const PATIENCE: Duration = Duration::from_secs(200);

fn white(roughness: f64, anisotropy: f64, ior: f64) -> Material {
    Material {
        roughness,
        anisotropy,
        angle_deg: 0.0,
        ior,
        rgb0: [1.0; 3],
        rgb90: [1.0; 3],
    }
}

/// Examines a case and its variations, and prints all that is found.
fn hold(
    case: &Case,
    effort: Effort,
    vary: impl Fn(&mut Random, &mut Specification, &mut Material),
) {
    let mut failed = Vec::new();
    for variation in 0..=VARIATIONS {
        let case = if variation == 0 {
            case.clone()
        } else {
            varied(case, variation, &vary)
        };
        let outcome = examine(&case, effort);
        assert!(outcome.hybrid, "the hybrid integrator takes it");
        if !outcome.findings.is_empty() {
            println!("--- variation {variation}");
            for finding in &outcome.findings {
                println!("{finding}");
            }
            println!("{}", case.reproduction());
            failed.push(variation);
        }
    }
    assert_eq!(failed, [0; 0], "variations off");
}

/// A variation that is admitted, and that the hybrid integrator takes.
fn varied(
    case: &Case,
    seed: u64,
    vary: &impl Fn(&mut Random, &mut Specification, &mut Material),
) -> Case {
    let mut random = Random::of_variation(seed);
    loop {
        let (mut specification, mut material) = (case.specification.clone(), case.material);
        vary(&mut random, &mut specification, &mut material);
        if let Ok(case) = Case::admitted(&specification, material)
            && case.is_worked_out()
        {
            return case;
        }
    }
}

fn square_film(specification: &mut Specification, side: u32) {
    (specification.image.width, specification.image.height) = (side, side);
}

/// The bulb's mirror image, smaller than half a pixel, falls between the nodes of a tile.
#[test]
fn class_a_the_bulbs_mirror_image_is_found() {
    const TEXT: &str = "
        [image]
        width = 4
        height = 4
        pixel = 'float'
    ";
    let case = Case::of_toml(TEXT, 6, white(0.0, 0.0, 10.0));
    hold(&case, EFFORT, |random, specification, material| {
        square_film(specification, random.one_of(&[1, 2, 3, 4, 5, 6, 8]));
        let elevation_deg = random.uniform(20.0, 80.0);
        let view = &mut specification.views[0];
        view.light_elevation_deg = elevation_deg;
        view.camera_elevation_deg = elevation_deg + random.uniform(-2.0, 2.0);
        view.checker = random.one_of(&[false, true]);
        specification.light.radius_m *= random.log_uniform(0.1, 1.0);
        material.roughness = random.one_of(&[0.0, 1e-3, 0.1, 0.5]);
        material.anisotropy = random.one_of(&[0.0, 0.0, 0.3]);
    });
}

/// An outline at most a pixel high or wide straddles a boundary between pixels.
#[test]
fn class_b_no_part_of_a_pixel_goes_to_its_neighbour() {
    const TEXT: &str = "
        [image]
        width = 8
        height = 8
        pixel = 'float'
        [[views]]
        camera_elevation_deg = 5
        checker = true
    ";
    let case = Case::of_toml(TEXT, 0, white(20.0, 0.0, 1.5));
    hold(&case, EFFORT, |random, specification, material| {
        square_film(specification, random.one_of(&[2, 3, 5, 8, 13, 16]));
        let view = &mut specification.views[0];
        view.camera_elevation_deg = random.uniform(1.0, 15.0);
        view.checker = random.one_of(&[false, true]);
        specification.camera.film_half_width *= random.log_uniform(0.5, 3.0);
        material.roughness = random.uniform(10.0, 60.0);
    });
}

/// The light on a large patch, or near the bulb, is no parabola.
#[test]
fn class_c_the_light_on_a_patch_is_worked_out() {
    const TEXT: &str = "
        [image]
        width = 8
        height = 8
        pixel = 'float'
        [light]
        distance_m = 0.3
        [checker]
        columns = 1
        rows = 1
        pitch_m = 0.5
        tilt_deg = 30
        patches_srgb8 = [[255, 255, 255]]
    ";
    let case = Case::of_toml(TEXT, 6, white(70.0, 0.0, 1.5));
    hold(&case, REFERENCE_ONLY, |random, specification, material| {
        specification.checker.pitch_m = random.log_uniform(0.1, 1.0);
        specification.checker.tilt_deg = random.uniform(0.0, 40.0);
        specification.light.distance_m = random.uniform(0.2, 0.5);
        material.roughness = random.uniform(10.0, 100.0);
        material.ior = random.uniform(1.2, 10.0);
    });
}

/// The bulb stands between the chart and the sample.
#[test]
fn class_d_the_bulb_hides_the_chart() {
    const TEXT: &str = "
        [image]
        width = 8
        height = 8
        pixel = 'float'
        [light]
        distance_m = 0.2
        radius_m = 0.05
    ";
    let in_the_way = Case::of_toml(TEXT, 4, white(20.0, 0.0, 10.0));
    assert!(
        !in_the_way.is_worked_out(),
        "such a view is the path tracer's"
    );
    let clear = TEXT.replace("0.05", "0.01");
    let case = Case::of_toml(&clear, 4, white(20.0, 0.0, 10.0));
    hold(&case, REFERENCE_ONLY, |random, specification, material| {
        let light = &mut specification.light;
        light.distance_m = random.uniform(0.15, 0.25);
        // Up to where the bulb reaches into the light between chart and sample, and beyond.
        light.radius_m = light.distance_m * random.uniform(0.05, 0.35);
        specification.views[0].light_elevation_deg = random.uniform(35.0, 50.0);
        specification.views[0].camera_elevation_deg = random.uniform(8.0, 22.0);
        material.roughness = random.uniform(5.0, 40.0);
    });
}

/// Narrow lobes send light to the chart where it stands in their way, and so do many bounces.
#[test]
fn class_e_narrow_lobes_light_the_chart() {
    const TEXT: &str = "
        [image]
        width = 8
        height = 8
        pixel = 'float'
        [checker]
        tilt_deg = 80
        [[views]]
        light_elevation_deg = 90
        checker = true
    ";
    let case = Case::of_toml(TEXT, 0, white(29.9, 0.0, 2.0));
    hold(&case, REFERENCE_ONLY, |random, specification, material| {
        specification.checker.tilt_deg = random.uniform(50.0, 90.0);
        specification.views[0].light_elevation_deg = random.uniform(70.0, 90.0);
        specification.views[0].camera_elevation_deg = random.uniform(20.0, 70.0);
        specification.integrator.max_bounces = random.one_of(&[2, 3, 4, 8, 16]);
        material.roughness = random.uniform(2.0, 50.0);
        material.ior = random.uniform(1.5, 10.0);
    });
}

/// Near the chart a rule misses most at the sample's edge, not in the middle of a tile.
#[test]
fn class_f_rules_are_looked_at_on_the_edge() {
    let text = "
        [image]
        width = 24
        height = 24
        pixel = 'float'
        [light]
        distance_m = 0.20356326606513153
        [checker]
        columns = 8
        rows = 3
        patches_srgb8 = PATCHES
        [[views]]
        camera_elevation_deg = 45
        light_elevation_deg = 45
        rotation_deg = 108
        checker = true
    "
    .replace("PATCHES", &format!("{:?}", [[255; 3]; 24]));
    let material = Material {
        roughness: 7.137372941667519,
        anisotropy: 0.8363177620097555,
        rgb0: [0.0; 3],
        ..white(0.0, 0.0, 10.0)
    };
    let case = Case::of_toml(&text, 0, material);
    hold(&case, EFFORT, |random, specification, material| {
        specification.light.distance_m = random.uniform(0.2, 0.4);
        specification.views[0].rotation_deg = random.uniform(90.0, 120.0);
        material.roughness = random.uniform(5.0, 9.0);
        material.anisotropy = random.uniform(0.7, 0.95);
    });
}

/// A lobe that is narrow along one axis blurs a small chart along the other to a stripe thinner than a pixel, beside
/// the chart's mirror image.
#[test]
fn class_g_a_stripe_does_not_hide_between_nodes() {
    let text = "
        [image]
        width = 12
        height = 12
        pixel = 'float'
        [camera]
        distance_m = 100
        film_half_width = 0.0234
        [accuracy]
        absolute = 2e-6
        relative = 2e-7
        [sample]
        side_m = 5
        [light]
        distance_m = 7.2
        radius_m = 1
        [checker]
        columns = 1
        rows = 37
        pitch_m = 0.0422
        lower_edge_y_m = 6.55
        tilt_deg = 78.5
        patches_srgb8 = PATCHES
        [[views]]
        camera_elevation_deg = 75
        light_elevation_deg = 62.8
        rotation_deg = -122.67
        checker = true
    "
    .replace("PATCHES", &format!("{:?}", [[255; 3]; 37]));
    let material = Material {
        roughness: 0.0109,
        angle_deg: 86.5,
        rgb0: [0.0; 3],
        ..white(0.0, 0.9999995, 1.04)
    };
    let case = Case::of_toml(&text, 0, material);
    hold(&case, EFFORT, |random, specification, material| {
        square_film(specification, random.one_of(&[4, 8, 12, 24]));
        specification.views[0].rotation_deg = random.uniform(-180.0, 180.0);
        specification.camera.film_half_width *= random.log_uniform(0.3, 3.0);
        let checker = &mut specification.checker;
        checker.pitch_m *= random.log_uniform(0.1, 3.0);
        checker.tilt_deg = random.uniform(45.0, 90.0);
        let lit = random.one_of(&[1, 7, 18, 30]);
        if random.one_of(&[true, false]) {
            checker.patches_srgb8 = (0..37)
                .map(|row| [if row == lit { 255 } else { 0 }; 3])
                .collect();
        }
        material.roughness *= random.log_uniform(1.0, 100.0);
        material.ior = random.uniform(1.04, 10.0);
    });
}

/// The chart in a near mirror, whose blurred edges are worked out by closed forms: from blurs far below a pixel to such
/// as are left to tiles.
#[test]
fn class_h_a_near_mirror_shows_the_chart() {
    const TEXT: &str = "
        [image]
        width = 64
        height = 64
        pixel = 'float'
        [accuracy]
        absolute = 1e-2
        relative = 1e-2
        [[views]]
        camera_elevation_deg = 20
        light_elevation_deg = 60
        checker = true
    ";
    const EVERYWHERE: Effort = Effort {
        finer: &[Kind::Resolution, Kind::Accuracy],
        ..EFFORT
    };
    let case = Case::of_toml(TEXT, 0, white(1.0, 0.0, 2.0));
    hold(&case, EVERYWHERE, |random, specification, material| {
        square_film(specification, random.one_of(&[64, 96, 128]));
        let relative = random.log_uniform(1e-4, 1e-1);
        specification.accuracy.relative = relative;
        specification.accuracy.absolute = relative * random.log_uniform(0.1, 1.0);
        specification.camera.film_half_width *= random.log_uniform(0.3, 1.0);
        let checker = &mut specification.checker;
        checker.tilt_deg = random.uniform(0.0, 60.0);
        (checker.columns, checker.rows) = random.one_of(&[(6, 4), (1, 1), (3, 2), (9, 5)]);
        checker.patches_srgb8 = (0..checker.columns * checker.rows)
            .map(|_| random.one_of(&[[255; 3], [0; 3], [200, 40, 90], [20, 120, 250]]))
            .collect();
        let view = &mut specification.views[0];
        view.camera_elevation_deg = random.uniform(8.0, 40.0);
        view.rotation_deg = random.uniform(0.0, 360.0);
        material.roughness = random.log_uniform(0.02, 1.2);
        material.anisotropy = random.one_of(&[0.0, 0.05, 0.1, 0.3]);
        material.angle_deg = random.uniform(0.0, 180.0);
        material.ior = random.uniform(1.1, 10.0);
    });
}

/// Evaluations of a rendering in a thread of its own, which is left behind where it takes too long.
fn evaluations(case: Case) -> Option<u64> {
    let (sender, receiver) = mpsc::channel();
    thread::spawn(move || {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(1)
            .build()
            .expect("a thread");
        let rendering = pool.install(|| render(&case.specification, &case));
        _ = sender.send(rendering.expect("an image").statistics.evaluations);
    });
    receiver.recv_timeout(PATIENCE).ok()
}

fn assert_bounded(cases: impl Iterator<Item = Case>) {
    let mut failures = String::new();
    for case in cases {
        let spent = evaluations(case.clone());
        if spent.is_none_or(|spent| spent > EVALUATIONS_MAX) {
            failures += &format!("{spent:?} evaluations\n{}", case.reproduction());
        }
    }
    assert!(failures.is_empty(), "{failures}");
}

/// A chart of many edges, seen in a glossy sample at a slant.
#[test]
fn class_unbounded_a_chart_of_many_edges_takes_bounded_work() {
    const SIDE: usize = 64;
    let mut specification = Specification::preset();
    specification.image.pixel = dataset::specification::Pixel::Float;
    square_film(&mut specification, 8);
    specification.views = vec![specification.views[6].clone()];
    specification.views[0].camera_elevation_deg = 0.2;
    specification.checker.columns = SIDE as u32;
    specification.checker.rows = SIDE as u32;
    let grey = |index: usize| {
        [if (index / SIDE + index).is_multiple_of(2) {
            255
        } else {
            0
        }; 3]
    };
    specification.checker.patches_srgb8 = (0..SIDE * SIDE).map(grey).collect();
    let case = Case::admitted(&specification, white(8.0, 0.5, 10.0)).expect("an admitted case");
    let vary = |random: &mut Random, specification: &mut Specification, material: &mut Material| {
        specification.views[0].camera_elevation_deg = random.log_uniform(0.1, 5.0);
        specification.checker.pitch_m *= random.log_uniform(0.1, 1.0);
        square_film(specification, random.one_of(&[8, 32, 128]));
        material.roughness = random.uniform(2.0, 20.0);
        material.anisotropy = random.uniform(0.3, 1.0);
    };
    let cases = (0..=VARIATIONS).map(|variation| match variation {
        0 => case.clone(),
        _ => varied(&case, variation, &vary),
    });
    assert_bounded(cases);
}

/// Drawn cases on the preset's film and to its accuracy.
#[test]
fn no_rendering_of_the_presets_size_takes_long() {
    const DRAWS: u64 = 12;
    let preset = Specification::preset();
    let cases = (0..DRAWS).map(|index| {
        let mut case = draw(20, index);
        case.specification.image.width = preset.image.width;
        case.specification.image.height = preset.image.height;
        case.specification.accuracy = preset.accuracy.clone();
        case
    });
    assert_bounded(cases);
}

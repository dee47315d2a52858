//! Interreflection against the path tracer, in scenes far from the preset's.

mod plain_path;

use dataset::{
    Material, Specification,
    specification::{Tint, View},
};
use rayon::prelude::*;
use renderer::{
    geometry::{BackendChoice, Ray},
    hybrid::{PreparedView, Unresolved},
    reflectance::Reflectance,
    sampler::Sampler,
    scene::Scene,
    vector::Vec3,
};

const REPLICATES: u32 = 32;
const SAMPLES: u32 = 4096;
const SIDE: u32 = 10;

/// Student's t on 31 degrees of freedom beyond which one of some 700 channels lies by chance in
/// one run of a thousand (Sidak).
const T_LIMIT: f64 = 6.6;

/// What differs from the preset.
#[derive(Clone, Copy, Debug)]
struct Case {
    name: &'static str,
    camera_deg: f64,
    light_deg: f64,
    tilt_deg: f64,
    light_m: f64,
    radius_m: f64,
    pitch_m: f64,
    gap_m: f64,
    bounces: u32,
    roughness: f64,
    anisotropy: f64,
    angle_deg: f64,
    ior: f64,
}

const PRESET: Case = Case {
    name: "preset",
    camera_deg: 45.0,
    light_deg: 45.0,
    tilt_deg: 38.0,
    light_m: 1.0,
    radius_m: 0.03,
    pitch_m: 0.04,
    gap_m: 0.005,
    bounces: 4,
    roughness: 60.0,
    anisotropy: 0.0,
    angle_deg: 0.0,
    ior: 2.0,
};

/// The first is the one that an exponent as a cut-off got wrong by 4.5e-3.
const CASES: [Case; 11] = [
    Case {
        name: "steep chart, light overhead",
        tilt_deg: 80.0,
        light_deg: 90.0,
        roughness: 29.9,
        ..PRESET
    },
    Case {
        name: "glossier",
        tilt_deg: 80.0,
        light_deg: 90.0,
        roughness: 18.0,
        ior: 10.0,
        ..PRESET
    },
    Case {
        name: "brushed",
        tilt_deg: 40.0,
        light_deg: 60.0,
        roughness: 8.0,
        anisotropy: 0.9,
        angle_deg: 20.0,
        ior: 5.0,
        ..PRESET
    },
    Case {
        name: "brushed along the chart",
        roughness: 20.0,
        anisotropy: 0.9,
        angle_deg: 85.0,
        ior: 10.0,
        ..PRESET
    },
    Case {
        name: "no gap",
        gap_m: 0.0,
        tilt_deg: 90.0,
        light_deg: 90.0,
        roughness: 70.0,
        ior: 10.0,
        ..PRESET
    },
    Case {
        name: "large patches",
        pitch_m: 0.3,
        tilt_deg: 60.0,
        light_deg: 90.0,
        light_m: 3.0,
        radius_m: 0.1,
        roughness: 85.0,
        ior: 10.0,
        ..PRESET
    },
    Case {
        name: "sixteen bounces",
        tilt_deg: 90.0,
        gap_m: 0.0,
        light_deg: 90.0,
        bounces: 16,
        roughness: 95.0,
        ior: 10.0,
        ..PRESET
    },
    Case {
        name: "large bulb",
        light_m: 1.5,
        radius_m: 0.45,
        tilt_deg: 40.0,
        light_deg: 90.0,
        roughness: 35.0,
        ior: 10.0,
        ..PRESET
    },
    Case {
        name: "low light",
        light_deg: 25.0,
        tilt_deg: 20.0,
        roughness: 50.0,
        ior: 3.0,
        ..PRESET
    },
    Case {
        name: "Lambert",
        roughness: 100.0,
        tilt_deg: 85.0,
        light_deg: 90.0,
        ..PRESET
    },
    Case {
        name: "two bounces",
        bounces: 2,
        roughness: 45.0,
        anisotropy: 0.5,
        angle_deg: 120.0,
        ior: 10.0,
        ..PRESET
    },
];

fn specification(case: &Case) -> Specification {
    let mut specification = Specification::preset();
    specification.image.width = SIDE;
    specification.image.height = SIDE;
    specification.image.pixel = dataset::specification::Pixel::Float;
    specification.integrator.max_bounces = case.bounces;
    specification.light.distance_m = case.light_m;
    specification.light.radius_m = case.radius_m;
    specification.checker.tilt_deg = case.tilt_deg;
    specification.checker.pitch_m = case.pitch_m;
    specification.checker.lower_edge_y_m = 0.5 * specification.sample.side_m + case.gap_m;
    specification.camera.film_half_width = 0.3;
    specification.views = vec![View {
        camera_elevation_deg: case.camera_deg,
        light_elevation_deg: case.light_deg,
        rotation_deg: 0.0,
        checker: true,
    }];
    specification
}

fn material(case: &Case) -> Material {
    Material {
        roughness: case.roughness,
        anisotropy: case.anisotropy,
        angle_deg: case.angle_deg,
        ior: case.ior,
        rgb0: [0.9, 0.6, 0.3],
        rgb90: [0.9, 0.9, 0.9],
    }
}

/// Positions along each side of the chart that are looked at, as shares of it: dense near the
/// sample, and none on a patch's edge.
const ACROSS: [f64; 4] = [0.03, 0.31, 0.55, 0.9];
const UP: [f64; 5] = [0.004, 0.03, 0.11, 0.4, 0.95];

/// The path tracer's mean of the radiance along a ray and its standard error, by channel.
fn trace(
    scene: &Scene,
    reflectance: &Reflectance,
    at: Vec3,
    index: u32,
    bounces: u32,
) -> [[f64; 2]; 3] {
    let ray = Ray {
        origin: scene.camera.position,
        direction: (at - scene.camera.position).normalized(),
    };
    let means: Vec<[f64; 3]> = (0..REPLICATES)
        .map(|replicate| {
            let sampler = Sampler::new(2027, index, replicate);
            let mut mean = [0.0; 3];
            for sample in 0..SAMPLES {
                let radiance =
                    plain_path::radiance(scene, reflectance, ray, &sampler, sample, bounces);
                for (mean, channel) in mean.iter_mut().zip(radiance) {
                    *mean += channel / f64::from(SAMPLES);
                }
            }
            mean
        })
        .collect();
    let count = f64::from(REPLICATES);
    std::array::from_fn(|channel| {
        let mean = means.iter().map(|one| one[channel]).sum::<f64>() / count;
        let squares: f64 = means
            .iter()
            .map(|one| (one[channel] - mean) * (one[channel] - mean))
            .sum();
        [mean, (squares / (count - 1.0) / count).sqrt()]
    })
}

fn scene_and_view(specification: &Specification) -> (Scene, PreparedView) {
    let scene = Scene::new(specification, 0, BackendChoice::Native)
        .expect("a view")
        .expect("native geometry");
    let prepared = PreparedView::new(&scene, specification).expect("a view that can be worked out");
    (scene, prepared)
}

/// The points of a chart of these sides that are looked at, and their numbers.
fn points_of([width, height]: [f64; 2]) -> Vec<([f64; 2], u32)> {
    let rows = UP.iter().map(|up| up * height);
    let points = rows.flat_map(|b| ACROSS.iter().map(move |across| [across * width, b]));
    points.zip(0..).collect()
}

/// At no point of the chart does the light differ from the path tracer's by more than the stated
/// error and chance.
#[test]
fn stated_errors_hold_in_scenes_far_from_the_preset() {
    /// Below this the path tracer's rare bright paths are too few to be normal.
    const RARE: f64 = 1e-4;
    let (mut failures, mut lit) = (Vec::new(), 0);
    for case in &CASES {
        let specification = specification(case);
        let (scene, prepared) = scene_and_view(&specification);
        let reflectance = Reflectance::new(&material(case), 0.0, Tint::Hue);
        let found = match prepared.interreflection(&reflectance) {
            Ok(found) => found.expect("a view with a chart"),
            // Where the chart touches the sample the light is discontinuous at the sample's
            // corners, and the path tracer may have to do.
            Err(Unresolved) if case.gap_m == 0.0 => continue,
            Err(Unresolved) => {
                failures.push(format!("{}: unresolved", case.name));
                continue;
            }
        };
        let chart = scene.chart.as_ref().expect("a chart");
        let plane = chart.plane();
        let (mut worst, mut most) = (0.0f64, 0.0f64);
        let points = points_of(plane.size());
        let traced: Vec<_> = points
            .par_iter()
            .map(|&([a, b], index)| {
                trace(&scene, &reflectance, plane.point(a, b), index, case.bounces)
            })
            .collect();
        for (&([a, b], _), traced) in points.iter().zip(&traced) {
            let (column, row) = ((a / plane.pitch) as u32, (b / plane.pitch) as u32);
            let colour = chart.patches()[plane.patch(column, row)];
            let offset = scene.bulb.centre - plane.point(a, b);
            let distance2 = offset.length_squared();
            let direct = scene.bulb.radiance * scene.bulb.radius * scene.bulb.radius / distance2
                * (offset.dot(plane.z) / distance2.sqrt());
            let indirect = found.on_chart([a, b]);
            for channel in 0..3 {
                let value = colour[channel] * (direct + indirect[channel]);
                let [mean, standard_error] = traced[channel];
                let off = (value - mean).abs();
                most = most.max(indirect[channel]);
                worst = worst.max(off - T_LIMIT * standard_error);
                if off > found.error() + T_LIMIT * standard_error + RARE {
                    failures.push(format!(
                        "{}, ({a:.4}, {b:.4}): {value} against {mean} +- {standard_error}, stated {}",
                        case.name,
                        found.error()
                    ));
                }
            }
        }
        // What is too dark to be worked out is stated.
        assert!(
            (most > 0.0 || found.error() > 0.0) && worst.is_finite(),
            "{}: nothing was compared",
            case.name
        );
        lit += usize::from(most > 0.0);
    }
    assert!(2 * lit > CASES.len(), "{lit} of {} are lit", CASES.len());
    assert!(failures.is_empty(), "{failures:#?}");
}

/// A mirror that throws the bulb's image on the chart is the path tracer's.
#[test]
fn a_caustic_on_the_chart_is_not_worked_out() {
    let case = Case {
        tilt_deg: 90.0,
        light_deg: 90.0,
        roughness: 1.0,
        ior: 10.0,
        ..PRESET
    };
    let specification = specification(&case);
    let (_, prepared) = scene_and_view(&specification);
    let reflectance = Reflectance::new(&material(&case), 0.0, Tint::Hue);
    assert_eq!(
        prepared.interreflection(&reflectance).err(),
        Some(Unresolved)
    );
    // In the preset the same mirror sends nothing that would matter.
    let preset = Specification::preset();
    let (_, prepared) = scene_and_view(&preset);
    let found = prepared.interreflection(&reflectance).expect("resolved");
    let found = found.expect("a view with a chart");
    assert!(
        found.evaluations() == 0 && found.error() < 1e-6,
        "{found:?}"
    );
}

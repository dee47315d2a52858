//! A search over all that a specification may say: every pixel of the hybrid integrator lies within
//! its tolerance, or within the error that it states.
//!
//! Specifications are drawn at random ([`draw`]) and rendered; a rendering is compared with one of a
//! finer film, with one to a smaller tolerance, and pixel by pixel with an independent estimate
//! ([`reference`]). The search prints its seed; `BRDFARM_SEED` repeats it.

#![allow(
    clippy::print_stdout,
    reason = "seeds, counts and reproductions are what the search is for"
)]

mod case;
mod classes;
mod draw;
mod examine;
mod guide;
#[path = "../plain_path/mod.rs"]
mod plain_path;
mod reference;
#[path = "../reference_pixels/mod.rs"]
mod reference_pixels;
mod search;

use case::Case;
use dataset::{Material, Specification, specification::View};
use examine::{Effort, Kind, examine};
use guide::Guide;
use rayon::prelude::*;
use reference::Reference;
use renderer::reflectance::Reflectance;
use search::{Draw, search};
use std::path::PathBuf;

/// The default suite's, of each kind: about a minute in all.
const DRAWS: u64 = 60;
const SEED: u64 = 13;

fn variable(name: &str, default: u64) -> u64 {
    std::env::var(name).map_or(default, |text| {
        text.parse()
            .unwrap_or_else(|_| panic!("{name} is a number"))
    })
}

/// All channels together fail once in two hundred seeds (t with 31 degrees of freedom).
#[test]
fn the_reference_agrees_with_cubature() {
    const T_LIMIT: f64 = 5.0;
    for (number, pixel) in reference_pixels::reference_pixels().iter().enumerate() {
        let mut specification = Specification::preset();
        specification.tint = pixel.tint;
        specification.views = vec![View {
            camera_elevation_deg: pixel.camera_elevation_deg,
            light_elevation_deg: pixel.light_elevation_deg,
            rotation_deg: pixel.rotation_deg,
            checker: false,
        }];
        let reflectance = Reflectance::new(&pixel.material, pixel.rotation_deg, pixel.tint);
        let reference = Reference::new(&specification, reflectance);
        let estimate = reference.pixel([pixel.column, pixel.row], 256, 1);
        for ((mean, spread), expected) in estimate.into_iter().zip(pixel.value) {
            assert!(
                (mean - expected).abs() <= T_LIMIT * spread && spread <= 0.01 * expected,
                "pixel {number}: {mean} +- {spread} against {expected}"
            );
        }
    }
}

/// Whatever a guide finds, it leaves the mean of the pixel's paths where it is: the mean over all points of what they
/// count is 1, in either half of the pixel a half. Where it finds the bulb's image, most paths begin in little of the
/// pixel.
#[test]
fn a_guide_leaves_the_mean() {
    const POINTS: u32 = 1 << 18;
    let mut gathered = 0;
    for index in 0..60 {
        let case = draw::draw_glints(SEED, index);
        let rotation = case.specification.views[0].rotation_deg;
        let reflectance = Reflectance::new(&case.material, rotation, case.specification.tint);
        let scene = Reference::new(&case.specification, reflectance.clone()).scene;
        let [column, row] = scene.camera.size().map(|size| f64::from(size / 2));
        let guide = Guide::new(&scene, &reflectance, [column, row]);
        // Hammersley's points.
        let points = (0..POINTS).map(|k| {
            let along = (f64::from(k) + 0.5) / f64::from(POINTS);
            guide.point([along, libm::ldexp(f64::from(k.reverse_bits()), -32)])
        });
        let (mut halves, mut rare) = ([[0.0; 2]; 2], 0);
        for (point, counts) in points {
            assert!(point.iter().all(|x| (0.0..=1.0).contains(x)) && counts <= 2.0);
            for axis in 0..2 {
                halves[axis][usize::from(point[axis] > 0.5)] += counts / f64::from(POINTS);
            }
            rare += u32::from(counts < 0.01);
        }
        for half in halves.into_iter().flatten() {
            assert!((half - 0.5).abs() < 0.02, "draw {index}: {halves:?}");
        }
        gathered += u32::from(rare * 4 > POINTS);
    }
    assert!(gathered > 5, "{gathered}");
}

#[test]
fn a_draw_is_a_function_of_seed_and_index() {
    let text = |seed, index| draw::draw(seed, index).reproduction();
    assert_eq!(text(1, 5), text(1, 5));
    assert_ne!(text(1, 5), text(1, 6));
    assert_ne!(text(1, 5), text(2, 5));
}

/// `finer` are the comparisons that are made.
fn search_shortly(draw: Draw, finer: &'static [Kind]) {
    let seed = variable("BRDFARM_SEED", SEED);
    println!("BRDFARM_SEED={seed}");
    let effort = Effort {
        pixels_max: 8,
        samples_max: 1024,
        finer,
    };
    let summary = search(draw, seed, [0, DRAWS], effort);
    summary.print();
    assert_eq!(summary.failures(), 0);
}

#[test]
fn a_short_search_finds_nothing() {
    search_shortly(draw::draw, &[Kind::Resolution, Kind::Accuracy]);
}

#[test]
fn a_short_search_at_coarse_accuracies_finds_nothing() {
    search_shortly(draw::draw_coarse, &[Kind::Resolution, Kind::Accuracy]);
}

#[test]
fn a_short_search_of_the_path_tracer_finds_nothing() {
    search_shortly(draw::draw_traced, &[]);
}

#[test]
fn a_short_search_of_streaks_finds_nothing() {
    search_shortly(draw::draw_streaks, &[]);
}

#[test]
fn a_short_search_of_glints_finds_nothing() {
    search_shortly(draw::draw_glints, &[]);
}

/// Seeds and draws of long searches in which pixels were off by more than they stated, and by what.
const ONCE_FAILED: [(u64, u64); 46] = [
    // A chart of a few pixels at the sample's edge, between the nodes of a tile.
    (1_795_348_325, 34),
    (20_261_122, 558),
    (20_261_122, 959),
    // The same, off a wide lobe.
    (20_261_303, 581),
    // What a tile was off by at its corners counted too little.
    (1_795_348_325, 82),
    (20_261_122, 310),
    // The finest polynomials along a lobe's narrow axis were not compared with anything.
    (20_261_122, 71),
    // Tiles with edges in them when the work was used up, judged as if they resolved them.
    (20_261_501, 241),
    // Kinks between the lines over a pixel.
    (20_261_122, 123),
    (20_261_122, 1172),
    // What a rough sample sends to the lowest patches, told by one parabola up a patch.
    (20_261_122, 215),
    (20_261_122, 710),
    // The top of the bulb's image, in a strip as long as the film.
    (778, 185),
    // The side of a tile, whose corners alone were looked at.
    (779, 64),
    // What lies between the end of a line over a pixel and its outermost point.
    (1_795_348_325, 104),
    // A step over which 15 and 7 points agreed.
    (20_261_302, 112),
    // Polynomials that did not converge before the work was used up.
    (20_261_302, 268),
    // A tile over part of a pixel of a coarse film, by a rule that was exact for cubics only.
    (20_261_302, 976),
    // Paths that met the bulb's mirror image, but not the lobe's blur about it.
    (20_261_301, 175),
    // A circle on which the integrand bends, through a large bulb but past the corners of a box around it.
    (20_261_126, 869),
    (20_261_126, 416),
    (20_261_126, 2528),
    // The tip of the bulb's image, over the side of a tile by a hundredth of a pixel.
    (20_261_126, 1882),
    // An edge through the middle of a tile that was given up: its even coefficients vanish.
    (20_261_126, 1045),
    // The finest rule, when it was still off by more than it may.
    (20_261_126, 1835),
    // What chart and sample send each other, on one tile far wider than the sample.
    (20_261_127, 307),
    // A streak of the bulb's light that bends, traced.
    (20_261_130, 47),
    // The tip of the bulb's image, between the nodes of a thin tile.
    (20_261_130, 1570),
    // Dark pixels on the sample's outline, next to bright ones.
    (20_261_130, 1798),
    (20_261_130, 1963),
    // Polynomials of two degrees that agreed by chance.
    (20_261_131, 1683),
    // The tip of a mirrored bulb in a pixel, where 15 and 7 points agreed.
    (20_261_131, 1124),
    // A chart a third of a pixel wide, between the nodes of the one tile of a film of three pixels.
    (20_261_132, 2107),
    // Polynomials that converge slowly, on pixels that no tile serves.
    (20_261_132, 1929),
    // The sample's edge just beside three thirty-seconds of a pixel, where the reference was wrong.
    (20_261_133, 1048),
    // Polynomials that three times differed by a twentieth of what they missed, on a chart of 300 patches.
    (20_261_133, 1259),
    // An edge between two nodes of a tile of one and a half pixels, where neither coefficients nor points showed it.
    (20_261_134, 2513),
    // Two rules over the chart with the same points, which agreed whatever they missed.
    (20_261_134, 677),
    // A part of the sample below the camera where the bulb stands lower, between the nodes of the only tile.
    (20_261_136, 2271),
    // Two rules that agreed on all but the far tail of a lobe.
    (20_261_136, 2790),
    // A highlight near the horizon in a pixel that sees most of the sample, traced.
    (20_261_136, 1474),
    // The bulb in a mirror, whose image bends near the horizon, traced.
    (20_261_138, 278),
    // Tiles of several pixels with edges in them when the work was used up, which told too little of it.
    (20_261_145, 1433),
    // Two kinds of rules that disagreed, of which the finest was believed.
    (20_261_151, 1783),
    // A small chart that a lobe blurs to a stripe beside its mirror image, between the nodes of a tile.
    (20_261_155, 297),
    // Light off the sample that falls within a few pixels of the chart, on a tile of twenty.
    (20_261_217, 525),
];

/// The same of searches of the path tracer.
const TRACED_ONCE_FAILED: [(u64, u64); 12] = [
    // A bulb 3 mm off a chart of 70 mm, whose lit part few paths from the sample met.
    (20_261_141, 535),
    // A sphere in a pixel that sees no more of its lit side than a thin crescent.
    (20_261_142, 2601),
    // A mirror's highlight on a cylinder, longer than its outline about the mirror image.
    (20_261_143, 38),
    // The bulb in a highly anisotropic mirror near the horizon: its tail lies beside what is brightest by the angle.
    (20_261_143, 2923),
    // A sphere's limb, all of whose light lies in a hundredth of a pixel.
    (20_261_144, 2034),
    // Light between the chart and the sample that few paths of a pixel bring, and none of these did.
    (20_261_143, 474),
    (20_261_143, 2778),
    (20_261_147, 95),
    (20_261_147, 225),
    (20_261_147, 959),
    // A streak on a cylinder, a hundredth of a pixel wide.
    (20_261_164, 376),
    // A bulb far larger than a narrow lobe, whose image lies across the lobe's axes.
    (20_261_190, 107),
];

/// The same of searches of streaks.
const STREAKS_ONCE_FAILED: [(u64, u64); 3] = [
    // The chart below the horizon of a mirror ball in part, where the lobe sends nothing but to one place.
    (20_261_177, 976),
    // The flank of a streak along the limb, beside whose middle there is no sample.
    (20_261_190, 299),
    // A pixel in the middle of which a camera close by sees past the sample.
    (20_261_191, 260),
];

/// And of glints.
const GLINTS_ONCE_FAILED: [(u64, u64); 4] = [
    // The bulb drawn out by grazing light across the axes of a near mirror, on a cylinder.
    (20_261_178, 71),
    // The image of a small bulb on the border of two pixels.
    (20_261_190, 96),
    // A streak across a flat sample in a thousandth of the pixel, and far beyond it.
    (20_261_193, 191),
    // A streak of which one half cannot be followed.
    (20_261_193, 322),
];

#[test]
fn draws_that_once_failed_hold() {
    hold(draw::draw, &ONCE_FAILED);
}

#[test]
fn traced_draws_that_once_failed_hold() {
    hold(draw::draw_traced, &TRACED_ONCE_FAILED);
}

#[test]
fn streaks_that_once_failed_hold() {
    hold(draw::draw_streaks, &STREAKS_ONCE_FAILED);
}

#[test]
fn glints_that_once_failed_hold() {
    hold(draw::draw_glints, &GLINTS_ONCE_FAILED);
}

fn hold(draw: Draw, once_failed: &[(u64, u64)]) {
    let effort = Effort {
        pixels_max: 8,
        samples_max: 1024,
        finer: &[Kind::Resolution, Kind::Accuracy],
    };
    let failed: Vec<_> = once_failed
        .par_iter()
        .filter(|(seed, index)| {
            let outcome = examine(&draw(*seed, *index), effort);
            for finding in &outcome.findings {
                println!("{seed} {index}: {finding}");
            }
            !outcome.findings.is_empty()
        })
        .collect();
    assert!(failed.is_empty(), "{failed:?}");
}

/// `tests/scenes.sh` runs it.
#[test]
#[ignore = "runs for as long as it is told to"]
fn a_long_search_finds_nothing() {
    search_as_told(draw::draw);
}

/// `tests/scenes.sh --coarse` runs it.
#[test]
#[ignore = "runs for as long as it is told to"]
fn a_long_search_at_coarse_accuracies_finds_nothing() {
    search_as_told(draw::draw_coarse);
}

/// `tests/scenes.sh --traced` runs it.
#[test]
#[ignore = "runs for as long as it is told to"]
fn a_long_search_of_the_path_tracer_finds_nothing() {
    search_as_told(draw::draw_traced);
}

/// `tests/scenes.sh --streaks` runs it.
#[test]
#[ignore = "runs for as long as it is told to"]
fn a_long_search_of_streaks_finds_nothing() {
    search_as_told(draw::draw_streaks);
}

/// `tests/scenes.sh --glints` runs it.
#[test]
#[ignore = "runs for as long as it is told to"]
fn a_long_search_of_glints_finds_nothing() {
    search_as_told(draw::draw_glints);
}

fn search_as_told(draw: Draw) {
    let seed = variable("BRDFARM_SEED", SEED);
    let (first, count) = (
        variable("BRDFARM_SCENES_FIRST", 0),
        variable("BRDFARM_SCENES", 100),
    );
    println!("BRDFARM_SEED={seed}");
    let effort = Effort {
        pixels_max: 12,
        samples_max: 4096,
        finer: &[Kind::Resolution, Kind::Accuracy],
    };
    let summary = search(draw, seed, [first, count], effort);
    summary.print();
    assert_eq!(summary.failures(), 0);
}

/// Examines the case that a failure printed: `BRDFARM_CASE` names the folder of its two files.
#[test]
#[ignore = "examines the files that it is told to"]
fn a_case_of_files_holds() {
    let folder = PathBuf::from(std::env::var("BRDFARM_CASE").expect("BRDFARM_CASE is a folder"));
    let text = |name| std::fs::read_to_string(folder.join(name)).expect("a file of the case");
    let material = Material::from_json(text("case.json").as_bytes()).expect("a material");
    let case = Case::of_toml(&text("case.toml"), 0, material);
    let effort = Effort {
        pixels_max: 256,
        samples_max: 16384,
        finer: &[Kind::Resolution, Kind::Accuracy],
    };
    let outcome = examine(&case, effort);
    for finding in &outcome.findings {
        println!("{finding}");
    }
    assert!(outcome.findings.is_empty());
}

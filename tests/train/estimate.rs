//! `brdfarm estimate` on photographs made from films.

use crate::camera::{self, FILM_PIXELS, FILM_WIDTH, Film, Map, Point, inverse, project, words};
use crate::pairs::{SPECIFICATION, TRAIN, exported, fail};
use crate::workplace::Workplace;
use dataset::{Specification, Split};
use image::{Rgb, RgbImage};
use serde_json::Value;
use std::{env, fs};

/// The cameras' elevations.
const ELEVATIONS_DEG: [f64; 2] = [30.0, 90.0];

/// The photographs' names.
const NAMES: [&str; 2] = ["oblique", "above"];

/// What photographs show of the films: their middle, turned, stretched and tilted a little.
const MAPS: [Map; 2] = [
    [
        [0.97, 0.04, 40.0],
        [-0.05, 1.02, 60.0],
        [-1.5e-4, 1.0e-4, 1.0],
    ],
    [
        [1.03, -0.06, 66.0],
        [0.05, 0.98, 90.0],
        [1.0e-4, -1.2e-4, 1.0],
    ],
];

/// How bright the photographs are.
const GAIN: [f64; 3] = [0.45, 0.35, 0.5];

/// What is photographed: of R = 54, so that no highlight is clipped at white.
const MATERIAL: u32 = 5;

/// The specification of the films that photographs are made from.
pub fn films() -> String {
    let half_width = 0.5 * FILM_WIDTH;
    SPECIFICATION
        .replace("materials = 24", "materials = 9000")
        .replace("width = 24", &format!("width = {FILM_PIXELS}"))
        .replace("height = 24", &format!("height = {FILM_PIXELS}"))
        .replace("relative = 1e-1", "relative = 1e-2")
        .replace("absolute = 1e-2", "absolute = 1e-3")
        .replace(
            "[accuracy]",
            &format!("[camera]\nfilm_half_width = {half_width}\n[accuracy]"),
        )
}

/// Where sample and chart are in films and photographs, as options.
struct Shots {
    films: String,
    photographs: String,
    charts: String,
}

/// Renders both films of a material.
fn films_of(place: &Workplace, material: u32) -> [Film; 2] {
    std::array::from_fn(|view| {
        let name = NAMES[view];
        place.succeed(&format!(
            "render --spec films.toml --material {material} --view {view} --out {name}.exr"
        ));
        Film::read(&place.path().join(format!("{name}.exr")))
    })
}

/// Takes photographs of films.
fn shoot(place: &Workplace, films: &[Film; 2], gain: [f64; 3]) -> Shots {
    let mut shots = Shots {
        films: String::new(),
        photographs: String::new(),
        charts: String::new(),
    };
    for (view, film) in films.iter().enumerate() {
        let (name, map) = (NAMES[view], &MAPS[view]);
        film.photograph(map, gain, &place.path().join(format!("{name}.png")));
        let seen = inverse(map);
        let moved = |corners: [Point; 4]| words(corners.map(|corner| project(&seen, corner)));
        let sample = camera::sample(ELEVATIONS_DEG[view]);
        let chart = camera::chart(ELEVATIONS_DEG[view]);
        shots.films += &format!(" --{name}-corners {}", words(sample));
        shots.photographs += &format!(" --{name}-corners {}", moved(sample));
        shots.charts += &format!(" --{name}-chart={}", moved(chart));
    }
    shots
}

fn posterior(place: &Workplace, out: &str) -> Value {
    let path = place.path().join(out).join("posterior.json");
    serde_json::from_slice(&fs::read(path).unwrap()).unwrap()
}

/// Readings in bins of their ranges.
fn bins(posterior: &Value) -> Vec<f64> {
    let labels = posterior["reading"].as_array().unwrap().iter();
    let position = |label: &Value| {
        let [low, high] = [0, 1].map(|end| label["range"][end].as_f64().unwrap());
        100.0 * (label["value"].as_f64().unwrap() - low) / (high - low)
    };
    labels.map(position).collect()
}

/// How far readings of photographs are from those of their films, in bins, in order.
fn apart(film: &Value, photograph: &Value) -> Vec<f64> {
    let pairs = bins(film).into_iter().zip(bins(photograph));
    let mut apart: Vec<f64> = pairs.map(|(film, other)| (film - other).abs()).collect();
    apart.sort_by(f64::total_cmp);
    apart
}

/// How far the gains of both photographs are from the truth, as a share of it.
fn gain_errors(posterior: &Value, truth: [f64; 3]) -> Vec<f64> {
    let error = |view: usize, channel: usize| {
        let found = posterior["gain"][view][channel].as_f64().unwrap();
        (found / truth[channel] - 1.0).abs()
    };
    (0..6).map(|place| error(place / 3, place % 3)).collect()
}

/// For each of the ten parameters whether the interval that the refinement states holds the truth.
fn covered(place: &Workplace, posterior: &Value, material: u32) -> Vec<bool> {
    let truth = Specification::load(&place.path().join("films.toml")).unwrap();
    let mut truth = truth.material(material).material;
    // Up to R = 90 a common factor of the colours shows nowhere, and the largest channel is stated as 1.
    let channels = truth.rgb0.iter().chain(&truth.rgb90);
    let largest = channels.copied().fold(0.0, f64::max);
    if truth.roughness <= 90.0 {
        truth.rgb0 = truth.rgb0.map(|channel| channel / largest);
        truth.rgb90 = truth.rgb90.map(|channel| channel / largest);
    }
    let truth = serde_json::to_value(truth).unwrap();
    let [low, high] = ["low", "high"].map(|end| &posterior["refined"][end]);
    let holds = |name: &str, low: &Value, truth: &Value, high: &Value| {
        let [low, truth, high] = [low, truth, high].map(|value| value.as_f64().unwrap());
        // The angle's may go through 0 and 180 degrees.
        let turns: &[f64] = if name == "angle_deg" {
            &[-180.0, 0.0, 180.0]
        } else {
            &[0.0]
        };
        turns
            .iter()
            .any(|turn| (low..=high).contains(&(truth + turn)))
    };
    let numbers = ["roughness", "anisotropy", "angle_deg", "ior"].into_iter();
    let numbers = numbers.map(|name| holds(name, &low[name], &truth[name], &high[name]));
    let colours = ["rgb0", "rgb90"]
        .into_iter()
        .flat_map(|name| (0..3).map(move |channel| (name, channel)));
    let colours = colours.map(|(name, channel)| {
        holds(
            name,
            &low[name][channel],
            &truth[name][channel],
            &high[name][channel],
        )
    });
    numbers.chain(colours).collect()
}

#[test]
fn photographs_are_read_as_their_films_are() {
    let place = exported();
    place.succeed(&format!("{TRAIN} --variant cnn0 --out net"));
    fs::write(place.path().join("films.toml"), films()).unwrap();
    let estimate = "estimate net/model.safetensors";
    let films = films_of(&place, MATERIAL);
    let Shots {
        films,
        photographs,
        charts,
    } = shoot(&place, &films, GAIN);

    place.succeed(&format!(
        "{estimate} oblique.exr above.exr --out film {films}"
    ));
    let said = place.succeed(&format!(
        "{estimate} oblique.png above.png --out photograph --refine {photographs} {charts}"
    ));
    assert!(said.contains("gain") && said.contains("refined"), "{said}");
    let (film, photograph) = (posterior(&place, "film"), posterior(&place, "photograph"));
    assert_eq!(gain_errors(&film, [1.0; 3]), [0.0; 6]);
    let errors = gain_errors(&photograph, GAIN);
    assert!(errors.iter().all(|error| *error < 0.02), "{errors:?}");
    let apart = apart(&film, &photograph);
    assert!(apart[5] < 1.0, "{apart:?} bins");
    // All ten; five percent of intervals miss by right.
    let covered = covered(&place, &photograph, MATERIAL);
    assert!(
        covered.iter().filter(|covered| **covered).count() >= 9,
        "{covered:?}"
    );

    // What was found is a material that renders, and a picture.
    let found = "--material-file photograph/material.json";
    place.succeed(&format!(
        "render --spec films.toml {found} --view 0 --out again.exr"
    ));
    let preview = image::open(place.path().join("photograph/preview.png")).unwrap();
    assert_eq!((preview.width(), preview.height()), (800, 536));
}

#[test]
fn what_cannot_be_estimated_is_told_with_its_place() {
    let place = exported();
    place.succeed(&format!("{TRAIN} --variant cnn0 --out net"));
    let estimate = |rest: &str| format!("estimate net/model.safetensors {rest} --out found");
    let refused = |rest: &str, words: &[&str]| {
        let said = fail(&place, &estimate(rest), 2);
        for word in words {
            assert!(said.contains(word), "{said:?} does not say {word:?}");
        }
    };
    let flat = |name: &str, code: u8| {
        let path = place.path().join(name);
        RgbImage::from_pixel(100, 80, Rgb([code; 3]))
            .save(path)
            .unwrap();
    };
    flat("grey.png", 100);
    flat("grey.jpg", 100);
    flat("white.png", 255);
    fs::write(place.path().join("text.png"), "no image").unwrap();
    let corners = "10,70,90,70,90,10,10,10";
    let both = format!("--oblique-corners {corners} --above-corners {corners}");
    let known = format!("{both} --gain 1");
    // What is fine: PNG and JPEG of the same, at a known gain.
    place.succeed(&estimate(&format!("grey.png grey.jpg {known}")));

    refused(
        &format!("grey.png nowhere.png {known}"),
        &["nowhere.png", "no such file"],
    );
    refused(&format!("text.png grey.png {known}"), &["text.png", "PNG"]);
    refused(
        "grey.png grey.png --gain 1",
        &["grey.png", "--oblique-corners"],
    );
    refused(
        &format!("grey.png grey.png {both}"),
        &["exposure", "--gain"],
    );
    refused(
        &format!("grey.png white.png {known}"),
        &["from above", "100 percent", "white"],
    );
    let small = "--above-corners 10,30,30,30,30,10,10,10";
    refused(
        &format!("grey.png grey.png --oblique-corners {corners} {small} --gain 1"),
        &["from above", "20 x 20", "32"],
    );
    let outside = "--above-corners 10,70,90,70,90,10,-10,10";
    refused(
        &format!("grey.png grey.png --oblique-corners {corners} {outside} --gain 1"),
        &["(-10, 10)", "100 x 80"],
    );
    let chart = "--above-chart 10,8,90,8,90,-200,10,-200";
    refused(
        &format!("grey.png grey.png {both} {chart}"),
        &["patches", "fewest"],
    );
    // What the command line itself refuses.
    let crossed = format!("{corners} --above-corners 10,70,90,10,90,70,10,10 --gain 1");
    let crossed = format!("--oblique-corners {crossed}");
    let gains = ["0", "1,2", "nan", "1e300", "1e-7"];
    let gains = gains.map(|gain| (format!("{both} --gain {gain}"), "'--gain"));
    for (wrong, told) in gains.into_iter().chain([(crossed, "the corners cross")]) {
        let output = place.run(&estimate(&format!("grey.png grey.png {wrong}")));
        assert_eq!(output.status.code(), Some(2), "{wrong}");
        let said = String::from_utf8(output.stderr).unwrap();
        assert!(said.contains(told), "{said}");
    }
}

/// Photographs of materials of the test split, read by a network that learned its trade:
/// `tests/photographs.sh MODEL [N]`.
#[test]
#[ignore = "takes minutes and a trained model: tests/photographs.sh runs it"]
#[allow(clippy::print_stdout, reason = "a campaign reports")]
fn campaign_of_photographs() {
    let model = env::var("PHOTOGRAPHS_MODEL").expect("PHOTOGRAPHS_MODEL names a model");
    let number = |name: &str| env::var(name).unwrap().parse::<u32>().unwrap();
    let (count, from) = (number("PHOTOGRAPHS"), number("PHOTOGRAPHS_FROM"));
    let place = Workplace::empty();
    let specification = place.path().join("films.toml");
    fs::write(&specification, films()).unwrap();
    let specification = Specification::load(&specification).unwrap();
    let materials = (from..9000).filter(|&index| specification.split(index) == Split::Test);
    let (mut gains, mut bins, mut held, mut refused) = (Vec::new(), Vec::new(), Vec::new(), 0);
    for material in materials.take(count as usize) {
        let films = films_of(&place, material);
        // As a photographer would: a tenth of the sample's channels may be white, but the chart is
        // not to drown in the steps of 8 bits.
        let bright =
            (0..2).map(|view| films[view].quantile(camera::sample(ELEVATIONS_DEG[view]), 0.9));
        let gain = GAIN.map(|gain| 2.0 * gain / bright.clone().fold(1.0, f64::max).min(3.0));
        let shots = shoot(&place, &films, gain);
        let estimate = |rest: String| place.run(&format!("estimate {model} {rest}"));
        let film = estimate(format!("oblique.exr above.exr --out film {}", shots.films));
        assert!(film.status.success(), "{film:?}");
        let photographs = format!("{} {}", shots.photographs, shots.charts);
        let output = estimate(format!(
            "oblique.png above.png --out photograph --refine {photographs}"
        ));
        if !output.status.success() {
            println!("{material}: {}", String::from_utf8_lossy(&output.stderr));
            refused += 1;
            continue;
        }
        let (film, photograph) = (posterior(&place, "film"), posterior(&place, "photograph"));
        let covered = covered(&place, &photograph, material);
        println!(
            "{material}: gains {:.4?}, bins {:.2?}, {covered:?}",
            gain_errors(&photograph, gain),
            apart(&film, &photograph)
        );
        gains.extend(gain_errors(&photograph, gain));
        bins.extend(apart(&film, &photograph));
        held.extend(covered);
    }
    bins.sort_by(f64::total_cmp);
    let worst = gains.iter().copied().fold(0.0, f64::max);
    let share = held.iter().filter(|held| **held).count() as f64 / held.len() as f64;
    println!(
        "{count} pairs, {refused} refused: gains off by {worst:.4} at most, readings {:.2} bins apart in the \
         median, {:.1} percent of refined intervals hold the truth",
        bins[bins.len() / 2],
        100.0 * share
    );
    assert!(worst < 0.02 && bins[bins.len() / 2] < 1.0 && share >= 0.95);
}

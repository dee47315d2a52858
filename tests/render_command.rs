//! `brdfarm render` as another program meets it: what it prints as JSON, and the error of each
//! pixel.

use dataset::Specification;
use exr::prelude::*;
use serde_json::Value;
use std::fs;
use std::path::Path;
use std::process::{Command, Output};

/// A film whose pixels are stored with 32 bits, so that a pixel's target can be worked out from the
/// file.
const SMALL: &str = "[image]\nwidth = 20\nheight = 12\npixel = \"float\"\n";
const TRACED: &str = "[integrator]\nkind = \"path\"\nsamples_per_pixel = 16\n";

/// How much two numbers may differ of which one was rounded to 32 bits.
const ROUNDING: f64 = 2.0 / (1u64 << 24) as f64;

fn brdfarm(arguments: &str, directory: &Path) -> Output {
    Command::new(env!("CARGO_BIN_EXE_brdfarm"))
        .args(arguments.split(' '))
        .current_dir(directory)
        .output()
        .expect("brdfarm runs")
}

fn text(bytes: &[u8]) -> &str {
    str::from_utf8(bytes).expect("UTF-8")
}

/// What a command that has to succeed prints.
fn printed(arguments: &str, directory: &Path) -> String {
    let output = brdfarm(arguments, directory);
    assert!(
        output.status.success(),
        "{arguments}: {}",
        text(&output.stderr)
    );
    text(&output.stdout).to_owned()
}

/// The one object that a command prints, on one line.
fn json(arguments: &str, directory: &Path) -> Value {
    let printed = printed(arguments, directory);
    assert_eq!(printed.lines().count(), 1, "{printed}");
    let value: Value = serde_json::from_str(&printed).expect("JSON");
    assert!(value.is_object(), "{value}");
    value
}

fn number(object: &Value, name: &str) -> f64 {
    object[name]
        .as_f64()
        .unwrap_or_else(|| panic!("{name} of {object}"))
}

fn specifications(directory: &Path) {
    let write = |name: &str, content: &str| {
        fs::write(directory.join(name), content).expect("written");
    };
    write("hybrid.toml", SMALL);
    write("path.toml", &format!("{SMALL}{TRACED}"));
    // Its camera sees the bulb, so the hybrid integrator leaves it to the path tracer.
    write(
        "left.toml",
        &format!(
            "{SMALL}[integrator]\nsamples_per_pixel = 16\n[camera]\nfilm_half_width = 4.0\n\
             distance_m = 2.0\n"
        ),
    );
}

fn digest_of(path: &Path) -> String {
    let bytes = fs::read(path).expect("a file");
    blake3::hash(&bytes).to_hex().to_string()
}

/// The pixels of a file of errors, and its header.
fn errors(path: &Path) -> (Vec<f64>, exr::meta::header::Header) {
    let mut meta = MetaData::read_from_file(path, true).expect("an EXR file");
    assert_eq!(meta.headers.len(), 1);
    let image = read_first_flat_layer_from_file(path).expect("an EXR file");
    let [channel] = image.layer_data.channel_data.list.as_slice() else {
        panic!("one channel");
    };
    assert_eq!(channel.name.to_string(), "error");
    let FlatSamples::F32(samples) = &channel.sample_data else {
        panic!("32-bit floats");
    };
    let errors = samples.iter().copied().map(f64::from).collect();
    (errors, meta.headers.remove(0))
}

/// The largest channel of each pixel of an image.
fn brightness(path: &Path) -> Vec<f64> {
    let image = read_first_flat_layer_from_file(path).expect("an EXR file");
    let channels: Vec<Vec<f32>> = image
        .layer_data
        .channel_data
        .list
        .iter()
        .map(|channel| channel.sample_data.values_as_f32().collect())
        .collect();
    assert_eq!(channels.len(), 3);
    (0..channels[0].len())
        .map(|pixel| f64::from(channels.iter().map(|c| c[pixel]).fold(0.0, f32::max)))
        .collect()
}

#[test]
fn json_says_what_the_line_says() {
    let directory = tempfile::tempdir().expect("a directory");
    let path = directory.path();
    specifications(path);
    for (name, integrator) in [("hybrid", "hybrid"), ("path", "path"), ("left", "path")] {
        let view = format!("render --spec {name}.toml --seed 5 --material 3 --view 0");
        let line = printed(&format!("{view} --out line.exr"), path);
        let answer = json(&format!("{view} --out json.exr --json"), path);
        assert_eq!(answer["digest"], digest_of(&path.join("line.exr")));
        assert_eq!(answer["digest"], digest_of(&path.join("json.exr")));
        assert_eq!(
            line,
            format!(
                "{}  error mean {:.2e}, 95th percentile {:.2e}, largest {:.2e}; {:.1}% of pixels \
                 within target\n",
                answer["digest"].as_str().expect("a digest"),
                number(&answer, "error_mean"),
                number(&answer, "error_p95"),
                number(&answer, "error_max"),
                100.0 * number(&answer, "within_target"),
            )
        );
        assert_eq!(answer["integrator"], integrator);
        assert_eq!(answer["samples"].as_u64() > Some(0), integrator == "path");
        assert_eq!(
            answer["evaluations"].as_u64() > Some(0),
            integrator == "hybrid"
        );
        for (key, expected) in [("seed", 5), ("material", 3), ("view", 0)] {
            assert_eq!(answer[key], expected);
        }
        assert_eq!(
            (&answer["width"], &answer["height"]),
            (&20.into(), &12.into())
        );
        assert_eq!(answer["renderer_version"], dataset::RENDERER_VERSION);
        assert_eq!(
            answer["accuracy"],
            serde_json::json!({"absolute": 1e-4, "relative": 1e-3})
        );
    }
}

/// A program can take a row of the manifest and what `render` prints for the same thing.
#[test]
fn json_has_the_names_and_the_values_of_the_manifest() {
    let directory = tempfile::tempdir().expect("a directory");
    let path = directory.path();
    fs::write(path.join("spec.toml"), format!("{SMALL}{TRACED}")).expect("written");
    printed("run --spec spec.toml --materials 1 --store store", path);
    printed(
        "dataset manifest export --store store --format jsonl --out rows.jsonl",
        path,
    );
    let rows = fs::read_to_string(path.join("rows.jsonl")).expect("rows");
    let rows: Vec<Value> = rows
        .lines()
        .map(|line| serde_json::from_str(line).expect("JSON"))
        .collect();
    assert_eq!(rows.len(), 14);
    for row in &rows[4..6] {
        let answer = json(
            &format!(
                "render --spec spec.toml --material 0 --view {} --json --error-out error.exr",
                row["view"]
            ),
            path,
        );
        let answer = answer.as_object().expect("an object");
        for (name, value) in answer {
            if !["accuracy", "integrator"].contains(&name.as_str()) {
                assert_eq!(value, &row[name], "{name}");
            }
        }
        assert_eq!(answer.len(), 16);
    }
}

#[test]
fn the_statistics_are_those_of_the_errors_of_the_pixels() {
    let directory = tempfile::tempdir().expect("a directory");
    let path = directory.path();
    specifications(path);
    for arguments in [
        "--spec hybrid.toml --material 3 --view 5",
        "--spec hybrid.toml --material 8 --view 10",
        "--spec path.toml --material 3 --view 5",
    ] {
        let answer = json(
            &format!("render {arguments} --out image.exr --error-out error.exr --json"),
            path,
        );
        let (mut errors, _) = errors(&path.join("error.exr"));
        assert_eq!(errors.len(), 20 * 12);
        // Rounded up, the errors are not below those that the statistics are of.
        let close = |name: &str, found: f64| {
            let stated = number(&answer, name);
            assert!(
                found >= stated * (1.0 - 1e-12) && found <= stated * (1.0 + ROUNDING),
                "{arguments}: {name} {stated}, of the pixels {found}"
            );
        };
        let accuracy = &answer["accuracy"];
        let within = |slack: f64| {
            let met = errors
                .iter()
                .zip(brightness(&path.join("image.exr")))
                .filter(|&(&error, value)| {
                    let target = number(accuracy, "relative") * value;
                    error <= target.max(number(accuracy, "absolute")) * slack
                })
                .count();
            met as f64 / errors.len() as f64
        };
        let stated = number(&answer, "within_target");
        let (fewest, most) = (within(1.0 - 2.0 * ROUNDING), within(1.0 + 2.0 * ROUNDING));
        assert!(fewest <= stated && stated <= most, "{arguments}: {stated}");
        assert!(most - fewest < 0.02, "{arguments}: {fewest} to {most}");

        close("error_mean", errors.iter().sum::<f64>() / 240.0);
        errors.sort_by(f64::total_cmp);
        close("error_p95", errors[239 * 95 / 100]);
        close("error_max", errors[239]);
    }
}

#[test]
fn a_file_of_errors_says_what_it_is_and_is_the_same_every_time() {
    let directory = tempfile::tempdir().expect("a directory");
    let path = directory.path();
    specifications(path);
    let view = "render --spec hybrid.toml --seed 5 --material 3 --view 5";
    let line = printed(&format!("{view} --error-out first.exr"), path);
    let digest = line.split(' ').next().expect("a digest");
    for others in ["--backend native --threads 1", "--threads 2 --json"] {
        printed(
            &format!("{view} --error-out again.exr --expect {digest} {others}"),
            path,
        );
        assert_eq!(
            digest_of(&path.join("first.exr")),
            digest_of(&path.join("again.exr")),
            "{others}"
        );
    }

    let (_, header) = errors(&path.join("first.exr"));
    assert_eq!(header.compression, Compression::ZIP16);
    assert_eq!(header.line_order, LineOrder::Increasing);
    let attributes = header.own_attributes;
    let comments = attributes.comments.expect("comments").to_string();
    assert!(comments.contains("in units of white"), "{comments}");
    assert_eq!(attributes.capture_date, None);
    let identity = attributes.other.get(&Text::from("brdfarm"));
    let Some(AttributeValue::Text(identity)) = identity else {
        panic!("the image's header");
    };
    let identity: Value = serde_json::from_str(&identity.to_string()).expect("JSON");
    for (key, expected) in [("seed", 5), ("material", 3), ("view", 5)] {
        assert_eq!(identity[key], expected);
    }
}

#[test]
fn where_the_digest_differs_no_errors_are_written() {
    let directory = tempfile::tempdir().expect("a directory");
    let path = directory.path();
    specifications(path);
    let output = brdfarm(
        &format!(
            "render --spec path.toml --material 3 --view 5 --error-out error.exr --json --expect {}",
            "0".repeat(64)
        ),
        path,
    );
    assert_eq!(output.status.code(), Some(1));
    assert_eq!(output.stdout, b"");
    assert!(text(&output.stderr).contains(&"0".repeat(64)));
    assert!(!path.join("error.exr").exists());
}

#[test]
fn errors_for_a_folder_that_is_not_there_are_a_failure_with_its_name() {
    let directory = tempfile::tempdir().expect("a directory");
    let path = directory.path();
    specifications(path);
    let output = brdfarm(
        "render --spec path.toml --material 3 --view 5 --error-out nowhere/error.exr",
        path,
    );
    let stderr = text(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{stderr}");
    assert!(stderr.contains("nowhere/error.exr"), "{stderr}");
    assert_eq!(stderr.lines().count(), 1, "{stderr}");
    assert_eq!(output.stdout, b"");
}

#[test]
fn a_material_from_a_file_has_no_index() {
    let directory = tempfile::tempdir().expect("a directory");
    let path = directory.path();
    specifications(path);
    fs::write(
        path.join("material.json"),
        r#"{"roughness": 20, "anisotropy": 0.5, "angle_deg": 40, "ior": 2,
            "rgb0": [0.8, 0.5, 0.3], "rgb90": [1, 1, 1]}"#,
    )
    .expect("written");
    let answer = json(
        "render --spec path.toml --material-file material.json --view 6 --out a.png --json",
        path,
    );
    assert_eq!(answer["material"], Value::Null);
    assert!(
        answer
            .as_object()
            .is_some_and(|keys| keys.contains_key("material"))
    );
}

/// The channels of a file by their names, row by row.
fn channels(path: &Path) -> std::collections::BTreeMap<String, Vec<f64>> {
    let image = read_all_data_from_file(path).expect("an EXR file");
    let layer = &image.layer_data[0];
    let of_channel = |channel: &AnyChannel<Levels<FlatSamples>>| {
        let Levels::Singular(samples) = &channel.sample_data else {
            panic!("one level");
        };
        let values = samples.values_as_f32().map(f64::from).collect();
        (channel.name.to_string(), values)
    };
    layer.channel_data.list.iter().map(of_channel).collect()
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Where the middle of a pixel is at this depth, in the world.
fn place(specification: &Specification, view: usize, pixel: [u32; 2], depth: f64) -> [f64; 3] {
    let geometry = specification.view_geometry(view).expect("a view");
    let [width, height] = [specification.image.width, specification.image.height].map(f64::from);
    let pitch = 2.0 * specification.camera.film_half_width / width;
    let x = f64::from(pixel[0]) + 0.5 - 0.5 * width;
    let y = 0.5 * height - f64::from(pixel[1]) - 0.5;
    let local = [x * pitch * depth, y * pitch * depth, -depth];
    let world = geometry.world_from_camera;
    world[..3]
        .iter()
        .map(|row| dot([row[0], row[1], row[2]], local) + row[3])
        .collect::<Vec<_>>()
        .try_into()
        .expect("three")
}

/// What a pixel sees of a sphere below the origin, of radius 0.05.
fn check_sphere(at: impl Fn(&str) -> f64, place: [f64; 3], turn_deg: f64) {
    let vector = |name: &str| ["X", "Y", "Z"].map(|axis| at(&format!("{name}.{axis}")));
    let (normal, tangent) = (vector("normal"), vector("tangent"));
    let from_centre = [place[0], place[1], place[2] + 0.05];
    assert!((dot(from_centre, normal) - 0.05).abs() < 1e-6, "{place:?}");
    assert!((dot(normal, normal) - 1.0).abs() < 1e-6);
    assert!((dot(tangent, tangent) - 1.0).abs() < 1e-6 && dot(tangent, normal).abs() < 1e-6);
    // The turn of the material, seen at the pole.
    if normal[2] > 0.98 {
        let (sine, cosine) = dataset::sin_cos_deg(turn_deg);
        assert!((tangent[0] - cosine).abs() < 0.05, "{tangent:?}");
        assert!((tangent[1] - sine).abs() < 0.05, "{tangent:?}");
    }
    let arc = 0.05 * libm::acos(normal[2]);
    let [u, v] = [at("uv.U"), at("uv.V")].map(|place| 0.1 * (place - 0.5));
    assert!((libm::hypot(u, v) - arc).abs() < 1e-5, "{u} {v} {arc}");
    assert!((u * normal[1] - v * normal[0]).abs() < 1e-6);
    assert_eq!((at("mask.chart"), at("mask.bulb")), (0.0, 0.0));
}

/// What a pixel of a sphere sees is where a ray through its middle meets it.
#[test]
fn what_the_pixels_see_is_written() {
    let directory = tempfile::tempdir().expect("a directory");
    let path = directory.path();
    let text = format!(
        "{SMALL}[sample]\nshape = \"sphere\"\n[accuracy]\nrelative = 0.1\nabsolute = 0.1\n"
    );
    fs::write(path.join("sphere.toml"), &text).expect("written");
    let specification = Specification::from_toml(&text, "sphere.toml").expect("one");
    // The film is so low that of these views 5 alone shows the chart.
    for view in [0, 5, 9] {
        let arguments = format!("render --spec sphere.toml --material 3 --view {view}");
        printed(&format!("{arguments} --aov aov.exr"), path);
        let seen = channels(&path.join("aov.exr"));
        let names = "depth.Z mask.bulb mask.chart mask.sample normal.X normal.Y normal.Z tangent.X \
                     tangent.Y tangent.Z uv.U uv.V";
        assert_eq!(seen.keys().cloned().collect::<Vec<_>>().join(" "), names);
        let mut of_sample = 0;
        for (index, &mask) in (0u32..).zip(&seen["mask.sample"]) {
            if mask == 0.0 {
                continue;
            }
            of_sample += 1;
            let at = |name: &str| seen[name][index as usize];
            let pixel = [index % 20, index / 20];
            let place = place(&specification, view, pixel, at("depth.Z"));
            check_sphere(at, place, specification.views[view].rotation_deg);
        }
        let of_chart: f64 = seen["mask.chart"].iter().sum();
        assert!(of_sample > 20, "{of_sample} pixels of the sample");
        assert!(
            if view == 5 {
                of_chart > 5.0
            } else {
                of_chart == 0.0
            },
            "view {view}"
        );
    }
}

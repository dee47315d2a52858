//! The command itself, as a person or a script meets it.

mod stores;

use serde_json::Value;
use std::fs;
use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};

fn brdfarm(arguments: &[&str], directory: &Path) -> Output {
    Command::new(env!("CARGO_BIN_EXE_brdfarm"))
        .args(arguments)
        .current_dir(directory)
        .output()
        .expect("brdfarm runs")
}

fn text(bytes: &[u8]) -> &str {
    str::from_utf8(bytes).expect("UTF-8")
}

fn files(directory: &Path) -> Vec<String> {
    fs::read_dir(directory)
        .expect("a directory")
        .map(|entry| {
            entry
                .expect("an entry")
                .file_name()
                .to_string_lossy()
                .into_owned()
        })
        .collect()
}

/// `brdfarm brdf` with both ends in hand.
fn spawn_brdf() -> Child {
    Command::new(env!("CARGO_BIN_EXE_brdfarm"))
        .arg("brdf")
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .expect("brdfarm runs")
}

/// Answers of `brdfarm brdf` to `input`, a JSON value a line.
fn brdf(input: &[u8]) -> Vec<Value> {
    let mut child = spawn_brdf();
    let mut stdin = child.stdin.take().expect("a pipe");
    let input = input.to_vec();
    let writer = std::thread::spawn(move || stdin.write_all(&input));
    let output = child.wait_with_output().expect("an end");
    writer.join().expect("no panic").expect("all input taken");
    assert!(output.status.success());
    text(&output.stdout)
        .lines()
        .map(|line| serde_json::from_str(line).expect("JSON"))
        .collect()
}

#[test]
fn brdf_answers_the_reference_values() {
    let cases: Vec<Value> =
        serde_json::from_str(include_str!("../../renderer/tests/reference/brdf.json"))
            .expect("JSON");
    for (tint, key) in [("hue", "f_hue"), ("product", "f_product")] {
        let input: String = cases
            .iter()
            .map(|case| {
                serde_json::json!({
                    "material": case["material"], "wi": case["wi"], "wo": case["wo"], "tint": tint
                })
                .to_string()
                    + "\n"
            })
            .collect();
        let answers = brdf(input.as_bytes());
        assert_eq!(answers.len(), cases.len());
        for (answer, case) in answers.iter().zip(&cases) {
            let numbers = |value: &Value| -> Vec<f64> {
                let list = value.as_array().expect("a list");
                list.iter()
                    .map(|number| number.as_f64().expect("a number"))
                    .collect()
            };
            let (found, expected) = (numbers(&answer["f"]), numbers(&case[key]));
            let largest = expected.iter().fold(0.0f64, |a, &b| a.max(b));
            let steep = |direction: &Value| numbers(direction)[2] >= 1e-4;
            let tolerance = if steep(&case["wi"]) && steep(&case["wo"]) {
                1e-7
            } else {
                1e-4
            };
            for (found, expected) in found.iter().zip(expected) {
                assert!(
                    (found - expected).abs() <= tolerance * largest,
                    "{case}: {answer}"
                );
            }
        }
    }
}

#[test]
fn brdf_reports_a_bad_line_and_goes_on() {
    let good = r#"{"material": {"roughness": 30, "anisotropy": 0.5, "angle_deg": 40, "ior": 2,
        "rgb0": [1, 1, 1], "rgb90": [1, 1, 1]}, "wi": [0, 0, 1], "wo": [0, 0, 2]}"#
        .replace('\n', "");
    let bad = [
        "noise".to_owned(),
        good.replace("\"ior\": 2", "\"ior\": 0.5"),
        good.replace("[0, 0, 1]", "[0, 0, 0]"),
        good.replace("\"wi\"", "\"w\""),
        good.replace("30", "1e999"),
        format!("\"{}\"", "x".repeat(3 << 20)),
    ];
    let mut input = String::new();
    for line in &bad {
        input.push_str(&format!("{line}\n\n{good}\n"));
    }
    input.push_str("\u{0}\n");
    let mut input = input.into_bytes();
    input.extend_from_slice(b"\xff\xfe\n");
    let answers = brdf(&input);
    assert_eq!(answers.len(), 2 * bad.len() + 2);
    for (number, pair) in answers.chunks(2).take(bad.len()).enumerate() {
        assert_eq!(pair[0]["line"], 3 * number + 1, "{}", pair[0]);
        assert!(pair[0]["error"].is_string());
        assert!(pair[1]["f"].is_array(), "{}", pair[1]);
    }
    assert!(answers[2 * bad.len()]["error"].is_string());
}

/// Every way a specification can be wrong: exit code 2, one sentence with the place, nothing
/// written.
#[test]
fn a_bad_specification_is_refused_in_one_sentence() {
    let noise: Vec<u8> = (0..10u32 << 20)
        .map(|i| (i.wrapping_mul(2_654_435_761) >> 24) as u8)
        .collect();
    let preset = Path::new(env!("CARGO_MANIFEST_DIR")).join("dataset/src/maxbrdf.toml");
    let preset = fs::read(preset).expect("the preset");
    let cases: [(&str, Option<&[u8]>, &str); 8] = [
        (
            "unknown key",
            Some(b"seed = 1\n[light]\nradius = 0.03\n"),
            "radius_m",
        ),
        (
            "out of range",
            Some(b"[parameters]\nior = [0.5, 10]\n"),
            "parameters.ior",
        ),
        ("wrong type", Some(b"materials = \"many\"\n"), "materials"),
        ("missing", None, "spec.toml"),
        ("truncated", Some(&preset[..preset.len() / 2]), "spec.toml:"),
        ("noise", Some(&noise), "spec.toml"),
        ("binary", Some(b"name = \"\xff\"\n"), "spec.toml"),
        (
            "a view too much",
            Some(b"[[views]]\ncamera_elevation_deg = 91\n"),
            "views",
        ),
    ];
    for (name, content, expected) in cases {
        let directory = tempfile::tempdir().expect("a directory");
        if let Some(content) = content {
            fs::write(directory.path().join("spec.toml"), content).expect("written");
        }
        let before = files(directory.path());
        for command in [
            "run --spec spec.toml --materials 1",
            "render --spec spec.toml --material 0 --view 5 --out x.exr",
            "coordinator serve --spec spec.toml --store store",
        ] {
            let words: Vec<_> = command.split(' ').collect();
            let output = brdfarm(&words, directory.path());
            let stderr = text(&output.stderr);
            assert_eq!(
                output.status.code(),
                Some(2),
                "{name}, {command:?}: {stderr}"
            );
            assert_eq!(stderr.lines().count(), 1, "{name}: {stderr}");
            assert!(stderr.contains(expected), "{name}: {stderr}");
            assert!(stderr.len() < 400, "{name}: {} characters", stderr.len());
            assert_eq!(
                files(directory.path()),
                before,
                "{name}, {command:?}: files appeared"
            );
        }
    }
}

#[test]
fn a_view_renders_again_to_its_digest_and_fails_loudly_otherwise() {
    let directory = tempfile::tempdir().expect("a directory");
    let small =
        "[image]\nwidth = 24\nheight = 24\n[integrator]\nkind = \"path\"\nsamples_per_pixel = 16\n";
    fs::write(directory.path().join("spec.toml"), small).expect("written");
    fs::write(
        directory.path().join("other.toml"),
        format!("{small}[light]\nradius_m = 0.030000000000000001\n[camera]\ndistance_m = 0.5000000000000001\n"),
    )
    .expect("written");
    let render = |arguments: &str| {
        let arguments: Vec<_> = format!("render {arguments}")
            .split(' ')
            .map(str::to_owned)
            .collect();
        let arguments: Vec<_> = arguments.iter().map(String::as_str).collect();
        brdfarm(&arguments, directory.path())
    };
    let first = render("--spec spec.toml --seed 5 --material 3 --view 5 --out a.exr");
    assert!(first.status.success(), "{}", text(&first.stderr));
    let digest = text(&first.stdout)
        .split_whitespace()
        .next()
        .expect("a digest")
        .to_owned();
    let written = fs::read(directory.path().join("a.exr")).expect("the file");
    assert_eq!(blake3::hash(&written).to_hex().to_string(), digest);

    for backend in ["native", "embree", "embree:sse2"] {
        for threads in [1, 2] {
            let again = render(&format!(
                "--spec spec.toml --seed 5 --material 3 --view 5 --backend {backend} --threads \
                 {threads} --expect {digest}"
            ));
            assert!(again.status.success(), "{}", text(&again.stderr));
        }
    }
    for other in [
        "--spec other.toml --seed 5 --material 3 --view 5",
        "--spec spec.toml --seed 6 --material 3 --view 5",
        "--spec spec.toml --seed 5 --material 4 --view 5",
        "--spec spec.toml --seed 5 --material 3 --view 6",
    ] {
        let refused = render(&format!("{other} --out b.exr --expect {digest}"));
        assert_eq!(refused.status.code(), Some(1), "{other}");
        assert!(
            text(&refused.stderr).contains(&digest),
            "{}",
            text(&refused.stderr)
        );
        assert!(!directory.path().join("b.exr").exists());
    }
}

#[test]
fn a_material_file_renders_and_a_bad_one_is_refused() {
    let directory = tempfile::tempdir().expect("a directory");
    let write = |name: &str, content: &str| {
        fs::write(directory.path().join(name), content).expect("written");
    };
    write(
        "spec.toml",
        "[image]\nwidth = 24\nheight = 24\n[integrator]\nkind = \"path\"\nsamples_per_pixel = 16\n",
    );
    let good = r#"{"roughness": 20, "anisotropy": 0.5, "angle_deg": 40, "ior": 2,
        "rgb0": [0.8, 0.5, 0.3], "rgb90": [1, 1, 1]}"#;
    write("good.json", good);
    write("high.json", &good.replace("20", "101"));
    write("cut.json", &good[..40]);
    write("key.json", &good.replace("ior", "index"));
    let render = |file: &str, out: &str| {
        brdfarm(
            &[
                "render",
                "--spec",
                "spec.toml",
                "--material-file",
                file,
                "--view",
                "6",
                "--out",
                out,
            ],
            directory.path(),
        )
    };
    let output = render("good.json", "good.png");
    assert!(output.status.success(), "{}", text(&output.stderr));
    let picture = image::open(directory.path().join("good.png"))
        .expect("a PNG")
        .to_rgb8();
    assert_eq!(picture.dimensions(), (24, 24));
    assert!(
        picture.pixels().any(|pixel| pixel.0[0] > 100),
        "all is dark"
    );
    for file in ["high.json", "cut.json", "key.json", "none.json"] {
        let output = render(file, "bad.exr");
        assert_eq!(output.status.code(), Some(2), "{file}");
        let stderr = text(&output.stderr);
        assert!(
            stderr.contains(file) && stderr.lines().count() == 1,
            "{stderr}"
        );
        assert!(!directory.path().join("bad.exr").exists());
    }
}

/// Answers come when they are due: another program may wait for one before it asks the next.
#[test]
fn brdf_answers_a_line_before_the_next_is_written() {
    let mut child = spawn_brdf();
    let mut stdin = child.stdin.take().expect("a pipe");
    let mut answers = BufReader::new(child.stdout.take().expect("a pipe")).lines();
    for line in 1..=2 {
        stdin.write_all(b"noise\r\n").expect("taken");
        let answer = answers.next().expect("an answer").expect("a line");
        let answer: Value = serde_json::from_str(&answer).expect("JSON");
        assert_eq!(answer["line"], line);
    }
    drop(stdin);
    assert!(child.wait().expect("an end").success());
}

/// Command lines that cannot be meant: exit code 2, the reason first, nothing written.
/// Commands that are refused, and what the first line of the refusal says.
const WRONG: &[(&str, &str)] = &[
    ("run --workers 100000", "100000"),
    ("run --materials 0", "a set has 1 to 1000000 materials"),
    ("run --spec huge.toml", "image.width"),
    ("run --store occupied", "thesis.tex"),
    ("coordinator serve --listen 0.0.0.0:0", "--insecure"),
    ("worker connect farm:7117", "http(s)://HOST:PORT"),
    (
        "worker connect http://farm:7117/jobs",
        "http(s)://HOST:PORT",
    ),
    ("dataset verify --store nowhere", "no store in nowhere"),
    ("dataset show --materials 5-3 --out x.png", "5-3"),
    ("dataset show --out x.jpg", ".png"),
    (
        "dataset manifest export --format csv --store occupied",
        "no store",
    ),
    (
        "dataset export out --layout files --store nowhere",
        "no store in nowhere",
    ),
    (
        "dataset export out --layout webdataset --links",
        "--layout files",
    ),
    (
        "dataset export out --layout files --rectified 0",
        "--rectified",
    ),
    ("dataset export out --layout files --licence CC/BY", "SPDX"),
    (
        "dataset export out --layout files --published today",
        "YYYY-MM-DD",
    ),
    ("dataset import nowhere", "nowhere/manifest.parquet"),
    ("dataset import occupied --manifest x.txt", ".parquet"),
    ("dataset verify --rerender 120%", "0% to 100%"),
    ("dataset gc --store nowhere", "no store in nowhere"),
    ("dataset repair --store nowhere", "no store in nowhere"),
    ("render --material 0 --view 14 --out x.exr", "14 views"),
    ("render --material 0 --view 0 --out x.jpg", ".exr or .png"),
    (
        "render --material 0 --view 0 --error-out x.png",
        "--error-out x.png: the name has to end in .exr",
    ),
    (
        "render --material 0 --view 0 --error-out x.exr --aov ./x.exr",
        "--aov ./x.exr: --error-out names the same file",
    ),
    (
        "render --material 0 --view 0 --out x.exr --error-out ./x.exr",
        "the same file",
    ),
    (
        "render --material 0 --view 0 --seed 9223372036854775808 --out x.exr",
        "--seed",
    ),
    (
        "render --material 0 --view 0 --exposure nan --out x.png",
        "exposure",
    ),
    ("render --material 0 --view 0 --expect 12ab", "64"),
    (
        "render --material-file /dev/zero --view 0 --out x.exr",
        "65536 bytes",
    ),
    ("report --views 14 --out x", "no view 14"),
    ("report --views 5-3 --out x", "5-3"),
    ("report --size 0 --out x", "0"),
    ("report --size 4096 --out x", "4096"),
    ("report --materials unicorn --out x", "unicorn"),
    ("report --materials 0-999 --out x", "100 materials"),
    ("report --materials 4294967295 --out x", "4294967295"),
    ("report --integrator radiosity --out x", "radiosity"),
    ("report --reference 1e-20 --out x", "accuracy"),
    ("report --quick --out huge.toml", "huge.toml"),
];

#[test]
fn a_wrong_command_line_is_refused_before_anything_is_written() {
    let directory = tempfile::tempdir().expect("a directory");
    let path = directory.path();
    fs::write(
        path.join("huge.toml"),
        "[image]\nwidth = 4096\nheight = 4096\n",
    )
    .expect("written");
    fs::create_dir(path.join("occupied")).expect("made");
    fs::write(path.join("occupied/thesis.tex"), "").expect("written");
    let before = files(path);
    for (arguments, expected) in WRONG {
        let words: Vec<_> = arguments.split(' ').collect();
        let output = brdfarm(&words, path);
        let stderr = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{arguments}: {stderr}");
        let first = stderr.lines().next().expect("a reason");
        assert!(
            first.starts_with("error: ") && first.contains(expected),
            "{arguments}: {stderr}"
        );
        assert_eq!(output.stdout, b"", "{arguments}");
        assert_eq!(files(path), before, "{arguments}: files appeared");
    }
    assert_eq!(files(&path.join("occupied")), ["thesis.tex"]);
}

#[test]
fn a_narrowed_report_is_written_whole() {
    let directory = tempfile::tempdir().expect("a directory");
    let output = brdfarm(
        &[
            "report",
            "--quick",
            "--materials",
            "all-lambert,5",
            "--views",
            "9,10-11,9",
            "--size",
            "8",
            "--reference",
            "1e-3",
            "--out",
            "a/b",
        ],
        directory.path(),
    );
    assert!(output.status.success(), "{}", text(&output.stderr));
    assert_eq!(text(&output.stdout), "a/b/report.html\n");
    let read =
        |name: &str| fs::read_to_string(directory.path().join("a/b").join(name)).expect("a text");
    assert!(read("report.html").starts_with("<!DOCTYPE html>"));
    // Two materials, three views, three settings of each integrator, and the header.
    assert_eq!(read("renderings.csv").lines().count(), 1 + 2 * 3 * 6);
    for name in [
        "stages.csv",
        "backends.csv",
        "calibration.csv",
        "shapes.csv",
        "time-error.svg",
    ] {
        assert!(!read(name).is_empty(), "{name}");
    }
    assert!(
        files(&directory.path().join("a/b"))
            .iter()
            .all(|name| !name.ends_with(".new"))
    );
}

#[test]
fn a_cause_is_told_once() {
    let directory = tempfile::tempdir().expect("a directory");
    let output = brdfarm(&["run", "--spec", "none.toml"], directory.path());
    assert_eq!(text(&output.stderr).matches("No such file").count(), 1);
}

#[test]
fn every_subcommand_explains_itself() {
    let directory = tempfile::tempdir().expect("a directory");
    for command in [
        "",
        "run",
        "coordinator",
        "coordinator serve",
        "worker",
        "worker connect",
        "dataset",
        "dataset manifest",
        "dataset manifest export",
        "dataset export",
        "dataset verify",
        "dataset repair",
        "dataset gc",
        "dataset import",
        "dataset diff",
        "dataset stats",
        "dataset show",
        "dataset specification",
        "render",
        "brdf",
        "report",
        "completions",
    ] {
        let mut arguments: Vec<_> = command.split_whitespace().collect();
        arguments.push("--help");
        let output = brdfarm(&arguments, directory.path());
        assert!(
            output.status.success(),
            "{command}: {}",
            text(&output.stderr)
        );
        let help = text(&output.stdout);
        assert!(help.contains("Usage: brdfarm"), "{help}");
        let longest = help.lines().map(|line| line.chars().count()).max();
        assert!(
            longest <= Some(100),
            "{command}: a line of {longest:?} characters"
        );
    }
    for shell in ["bash", "zsh", "fish"] {
        let output = brdfarm(&["completions", shell], directory.path());
        assert!(output.status.success() && text(&output.stdout).contains("brdfarm"));
    }
}

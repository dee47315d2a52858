//! A narrowed report from end to end: what is written reads back, and says what was measured.

use report::plan::{NamedMaterial, Plan, Setting};
use report::{File, Report};
use roxmltree::Document;
use std::sync::atomic::{AtomicU64, Ordering};

fn plan(materials: &[&str], views: &[u32], settings: &[Setting]) -> Plan {
    Plan {
        materials: NamedMaterial::hard()
            .filter(|one| materials.contains(&one.name.as_str()))
            .chain([NamedMaterial::of_the_set(3)])
            .collect(),
        views: views.to_vec(),
        size_pixels: 8,
        settings: settings.to_vec(),
        reference_relative: 1e-3,
        shape_accuracies: vec![0.2],
        threads: 2,
    }
}

fn files(plan: Plan) -> Vec<File> {
    let count = AtomicU64::new(0);
    let expected = plan.renderings();
    let report = Report::make(plan, &|| {
        count.fetch_add(1, Ordering::Relaxed);
    });
    assert_eq!(count.into_inner(), expected);
    report
        .and_then(|report| report.files())
        .expect("files of a report")
}

fn text<'a>(files: &'a [File], name: &str) -> &'a str {
    let file = files.iter().find(|file| file.name == name);
    &file.unwrap_or_else(|| panic!("no {name}")).text
}

const BOTH: [Setting; 4] = [
    Setting::Accuracy(1e-1),
    Setting::Accuracy(1e-2),
    Setting::Samples(16),
    Setting::Samples(32),
];

#[test]
fn tables_hold_a_row_a_rendering_and_finite_numbers() {
    let files = files(plan(&["half-lambert", "mirror"], &[8, 9], &BOTH));
    let mut reader = csv::Reader::from_reader(text(&files, "renderings.csv").as_bytes());
    let header = reader.headers().expect("a header").clone();
    let rows: Vec<_> = reader.records().map(|row| row.expect("a row")).collect();
    assert_eq!(rows.len(), 3 * 2 * 4);
    let column = |name: &str| header.iter().position(|one| one == name).expect("a column");
    let number = |row: &csv::StringRecord, name: &str| -> f64 {
        let value: f64 = row[column(name)].parse().expect("a number");
        assert!(value.is_finite(), "{name}: {value}");
        value
    };
    for row in &rows {
        assert!(number(row, "cpu_seconds") > 0.0 && number(row, "wall_seconds") > 0.0);
        for name in [
            "relative_mse",
            "smape",
            "mean_relative_error",
            "p95_relative_error",
            "stated_mean_relative_error",
            "stated_p95_relative_error",
            "stated_max_error",
            "reference_p95_relative_error",
        ] {
            assert!(number(row, name) >= 0.0, "{name}");
        }
        for name in ["share_within_stated_error", "share_meeting_target"] {
            assert!((0.0..=1.0).contains(&number(row, name)), "{name}");
        }
        number(row, "mean_difference");
        let traced = &row[column("integrator")] == "path";
        assert_eq!(number(row, "samples") > 0.0, traced);
        let chart = &row[column("chart")] == "true";
        assert_eq!(chart, number(row, "view") == 8.0);
        let hard = !row[column("material")].starts_with("maxbrdf");
        assert_eq!(&row[column("hard_case")] == "true", hard);
        if traced {
            // One set of paths for each surface that a pixel sees: sample, chart, bulb or its image.
            let sets = number(row, "samples") / number(row, "setting");
            assert!(
                sets.fract() == 0.0 && sets > 0.0 && sets <= 4.0 * 64.0,
                "{sets}"
            );
        }
    }
    // Black is the mirror with the light overhead; the diffuse material is compared everywhere.
    let pixels = |material: &str, view: &str| {
        let row = rows
            .iter()
            .find(|row| &row[column("material")] == material && &row[column("view")] == view);
        number(row.expect("a row"), "pixels_compared")
    };
    assert_eq!(pixels("mirror", "9"), 0.0);
    assert!(pixels("half-lambert", "9") > 0.0 && pixels("mirror", "8") > 0.0);

    expect_other_tables(&files);
}

/// Every other table has rows of its columns.
fn expect_other_tables(files: &[File]) {
    for (name, columns) in [
        ("stages.csv", 6),
        ("calibration.csv", 4),
        ("backends.csv", 7),
        ("shapes.csv", 11),
    ] {
        let mut reader = csv::Reader::from_reader(text(files, name).as_bytes());
        let rows: Vec<_> = reader.records().map(|row| row.expect("a row")).collect();
        assert!(!rows.is_empty() && rows.iter().all(|row| row.len() == columns));
    }
    let staged = text(files, "stages.csv");
    for stage in [
        "bulb",
        "interreflection",
        "chart",
        "reflected chart",
        "encode",
        "trace",
    ] {
        assert!(staged.contains(&format!(",{stage},")), "{stage}");
    }
    assert!(text(files, "backends.csv").starts_with("contender,"));
}

#[test]
fn plots_are_well_formed_and_their_texts_lie_inside() {
    let files = files(plan(&["half-lambert"], &[8, 9], &BOTH));
    let plots: Vec<_> = files
        .iter()
        .filter(|file| file.name.ends_with(".svg"))
        .collect();
    assert_eq!(plots.len(), 10);
    for plot in plots {
        let document =
            Document::parse(&plot.text).unwrap_or_else(|error| panic!("{}: {error}", plot.name));
        let root = document.root_element();
        let size = ["width", "height"].map(|name| -> f64 {
            let value = root.attribute(name).expect("a size");
            value.parse().expect("a number")
        });
        let texts: Vec<_> = root
            .descendants()
            .filter(|node| node.has_tag_name("text"))
            .collect();
        assert!(texts.len() > 6, "{}: {} texts", plot.name, texts.len());
        for node in texts {
            for (name, size) in ["x", "y"].into_iter().zip(size) {
                let place: f64 = node
                    .attribute(name)
                    .expect("a place")
                    .parse()
                    .expect("a number");
                assert!((0.0..=size).contains(&place), "{}: {node:?}", plot.name);
            }
        }
        for node in root.descendants() {
            for attribute in node.attributes() {
                assert!(
                    !attribute.value().contains("NaN"),
                    "{}: {node:?}",
                    plot.name
                );
            }
        }
        assert!(text(&files, "report.html").contains(&plot.text));
    }
}

#[test]
fn the_page_stands_alone() {
    let files = files(plan(&["half-lambert"], &[8], &BOTH));
    let page = text(&files, "report.html");
    assert_eq!(files.last().expect("files").name, "report.html");
    for absent in ["<script", "<link", "<img", "url(", "@import", "href=\"http"] {
        assert!(!page.contains(absent), "{absent}");
    }
    for present in [
        "Time against error",
        "Convergence",
        "Hard cases",
        "Calibration",
        "Where the time goes",
        "Backends",
        "Machine",
        "embree:sse2",
        "half-lambert",
        "maxbrdf-3",
    ] {
        assert!(page.contains(present), "{present}");
    }
    for wrong in ["NaN", ">inf", "-0 "] {
        assert!(!page.contains(wrong), "{wrong}");
    }
}

/// Whatever is left out, the rest is told.
#[test]
fn one_integrator_or_only_darkness_makes_a_report_too() {
    for settings in [&BOTH[..2], &BOTH[2..], &BOTH[..1]] {
        let files = files(plan(&[], &[9], settings));
        assert!(!text(&files, "report.html").contains("NaN"));
    }
    let mut dark = plan(&["mirror"], &[9], &BOTH);
    dark.materials.retain(|one| one.name == "mirror");
    let files = files(dark);
    assert!(!text(&files, "report.html").contains("NaN"));
    assert_eq!(text(&files, "renderings.csv").lines().count(), 1 + 4);
}

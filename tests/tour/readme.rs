//! README.md.

use crate::{Tour, database, free_port, s3};

const NOT_TYPED: &[(&str, &str)] = &[
    (
        "deploy/first-dataset.sh ",
        "installs Embree, builds in release",
    ),
    ("tests/run.sh ", "runs this test"),
    (
        "deploy/first-network.sh ",
        "builds in release, trains for minutes",
    ),
    ("cargo build ", "builds in release"),
    ("brdfarm estimate ", "needs two photographs"),
    (
        "brdfarm dataset browse ",
        "serves until it is stopped: tests/pages/ asks it for its pages",
    ),
    (
        "brdfarm render --material-file ",
        "needs the material found in the photographs",
    ),
];

const SMALLER: &[(&str, &str)] = &[
    ("materials = 24", "materials = 6"),
    (
        "--spec examples/pairs.toml ",
        "--spec examples/pairs.toml --materials 6 ",
    ),
    (
        "brdfarm train ",
        "brdfarm train --epochs 1 --block-epochs 1 ",
    ),
    (
        "brdfarm dataset observability ",
        "brdfarm dataset observability --materials 0 --side 8 ",
    ),
    (
        "brdfarm report ",
        "brdfarm report --quick --materials ordinary --views 9 --size 16 ",
    ),
];

const SERVES: &[(&str, usize)] = &[
    (
        "brdfarm coordinator serve --spec rough.toml --store farm --listen ",
        1,
    ),
    (
        "brdfarm coordinator serve --spec rough.toml --store postgres:",
        1,
    ),
];

/// What stands for other machines, and for their bucket and database.
fn here(bucket: &s3::Server) -> Vec<(&'static str, String)> {
    let [open, closed, shared] = [(); 3].map(|()| free_port());
    let keys = bucket.environment().into_iter();
    let keys: Vec<String> = keys
        .map(|(name, value)| format!("{name}={value}"))
        .collect();
    vec![
        (
            "--exit-when-complete",
            format!("--exit-when-complete --listen 127.0.0.1:{open}"),
        ),
        ("http://127.0.0.1:7117", format!("http://127.0.0.1:{open}")),
        (
            "--store farm --listen 0.0.0.0:7117",
            format!("--store farm --listen 127.0.0.1:{closed}"),
        ),
        (
            "https://farm.example.org:7117",
            format!("https://localhost:{closed}"),
        ),
        (
            "/rough --listen 0.0.0.0:7117",
            format!("/rough --listen 127.0.0.1:{shared}"),
        ),
        (
            "https://one.example.org:7117 https://two.example.org:7117",
            format!("https://localhost:{shared}"),
        ),
        (
            "AWS_ACCESS_KEY_ID=... AWS_SECRET_ACCESS_KEY=... AWS_REGION=...",
            keys.join(" "),
        ),
        ("s3://bucket/", format!("s3://{}/", s3::BUCKET)),
        ("postgres://brdfarm@db.example.org/brdfarm", database()),
        ("postgres://brdfarm@db.example.org/copy", database()),
    ]
}

#[test]
fn the_readme_can_be_typed() {
    let objects = tempfile::tempdir().unwrap();
    let bucket = s3::Server::start(objects.path());
    let tour = Tour {
        document: "README.md",
        not_typed: NOT_TYPED,
        smaller: SMALLER,
        here: here(&bucket),
        serves: SERVES,
    };
    tour.take();
}

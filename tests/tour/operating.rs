//! docs/operating.md.

use crate::{Tour, database, free_port, s3};

const NOT_TYPED: &[(&str, &str)] = &[
    (
        "sudo -u postgres psql",
        "makes a user of the system's PostgreSQL server",
    ),
    (
        "sudo -u postgres createdb",
        "makes a database of the same server",
    ),
    (
        "s3s-fs ",
        "is installed by hand; the bucket is this process's",
    ),
    (
        "brdfarm coordinator serve --store 'postgres:",
        "needs a database that speaks TLS",
    ),
];

/// What stands for the machine's bucket and database, and for its ports.
fn here(bucket: &s3::Server) -> Vec<(&'static str, String)> {
    let [one, two] = [(); 2].map(|()| free_port());
    let keys = bucket.environment();
    let key = |wanted: &str| {
        let mut keys = keys.iter();
        keys.find(|(name, _)| *name == wanted).unwrap().1.clone()
    };
    vec![
        (
            "AWS_ACCESS_KEY_ID=brdfarm",
            format!("AWS_ACCESS_KEY_ID={}", key("AWS_ACCESS_KEY_ID")),
        ),
        (
            "AWS_SECRET_ACCESS_KEY=\"$(openssl rand -hex 24)\"",
            format!("AWS_SECRET_ACCESS_KEY={}", key("AWS_SECRET_ACCESS_KEY")),
        ),
        ("http://localhost:9000", key("AWS_ENDPOINT_URL")),
        ("s3://brdfarm/", format!("s3://{}/", s3::BUCKET)),
        ("postgres://brdfarm@localhost/brdfarm", database()),
        (
            "for port in 7117 7118;",
            format!("for port in {one} {two};"),
        ),
        ("https://localhost:7117", format!("https://localhost:{one}")),
        ("https://localhost:7118", format!("https://localhost:{two}")),
    ]
}

#[test]
fn the_operating_manual_can_be_typed() {
    let objects = tempfile::tempdir().unwrap();
    let bucket = s3::Server::start(objects.path());
    let tour = Tour {
        document: "docs/operating.md",
        not_typed: NOT_TYPED,
        smaller: &[("materials = 60", "materials = 2")],
        here: here(&bucket),
        serves: &[("for port in ", 2)],
    };
    tour.take();
}

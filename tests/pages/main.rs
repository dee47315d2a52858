//! Pages in a browser, served by the real program over real sockets.

mod browser;
#[allow(dead_code, reason = "other tests use the rest")]
#[path = "../folder/mod.rs"]
mod folder;
#[allow(
    dead_code,
    clippy::unwrap_used,
    reason = "other tests use the rest, and a panic here is a failed test"
)]
#[path = "../trust/images.rs"]
mod images;
#[allow(dead_code, reason = "other tests use the rest")]
#[path = "../trust/liars.rs"]
mod liars;
mod places;
#[allow(dead_code, reason = "other tests use the rest")]
#[path = "../process/mod.rs"]
mod process;
#[allow(dead_code, reason = "other tests use the rest")]
#[path = "../s3/mod.rs"]
mod s3;
mod security;
#[allow(
    dead_code,
    clippy::unwrap_used,
    reason = "other tests use the rest, and a panic there is a failed test"
)]
#[path = "../../jobstore-postgres/src/testing.rs"]
mod server;
mod steering;
mod trouble;
#[allow(clippy::unwrap_used, reason = "a panic here is a failed test")]
#[path = "../trust/worker.rs"]
mod worker;

use browser::Browser;
use process::Process;
use renderer::decode_exr;
use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};

const SPECIFICATION: &str = r#"
name = "looked-at"
materials = 7
[image]
width = 24
height = 16
"#;

fn brdfarm(folder: &Path, arguments: &str) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_brdfarm"));
    command.current_dir(folder);
    command.args(arguments.split_whitespace());
    command
}

/// Does something that has to succeed; returns what it says.
fn done(folder: &Path, arguments: &str) -> String {
    let output = brdfarm(folder, arguments).output().expect("it runs");
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "brdfarm {arguments}: {said}");
    String::from_utf8(output.stdout).expect("UTF-8")
}

/// A server of pages that prints their address in its first line.
fn browse(folder: &Path, more: &str) -> (Process, Browser) {
    let arguments = format!("dataset browse --listen 127.0.0.1:0 {more}");
    let mut command = brdfarm(folder, &arguments);
    let (process, url) = Process::serving(&mut command).expect("pages");
    (process, Browser::new(&url))
}

fn rendered() -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    fs::write(folder.path().join("spec.toml"), SPECIFICATION).expect("written");
    done(
        folder.path(),
        "run --spec spec.toml --backend native --web 127.0.0.1:0",
    );
    folder
}

#[test]
fn a_store_is_looked_at() {
    let folder = rendered();
    let folder = folder.path();
    let (_process, browser) = browse(folder, "");
    let first = browser.get("/");
    assert_eq!(
        (first.status, first.header("location")),
        (303, "/materials")
    );
    let all = browser.get("/materials").page();
    assert!(all.contains("7 complete materials."), "{all}");
    assert_eq!(all.matches("class=\"card\"").count(), 7);

    // The address holds the filter: it opens the same view again.
    let some = "/materials?roughness_max=60&sort=-ior&view=3";
    let page = browser.get(some).page();
    assert!(page.contains("name=\"roughness_max\" value=\"60\""));
    assert!(page.contains("<option value=\"-ior\" selected>"));
    assert_eq!(page, browser.get(some).page());
    let csv = done(
        folder,
        "dataset manifest export --store store --format csv --out labels.csv",
    );
    assert!(csv.is_empty() || csv.contains("labels.csv"));
    let labels = fs::read_to_string(folder.join("labels.csv")).expect("labels");
    let header: Vec<&str> = labels.lines().next().expect("a line").split(',').collect();
    let column = |name: &str| {
        header
            .iter()
            .position(|other| *other == name)
            .expect("a column")
    };
    let (view, roughness) = (column("view"), column("roughness"));
    let smooth = labels.lines().skip(1).filter(|line| {
        let cells: Vec<&str> = line.split(',').collect();
        cells[view] == "3" && cells[roughness].parse::<f64>().expect("a number") <= 60.0
    });
    assert_eq!(page.matches("class=\"card\"").count(), smooth.count());

    let material = browser.get("/materials/4?view=2").page();
    let digest = labels.lines().find(|line| {
        let cells: Vec<&str> = line.split(',').collect();
        (cells[column("material")], cells[view]) == ("4", "2")
    });
    let digest = digest
        .expect("a row")
        .split(',')
        .nth(column("digest"))
        .expect("a cell");
    assert!(material.contains(digest), "{material}");
    assert!(material.contains("--material 4 --view 2 --expect"));
    images_are_those_of_the_store(&browser, folder, digest);
    let coverage = browser.get("/coverage").page();
    assert_eq!(coverage.matches("<svg").count(), 14 + 3);
    // A page is small without its images.
    assert!(material.len() + browser.get("/style.css").body.len() < 60_000);
}

fn images_are_those_of_the_store(browser: &Browser, folder: &Path, digest: &str) {
    let at = "/materials/4/views/2";
    let exr = browser.get(&format!("{at}/image.exr"));
    assert_eq!(exr.status, 200);
    let attachment = "attachment; filename=\"material-4-view-2.exr\"";
    assert_eq!(exr.header("content-disposition"), attachment);
    let blob = format!("store/blobs/{}/{digest}.exr", &digest[..2]);
    assert!(exr.body == fs::read(folder.join(blob)).expect("an image"));
    let values = decode_exr(&exr.body).expect("an image");
    let pixels = browser.get(&format!("{at}/pixels")).body;
    let pixels: Vec<f64> = pixels
        .chunks_exact(4)
        .map(|bytes| f64::from(f32::from_le_bytes(bytes.try_into().expect("four bytes"))))
        .collect();
    assert_eq!(pixels, values.as_flattened());
    for (name, size) in [
        ("image.png?stops=1.5", [24, 16]),
        ("thumbnail.png", [24, 16]),
        ("errors.png", [24, 16]),
    ] {
        let picture = browser.get(&format!("{at}/{name}"));
        assert_eq!(picture.header("content-type"), "image/png", "{name}");
        let decoded = image::load_from_memory(&picture.body).expect("a picture");
        assert_eq!([decoded.width(), decoded.height()], size, "{name}");
        let tag = picture.header("etag").to_owned();
        let again = browser.get_with(&format!("{at}/{name}"), &[("If-None-Match", &tag)]);
        assert_eq!((again.status, again.body.len()), (304, 0), "{name}");
    }
    let bright = browser.get(&format!("{at}/image.png?stops=6")).body;
    assert_ne!(bright, browser.get(&format!("{at}/image.png")).body);
}

/// Whatever an address says, the answer is a page that says what is wrong.
#[test]
fn no_address_breaks_the_pages() {
    let folder = rendered();
    let (_process, browser) = browse(folder.path(), "");
    let long = format!("/materials?where={}", "(".repeat(5_000));
    for (path, status) in [
        ("/materials?page=1000000000", 200),
        ("/materials?page=99999999999999999999999", 400),
        ("/materials?roughness_min=%00", 400),
        (
            "/materials?where=((((((((((((((((((((((((((((((((((((((((((((1",
            400,
        ),
        (&long, 400),
        ("/materials?%3Cscript%3E=1", 400),
        ("/materials/7", 404),
        ("/materials/4294967296", 404),
        ("/materials/-1", 404),
        ("/materials/1?view=14", 404),
        ("/materials/1?view=x", 400),
        ("/materials/..%2f..%2fetc%2fpasswd", 404),
        ("/materials/1/views/../../../../etc/passwd", 404),
        ("/materials/1/views/14/image.exr", 404),
        ("/materials/1/views/%2e%2e/image.exr", 404),
        ("/materials/1/views/0/image.png?stops=1e9", 400),
        ("/materials/1/views/0/image.png?stops=NaN", 400),
        ("/farm", 404),
        ("/live", 404),
        ("/jobs", 404),
        ("/act?do=pause", 404),
        ("/nothing", 404),
        ("/login?to=//evil.example", 303),
    ] {
        let answer = browser.get(path);
        assert_eq!(answer.status, status, "{path}: {}", answer.text());
        assert!(!answer.text().contains("<script>="), "{path}");
        assert!(
            answer
                .header("content-security-policy")
                .starts_with("default-src 'none'")
        );
    }
    let led = browser.get("/login?to=//evil.example");
    assert_eq!(led.header("location"), "/");
    for method in ["PUT", "DELETE", "OPTIONS", "BREW"] {
        let origin = browser.origin();
        let answer = browser.ask(method, "/materials", &[("Origin", &origin)], "");
        assert_eq!(answer.status, 404, "{method}");
    }
    // Names that others own, as in DNS rebinding.
    let rebound = browser.get_with("/materials", &[("Host", "evil.example")]);
    assert_eq!(rebound.status, 403);
}

#[test]
fn an_image_that_is_gone_or_damaged_is_said_to_be() {
    let folder = rendered();
    let (_process, browser) = browse(folder.path(), "");
    let blobs = folder.path().join("store/blobs");
    let mut images = Vec::new();
    for entry in fs::read_dir(blobs).expect("a folder") {
        let entry = entry.expect("an entry").path();
        images.extend(
            fs::read_dir(entry)
                .expect("a folder")
                .map(|file| file.expect("a file").path()),
        );
    }
    images
        .iter()
        .for_each(|image| fs::remove_file(image).expect("removed"));
    let missing = browser.get("/materials/0/views/0/image.png");
    assert_eq!(missing.status, 410);
    assert!(
        missing
            .text()
            .contains("the image is missing from the store")
    );
    images
        .iter()
        .for_each(|image| fs::write(image, "noise").expect("written"));
    let damaged = browser.get("/materials/0/views/0/image.exr");
    assert_eq!(damaged.status, 500);
    assert!(
        damaged.text().contains("it has fewer than its"),
        "{}",
        damaged.text()
    );
    // The page with the labels is still there.
    assert!(browser.get("/materials/0").page().contains("Roughness"));
}

#[test]
fn pages_that_others_reach_want_protection() {
    let folder = rendered();
    for arguments in [
        "dataset browse --listen 0.0.0.0:0",
        "run --spec spec.toml --web 0.0.0.0:0",
        "coordinator serve --listen 127.0.0.1:0 --web 0.0.0.0:0",
    ] {
        let mut command = brdfarm(folder.path(), arguments);
        let output = command.stdin(Stdio::null()).output().expect("it runs");
        assert!(!output.status.success(), "{arguments}");
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(
            said.contains("nothing protects them"),
            "{arguments}: {said}"
        );
    }
}

//! Workers that lie, fail and hang: processes of their own, with the real renderer.

use crate::cheap_image;
use crate::harness::{Harness, Process, patience, wait_for};
use dataset::{IMAGE_HEADER_ATTRIBUTE, SampledMaterial, Specification};
use exr::prelude::*;
use imagestore::validation::decode;
use renderer::geometry::BackendChoice;
use serde_json::Value;
use std::env;
use std::fs;
use std::process::{Command, Stdio};
use std::thread;
use std::time::Duration;
use tokio::sync::watch;
use worker::{Render, RenderFailure, RenderedView, RendererBackend, Worker};

/// What kind of bad worker a process is to be: `KIND ADDRESS`.
const BAD_WORKER: &str = "BRDFARM_TEST_BAD_WORKER";

/// A worker's renderer that something is wrong with.
struct Bad {
    kind: String,
    specification: Specification,
    sound: RendererBackend,
}

impl Render for Bad {
    fn render(
        &self,
        material: &SampledMaterial,
        view: u32,
    ) -> std::result::Result<RenderedView, RenderFailure> {
        match self.kind.as_str() {
            "broken" => return Err(RenderFailure("no light".to_owned())),
            "hanging" => thread::sleep(Duration::from_secs(3600)),
            _ => {}
        }
        let mut image = self.sound.render(material, view)?;
        if self.kind == "liar" && (material.index * 14 + view).is_multiple_of(5) {
            image.exr = brightened(&image.exr, &self.specification);
        }
        Ok(image)
    }
}

/// The image with one pixel a little brighter; everything else about it is right.
fn brightened(bytes: &[u8], specification: &Specification) -> Vec<u8> {
    let film = &specification.image;
    let mut image = decode(bytes, specification).expect("an image");
    let width = film.width as usize;
    image.pixels[width + 1][0] += 1.0 / 16.0;
    let pixels = image.pixels;
    let channels = SpecificChannels::rgb(move |place: Vec2<usize>| {
        let [red, green, blue] = pixels[place.y() * width + place.x()];
        (
            f16::from_f32(red),
            f16::from_f32(green),
            f16::from_f32(blue),
        )
    });
    let header = serde_json::to_string(&image.header).expect("JSON");
    let white = specification.white_luminance() as f32;
    let attributes = cheap_image::attributes(IMAGE_HEADER_ATTRIBUTE, &header, white);
    let encoding = Encoding {
        compression: Compression::ZIP16,
        blocks: Blocks::ScanLines,
        line_order: LineOrder::Increasing,
    };
    cheap_image::file(Layer::new(
        (width, film.height as usize),
        attributes,
        encoding,
        channels,
    ))
}

/// The process of a bad worker, which is its kind and its name.
#[test]
#[ignore = "tests start it, as a process of its own"]
fn be_a_bad_worker() {
    let Ok(task) = env::var(BAD_WORKER) else {
        return;
    };
    let (kind, address) = task.split_once(' ').expect("KIND ADDRESS");
    let kind = kind.to_owned();
    let options = worker::Options {
        name: kind.clone(),
        threads: 1,
        ..worker::Options::default()
    };
    let prepare = move |specification: &Specification| {
        let sound = RendererBackend::new(specification, BackendChoice::Native);
        let sound = sound.map_err(|error| RenderFailure(error.to_string()))?;
        let specification = specification.clone();
        Ok(Bad {
            kind,
            specification,
            sound,
        })
    };
    let runtime = tokio::runtime::Runtime::new().expect("a runtime");
    let summary = runtime.block_on(async {
        let (_stop, stopping) = watch::channel(false);
        let worker = Worker::connect(&[format!("http://{address}")], options, prepare).await?;
        worker.run(stopping).await
    });
    // A view that hangs would keep the process.
    runtime.shutdown_background();
    summary.expect("work");
}

fn bad_worker(kind: &str, harness: &Harness) -> Process {
    let mut command = Command::new(env::current_exe().expect("this program"));
    command.args(["--ignored", "--exact", "bad_workers::be_a_bad_worker"]);
    command.env(BAD_WORKER, format!("{kind} {}", harness.address));
    Process::spawn(command.stdout(Stdio::null()).stderr(Stdio::null()))
}

/// Names of workers that are blocked.
fn blocked(harness: &Harness) -> Vec<String> {
    let arguments = format!(
        "workers list --json --coordinator http://{}",
        harness.address
    );
    let listed = harness.succeed(&arguments);
    let workers = listed
        .lines()
        .map(|line| serde_json::from_str(line).expect("JSON"));
    let blocked = workers.filter(|worker: &Value| worker["barred"] != "");
    blocked
        .map(|worker| worker["name"].as_str().expect("a name").to_owned())
        .collect()
}

/// One in five of its images has one pixel that is not as it should be. Rendering some materials
/// again finds that out, and what it alone vouches for is rendered again.
#[test]
fn a_worker_that_lies_is_blocked_and_its_work_rendered_again() {
    let mut harness = Harness::new(24, 16);
    harness.lease_seconds = 10;
    harness.check_percent = 30;
    harness.start();
    let liar = bad_worker("liar", &harness);
    wait_for("lies", || harness.completed().len() >= 6);
    let sound = ["a", "b"].map(|name| harness.worker(name, &harness.address));
    harness.wait_until_finished();
    assert_eq!(blocked(&harness), ["liar"]);
    assert_eq!(harness.status()["set_aside"], 0);
    for worker in sound {
        assert_eq!(worker.ended(patience()).code(), Some(0));
    }
    drop(liar);
    harness.kill_coordinator();
    let log = fs::read_to_string(harness.store().join("completions.log")).expect("a log");
    assert!(log.contains("\"retracted\""), "nothing was taken back");
    // What was found out by a third worker has two lines, of which the later counts.
    harness.expect_the_undisturbed_set();
}

/// It fails whatever it gets: it is blocked, and no material is given up over it.
#[test]
fn a_worker_that_fails_everything_is_blocked_and_costs_no_material() {
    let mut harness = Harness::new(10, 16);
    harness.start();
    let broken = bad_worker("broken", &harness);
    wait_for("a block", || blocked(&harness) == ["broken"]);
    // It held two at most, so one may have failed after the third.
    let failures = harness.status()["failures"].as_u64();
    assert!(matches!(failures, Some(3 | 4)), "{failures:?}");
    let sound = harness.worker("sound", &harness.address);
    harness.wait_until_finished();
    let status = harness.status();
    assert_eq!(status["set_aside"], 0);
    assert_eq!(status["failures"].as_u64(), failures, "it worked again");
    assert_eq!(sound.ended(patience()).code(), Some(0));
    drop(broken);
    harness.kill_coordinator();
    harness.expect_undisturbed();
}

/// It renews its leases and gets nowhere: its work goes to others, and it ends by itself.
#[test]
fn a_worker_that_hangs_is_given_up() {
    let mut harness = Harness::new(4, 16);
    harness.options = "--job-deadline-seconds 4".to_owned();
    harness.start();
    let hanging = bad_worker("hanging", &harness);
    wait_for("leases", || harness.status()["leased"] == 2);
    let sound = harness.worker("sound", &harness.address);
    harness.wait_until_finished();
    assert_eq!(harness.status()["set_aside"], 0);
    assert_ne!(
        hanging.ended(patience()).code(),
        Some(0),
        "it says that it hangs"
    );
    assert_eq!(sound.ended(patience()).code(), Some(0));
    harness.kill_coordinator();
    harness.expect_undisturbed();
}

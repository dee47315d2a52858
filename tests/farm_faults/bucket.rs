//! Images in a bucket: workers send them there themselves, over URLs, and nothing that happens to
//! server, coordinator, workers or bytes changes the set.

use crate::campaign::campaign;
use crate::harness::{Harness, patience, wait_for};
use crate::liar::{Claim, Liar, put, recorded};
use crate::s3::{Server, UPLOAD};
use std::fs;
use std::path::PathBuf;
use std::time::Duration;

/// A farm whose images go to a server of its own.
fn farm(materials: u32, samples: u32) -> (Harness, Server) {
    let mut harness = Harness::new(materials, samples);
    let server = Server::start(&harness.path().join("s3"));
    harness.environment = server.environment();
    harness.options = "--blobs s3://farm/a/set".to_owned();
    (harness, server)
}

#[test]
fn image_bytes_go_from_workers_to_the_bucket_and_nowhere_else() {
    let (mut harness, server) = farm(6, 16);
    harness.options += " --log trace";
    harness.start();
    let worker = harness.worker("w", &harness.address);
    assert_eq!(worker.ended(patience()).code(), Some(0));
    harness.wait_until_finished();
    harness.kill_coordinator();
    let counts = server.counts();
    let images = 6 * 14;
    let sizes = server.objects("a/set/blobs").into_iter().map(|path| {
        let file = fs::metadata(path).expect("a file");
        file.len()
    });
    let bytes: u64 = sizes.sum();
    assert_eq!(server.objects("a/set/blobs").len(), images as usize);
    let uploads = counts[UPLOAD];
    assert_eq!((uploads.requests, uploads.bytes_in), (images, bytes));
    assert_eq!(counts["COPY"].requests, images);
    // What the coordinator itself wrote and read is the note of whose place it is.
    for kind in ["PUT", "GET"] {
        let count = counts[kind];
        assert!(count.bytes_in + count.bytes_out < 200, "{kind}: {count:?}");
    }
    wait_for("uploads to be cleared", || {
        server.objects("a/set/staging").is_empty()
    });
    // Whoever has a URL may write: none is in a log, of either side, at any level.
    let worker_log = fs::read_to_string(harness.path().join("w.worker")).expect("a log");
    for log in [harness.log(), worker_log] {
        assert!(!log.contains("X-Amz-Signature"), "{log}");
    }
    harness.expect_undisturbed();
}

#[test]
fn whoever_stops_has_removed_its_uploads() {
    let (harness, server) = farm(2, 16);
    server.remove_after(4000);
    harness.succeed("run --spec spec.toml --store farm --backend native --blobs s3://farm/a/set");
    assert!(server.counts()["DELETE"].requests > 0);
    assert!(server.objects("a/set/staging").is_empty());
}

#[test]
fn random_kills_lose_and_change_nothing_in_a_bucket() {
    let (harness, _server) = farm(12, 64);
    campaign(harness, 12, 6, 900);
}

/// At least 100 kills in one run of 60 materials: `tests/campaign.sh`.
#[test]
#[ignore = "takes minutes: tests/campaign.sh runs it"]
fn campaign_of_a_hundred_kills_in_a_bucket() {
    let (harness, _server) = farm(60, 256);
    campaign(harness, 60, 100, 700);
}

#[test]
fn a_server_that_goes_away_and_bytes_that_are_hurt_on_their_way_change_nothing() {
    let (mut harness, server) = farm(8, 64);
    harness.start();
    server.flip_uploads(5);
    let worker = harness.worker("w", &harness.address);
    wait_for("a completion", || !harness.completed().is_empty());
    server.cut_uploads(5);
    server.down(true);
    std::thread::sleep(Duration::from_secs(3));
    server.down(false);
    harness.wait_until_finished();
    assert_eq!(harness.status()["set_aside"], 0);
    assert_eq!(worker.ended(patience()).code(), Some(0));
    harness.kill_coordinator();
    harness.expect_undisturbed();
}

/// The object of some image.
fn image(server: &Server, number: usize) -> PathBuf {
    server.objects("a/set/blobs")[number].clone()
}

/// Flips a bit of an image, cuts others short, makes one longer and removes one.
fn damage(server: &Server) {
    let mut flipped = fs::read(image(server, 3)).expect("an image");
    let half = flipped.len() / 2;
    flipped[half] ^= 4;
    fs::write(image(server, 3), &flipped).expect("written");
    fs::write(image(server, 10), &flipped[..half]).expect("written");
    fs::write(image(server, 20), []).expect("written");
    fs::write(image(server, 40), [&flipped[..], &flipped].concat()).expect("written");
    fs::remove_file(image(server, 50)).expect("removed");
}

#[test]
fn what_is_wrong_in_a_bucket_is_found_mended_and_cleared() {
    let (harness, server) = farm(6, 16);
    harness.succeed("run --spec spec.toml --store farm --backend native --blobs s3://farm/a/set");
    // The place is remembered, and is this store's alone.
    harness.succeed("run --spec spec.toml --store farm --backend native");
    let refused = |arguments: &str, why: &str| {
        let output = harness.run(arguments);
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{said}");
        assert!(said.contains(why), "{said}");
    };
    refused(
        "run --spec spec.toml --store farm --blobs s3://farm/b",
        "keeps its images in s3://farm/a/set, not in s3://farm/b",
    );
    refused(
        "run --spec spec.toml --store other --blobs s3://farm/a/set",
        "belongs to another store",
    );
    refused(
        "run --spec spec.toml --store other --blobs ftp://farm/a",
        "a bucket is named as",
    );

    damage(&server);
    let output = harness.run("dataset verify --store farm --report report.json");
    assert_eq!(output.status.code(), Some(1));
    let report = fs::read(harness.path().join("report.json")).expect("a report");
    let report: serde_json::Value = serde_json::from_slice(&report).expect("JSON");
    let mut kinds: Vec<&str> = report["faults"]
        .as_array()
        .expect("faults")
        .iter()
        .map(|fault| fault["kind"].as_str().expect("a kind"))
        .collect();
    kinds.sort_unstable();
    assert_eq!(kinds, ["digest", "missing", "size", "size", "size"]);
    let said = harness.succeed("dataset repair --store farm");
    assert!(said.contains("mended 5 faults"), "{said}");
    harness.succeed("dataset verify --store farm");

    // An image that nothing names, an upload that was never completed, something foreign.
    let name = format!("{:064x}", 7);
    let blobs = image(&server, 0)
        .parent()
        .and_then(|folder| folder.parent())
        .expect("a folder")
        .to_owned();
    fs::create_dir_all(blobs.join("00")).expect("a folder");
    fs::write(blobs.join("00").join(format!("{name}.exr")), b"x").expect("written");
    fs::write(blobs.join("notes.txt"), b"x").expect("written");
    let staging = blobs.with_file_name("staging").join("0123");
    fs::create_dir_all(&staging).expect("a folder");
    fs::write(staging.join(format!("{name}.exr")), b"xyz").expect("written");
    let said = harness.succeed("dataset gc --store farm");
    assert!(said.contains("--delete would remove 2 images"), "{said}");
    assert!(said.contains("notes.txt (no image; it stays)"), "{said}");
    harness.succeed("dataset gc --store farm --delete");
    assert!(server.objects("a/set/staging").is_empty());
    assert_eq!(server.objects("a/set/blobs").len(), 6 * 14 + 1);
    harness.succeed("dataset verify --store farm");
    harness.succeed("dataset stats --store farm --pixels");
    harness.succeed("dataset show --store farm --materials 0-1 --out sheet.png");
    harness.expect_undisturbed();
}

#[test]
fn exports_into_a_bucket_are_those_into_a_folder_and_come_back() {
    let (harness, server) = farm(6, 16);
    harness.succeed("run --spec spec.toml --store farm --backend native --blobs s3://farm/a/set");
    for layout in ["webdataset", "huggingface", "files"] {
        let export = |to: &str| {
            harness.succeed(&format!(
                "dataset export {to} --store farm --layout {layout} --npy --shard-megabytes 1"
            ))
        };
        export(layout);
        let url = format!("s3://farm/exports/{layout}");
        export(&url);
        let folder = harness.path().join(layout);
        let place = harness.path().join("s3/farm/exports").join(layout);
        let objects = server.objects(&format!("exports/{layout}"));
        assert!(objects.len() > 8);
        for object in &objects {
            let part = object.strip_prefix(&place).expect("below");
            let file = fs::read(folder.join(part)).expect("a file of the same name");
            assert!(
                fs::read(object).expect("an object") == file,
                "{}",
                part.display()
            );
        }
        // Where one was not finished the same command goes on, and makes nothing twice.
        let shard = objects
            .iter()
            .find(|object| object.starts_with(place.join("train")));
        fs::remove_file(shard.expect("a shard")).expect("removed");
        server.forget_counts();
        export(&url);
        assert_eq!(server.objects(&format!("exports/{layout}")), objects);
        let output = harness.run(&format!(
            "dataset export {url} --store farm --layout {layout}"
        ));
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{said}");
        assert!(said.contains("holds another export"), "{said}");

        harness.succeed(&format!("dataset import {url} --store {layout}-back"));
        harness.succeed(&format!(
            "dataset import {url} --store {layout}-bucket --blobs s3://farm/{layout}-back"
        ));
        for store in ["back", "bucket"] {
            let manifest = |store: &str| {
                harness.succeed(&format!(
                    "dataset manifest export --store {store} --format csv --out {store}.csv"
                ));
                fs::read(harness.path().join(format!("{store}.csv"))).expect("a manifest")
            };
            assert_eq!(manifest(&format!("{layout}-{store}")), manifest("farm"));
            harness.succeed(&format!("dataset verify --store {layout}-{store}"));
        }
    }
}

/// What the images of a material are called, and rubbish of their sizes.
fn rubbish(harness: &Harness, material: u32) -> Vec<Claim> {
    let images = recorded(harness, "undisturbed", material).into_iter();
    let images = images.map(|(digest, bytes)| Claim {
        digest,
        bytes: vec![7; bytes],
    });
    images.collect()
}

/// As many images, called what they are.
fn rubbish_by_its_name(number: u8) -> Vec<Claim> {
    let images = (0..14u8).map(|view| {
        let bytes = vec![number, view, 1, 2, 3];
        Claim {
            digest: dataset::Digest::of(&bytes).as_bytes().to_vec(),
            bytes,
        }
    });
    images.collect()
}

#[test]
fn a_liar_replaces_no_image_that_somebody_else_vouches_for() {
    let (mut harness, server) = farm(3, 16);
    harness.succeed("run --spec spec.toml --store undisturbed --backend native");
    harness.start();
    let mut liar = Liar::lease(&harness);
    let (mine, others) = (liar.material, (liar.material + 1) % 3);

    // An image that nobody has delivered yet, taken in advance: this is believed.
    let mut claims = rubbish_by_its_name(1);
    claims[5] = rubbish(&harness, others)[5].clone();
    let told = liar.deliver(&claims).expect("believed");
    assert!(told.missing.is_empty());
    // Who renders it gets its name back, since the coordinator reads what two people claim.
    let mut late = Liar::lease(&harness);
    assert_ne!(late.material, mine);
    let honest = harness.worker("honest", &harness.address);
    wait_for("the other one", || harness.completed().len() == 2);

    // An image that somebody has delivered: this is read, and refused.
    let done = harness
        .completed()
        .iter()
        .map(|material| *material as u32)
        .find(|done| *done != mine);
    let done = done.expect("one more");
    let mut claims = rubbish_by_its_name(2);
    claims[5] = rubbish(&harness, done)[5].clone();
    let refused = late.deliver(&claims).expect_err("refused");
    assert_eq!(refused.code(), tonic::Code::InvalidArgument, "{refused:?}");
    assert!(
        refused
            .message()
            .contains("view 5: the bytes have the digest"),
        "{refused:?}"
    );
    wait_for("the end", || harness.completed().len() == 3);
    assert_eq!(honest.ended(patience()).code(), Some(0));
    harness.kill_coordinator();
    drop(late);

    let output = harness.run("dataset verify --store farm --report report.json");
    assert_eq!(output.status.code(), Some(1));
    let report = fs::read(harness.path().join("report.json")).expect("a report");
    let report: serde_json::Value = serde_json::from_slice(&report).expect("JSON");
    let faults = report["faults"].as_array().expect("faults");
    assert!(
        faults.iter().all(|fault| fault["material"] == mine),
        "{report:#}"
    );
    assert_eq!(faults.len(), 14);
    assert!(!server.objects("a/set/blobs").is_empty());
}

#[test]
fn rubbish_under_true_names_is_mended_by_whoever_renders_it_again() {
    let (harness, server) = farm(2, 16);
    rubbish_is_mended(harness, &server);
}

/// Azure's signatures cover no MD5, and its entity tags tell none: a worker can send what it likes.
#[test]
fn rubbish_is_mended_where_the_server_tells_no_md5() {
    let (harness, server) = farm(2, 16);
    server.tell_no_md5();
    rubbish_is_mended(harness, &server);
}

fn rubbish_is_mended(mut harness: Harness, server: &Server) {
    harness.succeed("run --spec spec.toml --store undisturbed --backend native");
    harness.check_percent = 100;
    harness.start();
    let mut liar = Liar::lease(&harness);
    let claims = rubbish(&harness, liar.material);
    let urls = liar.urls(&claims).expect("URLs");
    // The signature covers what was declared.
    let mut other = claims[0].bytes.clone();
    other[0] ^= 1;
    assert_eq!(put(&urls[0], &other), 400);
    assert_eq!(put(&urls[0], &other[1..]), 400);
    let mut bare = urls[0].clone();
    bare.headers.clear();
    assert_eq!(put(&bare, &claims[0].bytes), 403);
    // Nothing counts that did not arrive.
    let told = liar.complete(&claims).expect("an answer");
    assert_eq!(told.missing.len(), 14);
    let told = liar.deliver(&claims).expect("believed");
    assert!(told.missing.is_empty());
    let workers = ["a", "b"].map(|name| harness.worker(name, &harness.address));
    harness.wait_until_finished();
    for worker in workers {
        assert_eq!(worker.ended(patience()).code(), Some(0));
    }
    harness.kill_coordinator();
    let said = harness.succeed("dataset verify --store farm");
    assert!(said.contains("verified 28 images"), "{said}");
    assert_eq!(server.objects("a/set/blobs").len(), 28);
}

#[test]
fn a_url_is_of_no_use_when_its_time_is_over() {
    let (mut harness, _server) = farm(2, 16);
    harness.succeed("run --spec spec.toml --store undisturbed --backend native");
    // A URL lives for fifteen leases.
    harness.lease_seconds = 1;
    harness.start();
    let mut liar = Liar::lease(&harness);
    let claims = rubbish_by_its_name(3);
    let urls = liar.urls(&claims).expect("URLs");
    assert_eq!(put(&urls[0], &claims[0].bytes), 200);
    std::thread::sleep(Duration::from_secs(17));
    assert_eq!(put(&urls[1], &claims[1].bytes), 403);
    // The lease is lost as well, and nobody gets another.
    let refused = liar.urls(&claims).expect_err("lost");
    assert_eq!(refused.code(), tonic::Code::FailedPrecondition);
    let worker = harness.worker("w", &harness.address);
    harness.wait_until_finished();
    assert_eq!(worker.ended(patience()).code(), Some(0));
    harness.kill_coordinator();
    harness.expect_undisturbed();
}

/// A store in a bucket and an export in a bucket have the mesh of their sample, and an import finds it.
#[test]
fn a_mesh_goes_into_a_bucket_and_comes_back() {
    let (harness, server) = farm(2, 16);
    let mesh = "v -1 -1 0\nv 0 -1 1\nv 1 -1 0\nv -1 1 0\nv 0 1 1\nv 1 1 0\nf 1 2 5 4\nf 2 3 6 5\n";
    let name = format!("{}.mesh", dataset::Digest::of(mesh.as_bytes()));
    fs::write(harness.path().join("tent.obj"), mesh).expect("written");
    let specification = "materials = 2\n[image]\nwidth = 16\nheight = 16\n[accuracy]\nabsolute = 0.02\n\
                         relative = 0.2\n[sample]\nshape = \"mesh\"\nmesh = \"tent.obj\"\n[[views]]\n";
    fs::write(harness.path().join("spec.toml"), specification).expect("written");
    harness.succeed("run --spec spec.toml --store farm --backend native --blobs s3://farm/a/set");
    let url = "s3://farm/exports/tent";
    harness.succeed(&format!(
        "dataset export {url} --store farm --layout webdataset"
    ));
    let object = harness.path().join("s3/farm/exports/tent").join(&name);
    assert!(server.objects("exports/tent").contains(&object));
    assert_eq!(fs::read(&object).expect("the mesh"), mesh.as_bytes());
    harness.succeed("dataset manifest export --store farm --format csv --out manifest.csv");

    let manifests = ["", "--manifest manifest.csv"];
    for damage in [None, Some("v 0 0 0")] {
        match damage {
            None => fs::remove_file(&object).expect("removed"),
            Some(bytes) => fs::write(&object, bytes).expect("written"),
        }
        for manifest in manifests {
            let output = harness.run(&format!("dataset import {url} --store back {manifest}"));
            let said = String::from_utf8_lossy(&output.stderr).into_owned();
            assert!(!output.status.success());
            let place = format!("{url}/{name}");
            assert!(said.contains(&place) && said.contains("put back"), "{said}");
            assert!(!harness.path().join("back").exists());
        }
    }
    // The same export again brings it back.
    harness.succeed(&format!(
        "dataset export {url} --store farm --layout webdataset"
    ));
    harness.succeed(&format!("dataset import {url} --store back"));
    harness.succeed("dataset verify --store back --rerender 100%");
    assert_eq!(
        fs::read(harness.path().join("back").join(name)).expect("the mesh"),
        mesh.as_bytes()
    );
}

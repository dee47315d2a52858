//! Inputs to begin with: what is sound today. They are made, not kept, because they carry the
//! specification's hash and the renderer's version.

use crate::cheap_image::{Cheap, cheap_image};
use crate::complete_store::{completion, make_store};
use crate::fixtures::{LEASED, LIVE_SPECIFICATION, SPECIFICATION, WORKER, film};
use dataset::{
    Digest, HARD_CASES, IMAGE_HEADER_ATTRIBUTE, RENDERER_VERSION, Specification,
    specification::Pixel,
};
use datastore::ReadOnlyStore;
use export::{
    card::Publication,
    layout::{Layout, Options, export as export_layout},
    manifest::{Format, export},
    product::Products,
    selection::Selection,
};
use jobqueue::{
    Block, BlockCause, Dispute, Failure, Fingerprint, Holder, JobRecord, JobState, Mode,
    RedundantRender, WorkerRecord,
    token::{Token, WorkerId},
};
use prost::Message;
use serde::Serialize;
use std::{fs, path::Path};

/// Inputs that are accepted, each with its target's name.
///
/// # Panics
/// When they cannot be made.
pub fn seeds() -> Vec<(&'static str, Vec<u8>)> {
    let mut seeds = vec![
        (
            "specification",
            Specification::preset().to_toml().into_bytes(),
        ),
        ("specification", SPECIFICATION.to_json().into_bytes()),
        ("image", cheap_image(&SPECIFICATION, 0, 0)),
        ("image", float_image()),
        (
            "image_header",
            Cheap::new(&SPECIFICATION, 0, 1).header.into_bytes(),
        ),
        ("completion_log", completion_log()),
        ("ledger", ledger()),
        ("calls", calls()),
        (
            "condition",
            b"not (roughness < 2e1 or split != 'train') and rgb0_lab_2 >= -.5".to_vec(),
        ),
        ("index_list", b"3,5-9, 12 - 4294967295".to_vec()),
        (
            "address",
            b"roughness_max=20&split=test&where=ior+%3E+2&sort=-seconds&page=3".to_vec(),
        ),
        ("address", b"do=block&worker=a%20b&reason=dust".to_vec()),
        ("address", b"state=quarantined&from=17".to_vec()),
        (
            "tokens",
            format!(
                "# a farm's\nworker {}\n\noperator {}\n",
                "a".repeat(32),
                "b".repeat(64)
            )
            .into_bytes(),
        ),
        ("tokens", json(&Token::from_bytes(*b"0123456789abcdef"))),
        ("tokens", Digest::of(b"").to_string().into_bytes()),
        (
            "credentials",
            b"http://127.0.0.1:7117\0a-token-of-a-worker-0123456789abc".to_vec(),
        ),
        ("material", json(&HARD_CASES[0].material)),
        ("material", question()),
    ];
    seeds.extend(crate::mesh::seeds().map(|file| ("mesh", file)));
    seeds.extend(manifests());
    seeds
}

fn json(value: &impl Serialize) -> Vec<u8> {
    serde_json::to_vec(value).unwrap()
}

fn float_image() -> Vec<u8> {
    let mut image = Cheap::new(&SPECIFICATION, 0, 0);
    image.film = film(Pixel::Float);
    assert_eq!(image.attribute, IMAGE_HEADER_ATTRIBUTE);
    image.encode()
}

fn question() -> Vec<u8> {
    let material = HARD_CASES[0].material;
    json(&serde_json::json!({
        "material": material, "wi": [0, 0.5, 0.5], "wo": [0.1, -0.5, 0.5], "tint": "hue",
    }))
}

/// A completion, a retraction of it, and a torn end.
fn completion_log() -> Vec<u8> {
    let (completion, _) = completion(&SPECIFICATION, 3);
    let completion = String::from_utf8(json(&completion)).unwrap();
    let other = completion.replacen("\"material\":3", "\"material\":4", 1);
    format!("={completion}\n={other}\n={{\"retracted\":4}}\nnoise\n={completion}").into_bytes()
}

/// A record of every kind.
fn ledger() -> Vec<u8> {
    let holder = |name: &str| Holder {
        token: Token::from_bytes([9; 16]),
        worker: WorkerId::from_bytes([1; 16]),
        name: name.to_owned(),
    };
    let failure = Failure {
        worker: "v".to_owned(),
        error: "no light".to_owned(),
    };
    let completed = |redundant| JobState::Completed {
        fingerprint: Fingerprint::of_images(Digest::of(&[1])),
        worker: "w".to_owned(),
        redundant,
    };
    let dispute = Dispute {
        fingerprint: Fingerprint::of_images(Digest::of(&[0])),
        worker: "v".to_owned(),
        holder: Some(holder("u")),
    };
    let states = [
        JobState::Leased(holder("w")),
        completed(RedundantRender::None),
        completed(RedundantRender::Due),
        completed(RedundantRender::Leased(holder("v"))),
        completed(RedundantRender::Disputed(dispute)),
        JobState::Quarantined,
        JobState::Cancelled,
    ];
    let mut lines = Vec::new();
    for (number, state) in (b'0'..).zip(states) {
        lines.push(number);
        lines.extend(json(&JobRecord {
            state,
            priority: -3,
            failures: vec![failure.clone()],
            leases_lost: 2,
        }));
        lines.push(b'\n');
    }
    let blocked = WorkerRecord {
        failures: 3,
        block: Some(Block {
            cause: BlockCause::Operator,
            reason: "dust".to_owned(),
        }),
        ..WorkerRecord::default()
    };
    for (letter, record) in [
        (b'w', json(&WorkerRecord::default())),
        (b'v', json(&blocked)),
        (b'm', json(&Mode::Running)),
        (b'c', json(&completion(&SPECIFICATION, 0).0)),
    ] {
        lines.push(letter);
        lines.extend(record);
        lines.push(b'\n');
    }
    lines
}

/// A material leased, delivered and looked at.
fn calls() -> Vec<u8> {
    let leave = proto::DeregisterRequest {
        worker_id: WORKER.0.to_vec(),
    };
    [
        lease_calls(),
        delivery_calls(),
        operator_calls(),
        call(b'D', &leave),
    ]
    .concat()
}

/// A call as the fuzz target reads it: its letter, its length, its message.
fn call(letter: u8, message: &impl Message) -> Vec<u8> {
    let message = message.encode_to_vec();
    let length = (message.len() as u16).to_be_bytes();
    [&[letter], &length[..], &message].concat()
}

/// A worker comes, and asks for work and for more time.
fn lease_calls() -> Vec<u8> {
    let worker_id = WORKER.0.to_vec();
    let register = proto::RegisterRequest {
        name: "w".to_owned(),
        renderer_version: RENDERER_VERSION.to_owned(),
        specification_hash: LIVE_SPECIFICATION.hash().as_bytes().to_vec(),
        worker_id: worker_id.clone(),
        resolves_disputes: false,
    };
    let lease = proto::LeaseRequest {
        worker_id: worker_id.clone(),
        jobs_max: 1,
        wait_ms: 1,
    };
    let renewal = proto::Renewal {
        token: LEASED.to_vec(),
        material: 0,
        views_done: 1,
    };
    let renew = proto::RenewRequest {
        worker_id,
        renewals: vec![renewal],
    };
    [
        call(b'R', &register),
        call(b'L', &lease),
        call(b'N', &renew),
    ]
    .concat()
}

/// It delivers images: the first comes along with the completion. Then it fails.
fn delivery_calls() -> Vec<u8> {
    let token = LEASED.to_vec();
    let (done, images) = completion(&LIVE_SPECIFICATION, 0);
    let digests = done
        .views
        .iter()
        .map(|view| view.digest.as_bytes().to_vec());
    let find = proto::FindMissingBlobsRequest {
        digests: digests.collect(),
        token: token.clone(),
        material: 0,
    };
    let mut calls = call(b'M', &find);
    let mut images = images.into_iter();
    let brought = images.next();
    for (view, image) in done.views[1..].iter().zip(images) {
        let put = proto::PutBlobRequest {
            digest: view.digest.as_bytes().to_vec(),
            size: view.bytes,
            data: image.into(),
            token: token.clone(),
            material: 0,
        };
        calls.extend(call(b'P', &put));
    }
    let views = done.views.iter().enumerate();
    let views = views.map(|(number, view)| proto::View {
        digest: view.digest.as_bytes().to_vec(),
        size: view.bytes,
        statistics: Some(proto::ErrorStatistics {
            mean: 1e-4,
            ..proto::ErrorStatistics::default()
        }),
        image: match (number, &brought) {
            (0, Some(image)) => image.clone().into(),
            _ => Default::default(),
        },
        ..proto::View::default()
    });
    let complete = proto::CompleteRequest {
        token: token.clone(),
        material: 0,
        views: views.collect(),
        seconds: 0.5,
    };
    calls.extend(call(b'C', &complete));
    let fail = proto::FailRequest {
        token,
        material: 0,
        error: "no light".to_owned(),
    };
    calls.extend(call(b'F', &fail));
    calls
}

/// What an operator and a reader ask for.
fn operator_calls() -> Vec<u8> {
    let selection = proto::JobSelection {
        ranges: vec![proto::MaterialRange { first: 1, last: 9 }],
        states: vec![proto::JobState::Pending.into()],
    };
    let list = proto::ListJobsRequest {
        selection: Some(selection.clone()),
        from: 0,
        jobs_max: 5,
    };
    let prioritize = proto::PrioritizeJobsRequest {
        selection: Some(selection.clone()),
        priority: 5,
    };
    let cancel = proto::CancelJobsRequest {
        selection: Some(selection),
    };
    let block = proto::BarWorkerRequest {
        name: "w".to_owned(),
        reason: "dust".to_owned(),
    };
    [
        call(b'l', &list),
        call(b'p', &prioritize),
        call(b'c', &cancel),
        call(b'b', &block),
        call(b's', &()),
        call(b'w', &()),
    ]
    .concat()
}

/// Manifests of a store in every format, and shards of its images.
fn manifests() -> Vec<(&'static str, Vec<u8>)> {
    let scratch = tempfile::tempdir().unwrap();
    let store = store(&scratch.path().join("store"));
    let mut seeds = Vec::new();
    for (name, format) in [
        ("manifest_jsonl", Format::Jsonl),
        ("manifest_csv", Format::Csv),
        ("manifest_parquet", Format::Parquet),
    ] {
        seeds.push((name, manifest(&store, format, scratch.path())));
    }
    for (name, layout, ending) in [
        ("shard_tar", Layout::WebDataset, "tar"),
        ("shard_parquet", Layout::HuggingFace, "parquet"),
    ] {
        let options = Options {
            layout,
            selection: Selection::default(),
            products: Products::default(),
            shard_bytes: 1 << 20,
            threads: 1,
            publication: Publication::default(),
            overwrite: false,
        };
        let out = scratch.path().join(name);
        export_layout(&store, &options, b"", &out, &|_| ()).unwrap();
        seeds.push((name, shard(&out, ending).unwrap()));
    }
    seeds
}

/// A store that is complete.
pub(crate) fn store(path: &Path) -> ReadOnlyStore {
    make_store(path, &SPECIFICATION, 0..SPECIFICATION.materials);
    ReadOnlyStore::open(path).unwrap()
}

/// A store's manifest; `scratch` is a folder to write it to.
pub(crate) fn manifest(store: &ReadOnlyStore, format: Format, scratch: &Path) -> Vec<u8> {
    let path = scratch.join("out");
    export(store, format, false, &path).unwrap();
    fs::read(path).unwrap()
}

/// The first file of such an ending in a folder of a folder.
fn shard(folder: &Path, ending: &str) -> Option<Vec<u8>> {
    let folders = fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().path());
    let files = folders.filter(|path| path.is_dir()).flat_map(|folder| {
        let entries = fs::read_dir(folder).unwrap();
        entries.map(|entry| entry.unwrap().path())
    });
    let mut shards = files.filter(|path| path.extension().is_some_and(|found| found == ending));
    shards.next().map(|path| fs::read(path).unwrap())
}

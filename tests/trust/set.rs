//! A set from its first lease to its last, and what is in it then.

use crate::{
    images::Images,
    liars::Liar,
    process::Process,
    worker::{End, Puppet},
};
use proto::client::Credentials;
use serde_json::Value;
use std::{
    collections::BTreeSet,
    fs,
    path::Path,
    process::Command,
    sync::{Arc, atomic::AtomicU64, atomic::Ordering},
    thread,
    time::Duration,
};
use tempfile::TempDir;
use tokio::{runtime, task::JoinSet};

/// How long a coordinator may take to end.
const PATIENCE: Duration = Duration::from_secs(60);

/// What a set came to.
pub struct Outcome {
    /// Materials of which an image is not the true one.
    pub wrong_images: Vec<u32>,
    /// Materials of which a number in the manifest is not the true one.
    pub wrong_statistics: Vec<u32>,
    pub honest_blocked: bool,
    /// What workers delivered beyond a rendering of each material.
    pub redundant_renders: u64,
}

impl Outcome {
    pub fn is_right(&self) -> bool {
        self.wrong_images.is_empty() && self.wrong_statistics.is_empty() && !self.honest_blocked
    }
}

/// A coordinator with credentials, and its set.
struct Farm {
    folder: TempDir,
    coordinator: Process,
    url: String,
}

fn brdfarm(folder: &Path, arguments: &str) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_brdfarm"));
    command.current_dir(folder);
    command.args(arguments.split_whitespace());
    command
}

fn said(folder: &Path, arguments: &str) -> (bool, String) {
    let output = brdfarm(folder, arguments).output().unwrap();
    let both = [&output.stdout[..], &output.stderr[..]].concat();
    (output.status.success(), String::from_utf8(both).unwrap())
}

impl Farm {
    fn start(images: &Images, workers: &[&str], more: &str) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let specification = images.specification.to_toml();
        fs::write(folder.path().join("spec.toml"), specification).unwrap();
        let named = workers.iter().map(|name| format!(" --worker {name}"));
        let named: String = named.collect();
        let (made, text) = said(folder.path(), &format!("credentials keys{named}"));
        assert!(made, "{text}");
        let serve = format!(
            "coordinator serve --spec spec.toml --store store --listen 127.0.0.1:0 \
             --credentials keys/coordinator {more}"
        );
        let mut command = brdfarm(folder.path(), &serve);
        let (coordinator, url) = Process::serving(&mut command).unwrap();
        Self {
            folder,
            coordinator,
            url,
        }
    }

    fn puppet(&self, images: &Arc<Images>, worker: &str, liar: Option<Liar>) -> Puppet {
        let keys = self.folder.path().join("keys/workers").join(worker);
        Puppet {
            images: Arc::clone(images),
            url: self.url.clone(),
            credentials: Credentials {
                token: Some(fs::read_to_string(keys.join("token")).unwrap()),
                authority: Some(fs::read(keys.join("authority.pem")).unwrap()),
                identity: None,
            },
            name: "machine".to_owned(),
            liar,
            delivered: Arc::new(AtomicU64::new(0)),
        }
    }

    fn control(&self, command: &str, side: &str) -> (bool, String) {
        let url = &self.url;
        let arguments = format!("{command} --coordinator {url} --credentials keys/{side}");
        said(self.folder.path(), &arguments)
    }

    /// Materials of which an image, and of which a number, is not the true one.
    fn wrong(&self, images: &Images) -> (Vec<u32>, Vec<u32>) {
        let export = "dataset manifest export --store store --format jsonl --out rows.jsonl";
        let (done, text) = said(self.folder.path(), export);
        assert!(done, "{text}");
        let rows = fs::read_to_string(self.folder.path().join("rows.jsonl")).unwrap();
        let (mut digests, mut statistics) = (BTreeSet::new(), BTreeSet::new());
        let mut count = 0;
        for row in rows.lines() {
            let row: Value = serde_json::from_str(row).unwrap();
            let material = row["material"].as_u64().unwrap() as u32;
            let truth = &images.truth(material)[row["view"].as_u64().unwrap() as usize];
            let (told, pixels) = (truth.statistics.unwrap(), truth.pixels.unwrap());
            let digest = dataset::Digest::from_bytes(truth.digest[..].try_into().unwrap());
            if row["digest"] != digest.to_string() {
                digests.insert(material);
            }
            if row["error_mean"] != told.mean
                || row["error_p95"] != told.p95
                || row["brightness_mean"] != pixels.brightness_mean
            {
                statistics.insert(material);
            }
            count += 1;
        }
        let specification = &images.specification;
        let all = specification.materials as usize * specification.views.len();
        assert_eq!(count, all, "the set is complete");
        let numbers = |set: BTreeSet<u32>| set.into_iter().collect();
        (numbers(digests), numbers(statistics))
    }
}

/// Lets workers work, each until it is finished or blocked.
fn work(puppets: Vec<Puppet>) -> Vec<End> {
    let runtime = runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .unwrap();
    runtime.block_on(async {
        let mut working = JoinSet::new();
        for (number, puppet) in puppets.into_iter().enumerate() {
            working.spawn(async move { (number, puppet.work().await) });
        }
        let mut ends = working.join_all().await;
        ends.sort_by_key(|(number, _)| *number);
        ends.into_iter().map(|(_, end)| end).collect()
    })
}

/// A set with two honest workers.
pub fn run(images: &Arc<Images>, liar: Option<Liar>) -> Outcome {
    run_with(images, liar, 2)
}

/// A set with this many honest workers, who all work to its end.
pub fn run_with(images: &Arc<Images>, liar: Option<Liar>, honest: usize) -> Outcome {
    finish(images, liar, honest).1
}

/// The lies that are left in the set of a liar that was not found out are all named and mended by
/// whoever renders the whole set again. Returns how many there were.
pub fn mended(images: &Arc<Images>, liar: Liar) -> usize {
    let (farm, outcome) = loop {
        let (farm, outcome) = finish(images, Some(liar), 2);
        if !outcome.wrong_images.is_empty() {
            break (farm, outcome);
        }
    };
    let at = farm.folder.path();
    let (sound, text) = said(at, "dataset verify --store store --rerender 100%");
    assert!(!sound, "{text}");
    let (mended, text) = said(at, "dataset repair --store store --rerender 100%");
    assert!(mended, "{text}");
    assert!(text.contains("eve/"), "whose they were: {text}");
    let (sound, text) = said(at, "dataset verify --store store --rerender 100%");
    assert!(sound, "{text}");
    assert_eq!(farm.wrong(images), (Vec::new(), Vec::new()));
    outcome.wrong_images.len()
}

fn finish(images: &Arc<Images>, liar: Option<Liar>, honest: usize) -> (Farm, Outcome) {
    let names: Vec<String> = (0..honest)
        .map(|number| format!("honest{number}"))
        .collect();
    let mut workers: Vec<&str> = names.iter().map(String::as_str).collect();
    workers.push("eve");
    let mut farm = Farm::start(images, &workers, "--exit-when-complete");
    let puppets = names.iter().map(|name| farm.puppet(images, name, None));
    let mut puppets: Vec<Puppet> = puppets.collect();
    if liar.is_some() {
        puppets.push(farm.puppet(images, "eve", liar));
    }
    if liar == Some(Liar::TwoNames) {
        puppets.push(Puppet {
            name: "another".to_owned(),
            ..farm.puppet(images, "eve", liar)
        });
    }
    let delivered = puppets.iter().map(|puppet| Arc::clone(&puppet.delivered));
    let delivered: Vec<Arc<AtomicU64>> = delivered.collect();
    let ends = work(puppets);
    let deadline = std::time::Instant::now() + PATIENCE;
    while !farm.coordinator.has_ended() {
        assert!(std::time::Instant::now() < deadline, "the set does not end");
        thread::sleep(Duration::from_millis(20));
    }
    let (wrong_images, wrong_statistics) = farm.wrong(images);
    let all = delivered.iter().map(|count| count.load(Ordering::Relaxed));
    let outcome = Outcome {
        wrong_images,
        wrong_statistics,
        honest_blocked: ends[..honest].contains(&End::Blocked),
        redundant_renders: all.sum::<u64>() - u64::from(images.specification.materials),
    };
    (farm, outcome)
}

/// One honest worker and one liar: nobody can decide but the operator, whose command does.
pub fn tie(images: &Arc<Images>) {
    let mut farm = Farm::start(images, &["honest", "eve"], "");
    let honest = || farm.puppet(images, "honest", None);
    let ends = work(vec![
        honest(),
        farm.puppet(images, "eve", Some(Liar::Always)),
    ]);
    assert_eq!(
        ends,
        [End::Finished, End::Finished],
        "nobody waits for ever"
    );
    let (fine, status) = farm.control("status", "reader");
    assert!(!fine, "{status}");
    let contradiction = "eve/machine-0 contradicts honest/machine-0";
    let other_way = "honest/machine-0 contradicts eve/machine-0";
    assert!(
        status.contains(contradiction) || status.contains(other_way),
        "{status}"
    );
    assert!(status.contains("brdfarm jobs resolve"), "{status}");
    let (refused, text) = farm.control("jobs resolve", "workers/eve");
    assert!(!refused && text.contains("operator's token"), "{text}");

    let (done, text) = farm.control("jobs resolve", "operator");
    assert!(done, "{text}");
    let (_, workers) = farm.control("workers list", "reader");
    assert!(
        workers.contains("blocked: the operator rendered"),
        "{workers}"
    );
    // What eve alone vouched for is to be rendered again.
    assert_eq!(work(vec![honest()]), [End::Finished]);
    let (fine, status) = farm.control("status", "reader");
    assert!(fine, "{status}");
    farm.coordinator.signal("TERM");
    while !farm.coordinator.has_ended() {
        thread::sleep(Duration::from_millis(20));
    }
    assert_eq!(farm.wrong(images), (Vec::new(), Vec::new()));
}

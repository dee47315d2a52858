//! What goes wrong in a farm is seen in the browser, with its reason, and mended there.

use crate::{
    brdfarm, browser::Browser, images::Images, liars::Liar, process::Process, steering::both,
    worker::Puppet,
};
use dataset::RENDERER_VERSION;
use proto::{
    FailRequest, LeaseRequest, RegisterRequest,
    client::{Credentials, farm, with_deadline},
};
use std::fs;
use std::path::Path;
use std::process::Command;
use std::sync::{Arc, atomic::AtomicU64};
use std::time::Duration;
use tokio::task::JoinSet;

const MATERIALS: u32 = 12;

const REASON: &str = "no rays came back: <b>lens cap</b>";

/// A farm with trouble: workers that failed a material, a liar that was found out, and honest ones.
struct Troubled {
    images: Arc<Images>,
    url: String,
    pages: String,
    _coordinator: Process,
}

impl Troubled {
    async fn start(folder: &Path) -> Self {
        let images = Images::render(MATERIALS);
        let specification = images.specification.to_toml();
        fs::write(folder.join("spec.toml"), specification).expect("written");
        let arguments = "coordinator serve --spec spec.toml --listen 127.0.0.1:0 --web 127.0.0.1:0 \
                         --check-percent 100";
        let (coordinator, url, pages) = both(&mut brdfarm(folder, arguments), folder);
        let farm = Self {
            images,
            url,
            pages,
            _coordinator: coordinator,
        };
        for name in ["one", "two", "three"] {
            farm.fail(name).await;
        }
        let mut puppets = JoinSet::new();
        for (name, liar) in [("liar", Some(Liar::Always)), ("ann", None), ("bob", None)] {
            puppets.spawn(farm.puppet(name, liar).work());
        }
        while let Some(ended) = puppets.join_next().await {
            ended.expect("a worker's end");
        }
        farm
    }

    fn puppet(&self, name: &str, liar: Option<Liar>) -> Puppet {
        Puppet {
            images: Arc::clone(&self.images),
            url: self.url.clone(),
            credentials: Credentials::default(),
            name: name.to_owned(),
            liar,
            delivered: Arc::new(AtomicU64::new(0)),
        }
    }

    /// Fails the first material that is handed out.
    async fn fail(&self, name: &str) {
        let mut client = farm(&self.url, &Credentials::default()).expect("a client");
        let register = RegisterRequest {
            name: name.to_owned(),
            renderer_version: RENDERER_VERSION.to_owned(),
            specification_hash: self.images.specification.hash().as_bytes().to_vec(),
            worker_id: Vec::new(),
            resolves_disputes: false,
        };
        let registered = client.register(with_deadline(register)).await;
        let worker_id = registered.expect("registered").into_inner().worker_id;
        let lease = LeaseRequest {
            worker_id,
            jobs_max: 1,
            wait_ms: 0,
        };
        let leased = client.lease(with_deadline(lease)).await;
        let job = leased.expect("leased").into_inner().jobs.remove(0);
        let failed = FailRequest {
            token: job.token,
            material: job.material,
            error: REASON.to_owned(),
        };
        client.fail(with_deadline(failed)).await.expect("failed");
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn trouble_is_seen_with_its_reason_and_mended() {
    let folder = tempfile::tempdir().expect("a folder");
    let farm = Troubled::start(folder.path()).await;
    let browser = Browser::new(&farm.pages);
    let page = browser.get("/farm").page();
    let reason = "no rays came back: &lt;b&gt;lens cap&lt;/b&gt;";
    assert!(
        page.contains("1 quarantined") && page.contains(reason),
        "{page}"
    );
    assert!(page.contains("/act?do=retry&amp;material=0"), "{page}");
    let blocked = browser.get("/workers").page();
    let liar = blocked.split("<tr>").find(|row| row.contains("liar-0"));
    assert!(liar.expect("the liar").contains("blocked: "), "{blocked}");
    let jobs = browser.get("/jobs?state=quarantined").page();
    assert_eq!(jobs.matches(reason).count(), 3, "{jobs}");

    let asked = browser.get("/act?do=retry&material=0").page();
    assert!(asked.contains("its failures are forgotten"));
    browser.post("/act", "do=retry&material=0").page();
    let mut mending = JoinSet::new();
    for name in ["cleo", "dan"] {
        mending.spawn(farm.puppet(name, None).work());
    }
    while let Some(ended) = mending.join_next().await {
        ended.expect("a worker's end");
    }
    let told = browser.listen("/live", |told| told.contains("12 of 12 materials"));
    assert!(!told.contains("quarantined"), "{told}");
}

/// The same in Chromium: `tests/browser.sh` has the driver.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
#[ignore = "needs Chromium: run by tests/browser.sh"]
async fn trouble_is_mended_in_chromium() {
    let folder = tempfile::tempdir().expect("a folder");
    let farm = Troubled::start(folder.path()).await;
    let driver = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/browser/trouble.py");
    let mut driver = Command::new("python3")
        .args([driver, &farm.pages])
        .spawn()
        .expect("Python");
    // An honest worker comes again and again, and finds work once a button was pressed.
    let working = tokio::spawn(async move {
        loop {
            farm.puppet("cleo", None).work().await;
            tokio::time::sleep(Duration::from_secs(1)).await;
        }
    });
    let ended = tokio::task::spawn_blocking(move || driver.wait()).await;
    working.abort();
    assert!(ended.expect("a thread").expect("its end").success());
}

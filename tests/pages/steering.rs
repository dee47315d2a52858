//! A farm that is watched and steered in a browser.

use crate::{SPECIFICATION, brdfarm, browser::Browser, process::Process};
use std::fs;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Command, Stdio};

/// A coordinator and the address of its pages.
pub fn serving(folder: &Path, arguments: &str) -> (Process, String) {
    let (process, _, pages) = both(&mut brdfarm(folder, arguments), folder);
    (process, pages)
}

/// A coordinator, its address and that of its pages.
pub fn both(command: &mut Command, folder: &Path) -> (Process, String, String) {
    let out = folder.join("said");
    let file = fs::File::create(&out).expect("a file");
    let process = Process::spawn(command.stdout(Stdio::from(file)));
    loop {
        let reader = BufReader::new(fs::File::open(&out).expect("a file"));
        let lines: Vec<String> = reader.lines().map(|line| line.expect("a line")).collect();
        let after = |begin: &str| {
            let found = lines.iter().find_map(|line| line.strip_prefix(begin));
            found.map(str::to_owned)
        };
        if let (Some(url), Some(pages)) = (after("listening on "), after("pages at ")) {
            return (process, url, pages);
        }
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
}

fn coordinator(folder: &Path, listen: &str, web: &str) -> (Process, String, String) {
    let arguments = format!("coordinator serve --spec spec.toml --listen {listen} --web {web}");
    both(&mut brdfarm(folder, &arguments), folder)
}

fn worker(folder: &Path, url: &str, name: &str) -> Process {
    let arguments = format!("worker connect {url} --threads 1 --backend native --name {name}");
    Process::spawn(brdfarm(folder, &arguments).stdout(Stdio::null()))
}

#[test]
fn a_farm_is_watched_and_steered() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    fs::write(folder.join("spec.toml"), SPECIFICATION).expect("written");
    let (process, url, pages) = coordinator(folder, "127.0.0.1:0", "127.0.0.1:0");
    let browser = Browser::new(&pages);
    assert_eq!(browser.get("/").header("location"), "/farm");
    let farm = browser.get("/farm").page();
    assert!(farm.contains("0 of 7 materials"), "{farm}");

    // Nothing is handed out, and one material is taken out.
    let asked = browser.get("/act?do=pause").page();
    assert!(asked.contains("No job is handed out until somebody resumes it"));
    browser.post("/act", "do=pause").page();
    let cancelled = browser.post("/act", "do=cancel&material=3").page();
    assert!(cancelled.contains("1 material changed."), "{cancelled}");
    let again = browser.post("/act", "do=cancel&material=3").page();
    assert!(again.contains("Nothing changed"), "{again}");
    let jobs = browser.get("/jobs?state=cancelled").page();
    assert!(jobs.contains("do=retry&amp;material=3"), "{jobs}");
    browser
        .post("/act", "do=prioritize&material=6&priority=9")
        .page();
    for (form, status) in [
        ("do=prioritize&material=6&priority=999999999", 400),
        ("do=unblock&worker=nobody", 404),
        ("do=cancel&material=7", 200),
        ("do=everything", 400),
    ] {
        let answer = browser.post("/act", form);
        assert_eq!(answer.status, status, "{form}: {}", answer.text());
    }

    // A worker comes; what it does is told as it happens, and its images appear.
    let _worker = worker(folder, &url, "hand");
    browser.listen("/live", |told| told.contains("hand"));
    browser.post("/act", "do=resume").page();
    let told = browser.listen("/live", |told| told.contains("6 of 7 materials"));
    assert!(told.contains("completed"), "{told}");
    let told = browser.listen("/live", |told| {
        told.matches("/views/").count() >= 6 && told.contains("event: last")
    });
    assert!(told.contains("thumbnail.png"));
    // The first worker has left, because nothing was left to do.
    browser.post("/act", "do=retry&material=3").page();
    let _worker = worker(folder, &url, "another");
    browser.listen("/live", |told| told.contains("7 of 7 materials"));
    let materials = browser.wait_for_page("/materials", "7 complete materials.");
    assert_eq!(materials.matches("class=\"card\"").count(), 7);

    // After a restart the same addresses answer.
    process.kill();
    let [listen, web] = [&url, &pages].map(|url| {
        url.trim_start_matches("http://")
            .trim_end_matches('/')
            .to_owned()
    });
    let (_process, ..) = coordinator(folder, &listen, &web);
    browser.listen("/live", |told| told.contains("finished"));
}

//! Who is let in, and what they may do.

use crate::{brdfarm, browse, browser::Browser, done, process::Process, rendered};
use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
use std::fs;
use std::io::Write;
use std::net::TcpStream;
use std::path::Path;
use std::time::{Duration, Instant};

/// A coordinator with credentials that serves pages.
fn farm(folder: &Path) -> (Process, Browser) {
    done(folder, "credentials keys --host localhost");
    let (process, url) = crate::steering::serving(
        folder,
        "coordinator serve --spec spec.toml --listen 127.0.0.1:0 --web 127.0.0.1:0 --credentials \
         keys/coordinator",
    );
    // The certificate names a host, and no address.
    let url = url.replace("127.0.0.1", "localhost");
    (
        process,
        Browser::new(&url).trusting(&folder.join("keys/reader")),
    )
}

pub fn token(folder: &Path, role: &str) -> String {
    let tokens = fs::read_to_string(folder.join("keys/coordinator/tokens")).expect("tokens");
    let line = tokens
        .lines()
        .find(|line| line.starts_with(role))
        .expect("a role");
    line.split_whitespace().nth(1).expect("a token").to_owned()
}

pub fn sign_in(browser: &mut Browser, token: &str) {
    browser.cookie = None;
    let answer = browser.post("/login", &format!("token={token}&to=/workers"));
    assert_eq!(
        (answer.status, answer.header("location")),
        (303, "/workers")
    );
    let cookie = answer.header("set-cookie").to_owned();
    for part in ["HttpOnly", "SameSite=Strict", "Secure", "Path=/"] {
        assert!(cookie.contains(part), "{cookie}");
    }
    browser.cookie = cookie.split(';').next().map(str::to_owned);
}

#[test]
fn a_token_decides_who_sees_and_who_acts() {
    let folder = rendered();
    let folder = folder.path();
    let (_process, mut browser) = farm(folder);

    // Nobody known.
    let led = browser.get("/jobs?state=pending");
    assert_eq!(
        led.header("location"),
        "/login?to=%2Fjobs%3Fstate%3Dpending"
    );
    for path in [
        "/live",
        "/materials/0/views/0/image.exr",
        "/materials/0/views/0/pixels",
    ] {
        let refused = browser.get_with(path, &[("Accept", "*/*")]);
        assert_eq!(refused.status, 401, "{path}");
    }
    assert_eq!(browser.post("/act", "do=pause").status, 401);
    for wrong in ["", "x", &"x".repeat(40), &token(folder, "worker"), "%00"] {
        let refused = browser.post("/login", &format!("token={wrong}&to=/"));
        assert_eq!(
            (refused.status, refused.header("set-cookie")),
            (403, ""),
            "{wrong}"
        );
    }

    // A reader.
    sign_in(&mut browser, &token(folder, "reader"));
    let page = browser.get("/farm").page();
    assert!(!page.contains("/act?"), "{page}");
    assert_eq!(browser.get("/act?do=pause").status, 403);
    assert_eq!(browser.post("/act", "do=pause").status, 403);
    assert!(
        !browser
            .listen("/live", |told| told.contains("event: progress"))
            .contains("/act?")
    );

    // An operator.
    sign_in(&mut browser, &token(folder, "operator"));
    let page = browser.get("/farm").page();
    assert!(page.contains("finished"), "{page}");
    let cookie = browser.cookie.clone().expect("a cookie");
    for origin in ["https://evil.example", "null", "http://localhost:1"] {
        let headers = [("Origin", origin), ("Cookie", &*cookie)];
        let refused = browser.ask("POST", "/act", &headers, "do=pause");
        assert_eq!(refused.status, 403, "{origin}");
    }
    assert_eq!(browser.ask("POST", "/act", &[], "do=pause").status, 403);
    let done = browser.post("/act", "do=pause").page();
    assert!(done.contains("Pause the farm"), "{done}");
    assert!(browser.get("/farm").page().contains("paused"));

    // The same cookie after its session.
    assert_eq!(browser.post("/logout", "").header("location"), "/login");
    assert_eq!(browser.get_with("/farm", &[]).status, 401);
    assert_eq!(browser.post("/act", "do=resume").status, 401);
}

/// Texts that others choose stay texts: the name and the reason of a worker, in pages and in what is
/// told as it happens.
#[test]
fn a_hostile_name_stays_text() {
    let folder = rendered();
    let folder = folder.path();
    let (_process, url) = crate::steering::serving(
        folder,
        "coordinator serve --spec spec.toml --listen 127.0.0.1:0 --web 127.0.0.1:0",
    );
    let browser = Browser::new(&url);
    let script = "%3Cscript%3Ealert(1)%3C%2Fscript%3E%22%27";
    let lines = "%0D%0A%0D%0Aevent:+progress%0D%0Adata:+lie";
    let form = format!("do=block&worker={script}&reason={script}{lines}");
    let page = browser.get(&format!("/act?{form}")).page();
    assert!(page.contains("Block worker &lt;script&gt;"), "{page}");
    let blocked = browser.post("/act", &form).page();
    let told = browser.listen("/live", |told| told.contains("data: lie"));
    assert!(
        !told.lines().any(|line| line.starts_with("data: lie")),
        "{told}"
    );
    let pages = ["/workers", "/farm"].map(|path| browser.get(path).page());
    for text in [page, blocked, told].iter().chain(&pages) {
        assert!(!text.contains("<script>alert"));
    }
}

#[test]
fn silent_connections_keep_nobody_out() {
    let folder = rendered();
    let (_process, browser) = browse(folder.path(), "");
    let mut silent = Vec::new();
    // As many as the system lets this test have.
    let wanted = raise_open_files().saturating_sub(200).min(5_000);
    assert!(
        wanted >= 1_000,
        "the system lets this test open {wanted} files only"
    );
    for index in 0..wanted {
        // The system may have no room for more at some instant.
        let Ok(mut stream) = TcpStream::connect(browser.authority()) else {
            continue;
        };
        if index % 2 == 0 {
            // Half of them begin a request that never ends.
            let _ = stream.write_all(b"GET / HTTP/1.1\r\nHost:");
        }
        silent.push(stream);
    }
    assert!(
        silent.len() as u64 > wanted * 49 / 50,
        "{} of {wanted}",
        silent.len()
    );
    let began = Instant::now();
    browser.get("/materials").page();
    assert!(
        began.elapsed() < Duration::from_secs(10),
        "{:?}",
        began.elapsed()
    );
}

/// Each connection has a file at either end; the server raises its own limit.
fn raise_open_files() -> u64 {
    let limit = getrlimit(Resource::Nofile);
    let raised = Rlimit {
        current: limit.maximum,
        ..limit
    };
    setrlimit(Resource::Nofile, raised).expect("a higher limit");
    // None is no limit.
    limit.maximum.unwrap_or(u64::MAX)
}

#[test]
fn tokens_of_browse_are_those_of_credentials() {
    let folder = rendered();
    let folder = folder.path();
    done(folder, "credentials keys --host localhost");
    let mut command = brdfarm(
        folder,
        "dataset browse --listen 127.0.0.1:0 --credentials keys/coordinator",
    );
    let (_process, url) = Process::serving(&mut command).expect("pages");
    assert!(url.starts_with("https://"));
    let browser = Browser::new(&url.replace("127.0.0.1", "localhost"));
    let mut browser = browser.trusting(&folder.join("keys/reader"));
    assert_eq!(browser.get("/materials").status, 303);
    sign_in(&mut browser, &token(folder, "reader"));
    let page = browser.get("/materials").page();
    assert!(page.contains("Sign out"));
}

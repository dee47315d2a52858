//! Pages over a database and over a bucket.

use crate::{
    SPECIFICATION, brdfarm, browse, browser::Browser, done, process::Process, s3, security, server,
    steering::both,
};
use std::fs;
use std::net::{Shutdown, SocketAddr, TcpListener, TcpStream};
use std::path::Path;
use std::process::{Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};
use tokio::runtime::Runtime;

/// A coordinator, its address, and its pages.
fn replica(folder: &Path, database: &str) -> (Process, String, Browser) {
    let arguments = format!(
        "coordinator serve --spec spec.toml --store {database} --blobs images --listen 127.0.0.1:0 \
         --web 127.0.0.1:0 --credentials keys/coordinator"
    );
    let (process, url, pages) = both(&mut brdfarm(folder, &arguments), folder);
    let [url, pages] = [url, pages].map(|url| url.replace("127.0.0.1", "localhost"));
    let browser = Browser::new(&pages).trusting(&folder.join("keys/reader"));
    (process, url, browser)
}

/// Whoever signed in at one replica goes on at another, and sees there what was rendered for the first.
#[test]
fn a_replica_takes_over_from_one_that_is_lost() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    fs::write(folder.join("spec.toml"), SPECIFICATION).expect("written");
    done(folder, "credentials keys");
    let runtime = Runtime::new().expect("a runtime");
    let database = runtime.block_on(server::fresh_schema());
    let (first, url, mut one) = replica(folder, &database);
    let (_second, _, mut two) = replica(folder, &database);
    security::sign_in(&mut one, &security::token(folder, "operator"));
    assert!(one.get("/farm").page().contains("0 of 7 materials"));

    let arguments = format!(
        "worker connect {url} --threads 1 --backend native --name hand --credentials keys/worker"
    );
    let worker = Process::spawn(brdfarm(folder, &arguments).stdout(Stdio::null()));
    one.listen("/live", |told| told.contains("7 of 7 materials"));
    worker.kill();
    first.kill();

    two.cookie = one.cookie.clone();
    two.listen("/live", |told| told.contains("7 of 7 materials"));
    let materials = two.wait_for_page("/materials", "7 complete materials.");
    assert_eq!(materials.matches("class=\"card\"").count(), 7);
    let image = two.get("/materials/6/views/3/thumbnail.png");
    assert_eq!(image.header("content-type"), "image/png");
    two.post("/logout", "");
    assert_eq!(two.get_with("/farm", &[]).status, 401);

    let (_process, browser) = browse(folder, &format!("--store {database}"));
    let page = browser.get("/materials?sort=-roughness").page();
    assert!(page.contains("7 complete materials."), "{page}");
    assert_eq!(browser.get("/materials/2/views/0/image.exr").status, 200);
}

#[test]
fn images_in_a_bucket_are_looked_at() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    fs::write(folder.join("spec.toml"), SPECIFICATION).expect("written");
    let bucket = s3::Server::start(&folder.join("objects"));
    let run = format!(
        "run --spec spec.toml --backend native --blobs s3://{}/images",
        s3::BUCKET
    );
    let with_keys = |arguments: &str| {
        let mut command = brdfarm(folder, arguments);
        command.envs(bucket.environment());
        command
    };
    let rendered = with_keys(&run).output().expect("it runs");
    let said = String::from_utf8_lossy(&rendered.stderr);
    assert!(rendered.status.success(), "{said}");
    let mut command = with_keys("dataset browse --listen 127.0.0.1:0");
    let (_process, url) = Process::serving(&mut command).expect("pages");
    let browser = Browser::new(&url);
    assert!(
        browser
            .get("/materials")
            .page()
            .contains("7 complete materials.")
    );
    for path in ["image.exr", "thumbnail.png", "pixels", "errors.png"] {
        let answer = browser.get(&format!("/materials/5/views/1/{path}"));
        assert_eq!(
            answer.status,
            200,
            "{path}: {}",
            String::from_utf8_lossy(&answer.body)
        );
    }
    // What the bucket does not give is said, and the labels are still there.
    bucket.down(true);
    let away = browser.get("/materials/5/views/2/image.exr");
    assert_eq!(away.status, 500, "{}", String::from_utf8_lossy(&away.body));
    assert!(browser.get("/materials/5").page().contains("Roughness"));
}

/// How long a balancer leads connections to a replica that is lost, until its checks find that out.
const FOUND_OUT: Duration = Duration::from_secs(6);

/// Leads connections to the first of two replicas, and once that is lost, to the second. Returns its own
/// address.
fn balance(first: String, second: String) -> SocketAddr {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = listener.local_addr().expect("an address");
    thread::spawn(move || {
        let mut lost_at = None;
        for client in listener.incoming().flatten() {
            if let Ok(server) = TcpStream::connect(&first) {
                forward(&client, &server);
            } else if lost_at.get_or_insert_with(Instant::now).elapsed() > FOUND_OUT {
                forward(&client, &TcpStream::connect(&second).expect("the second"));
            }
        }
    });
    address
}

/// Copies what either side says, until one ends.
fn forward(client: &TcpStream, server: &TcpStream) {
    for (from, to) in [(client, server), (server, client)] {
        let socket = |of: &TcpStream| of.try_clone().expect("a socket");
        let (mut from, mut to) = (socket(from), socket(to));
        thread::spawn(move || {
            // Whoever is killed resets its connections.
            let _ = std::io::copy(&mut from, &mut to);
            let _ = to.shutdown(Shutdown::Both);
        });
    }
}

/// A page in Chromium goes on through another replica: `tests/browser.sh` has the driver.
#[test]
#[ignore = "needs Chromium: run by tests/browser.sh"]
fn a_replica_is_lost_in_chromium() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let specification = SPECIFICATION.replace("materials = 7", "materials = 400");
    fs::write(folder.join("spec.toml"), specification).expect("written");
    done(folder, "credentials keys");
    let runtime = Runtime::new().expect("a runtime");
    let database = runtime.block_on(server::fresh_schema());
    let (first, _, one) = replica(folder, &database);
    let (_second, url, two) = replica(folder, &database);
    let [one, two] = [one, two].map(|browser| browser.authority().to_owned());
    let balancer = balance(one, two);
    let arguments = format!(
        "worker connect {url} --threads 1 --backend native --name hand --credentials keys/worker"
    );
    let _worker = Process::spawn(brdfarm(folder, &arguments).stdout(Stdio::null()));
    let driver = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/browser/replica.py");
    let ended = Command::new("python3")
        .args([driver, &format!("https://localhost:{}/", balancer.port())])
        .args([
            &security::token(folder, "operator"),
            &first.id().to_string(),
        ])
        .status();
    assert!(ended.expect("Python").success());
}

//! Two coordinators of one dataset in PostgreSQL, each with pages.

use crate::{
    SPECIFICATION, brdfarm, browser::Browser, done, process::Process, security, server,
    steering::both,
};
use std::fs;
use std::path::Path;
use std::process::Stdio;
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
}

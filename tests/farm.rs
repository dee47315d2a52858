//! Whole datasets, made by real processes over real sockets.

#[allow(dead_code, reason = "other tests use the rest")]
mod process;

use process::Process;
use serde_json::Value;
use std::fs;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

/// How long a farm of this size may take at the very most.
const PATIENCE: Duration = Duration::from_secs(180);

/// Small images, so that 14 of them take a fraction of a second.
const SPECIFICATION: &str = r#"
name = "small"
materials = 20
[image]
width = 32
height = 32
[integrator]
kind = "path"
samples_per_pixel = 16
"#;

fn brdfarm(directory: &Path) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_brdfarm"));
    command.current_dir(directory);
    command
}

fn run(directory: &Path, arguments: &str) -> Output {
    brdfarm(directory)
        .args(arguments.split_whitespace())
        .output()
        .expect("brdfarm runs")
}

fn succeed(directory: &Path, arguments: &str) -> String {
    let output = run(directory, arguments);
    assert!(
        output.status.success(),
        "brdfarm {arguments}: {}",
        String::from_utf8_lossy(&output.stderr)
    );
    String::from_utf8(output.stdout).expect("UTF-8")
}

fn workplace() -> tempfile::TempDir {
    let directory = tempfile::tempdir().expect("a directory");
    fs::write(directory.path().join("spec.toml"), SPECIFICATION).expect("written");
    directory
}

/// The manifest of a store: a function of its images.
fn manifest(directory: &Path, store: &str) -> String {
    let out = format!("{store}.jsonl");
    succeed(
        directory,
        &format!("dataset manifest export --store {store} --format jsonl --out {out}"),
    );
    fs::read_to_string(directory.join(out)).expect("a manifest")
}

/// A coordinator that ends when its set is complete, and its URL.
fn coordinator(directory: &Path, store: &str) -> (Process, String) {
    let mut command = brdfarm(directory);
    command
        .args([
            "coordinator",
            "serve",
            "--spec",
            "spec.toml",
            "--store",
            store,
        ])
        .args([
            "--listen",
            "127.0.0.1:0",
            "--lease-seconds",
            "2",
            "--exit-when-complete",
        ]);
    Process::serving(&mut command).expect("a coordinator")
}

fn worker(directory: &Path, url: &str) -> Process {
    let mut command = brdfarm(directory);
    command.args(["worker", "connect", url, "--threads", "1"]);
    Process::spawn(command.stdout(Stdio::null()))
}

fn completions(store: &Path) -> usize {
    fs::read_to_string(store.join("completions.log")).map_or(0, |log| log.lines().count())
}

fn wait_for_completions(store: &Path, count: usize) {
    let deadline = Instant::now() + PATIENCE;
    while completions(store) < count {
        assert!(Instant::now() < deadline, "no {count} completions");
        std::thread::sleep(Duration::from_millis(5));
    }
}

fn rows(manifest: &str) -> Vec<Value> {
    manifest
        .lines()
        .map(|line| serde_json::from_str(line).expect("JSON"))
        .collect()
}

#[test]
fn a_killed_worker_loses_nothing_and_changes_nothing() {
    let directory = workplace();
    let directory = directory.path();
    succeed(
        directory,
        "run --spec spec.toml --store undisturbed --workers 2",
    );

    let (coordinator, url) = coordinator(directory, "farm");
    let doomed = worker(directory, &url);
    let survivor = worker(directory, &url);
    wait_for_completions(&directory.join("farm"), 4);
    doomed.kill();
    assert!(
        completions(&directory.join("farm")) < 20,
        "killed too late to tell anything"
    );
    assert!(coordinator.ended(PATIENCE).success());
    assert!(survivor.ended(PATIENCE).success());

    succeed(directory, "dataset verify --store farm");
    let farm = manifest(directory, "farm");
    assert_eq!(farm, manifest(directory, "undisturbed"));
    let images: Vec<_> = rows(&farm)
        .iter()
        .map(|row| (row["material"].as_u64(), row["view"].as_u64()))
        .collect();
    let expected: Vec<_> = (0..20)
        .flat_map(|material| (0..14).map(move |view| (Some(material), Some(view))))
        .collect();
    assert_eq!(images, expected, "every image once, in order");
}

#[test]
fn a_killed_coordinator_resumes_with_what_it_acknowledged() {
    let directory = workplace();
    let directory = directory.path();
    let (first, url) = coordinator(directory, "farm");
    let left_behind = worker(directory, &url);
    wait_for_completions(&directory.join("farm"), 3);
    first.kill();
    left_behind.kill();
    let kept = completions(&directory.join("farm"));
    let partial =
        "dataset manifest export --store farm --format jsonl --partial --out partial.jsonl";
    succeed(directory, partial);
    let before = fs::read_to_string(directory.join("partial.jsonl")).expect("a manifest");
    assert!(
        before.lines().count() >= 14 * (kept - 1),
        "acknowledged work is gone"
    );

    // Fewer than the store was made for: those are what is checked.
    let fewer = succeed(directory, "run --spec spec.toml --store farm --materials 8");
    assert!(fewer.contains("verified 112 images of 8"), "{fewer}");
    let summary = succeed(directory, "run --spec spec.toml --store farm");
    assert!(summary.contains("store "), "{summary}");
    let after = manifest(directory, "farm");
    for row in before.lines() {
        assert!(after.contains(row), "an image changed: {row}");
    }
    assert_eq!(after.lines().count(), 20 * 14);
}

#[test]
fn a_run_resumes_grows_and_says_when_there_is_nothing_to_do() {
    let directory = workplace();
    let directory = directory.path();
    let first = succeed(directory, "run --spec spec.toml --materials 2");
    assert!(
        first.contains("rendered 28 images") && first.contains("verified 28"),
        "{first}"
    );
    for name in [
        "manifest.parquet",
        "contact-sheet.png",
        "specification.json",
    ] {
        assert!(directory.join("store").join(name).exists(), "no {name}");
    }
    let small = manifest(directory, "store");

    let again = succeed(directory, "run --spec spec.toml --materials 2");
    assert!(again.contains("nothing to do"), "{again}");

    let grown = succeed(directory, "run --spec spec.toml --materials 3");
    assert!(grown.contains("rendered 14 images"), "{grown}");
    assert!(
        manifest(directory, "store").starts_with(&small),
        "what was there changed"
    );

    fs::write(
        directory.join("other.toml"),
        SPECIFICATION.replace("32", "33"),
    )
    .expect("written");
    let other = run(directory, "run --spec other.toml");
    assert!(!other.status.success(), "another specification was let in");
}

/// Asked to stop or killed: the same command goes on, and never waits for a lease of the
/// process that is gone to run out (a minute).
#[test]
fn a_run_that_is_stopped_or_killed_goes_on_at_once() {
    let directory = workplace();
    let directory = directory.path();
    for (signal, code) in [("TERM", Some(143)), ("KILL", None)] {
        let mut child = brdfarm(directory)
            .args(["run", "--spec", "spec.toml", "--store", signal])
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .expect("a run");
        wait_for_completions(&directory.join(signal), 1);
        let sent = Command::new("kill")
            .args(["-s", signal, &child.id().to_string()])
            .status();
        assert!(sent.expect("kill runs").success());
        let mut said = String::new();
        let mut stderr = child.stderr.take().expect("a pipe");
        stderr.read_to_string(&mut said).expect("text");
        assert_eq!(child.wait().expect("an end").code(), code, "{said}");
        assert_eq!(said.contains("the same command resumes"), code.is_some());

        let resumed = Instant::now();
        let arguments = format!("run --spec spec.toml --store {signal}");
        let summary = succeed(directory, &arguments);
        assert!(summary.contains("verified 280 images"), "{summary}");
        assert!(resumed.elapsed() < Duration::from_secs(40));
    }
    assert_eq!(manifest(directory, "TERM"), manifest(directory, "KILL"));
}

#[test]
fn logs_go_to_standard_error_and_are_plain_in_a_file() {
    let directory = workplace();
    let output = run(
        directory.path(),
        "run --spec spec.toml --materials 1 --log info",
    );
    let [stdout, stderr] =
        [output.stdout, output.stderr].map(|bytes| String::from_utf8(bytes).expect("UTF-8"));
    assert!(stderr.contains("the coordinator listens"), "{stderr}");
    assert!(!stderr.contains('\u{1b}'), "{stderr}");
    let begins: Vec<_> = stdout
        .lines()
        .map(|line| line.split_whitespace().next().expect("a word"))
        .collect();
    assert_eq!(
        begins,
        ["rendered", "verified", "store", "manifest", "contact"],
        "{stdout}"
    );
}

/// A link, as /dev/stdout is one, leads on; it is not replaced by a file.
#[test]
fn a_manifest_goes_through_a_link() {
    let directory = workplace();
    let directory = directory.path();
    succeed(directory, "run --spec spec.toml --materials 1");
    std::os::unix::fs::symlink("there.csv", directory.join("link.csv")).expect("a link");
    succeed(
        directory,
        "dataset manifest export --format csv --out link.csv",
    );
    let there = fs::read_to_string(directory.join("there.csv")).expect("a manifest");
    assert_eq!(there.lines().count(), 1 + 14);
    assert!(directory.join("link.csv").is_symlink());
}

#[test]
fn any_image_of_the_manifest_renders_again_to_its_digest() {
    let directory = workplace();
    let directory = directory.path();
    succeed(directory, "run --spec spec.toml --materials 2");
    for row in rows(&manifest(directory, "store")) {
        let (seed, material, view) = (&row["seed"], &row["material"], &row["view"]);
        let digest = row["digest"].as_str().expect("a digest");
        succeed(
            directory,
            &format!(
                "render --spec spec.toml --seed {seed} --material {material} --view {view} \
                 --expect {digest}"
            ),
        );
    }
}

#[test]
fn verify_names_what_is_broken() {
    let directory = workplace();
    let directory = directory.path();
    succeed(directory, "run --spec spec.toml --materials 2");
    let all = rows(&manifest(directory, "store"));
    let path = |row: &Value| {
        directory
            .join("store")
            .join(row["path"].as_str().expect("a path"))
    };
    let flipped: PathBuf = path(&all[3]);
    let mut bytes = fs::read(&flipped).expect("an image");
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    fs::write(&flipped, bytes).expect("written");
    fs::remove_file(path(&all[20])).expect("removed");

    let output = run(directory, "dataset verify");
    assert_eq!(output.status.code(), Some(1));
    let found = String::from_utf8(output.stdout).expect("UTF-8");
    assert!(found.contains("material 0, view 3"), "{found}");
    assert!(found.contains("material 1, view 6"), "{found}");
    assert_eq!(found.lines().count(), 2, "{found}");
}

/// The exports, read by pyarrow, numpy and OpenEXR: `tests/clients/install.sh` installs them.
#[test]
fn python_reads_what_leaves_the_farm() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let clients = root.join("target/python-clients");
    assert!(
        clients.exists(),
        "the Python readers are missing: run tests/clients/install.sh, or tests/run.sh for all tests"
    );
    let directory = workplace();
    let directory = directory.path();
    succeed(directory, "run --spec spec.toml --materials 3");
    for format in ["parquet", "csv", "jsonl"] {
        succeed(
            directory,
            &format!("dataset manifest export --format {format} --out manifest.{format}"),
        );
    }
    let output = Command::new("python3")
        .arg(root.join("tests/clients/read_exports.py"))
        .args([
            "store",
            "manifest.parquet",
            "manifest.csv",
            "manifest.jsonl",
        ])
        .env("PYTHONPATH", clients)
        .current_dir(directory)
        .output()
        .expect("python3 runs");
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(
        output.status.success(),
        "{said}{}",
        String::from_utf8_lossy(&output.stderr)
    );
    assert!(said.contains("42 images"), "{said}");
}

/// The most arenas of threads that the heap of a run has at one time: pieces of 64 MiB that begin at a
/// multiple of their size, of which only the beginning is in use.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
fn arenas_of_a_run(variables: &[(&str, &str)]) -> usize {
    const ARENA_BYTES: u64 = 64 << 20;
    let place = workplace();
    let mut command = brdfarm(place.path());
    command.args(["run", "--spec", "spec.toml", "--workers", "4"]);
    command.env_remove("MALLOC_ARENA_MAX");
    command.env_remove("GLIBC_TUNABLES");
    command.envs(variables.iter().copied());
    let mut child = command
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .expect("brdfarm runs");
    let maps = PathBuf::from(format!("/proc/{}/maps", child.id()));
    let is_arena = |[used, rest]: &[(u64, u64, bool); 2]| {
        let (start, is_writable) = (used.0, used.2);
        let is_whole = rest.1 == start + ARENA_BYTES && rest.0 == used.1;
        start % ARENA_BYTES == 0 && is_writable && !rest.2 && is_whole
    };
    let mut most = 0;
    while child.try_wait().expect("a child").is_none() {
        let maps = fs::read_to_string(&maps).unwrap_or_default();
        let ranges: Vec<(u64, u64, bool)> = maps.lines().filter_map(mapping).collect();
        most = most.max(ranges.array_windows().filter(|pair| is_arena(pair)).count());
        std::thread::sleep(Duration::from_millis(5));
    }
    assert!(child.wait().expect("a child").success());
    most
}

/// Start, end, and whether it can be written, of a line of `/proc/PID/maps`.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
fn mapping(line: &str) -> Option<(u64, u64, bool)> {
    let (range, rest) = line.split_once(' ')?;
    let (start, end) = range.split_once('-')?;
    let number = |text| u64::from_str_radix(text, 16).ok();
    Some((number(start)?, number(end)?, rest.starts_with("rw")))
}

#[cfg(all(target_os = "linux", target_env = "gnu"))]
#[test]
fn the_heap_has_no_more_arenas_than_there_are_cores() {
    let cores = std::thread::available_parallelism().expect("cores").get();
    let more = (4 * cores).to_string();
    let tunable = format!("glibc.malloc.arena_max={more}");
    for variable in [("MALLOC_ARENA_MAX", &more), ("GLIBC_TUNABLES", &tunable)] {
        let freely = arenas_of_a_run(&[(variable.0, variable.1)]);
        assert!(freely > cores, "{freely} arenas where {more} are allowed");
    }
    let limited = arenas_of_a_run(&[]);
    assert!(limited <= cores, "{limited} arenas on {cores} cores");
}

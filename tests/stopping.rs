//! Programs that are asked to stop, and programs whose view does not end: both end, and say why.

#[allow(dead_code, reason = "other tests use the rest")]
mod process;

use process::Process;
use std::fs::{self, File};
use std::path::Path;
use std::process::Command;
use std::thread::{self, sleep};
use std::time::{Duration, Instant};
use tempfile::TempDir;

/// Days of work on any machine, in one view.
const ENDLESS: &str = "materials = 3\n[image]\nwidth = 512\nheight = 512\n\
    [integrator]\nkind = \"path\"\nsamples_per_pixel = 65536\n";

/// More than a program that stops may take: views under way have their grace.
const PATIENCE: Duration = Duration::from_secs(60);

/// After this long a worker that has a job is in its first view.
const BEGUN: Duration = Duration::from_millis(1_500);

/// How long a job may take where a test waits for its end, seconds.
const DEADLINE: u64 = 2;

/// A folder with that specification.
fn folder() -> TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    fs::write(folder.path().join("endless.toml"), ENDLESS).expect("written");
    folder
}

fn command(folder: &Path, arguments: &str) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_brdfarm"));
    command.current_dir(folder);
    command.args(arguments.split_whitespace());
    command
}

/// A program whose outputs go to files.
fn start(folder: &Path, arguments: &str) -> Process {
    let file = |name: &str| File::create(folder.join(name)).expect("a file");
    let mut command = command(folder, arguments);
    Process::spawn(command.stdout(file("out")).stderr(file("error")))
}

fn said(folder: &Path) -> String {
    fs::read_to_string(folder.join("error")).expect("a file")
}

fn wait_until(what: &str, holds: impl Fn() -> bool) {
    let began = Instant::now();
    while !holds() {
        assert!(began.elapsed() < PATIENCE, "{what}");
        sleep(Duration::from_millis(50));
    }
}

const RUN: &str = "--log debug run --spec endless.toml --workers 2 --backend native";

#[test]
fn a_run_whose_view_does_not_end_says_so_and_ends() {
    let folder = folder();
    let folder = folder.path();
    let run = start(folder, &format!("{RUN} --job-deadline-seconds {DEADLINE}"));
    assert_eq!(run.ended(PATIENCE).code(), Some(1));
    let said = said(folder);
    let why = format!("was not rendered within {DEADLINE} s and cannot be interrupted");
    assert!(said.contains(&why), "{said}");
}

#[test]
fn a_worker_whose_view_does_not_end_says_so_and_ends() {
    let folder = folder();
    let folder = folder.path();
    let serve = format!(
        "coordinator serve --spec endless.toml --listen 127.0.0.1:0 --job-deadline-seconds {DEADLINE}"
    );
    let (coordinator, url) = Process::serving(&mut command(folder, &serve)).expect("it listens");
    let worker = start(
        folder,
        &format!("worker connect {url} --threads 1 --backend native"),
    );
    assert_eq!(worker.ended(PATIENCE).code(), Some(1));
    let said = said(folder);
    assert!(said.contains("cannot be interrupted"), "{said}");
    coordinator.kill();
}

#[test]
fn a_run_in_a_view_that_does_not_end_stops_when_it_is_asked_to() {
    let stop = |signals: &[&str], code: i32| {
        let folder = folder();
        let folder = folder.path();
        let run = start(folder, RUN);
        wait_until("a job", || said(folder).contains("worker::worker: leased"));
        // A worker that has not begun its view hands it back at once, and a second signal finds nothing to stop.
        for signal in signals {
            sleep(BEGUN);
            run.signal(signal);
        }
        assert_eq!(run.ended(PATIENCE).code(), Some(code));
        said(folder)
    };
    thread::scope(|scope| {
        let once = [("INT", 130), ("TERM", 143)];
        let once = once.map(|(signal, code)| scope.spawn(move || stop(&[signal], code)));
        let twice = scope.spawn(|| stop(&["INT", "INT"], 130));
        for said in once.map(|stopped| stopped.join().expect("it stops")) {
            assert!(
                said.contains(
                    "stopping: finishing the views under way; a second signal stops at once"
                ),
                "{said}"
            );
            assert!(
                said.contains("stopped with 0 of 3 materials complete"),
                "{said}"
            );
        }
        let said = twice.join().expect("it stops");
        assert!(said.contains("stopped at once"), "{said}");
    });
}

/// As `timeout` sends it: to the program, and to its group.
#[test]
fn two_signals_at_once_are_one_request() {
    let folder = folder();
    let folder = folder.path();
    let run = start(folder, RUN);
    wait_until("a job", || said(folder).contains("leased"));
    run.signal("TERM");
    sleep(Duration::from_millis(100));
    run.signal("TERM");
    assert_eq!(run.ended(PATIENCE).code(), Some(143));
    let said = said(folder);
    assert!(said.contains("stopped with 0 of 3 materials"), "{said}");
}

#[test]
fn without_a_terminal_a_line_now_and_then_says_how_far_it_is() {
    let folder = folder();
    let folder = folder.path();
    let run = start(folder, RUN);
    wait_until("a line", || said(folder).contains("\n0 of 42 "));
    run.signal("KILL");
    run.ended(PATIENCE);
}

#[test]
fn status_finds_a_run_and_a_second_run_is_told_of_it() {
    let folder = folder();
    let folder = folder.path();
    let run = start(folder, RUN);
    wait_until("a job", || said(folder).contains("leased"));
    let answer = |arguments: &str| {
        let output = command(folder, arguments).output().expect("it runs");
        let both = [output.stdout, output.stderr].concat();
        String::from_utf8(both).expect("text")
    };
    for arguments in ["status", "status --store store"] {
        let told = answer(arguments);
        assert!(told.contains("0 of 3 complete, "), "{told}");
        assert!(told.contains("workers     2"), "{told}");
    }
    let told = answer("run --spec endless.toml");
    let holder = format!("is in use by process {}", run.id());
    assert!(told.contains(&holder), "{told}");
    run.kill();
    let told = answer("status --store store");
    assert!(told.contains("not served"), "{told}");
}

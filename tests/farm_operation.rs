//! A farm steered from the command line, with real processes.

#[allow(dead_code, reason = "other tests use the rest")]
mod process;

use process::Process;
use serde_json::Value;
use std::fs;
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

const PATIENCE: Duration = Duration::from_secs(60);

const SPECIFICATION: &str = r#"
name = "steered"
materials = 8
[image]
width = 16
height = 16
[integrator]
kind = "path"
samples_per_pixel = 16
"#;

fn brdfarm(directory: &Path) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_brdfarm"));
    command.current_dir(directory);
    command
}

fn coordinator(directory: &Path) -> (Process, String) {
    let mut command = brdfarm(directory);
    command
        .args(["coordinator", "serve", "--spec", "spec.toml"])
        .args(["--listen", "127.0.0.1:0"]);
    Process::serving(&mut command).expect("a coordinator")
}

struct Farm<'a> {
    directory: &'a Path,
    url: String,
}

impl Farm<'_> {
    fn run(&self, arguments: &str) -> Output {
        let mut command = brdfarm(self.directory);
        command.args(arguments.split_whitespace());
        command.env("BRDFARM_COORDINATOR", &self.url);
        command.output().expect("brdfarm runs")
    }

    fn say(&self, arguments: &str) -> String {
        let output = self.run(arguments);
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "brdfarm {arguments}: {said}");
        String::from_utf8(output.stdout).expect("UTF-8")
    }

    fn status(&self) -> Value {
        serde_json::from_str(&self.say("status --json")).expect("JSON")
    }

    fn worker(&self) -> Process {
        let mut command = brdfarm(self.directory);
        command
            .args(["worker", "connect", &self.url, "--threads", "1"])
            .args(["--name", "hand", "--backend", "native"]);
        Process::spawn(command.stdout(Stdio::null()))
    }

    fn wait(&self, until: impl Fn(&Value) -> bool) -> Value {
        let deadline = Instant::now() + PATIENCE;
        loop {
            let status = self.status();
            if until(&status) {
                return status;
            }
            assert!(Instant::now() < deadline, "{status}");
            std::thread::sleep(Duration::from_millis(50));
        }
    }
}

#[test]
fn a_farm_obeys_its_commands() {
    let directory = tempfile::tempdir().expect("a directory");
    let directory = directory.path();
    fs::write(directory.join("spec.toml"), SPECIFICATION).expect("written");
    let (_coordinator, url) = coordinator(directory);
    let farm = Farm { directory, url };

    assert_eq!(farm.say("pause"), "paused\n");
    assert_eq!(farm.say("pause"), "paused, as before\n");
    assert!(farm.say("jobs cancel 2,4-5 --dry-run").lines().count() == 3);
    assert_eq!(farm.say("jobs cancel 2,4-5"), "cancelled: 2,4-5\n");
    assert_eq!(farm.say("jobs retry 4"), "back in the queue: 4\n");
    assert_eq!(
        farm.say("jobs prioritize 6-7 --priority 9"),
        "prioritized: 6-7\n"
    );
    let cancelled = farm.say("jobs list --state cancelled --json");
    assert_eq!(cancelled.lines().count(), 2, "{cancelled}");
    assert!(farm.say("jobs show 6").contains("priority 9"));
    let status = farm.status();
    assert_eq!(status["mode"], "paused");
    assert_eq!(
        (&status["pending"], &status["cancelled"]),
        (&6.into(), &2.into())
    );

    let worker = farm.worker();
    farm.wait(|status| status["workers"] == 1);
    assert_eq!(
        farm.say("workers block hand --reason dust"),
        "hand is blocked; 0 leases taken back\n"
    );
    assert!(farm.say("workers list").contains("blocked: dust"));
    let stranger = farm.say("workers block hnad");
    assert!(
        stranger.contains("no worker of that name is known"),
        "{stranger}"
    );
    farm.say("workers unblock hnad");
    farm.say("resume");
    std::thread::sleep(Duration::from_millis(300));
    assert_eq!(farm.status()["completed"], 0, "its only worker is blocked");
    assert_eq!(farm.say("workers unbar hand"), "hand works again\n");
    let done = farm.wait(|status| status["finished"] == true);
    assert_eq!(
        (&done["completed"], &done["images"]),
        (&6.into(), &84.into())
    );
    let shown = farm.say("status --watch");
    assert!(
        shown.contains("6 of 8 complete") && shown.contains("2 cancelled"),
        "{shown}"
    );
    assert!(farm.say("jobs show 0").contains("completed  hand"));
    drop(worker);

    assert_eq!(farm.say("drain"), "draining\n");
    farm.say("jobs retry 2");
    let leaving = farm.worker();
    assert!(leaving.ended(PATIENCE).success(), "drained workers leave");
    assert_eq!(farm.status()["completed"], 6);
}

#[test]
fn wrong_orders_are_refused_with_the_right_code() {
    let directory = tempfile::tempdir().expect("a directory");
    let directory = directory.path();
    fs::write(directory.join("spec.toml"), SPECIFICATION).expect("written");
    let (_coordinator, url) = coordinator(directory);
    let farm = Farm { directory, url };
    for (arguments, code, what) in [
        ("jobs show 8", 2, "no material 8"),
        ("jobs retry 5-3", 2, "goes backwards"),
        ("jobs retry", 2, "<LIST>"),
        ("jobs prioritize 1 --priority 9999", 2, "1000"),
        ("workers unbar nobody", 1, "no worker called"),
        (
            "status --coordinator http://127.0.0.1:9",
            1,
            "does not answer",
        ),
        ("status --coordinator here", 2, "http(s)://HOST:PORT"),
        ("status --credentials /nowhere", 2, "/nowhere"),
    ] {
        let output = farm.run(arguments);
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(code), "{arguments}: {said}");
        assert!(said.contains(what), "{arguments}: {said}");
    }
}

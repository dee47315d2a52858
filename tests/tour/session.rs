//! A shell in which a page is typed.

use std::fs::{self, File};
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

/// How long a page may take at the very most.
const PATIENCE: Duration = Duration::from_secs(300);

/// What the script begins with. It ends at the first statement that fails, says where that stands,
/// and stops what it left in the background.
const HEAD: &str = r#"set -euo pipefail
at=
end() {
    code=$?
    if [ "$code" != 0 ]; then
        echo "the statement at $at fails with $code"
        tail -n 20 served-* 2>/dev/null || true
    fi
    kill $(jobs -p) 2>/dev/null || true
    wait
}
trap end EXIT
# Waits until the coordinators started since `before` was set say that they listen: $1 of them, in
# the file $2. Each of them has to be alive.
listening() {
    started=
    for process in $(jobs -p); do
        case " $before " in
            *" $process "*) ;;
            *) started="$started $process" ;;
        esac
    done
    until [ "$(grep -c 'listening on' "$2")" = "$1" ]; do
        for process in $started; do kill -0 "$process"; done
        sleep 0.05
    done
}
"#;

/// A script that is put together statement by statement.
pub struct Script {
    text: String,
    /// Whether the statement before was started in the background and ends by itself.
    begun: bool,
}

impl Script {
    pub fn new() -> Self {
        Self {
            text: HEAD.to_owned(),
            begun: false,
        }
    }

    /// Adds a statement that stands at `place`. One that the page starts in the background is waited
    /// for after the next.
    pub fn statement(&mut self, place: &str, text: &str) {
        self.text += &format!("at={place}\n{text}\n");
        if self.begun {
            self.text += "wait $begun\n";
        }
        self.begun = text.ends_with(" &");
        if self.begun {
            self.text += "begun=$!\n";
        }
    }

    /// Adds a statement that starts coordinators, which serve until the session ends.
    pub fn serves(&mut self, place: &str, text: &str, coordinators: usize) {
        let file = format!("served-{}", self.text.len());
        let command = match text.starts_with("for ") {
            true => format!("{text} >{file} 2>&1"),
            false => format!("{text} >{file} 2>&1 &"),
        };
        self.text += &format!("at={place}\nbefore=$(echo $(jobs -p))\n{command}\n");
        self.text += &format!("listening {coordinators} {file}\n");
    }
}

/// A process and all that it started, which end with it.
struct Group(Child);

impl Group {
    fn ended(&mut self) -> Option<ExitStatus> {
        let deadline = Instant::now() + PATIENCE;
        while Instant::now() < deadline {
            if let Some(status) = self.0.try_wait().expect("a status") {
                return Some(status);
            }
            sleep(Duration::from_millis(20));
        }
        None
    }
}

impl Drop for Group {
    fn drop(&mut self) {
        let group = format!("-{}", self.0.id());
        let mut kill = Command::new("kill");
        // An error means that all have ended already.
        let _ = kill
            .args(["-s", "KILL", "--", &group])
            .stderr(Stdio::null())
            .status();
        let _ = self.0.wait();
    }
}

/// Types a script in a folder, with `brdfarm` on the path.
pub fn play(script: &Script, folder: &Path) {
    let program = Path::new(env!("CARGO_BIN_EXE_brdfarm")).parent().unwrap();
    let path = std::env::var("PATH").unwrap_or_default();
    let log = folder.join("said");
    let file = File::create(&log).unwrap();
    let mut bash = Command::new("bash");
    bash.args(["-c", &script.text])
        .current_dir(folder)
        .env("PATH", format!("{}:{path}", program.display()))
        .stdin(Stdio::null())
        .stdout(file.try_clone().unwrap())
        .stderr(file)
        .process_group(0);
    let status = Group(bash.spawn().unwrap()).ended();
    let said = fs::read_to_string(&log).unwrap();
    let status = status.unwrap_or_else(|| panic!("it does not end:\n{said}"));
    assert!(status.success(), "{said}");
}

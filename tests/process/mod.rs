//! Processes of the program, which end with their test.

use std::fs;
use std::io::{BufRead, BufReader};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

/// A process that is killed when its test is over.
pub struct Process(Child);

impl Process {
    pub fn spawn(command: &mut Command) -> Self {
        Self(command.spawn().expect("a process"))
    }

    /// A coordinator that says where it listens, and its URL; `None` where it ends before.
    pub fn serving(command: &mut Command) -> Option<(Self, String)> {
        let mut process = Self::spawn(command.stdout(Stdio::piped()));
        let mut line = String::new();
        let stdout = process.0.stdout.take().expect("a pipe");
        BufReader::new(stdout).read_line(&mut line).expect("a line");
        let url = line.trim().rsplit(' ').next().unwrap_or_default();
        (!url.is_empty()).then(|| (process, url.to_owned()))
    }

    pub fn id(&self) -> u32 {
        self.0.id()
    }

    pub fn signal(&self, name: &str) {
        let id = self.id().to_string();
        let sent = Command::new("kill").args(["-s", name, &id]).status();
        assert!(sent.expect("kill runs").success(), "SIG{name} to {id}");
    }

    pub fn kill(mut self) {
        self.0.kill().expect("SIGKILL");
        self.0.wait().expect("its end");
    }

    pub fn has_ended(&mut self) -> bool {
        self.0.try_wait().expect("a status").is_some()
    }

    /// Waits for its end.
    pub fn ended(mut self, patience: Duration) -> ExitStatus {
        let deadline = Instant::now() + patience;
        while !self.has_ended() {
            assert!(Instant::now() < deadline, "a process does not end");
            sleep(Duration::from_millis(10));
        }
        self.0.wait().expect("a status")
    }

    /// What the system says of its memory, bytes: `VmRSS` what it has, `VmHWM` the most it had.
    /// `None` where it has ended.
    pub fn memory_bytes(&self, what: &str) -> Option<u64> {
        let status = fs::read_to_string(format!("/proc/{}/status", self.id())).ok()?;
        let mut words = status.split_whitespace();
        words.find(|word| word.trim_end_matches(':') == what)?;
        let kilobytes: u64 = words.next()?.parse().ok()?;
        Some(kilobytes << 10)
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        // An error means that it has ended already.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

//! Types README.md and docs/operating.md: every line of their shell blocks, in order, in an empty
//! folder, with a private PostgreSQL server and a bucket of this process.
#![allow(clippy::unwrap_used, reason = "a panic here is a failed test")]

#[allow(dead_code, reason = "other tests use the rest")]
#[path = "../folder/mod.rs"]
mod folder;
mod operating;
mod page;
mod readme;
#[allow(dead_code, reason = "other tests use the rest")]
#[path = "../s3/mod.rs"]
mod s3;
#[allow(dead_code, reason = "other tests use the rest")]
#[path = "../../jobstore-postgres/src/testing.rs"]
mod server;
mod session;

use page::Statement;
use session::Script;
use std::fs;
use std::net::TcpListener;
use std::os::unix::fs::symlink;
use std::path::Path;
use std::sync::atomic::{AtomicU16, Ordering};

/// Lines of the feature `training`.
const TRAINING: [&str; 3] = [
    "brdfarm train ",
    "brdfarm evaluate ",
    "brdfarm dataset observability ",
];

/// A page, and what is special about typing it. Lines are named by how they begin.
struct Tour {
    document: &'static str,
    /// Lines that are not typed, each with the reason.
    not_typed: &'static [(&'static str, &'static str)],
    /// Pieces of lines, and what is typed for them, so that the test takes seconds.
    smaller: &'static [(&'static str, &'static str)],
    /// The same for names of other machines: all is on this one, on free ports.
    here: Vec<(&'static str, String)>,
    /// Lines that serve until they are stopped, and how many coordinators each starts.
    serves: &'static [(&'static str, usize)],
}

impl Tour {
    /// Types the page and expects every statement to succeed.
    fn take(&self) {
        let root = Path::new(env!("CARGO_MANIFEST_DIR"));
        let page = fs::read_to_string(root.join(self.document)).unwrap();
        let statements = page::statements(&page);
        let mut script = Script::new();
        let mut typed = String::new();
        let chosen = statements
            .iter()
            .filter(|statement| self.is_typed(statement));
        for statement in chosen {
            self.add(statement, &mut script);
            typed += &statement.text;
            typed.push('\n');
        }
        self.check(&statements, &typed);
        let folder = tempfile::tempdir().unwrap();
        symlink(root.join("examples"), folder.path().join("examples")).unwrap();
        session::play(&script, folder.path());
    }

    fn is_typed(&self, statement: &Statement) -> bool {
        let text = &statement.text;
        let is_built = cfg!(feature = "training") || !is_of_training(text);
        let mut not_typed = self.not_typed.iter();
        is_built && !not_typed.any(|(beginning, _)| text.starts_with(beginning))
    }

    fn add(&self, statement: &Statement, script: &mut Script) {
        let mut text = statement.text.clone();
        for (piece, by) in self.smaller {
            text = text.replace(piece, by);
        }
        for (piece, by) in &self.here {
            text = text.replace(piece, by);
        }
        let place = format!("{}:{}", self.document, statement.line);
        let mut serves = self.serves.iter();
        match serves.find(|(beginning, _)| statement.text.starts_with(beginning)) {
            Some((_, coordinators)) => script.serves(&place, &text, *coordinators),
            None => script.statement(&place, &text),
        }
    }

    /// Refuses exceptions for lines that are gone.
    fn check(&self, statements: &[Statement], typed: &str) {
        let document = self.document;
        let not_typed = self.not_typed.iter().map(|(beginning, _)| *beginning);
        let serves = self.serves.iter().map(|(beginning, _)| *beginning);
        for beginning in not_typed.chain(serves) {
            let mut all = statements.iter();
            assert!(
                all.any(|statement| statement.text.starts_with(beginning)),
                "no line of {document} begins with {beginning:?}"
            );
        }
        let smaller = self.smaller.iter().map(|(piece, _)| *piece);
        let here = self.here.iter().map(|(piece, _)| *piece);
        for piece in smaller.chain(here) {
            let is_built = cfg!(feature = "training") || !is_of_training(piece);
            assert!(
                !is_built || typed.contains(piece),
                "no line of {document} that is typed has {piece:?}"
            );
        }
    }
}

fn is_of_training(line: &str) -> bool {
    TRAINING.iter().any(|command| line.starts_with(command))
}

/// A port that nobody listens at, nor at the one 2,000 above it, where the operating manual serves
/// metrics. Both lie below the ports that systems give to clients (from 32,768 on Linux, from 49,152
/// elsewhere): a client of another test would take one of those before the manual listens at it.
fn free_port() -> u16 {
    static NEXT: AtomicU16 = AtomicU16::new(0);
    let first = 12_000 + std::process::id() as u16 % 8_000;
    loop {
        let port = first + NEXT.fetch_add(1, Ordering::Relaxed);
        assert!(port < 30_000, "no port is free");
        let pair = [port, port + 2_000];
        if pair
            .iter()
            .all(|port| TcpListener::bind(("127.0.0.1", *port)).is_ok())
        {
            return port;
        }
    }
}

/// The URL of an empty database, as a word of the shell.
fn database() -> String {
    let runtime = tokio::runtime::Runtime::new().unwrap();
    format!("'{}'", runtime.block_on(server::fresh_schema()))
}

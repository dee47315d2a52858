//! The machine and the program that made a report.

use chrono::{SecondsFormat, Utc};
use dataset::RENDERER_VERSION;
use std::fs;
use std::num::NonZero;
use std::thread::available_parallelism;

/// What is stated of a machine that the system does not describe.
const UNKNOWN: &str = "unknown";

/// Names and values, in the order of the table. Nothing names the host.
pub fn facts() -> Vec<(&'static str, String)> {
    let system = rustix::system::uname();
    let kernel = format!(
        "{} on {}",
        system.sysname().to_string_lossy(),
        system.machine().to_string_lossy()
    );
    let os = field("/etc/os-release", '=', "PRETTY_NAME");
    let cores = available_parallelism().map_or(1, NonZero::get);
    let build = if cfg!(debug_assertions) {
        "with debug assertions: times are not those of a release build"
    } else {
        "release"
    };
    vec![
        ("Processor", field("/proc/cpuinfo", ':', "model name")),
        ("Instruction sets", instruction_sets().join(", ")),
        ("Cores", cores.to_string()),
        ("Memory", memory(&field("/proc/meminfo", ':', "MemTotal"))),
        ("System", format!("{os}, {kernel}")),
        ("Program", format!("brdfarm {}", env!("CARGO_PKG_VERSION"))),
        ("Renderer", format!("version {RENDERER_VERSION}")),
        ("Build", build.to_owned()),
        (
            "Date",
            Utc::now().to_rfc3339_opts(SecondsFormat::Secs, true),
        ),
    ]
}

/// The value of the first line of a file that begins with `key`, less quotes.
fn field(path: &str, separator: char, key: &str) -> String {
    let text = fs::read_to_string(path).unwrap_or_default();
    value(&text, separator, key).unwrap_or_else(|| UNKNOWN.to_owned())
}

fn value(text: &str, separator: char, key: &str) -> Option<String> {
    text.lines().find_map(|line| {
        let (name, value) = line.split_once(separator)?;
        (name.trim() == key).then(|| value.trim().trim_matches('"').to_owned())
    })
}

/// The kernel's kibibytes, as people write them.
fn memory(total: &str) -> String {
    const KIB_A_GIB: f64 = 1_048_576.0;
    let kib: Option<f64> = total
        .strip_suffix(" kB")
        .and_then(|number| number.parse().ok());
    kib.map_or_else(
        || total.to_owned(),
        |kib| format!("{:.1} GiB", kib / KIB_A_GIB),
    )
}

#[cfg(target_arch = "x86_64")]
fn instruction_sets() -> Vec<&'static str> {
    [
        ("SSE4.2", std::is_x86_feature_detected!("sse4.2")),
        ("AVX", std::is_x86_feature_detected!("avx")),
        ("AVX2", std::is_x86_feature_detected!("avx2")),
        ("AVX-512", std::is_x86_feature_detected!("avx512f")),
    ]
    .into_iter()
    .filter(|(_, there)| *there)
    .map(|(name, _)| name)
    .collect()
}

#[cfg(not(target_arch = "x86_64"))]
fn instruction_sets() -> Vec<&'static str> {
    vec![std::env::consts::ARCH]
}

#[cfg(test)]
mod tests {
    use super::*;
    use chrono::DateTime;

    #[test]
    fn values_are_read_by_their_names() {
        let text = "NAME=x\nPRETTY_NAME=\"An OS 12\"\nmodel name\t: A CPU : B\n";
        assert_eq!(value(text, '=', "PRETTY_NAME").as_deref(), Some("An OS 12"));
        assert_eq!(value(text, ':', "model name").as_deref(), Some("A CPU : B"));
        assert_eq!(value(text, '=', "VERSION"), None);
        assert_eq!(memory("24664092 kB"), "23.5 GiB");
        assert_eq!(memory(UNKNOWN), UNKNOWN);
        assert_eq!(field("/nowhere", '=', "x"), UNKNOWN);
    }

    /// Where Linux describes the machine. On other processors it gives no model name.
    #[cfg(target_os = "linux")]
    #[test]
    fn the_facts_of_a_machine_are_found() {
        let facts = facts();
        let fact = |wanted: &str| {
            let fact = facts.iter().find(|(name, _)| *name == wanted);
            fact.map_or("", |(_, fact)| fact.as_str())
        };
        if cfg!(target_arch = "x86_64") {
            assert_ne!(fact("Processor"), UNKNOWN);
            assert!(fact("Instruction sets").contains("SSE4.2"));
        }
        let cores: usize = fact("Cores").parse().expect("a number of cores");
        assert!(cores > 0);
        let memory = fact("Memory").strip_suffix(" GiB").expect("gibibytes");
        assert!(memory.parse::<f64>().expect("a number") > 0.0);
        let system = format!("Linux on {}", std::env::consts::ARCH);
        assert!(fact("System").ends_with(&system), "{}", fact("System"));
        assert!(fact("Program").ends_with(env!("CARGO_PKG_VERSION")));
        assert!(fact("Renderer").ends_with(&RENDERER_VERSION.to_string()));
        let date = DateTime::parse_from_rfc3339(fact("Date")).expect("a date");
        let age = Utc::now().signed_duration_since(date);
        assert!((0..60).contains(&age.num_seconds()), "{date}");
    }
}

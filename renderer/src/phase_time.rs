//! Where the time of a view goes.

use std::time::Instant;

/// What a phase of a view took.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PhaseTime {
    /// The phase: `trace` of the path tracer; `bulb`, `interreflection`, `chart` and `reflected chart` of
    /// the hybrid integrator; `encode` of both.
    pub name: &'static str,
    /// Wall-clock seconds.
    pub seconds: f64,
}

/// Does `work` and notes what it took.
pub(crate) fn timed<T>(
    phases: &mut Vec<PhaseTime>,
    name: &'static str,
    work: impl FnOnce() -> T,
) -> T {
    let start = Instant::now();
    let done = work();
    phases.push(PhaseTime {
        name,
        seconds: start.elapsed().as_secs_f64(),
    });
    done
}

//! What materials of the preset cost, and how many of their pixels meet the tolerance.
//!
//! `survey FIRST COUNT [STRIDE]` renders materials FIRST, FIRST + STRIDE, ... in every view on one
//! thread, and prints a line of comma-separated values for each image: material, view, processor
//! seconds, the share of pixels within the tolerance, evaluations, then the seconds of each phase.
//! A summary with the tail goes to standard error.

use dataset::Specification;
use renderer::{Renderer, geometry::BackendChoice};
use std::{collections::BTreeMap, error::Error, io::Write};

fn main() -> Result<(), Box<dyn Error>> {
    let numbers: Vec<u32> = std::env::args()
        .skip(1)
        .map(|argument| argument.parse())
        .collect::<Result<_, _>>()?;
    let (first, count) = match numbers[..] {
        [first, count, ..] => (first, count),
        _ => return Err("usage: survey FIRST COUNT [STRIDE]".into()),
    };
    let stride = numbers.get(2).copied().unwrap_or(1);
    rayon::ThreadPoolBuilder::new()
        .num_threads(1)
        .build_global()?;
    let specification = Specification::preset();
    let renderer = Renderer::new(&specification, BackendChoice::Native)?;
    let mut survey = Survey::default();
    let mut out = std::io::stdout().lock();
    for material in (0..count).map(|step| first + stride * step) {
        let drawn = specification.material(material).material;
        for view in 0..specification.views.len() as u32 {
            let begin = cpu_seconds();
            let rendering = renderer.render(&drawn, Some(material), view)?;
            let seconds = cpu_seconds() - begin;
            let statistics = &rendering.statistics;
            write!(
                out,
                "{material},{view},{seconds:.6},{:.6},{}",
                statistics.within_target, statistics.evaluations
            )?;
            for phase in &rendering.phases {
                write!(out, ",{}={:.6}", phase.name, phase.seconds)?;
                *survey.phases.entry(phase.name).or_default() += phase.seconds;
            }
            writeln!(out)?;
            survey.images.push(seconds);
            survey.within.push(statistics.within_target);
            *survey.materials.entry(material).or_default() += seconds;
        }
    }
    survey.summarise();
    Ok(())
}

#[derive(Default)]
struct Survey {
    images: Vec<f64>,
    within: Vec<f64>,
    materials: BTreeMap<u32, f64>,
    phases: BTreeMap<&'static str, f64>,
}

impl Survey {
    #[allow(clippy::print_stderr)]
    fn summarise(&self) {
        let count = self.images.len() as f64;
        let total: f64 = self.images.iter().sum();
        let mut materials: Vec<f64> = self.materials.values().copied().collect();
        materials.sort_unstable_by(|a, b| b.total_cmp(a));
        let share = |part: f64| {
            let top = (materials.len() as f64 * part).ceil() as usize;
            100.0 * materials[..top].iter().sum::<f64>() / total
        };
        let dearest = self.images.iter().copied().fold(0.0, f64::max);
        eprintln!(
            "{:.1} ms an image; dearest image {dearest:.2} s, material {:.2} s; top 1% of \
             materials {:.0}% of the time, top 10% {:.0}%",
            1e3 * total / count,
            materials[0],
            share(0.01),
            share(0.1)
        );
        let mean = self.within.iter().sum::<f64>() / count;
        let least = self.within.iter().copied().fold(1.0, f64::min);
        let short = self.within.iter().filter(|&&share| share < 0.99).count();
        eprintln!(
            "{:.4}% of pixels within the tolerance, worst image {:.2}%, {short} of {count} images \
             below 99%",
            100.0 * mean,
            100.0 * least
        );
        for (name, seconds) in &self.phases {
            eprintln!("{name}: {:.2} ms an image", 1e3 * seconds / count);
        }
    }
}

/// User and system time of this process.
fn cpu_seconds() -> f64 {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    time.tv_sec as f64 + 1e-9 * time.tv_nsec as f64
}

//! What materials of the preset cost, and how many of their pixels meet the tolerance.
//!
//! `survey FIRST COUNT [STRIDE] [relative=R] [check]` renders materials FIRST, FIRST + STRIDE, ... of the preset in
//! every view on one thread, and prints a line of comma-separated values for each image: material, view,
//! processor seconds, the share of pixels within the tolerance by their stated errors, evaluations, then
//! the seconds of each phase. A summary with the tail goes to standard error. `survey hard [check]` does
//! the same with the hard cases ([`HARD_CASES`]), by their names. With `relative=R` the tolerance is R of a
//! pixel's value, and a tenth of that as an absolute one, as in the preset.
//!
//! With `check` each view is rendered again, to a hundredth of the tolerance, and four columns tell of
//! the image against that one: the share of pixels whose error is within what both state, the same
//! within the tolerance and what the finer one states, the largest error over the tolerance, and by how
//! many tolerances the worst pixel is off beyond what both state.

use dataset::specification::Accuracy;
use dataset::{HARD_CASES, Material, Specification};
use renderer::film::Film;
use renderer::{Renderer, geometry::BackendChoice};
use std::{collections::BTreeMap, error::Error, io::Write};

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments: Vec<String> = std::env::args().skip(1).collect();
    let check = arguments.pop_if(|last| last == "check").is_some();
    let mut specification = Specification::preset();
    if let Some(last) = arguments.pop_if(|last| last.starts_with("relative=")) {
        let relative = last["relative=".len()..].parse::<f64>();
        let relative = relative.map_err(|error| format!("{last} is no tolerance: {error}"))?;
        specification.accuracy.absolute *= relative / specification.accuracy.relative;
        specification.accuracy.relative = relative;
    }
    let subjects = subjects(&specification, &arguments)?;
    rayon::ThreadPoolBuilder::new()
        .num_threads(1)
        .build_global()?;
    let renderer = Renderer::new(&specification, BackendChoice::Native)?;
    let finer = match check {
        true => Some(Renderer::new(
            &finer(&specification),
            BackendChoice::Native,
        )?),
        false => None,
    };
    let mut survey = Survey::default();
    let mut out = std::io::stdout().lock();
    for Subject {
        name,
        index,
        material,
    } in subjects
    {
        for view in 0..specification.views.len() as u32 {
            let begin = cpu_seconds();
            let rendering = renderer.render(&material, index, view)?;
            let seconds = cpu_seconds() - begin;
            let statistics = &rendering.statistics;
            write!(
                out,
                "{name},{view},{seconds:.6},{:.6},{}",
                statistics.within_target, statistics.evaluations
            )?;
            for phase in &rendering.phases {
                write!(out, ",{}={:.6}", phase.name, phase.seconds)?;
                *survey.phases.entry(phase.name).or_default() += phase.seconds;
            }
            if let Some(finer) = &finer {
                let finer = finer.render(&material, index, view)?.film;
                let image = Checked::new(&specification.accuracy, &rendering.film, &finer);
                let Checked {
                    stated,
                    within,
                    worst,
                    beyond,
                } = image;
                write!(
                    out,
                    ",stated={stated:.6},true={within:.6},worst={worst:.3},beyond={beyond:.3}"
                )?;
                survey.checked.push(image);
            }
            writeln!(out)?;
            survey.images.push(seconds);
            survey.within.push(statistics.within_target);
            *survey.materials.entry(name.clone()).or_default() += seconds;
        }
    }
    survey.summarise();
    Ok(())
}

/// A material to render.
struct Subject {
    /// Its index in the preset, or its name among the hard cases.
    name: String,
    index: Option<u32>,
    material: Material,
}

/// The materials that the arguments name.
fn subjects(
    specification: &Specification,
    arguments: &[String],
) -> Result<Vec<Subject>, Box<dyn Error>> {
    if arguments == ["hard"] {
        let cases = HARD_CASES.into_iter().map(|case| Subject {
            name: case.name.to_owned(),
            index: None,
            material: case.material,
        });
        return Ok(cases.collect());
    }
    let numbers: Vec<u32> = arguments
        .iter()
        .map(|argument| argument.parse())
        .collect::<Result<_, _>>()?;
    let (first, count, stride) = match numbers[..] {
        [first, count] => (first, count, 1),
        [first, count, stride] => (first, count, stride),
        _ => {
            return Err(
                "usage: survey FIRST COUNT [STRIDE] [relative=R] [check], or survey hard [relative=R] [check]"
                    .into(),
            );
        }
    };
    let indices = (0..count).map(|step| first + stride * step);
    let drawn = indices.map(|index| Subject {
        name: index.to_string(),
        index: Some(index),
        material: specification.material(index).material,
    });
    Ok(drawn.collect())
}

/// The same to a hundredth of the tolerance.
fn finer(specification: &Specification) -> Specification {
    let mut finer = specification.clone();
    finer.accuracy.absolute *= 0.01;
    finer.accuracy.relative *= 0.01;
    finer
}

/// An image against a finer rendering.
#[derive(Clone, Copy)]
struct Checked {
    /// The share of pixels whose error is within what both renderings state.
    stated: f64,
    /// The share of pixels whose error is within the tolerance and what the finer rendering states.
    within: f64,
    /// The largest error, less what the finer rendering states, over the tolerance.
    worst: f64,
    /// The largest error beyond what both renderings state, over the tolerance; 0 if there is none.
    beyond: f64,
}

impl Checked {
    fn new(accuracy: &Accuracy, image: &Film, finer: &Film) -> Self {
        let count = image.pixels.len() as f64;
        let (mut stated, mut within, mut worst, mut beyond) = (0.0, 0.0, 0.0f64, 0.0f64);
        for (pixel, finer) in image.pixels.iter().zip(&finer.pixels) {
            let channels = pixel.value.iter().zip(finer.value);
            let error = channels.fold(0.0, |most: f64, (a, b)| most.max((a - b).abs()));
            let value = finer.value.into_iter().fold(0.0, f64::max);
            let tolerance = accuracy.absolute.max(accuracy.relative * value);
            let missed = error - finer.error;
            stated += f64::from(u8::from(missed <= pixel.error));
            within += f64::from(u8::from(missed <= tolerance));
            worst = worst.max(missed / tolerance);
            beyond = beyond.max((missed - pixel.error) / tolerance);
        }
        Self {
            stated: stated / count,
            within: within / count,
            worst,
            beyond,
        }
    }
}

#[derive(Default)]
struct Survey {
    images: Vec<f64>,
    checked: Vec<Checked>,
    within: Vec<f64>,
    materials: BTreeMap<String, f64>,
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
        self.summarise_checked();
        for (name, seconds) in &self.phases {
            eprintln!("{name}: {:.2} ms an image", 1e3 * seconds / count);
        }
    }

    #[allow(clippy::print_stderr)]
    fn summarise_checked(&self) {
        if self.checked.is_empty() {
            return;
        }
        let tell = |what: &str, of: fn(&Checked) -> f64| {
            let shares: Vec<f64> = self.checked.iter().map(of).collect();
            let mean = shares.iter().sum::<f64>() / shares.len() as f64;
            let least = shares.iter().copied().fold(1.0, f64::min);
            let short = shares.iter().filter(|&&share| share < 0.99).count();
            eprintln!(
                "against the finer rendering: {:.4}% of pixels within {what}, worst image {:.2}%, \
                 {short} of {} images below 99%",
                100.0 * mean,
                100.0 * least,
                shares.len()
            );
        };
        tell("their stated error", |image| image.stated);
        tell("the tolerance", |image| image.within);
        let largest = |of: fn(&Checked) -> f64| self.checked.iter().map(of).fold(0.0, f64::max);
        eprintln!(
            "largest error: {:.2} tolerances, largest beyond what is stated: {:.2}",
            largest(|image| image.worst),
            largest(|image| image.beyond)
        );
    }
}

/// User and system time of this process.
fn cpu_seconds() -> f64 {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    time.tv_sec as f64 + 1e-9 * time.tv_nsec as f64
}

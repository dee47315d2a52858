//! Renders views on request and tells what each took of the processor: the side of this renderer in
//! `bench/mitsuba`, where the other side is one process as well.
//!
//! A line of standard input is a request, one of standard output its answer (JSON). Scenes are built
//! before the clock starts; nothing is kept from one rendering to the next. Images are files of
//! 64-bit numbers, little-endian: rows, columns, three channels.

use dataset::{Material, Specification};
use renderer::{
    film::Film, geometry::BackendChoice, hybrid::PreparedView, reflectance::Reflectance,
    scene::Scene,
};
use serde::{Deserialize, Serialize};
use std::{
    error::Error,
    fs,
    io::{self, BufRead, Write},
    path::PathBuf,
};

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Request {
    material: Material,
    view: usize,
    /// Relative accuracy, and absolute in units of white.
    relative: f64,
    absolute: f64,
    /// How often to render.
    repetitions: u32,
    /// Where the image goes.
    out: PathBuf,
}

#[derive(Serialize)]
struct Answer {
    /// Of each rendering: user and system time of all threads, from the material to the film.
    cpu_seconds: Vec<f64>,
    /// The mean of the film's own bound of its error, in units of white.
    stated_error: f64,
}

fn main() -> Result<(), Box<dyn Error>> {
    for line in io::stdin().lock().lines() {
        let answer = render(&serde_json::from_str(&line?)?)?;
        let mut stdout = io::stdout().lock();
        serde_json::to_writer(&mut stdout, &answer)?;
        writeln!(stdout)?;
        stdout.flush()?;
    }
    Ok(())
}

fn render(request: &Request) -> Result<Answer, Box<dyn Error>> {
    let mut specification = Specification::preset();
    specification.accuracy.relative = request.relative;
    specification.accuracy.absolute = request.absolute;
    let view = specification.views.get(request.view);
    let rotation_deg = view.ok_or("there is no such view")?.rotation_deg;
    let scene = Scene::new(&specification, request.view, BackendChoice::Native);
    let scene = scene.ok_or("there is no such view")??;
    let prepared =
        PreparedView::new(&scene, &specification).ok_or("the view is one for the path tracer")?;

    let mut answer = Answer {
        cpu_seconds: Vec::new(),
        stated_error: 0.0,
    };
    for repetition in 0..request.repetitions {
        let begin = cpu_seconds();
        let reflectance = Reflectance::new(&request.material, rotation_deg, specification.tint);
        let (film, ..) = prepared.render(&reflectance, None).expect("resolved");
        answer.cpu_seconds.push(cpu_seconds() - begin);
        if repetition == 0 {
            answer.stated_error = film.statistics(&specification.accuracy, 0, 0).mean;
            fs::write(&request.out, bytes(&film))?;
        }
    }
    Ok(answer)
}

fn bytes(film: &Film) -> Vec<u8> {
    let values = film.pixels.iter().flat_map(|pixel| pixel.value);
    values.flat_map(f64::to_le_bytes).collect()
}

/// User and system time of all threads of this process.
fn cpu_seconds() -> f64 {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    time.tv_sec as f64 + 1e-9 * time.tv_nsec as f64
}

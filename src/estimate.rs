//! `brdfarm estimate`.

use crate::evaluate::ReadingName;
use crate::failure::BadInput;
use crate::train::model_file;
use crate::{cores, output};
use clap::Args;
use dataset::Material;
use export::file::write_bytes;
use export::rectify;
use inverse::parameters::{ANGLE, Theta};
use inverse::{Nuisances, Stop};
use serde::Serialize;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::str::FromStr;
use training::device::Accelerator;
use training::estimation::corners::Corners;
use training::estimation::exposure::{GAIN_RANGE, Gain};
use training::estimation::fitting::{NUISANCES, Refinement};
use training::estimation::photograph::Photograph;
use training::estimation::sample::Shot;
use training::estimation::{Estimate, Exposure, Task, estimate};
use training::model::Model;

/// Estimate a material from two photographs
///
/// The photographs are OpenEXR with linear values, or PNG or JPEG, whose codes are taken as sRGB. Mark
/// the four corners of the sample in each, and those of the colour chart if it is in the scene, because
/// it shows the exposure. Writes material.json (for `brdfarm render --material-file`), posterior.json
/// and preview.png: each photograph, its sample, and next to it the rendered estimate.
///
/// Corners are eight numbers, x and y in pixels from the top left corner of the photograph: near left,
/// near right, far right, far left, as the camera sees them. Films that brdfarm rendered under the
/// model's specification need neither corners nor gain.
#[derive(Debug, Args)]
pub struct Options {
    /// A model that `brdfarm train` wrote, or its folder
    #[arg(value_name = "MODEL", value_parser = model_file())]
    model: PathBuf,
    /// The photograph from the side; in the preset 30 degrees above the horizon
    #[arg(value_name = "OBLIQUE")]
    oblique: PathBuf,
    /// The photograph from above
    #[arg(value_name = "ABOVE")]
    above: PathBuf,
    /// The folder to write to
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// The sample's corners in the oblique photograph
    #[arg(long, value_name = "CORNERS")]
    oblique_corners: Option<Corners>,
    /// The sample's corners in the photograph from above
    #[arg(long, value_name = "CORNERS")]
    above_corners: Option<Corners>,
    /// The chart's corners in the oblique photograph; they may lie beside it
    #[arg(long, value_name = "CORNERS", conflicts_with = "gain")]
    oblique_chart: Option<Corners>,
    /// The chart's corners in the photograph from above. A photograph without a chart is assumed to
    /// have the exposure of the other
    #[arg(long, value_name = "CORNERS", conflicts_with = "gain")]
    above_chart: Option<Corners>,
    /// The linear value in both photographs of a perfect white diffuser that faces the bulb: one
    /// number, or three for red, green and blue
    #[arg(long, value_name = "GAIN")]
    gain: Option<GainArgument>,
    /// Refine the network's reading with the renderer: fit material, light, cameras and exposure to
    /// the pixels of both photographs. Takes up to a minute of a core
    #[arg(long)]
    refine: bool,
    /// With --refine: light and cameras are exactly at the positions of the specification
    #[arg(long, requires = "refine")]
    geometry_known: bool,
    /// How a distribution over bins becomes a value
    #[arg(long, value_enum, default_value = "unbiased")]
    reading: ReadingName,
    /// The device that computes: cpu, cuda, cuda:1, wgpu
    #[arg(long, default_value = "cpu", value_name = "DEVICE")]
    device: Accelerator,
    /// Threads; 0 takes one for each core
    #[arg(long, default_value_t = 0, value_name = "N",
          value_parser = clap::value_parser!(u64).range(..=cores::COUNT_MAX))]
    threads: u64,
}

/// One number for all channels, or three.
#[derive(Clone, Copy, Debug)]
struct GainArgument(Gain);

impl FromStr for GainArgument {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let numbers = text.split(',').map(|word| {
            let number = word.trim().parse::<f64>().ok();
            let sound = number.filter(|number| GAIN_RANGE.contains(number));
            let (least, most) = (GAIN_RANGE.start(), GAIN_RANGE.end());
            sound.ok_or_else(|| format!("{word:?} is no number from {least:e} to {most:e}"))
        });
        let numbers: Vec<f64> = numbers.collect::<Result<_, _>>()?;
        match numbers[..] {
            [one] => Ok(Self([one; 3])),
            [red, green, blue] => Ok(Self([red, green, blue])),
            _ => Err("a gain is one number, or three for red, green and blue".to_owned()),
        }
    }
}

/// Estimates.
pub fn execute(options: &Options) -> anyhow::Result<()> {
    rayon::ThreadPoolBuilder::new()
        .num_threads(cores::count(options.threads))
        .build_global()?;
    let device = options.device.open()?;
    let model = Model::read(&options.model, &device)?;
    let shots = shots(options, &model)?;
    output::make_folder(&options.out)?;
    let task = Task {
        exposure: exposure(options, &shots)?,
        model: &model,
        shots,
        reading: options.reading.reading(),
        refine: options.refine.then(|| match options.geometry_known {
            true => Nuisances {
                gain: NUISANCES.gain,
                ..Nuisances::default()
            },
            false => NUISANCES,
        }),
    };
    let found = estimate(&task, &device)?;
    let posterior = serde_json::to_vec_pretty(&posterior(&model, &found))?;
    let material = serde_json::to_vec_pretty(&found.material)?;
    write_bytes(&options.out.join("material.json"), &material)?;
    write_bytes(&options.out.join("posterior.json"), &posterior)?;
    write_bytes(&options.out.join("preview.png"), &found.preview)?;
    print(&model, &found)
}

fn shots(options: &Options, model: &Model) -> anyhow::Result<[Shot; 2]> {
    let [oblique_view, above_view] = model.options.identity.views;
    let shot = |path: &Path, option: &str, corners: Option<Corners>, chart, view| {
        let photograph = Photograph::read(path)?;
        let sample = match corners {
            Some(corners) => corners,
            None => film_corners(model, &photograph, view)?.ok_or_else(|| {
                BadInput(format!(
                    "{}: where is the sample? Give {option}: only in films that brdfarm rendered as \
                     view {view} of the model's specification is it known",
                    path.display()
                ))
            })?,
        };
        anyhow::Ok(Shot {
            photograph,
            sample,
            chart,
        })
    };
    Ok([
        shot(
            &options.oblique,
            "--oblique-corners",
            options.oblique_corners,
            options.oblique_chart,
            oblique_view,
        )?,
        shot(
            &options.above,
            "--above-corners",
            options.above_corners,
            options.above_chart,
            above_view,
        )?,
    ])
}

/// The sample's corners in a film of the model's own view.
fn film_corners(
    model: &Model,
    photograph: &Photograph,
    view: u32,
) -> anyhow::Result<Option<Corners>> {
    let identity = &model.options.identity;
    let same = photograph.header.as_ref().is_some_and(|header| {
        header.view == view && header.specification == identity.specification
    });
    if !same {
        return Ok(None);
    }
    let geometry = model.options.scene()?.view_geometry(view as usize);
    let outline = geometry.and_then(|geometry| rectify::outline(&geometry.sample_from_film));
    Ok(outline.map(Corners))
}

fn exposure(options: &Options, shots: &[Shot; 2]) -> Result<Exposure, BadInput> {
    if let Some(GainArgument(gain)) = options.gain {
        return Ok(Exposure::Known(gain));
    }
    if shots.iter().any(|shot| shot.chart.is_some()) {
        return Ok(Exposure::Chart);
    }
    // brdfarm's own images are in units of white.
    match shots.iter().all(|shot| shot.photograph.header.is_some()) {
        true => Ok(Exposure::Known([1.0; 3])),
        false => Err(BadInput(
            "nothing tells the exposure: give --oblique-chart, --above-chart or --gain".to_owned(),
        )),
    }
}

/// The content of posterior.json.
#[derive(Serialize)]
struct Posterior<'a> {
    /// The gains of red, green and blue in the oblique photograph and in the one from above.
    gain: [Gain; 2],
    /// The network's reading, a label each.
    reading: Vec<Label<'a>>,
    /// What the renderer found; null without --refine.
    refined: Option<Refined>,
}

/// A label as the network says it.
#[derive(Serialize)]
struct Label<'a> {
    name: &'a str,
    value: f64,
    /// 95 percent of the distribution. Of the angle it goes through 0 where its lower end is above its
    /// upper one.
    interval: [f64; 2],
    /// The ends of the range that 100 equal bins divide.
    range: [f64; 2],
    probabilities: &'a [f64],
}

/// The material as the renderer refined it, with intervals of 95 percent under the same names. That
/// of the angle may reach below 0 or beyond 180 degrees: it then goes on at the other end. Where only
/// the hue of the colours shows, up to R = 90, the largest of their channels is 1.
#[derive(Serialize)]
struct Refined {
    material: Material,
    low: Material,
    high: Material,
    /// Degrees added to the light's elevation.
    light_elevation_deg: f64,
    /// Factor of the light's distance.
    light_distance: f64,
    /// Degrees added to the cameras' elevations.
    camera_elevation_deg: Vec<f64>,
    /// Further factors of the gains.
    gain: Vec<Gain>,
    /// The standard deviation of what is left, in sRGB codes from 0 to 1.
    residual_sd: f64,
    renderings: u32,
    /// Whether the fit ended by itself: converged, stuck, or renderings_spent.
    stop: &'static str,
}

fn posterior<'a>(model: &Model, found: &'a Estimate) -> Posterior<'a> {
    let axes = model.options.training.colours.axes().into_iter();
    let labels = axes.enumerate().map(|(parameter, axis)| Label {
        name: axis.name,
        value: found.values[parameter],
        interval: found.intervals[parameter],
        range: axis.range,
        probabilities: &found.distributions[parameter],
    });
    Posterior {
        gain: found.gains,
        reading: labels.collect(),
        refined: found.refinement.as_ref().map(refined),
    }
}

fn refined(found: &Refinement) -> Refined {
    let end = |which: usize| {
        let ends = found.intervals.map(|interval| interval[which]);
        Material {
            angle_deg: 180.0 * ends[ANGLE],
            ..Theta(ends).material()
        }
    };
    let fit = &found.fit;
    Refined {
        material: found.material,
        low: end(0),
        high: end(1),
        light_elevation_deg: fit.nuisances.light_elevation_deg,
        light_distance: fit.nuisances.light_distance,
        camera_elevation_deg: fit.nuisances.camera_elevation_deg.clone(),
        gain: fit.nuisances.gain.clone(),
        residual_sd: fit.residual_sd,
        renderings: fit.renderings,
        stop: match fit.stop {
            Stop::Converged => "converged",
            Stop::Stuck => "stuck",
            Stop::RenderingsSpent => "renderings_spent",
        },
    }
}

fn print(model: &Model, found: &Estimate) -> anyhow::Result<()> {
    let mut out = io::stdout();
    let [oblique, above] = found
        .gains
        .map(|[red, green, blue]| format!("{red:.4}, {green:.4}, {blue:.4}"));
    writeln!(out, "gain             {oblique}; from above {above}")?;
    for (parameter, axis) in model.options.training.colours.axes().iter().enumerate() {
        let [low, high] = found.intervals[parameter];
        let value = found.values[parameter];
        writeln!(
            out,
            "{:<16} {value:>8.3}   95%: {low:.3} to {high:.3}",
            axis.name
        )?;
    }
    if let Some(found) = &found.refinement {
        let Refined {
            material,
            low,
            high,
            ..
        } = refined(found);
        writeln!(out, "refined")?;
        let rows = [
            (
                "roughness",
                material.roughness,
                low.roughness,
                high.roughness,
            ),
            (
                "anisotropy",
                material.anisotropy,
                low.anisotropy,
                high.anisotropy,
            ),
            (
                "angle_deg",
                material.angle_deg,
                low.angle_deg,
                high.angle_deg,
            ),
            ("ior", material.ior, low.ior, high.ior),
        ];
        for (name, value, low, high) in rows {
            writeln!(out, "{name:<16} {value:>8.3}   95%: {low:.3} to {high:.3}")?;
        }
    }
    Ok(())
}

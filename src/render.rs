//! `brdfarm render`: one view of one material.

use crate::failure::BadInput;
use crate::plural::count;
use crate::{cores, output, picture, specification, store_name};
use clap::Args;
use dataset::{
    Digest, Material,
    specification::{Accuracy, IntegratorKind, limits},
};
use datastore::StoreName;
use export::file::write_bytes;
use renderer::{Renderer, Rendering, geometry::BackendChoice};
use serde::Serialize;
use serde_json::{Map, Value};
use std::fs::File;
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};

/// The largest material file read.
const MATERIAL_FILE_BYTES_MAX: u64 = 1 << 16;

/// Render one view of a material, and write it or check its digest
///
/// The material is one of the set, given by seed and index, or is in a file. The same specification,
/// seed, material and view give the same bytes on any machine. --expect checks the digest, and nothing
/// is written if it differs. Prints the EXR file's digest and the measured error.
#[derive(Debug, Args)]
pub struct Options {
    #[command(flatten)]
    specification: specification::SpecificationOptions,
    /// Use the specification of this store
    #[arg(long, value_name = store_name::VALUE, value_parser = store_name::parser(),
          conflicts_with = "spec")]
    store: Option<StoreName>,
    /// The set's seed [default: the specification's]
    #[arg(long, conflicts_with = "material_file",
          value_parser = clap::value_parser!(u64).range(limits::SEED))]
    seed: Option<u64>,
    /// The material's index in the set, counted from 0
    #[arg(long, value_name = "INDEX", required_unless_present = "material_file")]
    material: Option<u32>,
    /// A material as JSON: roughness, anisotropy, angle_deg, ior, rgb0, rgb90 (linear); or a row of a
    /// manifest
    #[arg(long, value_name = "FILE", conflicts_with = "material")]
    material_file: Option<PathBuf>,
    /// The view's index in the specification, counted from 0
    #[arg(long, value_name = "NUMBER")]
    view: u32,
    /// The file to write: an .exr file, or a .png file to look at
    #[arg(long, value_name = "FILE", required_unless_present_any = ["expect", "error_out", "aov"])]
    out: Option<PathBuf>,
    /// The file for the stated error of each pixel: an .exr file with one channel, error, of
    /// 32-bit floats in units of white. The rounding of the image to 16 bits is not included
    #[arg(long, value_name = "FILE")]
    error_out: Option<PathBuf>,
    /// The file for what the middle of each pixel sees: an .exr file with the layers depth, normal,
    /// tangent, uv and mask, of 32-bit floats. Its comment has the units
    #[arg(long, value_name = "FILE")]
    aov: Option<PathBuf>,
    /// The BLAKE3 digest that the EXR file must have
    #[arg(long, value_name = "DIGEST")]
    expect: Option<Digest>,
    /// Print one JSON object: the identity of the image, the digest of its EXR file, and its error
    /// statistics, named as the columns of the manifest
    #[arg(long)]
    json: bool,
    /// What intersects rays with the scene: auto, native, embree, or embree with an instruction set,
    /// as in embree:avx2. The image is the same
    #[arg(long, default_value = "auto")]
    backend: BackendChoice,
    /// Threads to render with; 0 takes one for each core
    #[arg(long, default_value_t = 0, value_name = "N",
          value_parser = clap::value_parser!(u64).range(..=cores::COUNT_MAX))]
    threads: u64,
    /// Brightness of a .png, in stops: each doubles it
    #[arg(long, default_value_t = 0.0, value_name = "STOPS", allow_negative_numbers = true,
          value_parser = picture::parse_exposure)]
    exposure: f64,
}

/// Renders, checks and writes.
pub fn execute(options: &Options) -> anyhow::Result<()> {
    let mut specification = match &options.store {
        Some(store) => store_name::specification_of(store)?,
        None => options.specification.load()?,
    };
    if let Some(seed) = options.seed {
        specification.seed = seed;
    }
    let material = match (&options.material_file, options.material) {
        (Some(path), _) => read_material(path)?,
        (None, Some(index)) => specification.material(index).material,
        (None, None) => unreachable!("the command line requires one of both"),
    };
    if let Some(index) = options
        .material
        .filter(|index| *index >= specification.materials)
    {
        writeln!(
            io::stderr(),
            "note: material {index} is beyond the {} of this set",
            count(specification.materials, "material")
        )?;
    }
    let kind = options.out.as_deref().map(output_kind).transpose()?;
    check_others(options)?;
    if options.view as usize >= specification.views.len() {
        return Err(BadInput(format!(
            "--view {}: the specification has {} views, counted from 0",
            options.view,
            specification.views.len()
        ))
        .into());
    }
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(cores::count(options.threads))
        .build()?;
    let renderer = Renderer::new(&specification, options.backend)?;
    let rendering = pool.install(|| renderer.render(&material, options.material, options.view))?;
    let digest = Digest::of(&rendering.exr);
    if let Some(expected) = options.expect
        && expected != digest
    {
        anyhow::bail!("the image's digest is {digest}, not {expected} as expected");
    }
    if let (Some(path), Some(kind)) = (&options.out, kind) {
        match kind {
            OutputKind::Exr => write_bytes(path, &rendering.exr)?,
            OutputKind::Png => write_bytes(path, &developed(&rendering, options.exposure)?)?,
        }
    }
    if let Some(path) = &options.error_out {
        write_bytes(path, &renderer.encode_error(&rendering)?)?;
    }
    if let Some(path) = &options.aov {
        write_bytes(path, &renderer.encode_aov(&rendering)?)?;
    }
    if options.json {
        print_json(digest, &rendering, &specification.accuracy)
    } else {
        print_line(digest, &rendering)
    }
}

fn print_line(digest: Digest, rendering: &Rendering) -> anyhow::Result<()> {
    let statistics = rendering.statistics;
    writeln!(
        io::stdout(),
        "{digest}  error mean {:.2e}, 95th percentile {:.2e}, largest {:.2e}; {:.1}% of pixels \
         within target",
        statistics.mean,
        statistics.p95,
        statistics.max,
        100.0 * statistics.within_target
    )?;
    Ok(())
}

/// What `--json` prints. A field that is also a column of the manifest has the column's name.
#[derive(Serialize)]
struct Answer<'a> {
    digest: Digest,
    specification: &'a str,
    renderer_version: &'a str,
    seed: u64,
    /// Null for a material from a file.
    material: Option<u32>,
    view: u32,
    width: u32,
    height: u32,
    /// The integrator that rendered the view, which need not be the specification's.
    integrator: IntegratorKind,
    /// The error that the specification allows a pixel.
    accuracy: &'a Accuracy,
    error_mean: f64,
    error_p95: f64,
    error_max: f64,
    within_target: f64,
    samples: u64,
    evaluations: u64,
}

fn print_json(digest: Digest, rendering: &Rendering, accuracy: &Accuracy) -> anyhow::Result<()> {
    let Rendering {
        header,
        integrator,
        film,
        statistics,
        ..
    } = rendering;
    let answer = Answer {
        digest,
        specification: &header.specification,
        renderer_version: &header.renderer_version,
        seed: header.seed,
        material: header.material,
        view: header.view,
        width: film.width,
        height: film.height,
        integrator: *integrator,
        accuracy,
        error_mean: statistics.mean,
        error_p95: statistics.p95,
        error_max: statistics.max,
        within_target: statistics.within_target,
        samples: statistics.samples,
        evaluations: statistics.evaluations,
    };
    writeln!(io::stdout(), "{}", serde_json::to_string(&answer)?)?;
    Ok(())
}

fn developed(rendering: &Rendering, exposure: f64) -> anyhow::Result<Vec<u8>> {
    let film = &rendering.film;
    let values: Vec<_> = film.pixels.iter().map(|pixel| pixel.value).collect();
    picture::develop(&values, film.width, film.height, exposure)
}

#[derive(Clone, Copy)]
enum OutputKind {
    Exr,
    Png,
}

fn output_kind(path: &Path) -> Result<OutputKind, BadInput> {
    Ok(match output::ending("--out", path, &["exr", "png"])? {
        "png" => OutputKind::Png,
        _ => OutputKind::Exr,
    })
}

/// Refuses a name that is no .exr file's, or that another file of the command has as well.
fn check_others(options: &Options) -> anyhow::Result<()> {
    let mut taken: Vec<(&str, PathBuf)> = Vec::new();
    let files = [
        ("--out", &options.out),
        ("--error-out", &options.error_out),
        ("--aov", &options.aov),
    ];
    for (name, path) in files {
        let Some(path) = path else {
            continue;
        };
        if name != "--out" {
            output::ending(name, path, &["exr"])?;
        }
        let whole = std::path::absolute(path)?;
        if let Some((other, _)) = taken.iter().find(|(_, taken)| *taken == whole) {
            return Err(BadInput(format!(
                "{name} {}: {other} names the same file, give it another name",
                path.display()
            ))
            .into());
        }
        taken.push((name, whole));
    }
    Ok(())
}

fn read_material(path: &Path) -> Result<Material, BadInput> {
    let wrong = |what: &dyn std::fmt::Display| BadInput(format!("{}: {what}", path.display()));
    let mut text = Vec::new();
    // Bounded while reading: a device has no size to ask for.
    File::open(path)
        .and_then(|file| {
            file.take(MATERIAL_FILE_BYTES_MAX + 1)
                .read_to_end(&mut text)
        })
        .map_err(|error| wrong(&error))?;
    if text.len() as u64 > MATERIAL_FILE_BYTES_MAX {
        return Err(wrong(&format!(
            "a material has at most {MATERIAL_FILE_BYTES_MAX} bytes, but this is larger"
        )));
    }
    let material = from_row(&text).unwrap_or(text);
    Material::from_json(&material).map_err(|error| wrong(&error))
}

/// The material of a manifest's row, which has its colours under other names, and more; `None` where
/// it is no row.
fn from_row(text: &[u8]) -> Option<Vec<u8>> {
    let row: Map<String, Value> = serde_json::from_slice(text).ok()?;
    let mut material = Map::new();
    for (key, column) in [
        ("roughness", "roughness"),
        ("anisotropy", "anisotropy"),
        ("angle_deg", "angle_deg"),
        ("ior", "ior"),
        ("rgb0", "rgb0_linear"),
        ("rgb90", "rgb90_linear"),
    ] {
        material.insert(key.to_owned(), row.get(column)?.clone());
    }
    serde_json::to_vec(&material).ok()
}

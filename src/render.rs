//! `brdfarm render`: one view of one material.

use crate::failure::BadInput;
use crate::{cores, output, picture, specification};
use clap::Args;
use dataset::{Digest, Material, specification::limits};
use renderer::{Renderer, geometry::BackendChoice};
use std::fs::File;
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};

/// The largest material file read.
const MATERIAL_FILE_BYTES_MAX: u64 = 1 << 16;

/// Render one view of a material, and write it or check its digest
///
/// The material is one of the set, by seed and index, or stands in a file. The same specification,
/// seed, material and view give the same bytes on any machine; with --expect the digest is checked,
/// and nothing is written where it differs. Prints the digest and the measured error.
#[derive(Debug, Args)]
pub struct Options {
    #[command(flatten)]
    specification: specification::SpecificationOptions,
    /// The set's seed [default: the specification's]
    #[arg(long, conflicts_with = "material_file",
          value_parser = clap::value_parser!(u64).range(limits::SEED))]
    seed: Option<u64>,
    /// The material's index in the set, counted from 0
    #[arg(long, value_name = "INDEX", required_unless_present = "material_file")]
    material: Option<u32>,
    /// A material as JSON: roughness, anisotropy, angle_deg, ior, rgb0, rgb90 (linear)
    #[arg(long, value_name = "FILE", conflicts_with = "material")]
    material_file: Option<PathBuf>,
    /// The view's number in the specification, counted from 0
    #[arg(long, value_name = "NUMBER")]
    view: u32,
    /// Where to write: an .exr file, or a .png to look at
    #[arg(long, value_name = "FILE", required_unless_present = "expect")]
    out: Option<PathBuf>,
    /// The BLAKE3 digest that the EXR file must have
    #[arg(long, value_name = "DIGEST")]
    expect: Option<Digest>,
    /// What traces the rays: auto, native, embree, or embree with an instruction set, as in
    /// embree:avx2; the image is the same
    #[arg(long, default_value = "auto")]
    backend: BackendChoice,
    /// Threads to render with; 0 takes one a core
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
    let mut specification = options.specification.load()?;
    if let Some(seed) = options.seed {
        specification.seed = seed;
    }
    let material = match (&options.material_file, options.material) {
        (Some(path), _) => read_material(path)?,
        (None, Some(index)) => specification.material(index).material,
        (None, None) => unreachable!("the command line requires one of both"),
    };
    let kind = options.out.as_deref().map(output_kind).transpose()?;
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
        let bytes = match kind {
            OutputKind::Exr => rendering.exr,
            OutputKind::Png => {
                let film = &rendering.film;
                let values: Vec<_> = film.pixels.iter().map(|pixel| pixel.value).collect();
                picture::develop(&values, film.width, film.height, options.exposure)?
            }
        };
        output::write(path, &bytes)?;
    }
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

#[derive(Clone, Copy)]
enum OutputKind {
    Exr,
    Png,
}

fn output_kind(path: &Path) -> Result<OutputKind, BadInput> {
    Ok(match output::ending(path, &["exr", "png"])? {
        "png" => OutputKind::Png,
        _ => OutputKind::Exr,
    })
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
    Material::from_json(&text).map_err(|error| wrong(&error))
}

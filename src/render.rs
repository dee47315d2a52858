//! `brdfarm render`: one view of one material.

use crate::failure::BadInput;
use crate::{picture, specification};
use anyhow::Context;
use clap::Args;
use dataset::{Digest, Material};
use renderer::{Renderer, geometry::BackendChoice};
use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// The largest material file read.
const MATERIAL_FILE_BYTES_MAX: u64 = 1 << 16;

/// Renders one view of a material: of the set, by seed and index, or of a file.
///
/// The same specification, seed, material and view give the same bytes on any machine; with
/// --expect the digest is checked and nothing is written where it differs.
#[derive(Debug, Args)]
pub struct Options {
    #[command(flatten)]
    specification: specification::SpecificationOptions,
    /// The set's seed, where it is not the specification's
    #[arg(long, conflicts_with = "material_file")]
    seed: Option<u64>,
    /// The material's index in the set, counted from 0
    #[arg(long, value_name = "INDEX", required_unless_present = "material_file")]
    material: Option<u32>,
    /// A material as JSON: roughness, anisotropy, angle_deg, ior, rgb0, rgb90 (linear)
    #[arg(long, value_name = "FILE", conflicts_with = "material")]
    material_file: Option<PathBuf>,
    /// The view's number in the specification, counted from 0
    #[arg(long)]
    view: u32,
    /// Where to write: an .exr file, or a .png to look at
    #[arg(long, value_name = "FILE", required_unless_present = "expect")]
    out: Option<PathBuf>,
    /// The BLAKE3 digest that the EXR file must have
    #[arg(long, value_name = "DIGEST")]
    expect: Option<Digest>,
    /// How rays are traced, which changes no byte: auto, native, embree, or embree with an
    /// instruction set, as in embree:avx2
    #[arg(long, default_value = "auto")]
    backend: BackendChoice,
    /// Threads to render with; 0 takes every core
    #[arg(long, default_value_t = 0)]
    threads: usize,
    /// Brightness of a .png, in stops
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true)]
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
        .num_threads(options.threads)
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
        fs::write(path, bytes).with_context(|| format!("cannot write {}", path.display()))?;
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
    let extension = path
        .extension()
        .map(|extension| extension.to_ascii_lowercase());
    match extension.as_ref().and_then(|extension| extension.to_str()) {
        Some("exr") => Ok(OutputKind::Exr),
        Some("png") => Ok(OutputKind::Png),
        _ => Err(BadInput(format!(
            "--out {}: the name has to end in .exr or .png",
            path.display()
        ))),
    }
}

fn read_material(path: &Path) -> Result<Material, BadInput> {
    let place = path.display();
    let size = fs::metadata(path)
        .map_err(|error| BadInput(format!("{place}: {error}")))?
        .len();
    if size > MATERIAL_FILE_BYTES_MAX {
        return Err(BadInput(format!(
            "{place}: {size} bytes are too many for a material, at most {MATERIAL_FILE_BYTES_MAX} \
             are read"
        )));
    }
    let text = fs::read(path).map_err(|error| BadInput(format!("{place}: {error}")))?;
    let material: Material =
        serde_json::from_slice(&text).map_err(|error| BadInput(format!("{place}: {error}")))?;
    material
        .check()
        .map_err(|error| BadInput(format!("{place}: {error}")))?;
    Ok(material)
}

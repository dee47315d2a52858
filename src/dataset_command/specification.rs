//! `brdfarm dataset specification`.

use crate::failure::BadInput;
use crate::specification;
use clap::Args;
use export::manifest::read::read_specification;
use std::io::{self, Write};
use std::path::PathBuf;

/// Print a complete specification, and its hash as a comment
///
/// Prints every field, those too that the file leaves to the preset, and the hash that stands in
/// every image and manifest row. A Parquet manifest carries the specification of its images.
#[derive(Debug, Args)]
pub struct Options {
    #[command(flatten)]
    specification: specification::SetOptions,
    /// The specification inside a Parquet manifest instead
    #[arg(long, value_name = "FILE", conflicts_with_all = ["spec", "materials"])]
    manifest: Option<PathBuf>,
}

/// Prints it.
pub fn execute(options: &Options) -> anyhow::Result<()> {
    let specification = match &options.manifest {
        Some(path) => read_specification(path).map_err(|error| BadInput(error.to_string()))?,
        None => options.specification.load()?,
    };
    write!(
        io::stdout(),
        "# hash {}\n{}",
        specification.hash(),
        specification.to_toml()
    )?;
    Ok(())
}

//! `brdfarm dataset specification`.

use crate::specification;
use clap::Args;
use std::io::{self, Write};

/// Print a complete specification, and its hash as a comment
///
/// Prints every field, those too that the file leaves to the preset, and the hash that stands in
/// every image and manifest row.
#[derive(Debug, Args)]
pub struct Options {
    #[command(flatten)]
    specification: specification::SetOptions,
}

/// Prints it.
pub fn execute(options: &Options) -> anyhow::Result<()> {
    let specification = options.specification.load()?;
    write!(
        io::stdout(),
        "# hash {}\n{}",
        specification.hash(),
        specification.to_toml()
    )?;
    Ok(())
}

//! `brdfarm dataset specification`.

use crate::failure::BadInput;
use crate::{specification, store_name};
use clap::Args;
use datastore::StoreName;
use export::manifest::read::read_specification;
use std::io::{self, Write};
use std::path::PathBuf;

/// Print a complete specification, and its hash as a comment
///
/// Prints every field, including those that the file leaves to the preset, and the hash that is in
/// every image and manifest row. Can also print the specification of a store or of a Parquet manifest.
#[derive(Debug, Args)]
pub struct Options {
    #[command(flatten)]
    specification: specification::SetOptions,
    /// Print the specification of this store
    #[arg(long, value_name = store_name::VALUE, value_parser = store_name::parser(),
          conflicts_with = "spec")]
    store: Option<StoreName>,
    /// Print the specification inside this Parquet manifest
    #[arg(long, value_name = "FILE", conflicts_with_all = ["spec", "materials", "store"])]
    manifest: Option<PathBuf>,
}

/// Prints it.
pub fn execute(options: &Options) -> anyhow::Result<()> {
    let specification = match &options.manifest {
        Some(path) => read_specification(path).map_err(|error| BadInput(error.to_string()))?,
        None => options.specification.load(|| {
            let store = options.store.as_ref();
            store.map(store_name::specification_of).transpose()
        })?,
    };
    write!(
        io::stdout(),
        "# hash {}\n{}",
        specification.hash(),
        specification.to_toml()
    )?;
    Ok(())
}

//! `brdfarm reference`: the pages of the documentation that are written from the code.
//!
//! The pages are committed under `docs/reference/`. A test compares them with what this writes, so
//! they cannot become stale.

mod columns;
mod command;
mod markdown;
mod specification;

use crate::output::make_folder;
use anyhow::Context;
use clap::{Args, CommandFactory};
use std::fs;
use std::path::PathBuf;

/// Write the reference pages of the documentation
#[derive(Debug, Args)]
#[command(hide = true)]
pub struct Options {
    /// The folder to write them to
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

/// Writes them.
pub fn execute(options: &Options) -> anyhow::Result<()> {
    make_folder(&options.out)?;
    let pages = [
        ("command.md", command::page(crate::Cli::command())),
        ("specification.md", specification::page()),
        ("columns.md", columns::page()),
    ];
    for (name, text) in pages {
        let path = options.out.join(name);
        fs::write(&path, text).with_context(|| format!("cannot write {}", path.display()))?;
    }
    Ok(())
}

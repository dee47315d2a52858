//! `brdfarm dataset`: what is done with a store once it is there.

mod manifest;
pub mod show;
mod specification;
pub mod verify;

use clap::{Args, Subcommand};
use std::path::PathBuf;

/// What can be done with a dataset.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// The labels, a row an image
    #[command(subcommand)]
    Manifest(manifest::Command),
    /// Check every image: present, intact, finite, and what it says it is
    Verify(verify::Options),
    /// Make a contact sheet (PNG): a row a material, a column a view
    Show(show::Options),
    /// Print a complete specification, and its hash as a comment
    Specification(specification::Options),
}

/// The store that a command works on.
#[derive(Debug, Args)]
pub struct StoreOptions {
    /// The folder that images, labels and ledger live in
    #[arg(long, default_value = "store", value_name = "DIR")]
    store: PathBuf,
}

/// Does it.
pub fn execute(command: &Command) -> anyhow::Result<()> {
    match command {
        Command::Manifest(command) => manifest::execute(command),
        Command::Verify(options) => verify::execute(options),
        Command::Show(options) => show::execute(options),
        Command::Specification(options) => specification::execute(options),
    }
}
